"""Images of boxes in space: parallel rays, cast against every box."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.lever_scene import Size, corners

LIGHT = np.array([0.30, -0.46, 0.84])
AMBIENT, EDGE = 0.55, 0.55
"""Brightness of a face turned away from the light, and of an edge relative to its face."""
SAMPLES = 2
"""Rays along each side of a pixel."""
Colour = tuple[float, float, float]


class DrawnBox(NamedTuple):
    """A box to be drawn; alpha below 1: what is behind it shows through."""

    size: Size
    pose: Float[np.ndarray, "7"]
    colour: Colour
    alpha: float = 1.0


class View(NamedTuple):
    """Where rays come from: axes of the image in the world, its middle and its width (m), its pixels (across, down)."""

    right: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    middle: Float[np.ndarray, "3"]
    width: float
    pixels: tuple[int, int]

    @classmethod
    def from_direction(
        cls, azimuth: float, elevation: float, middle: Float[np.ndarray, "3"], width: float, pixels: tuple[int, int]
    ) -> "View":
        """The view from a direction (rad): azimuth about the vertical, elevation above the horizontal."""
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        up = np.array([-cosine * np.sin(elevation), -sine * np.sin(elevation), np.cos(elevation)])
        return cls(np.array([-sine, cosine, 0.0]), up, middle, width, pixels)


def image_of(boxes: Sequence[DrawnBox], view: View) -> Float[np.ndarray, "down across 3"]:
    """The image of boxes on white, seen from a view: rows from above, red, green and blue from 0 to 1."""
    across, down = (SAMPLES * count for count in view.pixels)
    step = view.width / across
    u = (np.arange(across) + 0.5 - across / 2) * step
    v = (down / 2 - np.arange(down) - 0.5) * step
    ahead = np.cross(view.up, view.right)
    image = np.ones((down, across, 3))
    nearest = np.full((down, across), np.inf)
    face = np.full((down, across), -1)
    for index, box in enumerate(sorted(boxes, key=lambda one: one.alpha < 1)):
        points = corners(box.size, box.pose) - view.middle
        rows, columns = _covered(-v, -(points @ view.up)), _covered(u, points @ view.right)
        origins, slope = _rays_in(box, view, u[columns], v[rows], ahead)
        half = np.sign(slope) * np.asarray(box.size) / 2
        enter = [(-half[k] - origins[k]) / slope[k] for k in range(3)]
        leave = [(half[k] - origins[k]) / slope[k] for k in range(3)]
        first = np.maximum(np.maximum(enter[0], enter[1]), enter[2])
        axis = np.where(first == enter[0], 0, np.where(first == enter[1], 1, 2))
        last = np.minimum(np.minimum(leave[0], leave[1]), leave[2])
        seen = (first <= last) & (first < nearest[rows, columns])
        normals = -np.sign(slope)[:, None] * pose_3d.rotation_matrix(box.pose[3:]).T
        shade = AMBIENT + (1 - AMBIENT) * np.maximum(normals @ LIGHT, 0.0)
        colours, there = shade[:, None] * np.asarray(box.colour), image[rows, columns]
        there[seen] = box.alpha * colours[axis[seen]] + (1 - box.alpha) * there[seen]
        if box.alpha == 1:
            nearest[rows, columns][seen] = first[seen]
        face[rows, columns][seen] = 3 * index + axis[seen]
    changes = np.zeros_like(nearest, dtype=bool)
    changes[:, 1:] |= face[:, 1:] != face[:, :-1]
    changes[1:] |= face[1:] != face[:-1]
    image[changes] *= EDGE
    return image.reshape(view.pixels[1], SAMPLES, view.pixels[0], SAMPLES, 3).mean((1, 3))


def _covered(rising: Float[np.ndarray, " rays"], values: Float[np.ndarray, " points"]) -> slice:
    """Those rays that lie between the least and the largest of the values."""
    return slice(int(np.searchsorted(rising, values.min())), int(np.searchsorted(rising, values.max())))


def _rays_in(
    box: DrawnBox, view: View, u: np.ndarray, v: np.ndarray, ahead: np.ndarray
) -> tuple[list[Float[np.ndarray, "down across"]], Float[np.ndarray, "3"]]:
    """Where rays start in the frame of a box, by axis, and their direction there, no component of it zero."""
    back = pose_3d.conjugate(box.pose[3:])
    right, up, slope, middle = pose_3d.rotate(
        np.stack((view.right, view.up, ahead, view.middle - box.pose[:3])), back[None]
    )
    slope = np.where(np.abs(slope) < 1e-9, 1e-9, slope)
    return [middle[k] + u[None, :] * right[k] + v[:, None] * up[k] for k in range(3)], slope
