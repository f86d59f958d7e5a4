"""Triangles and edges of what is drawn."""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from pushgraph.shape import Cuboid, Cylinder, Polygon

SIDES = 40
"""Of a drawn circle."""


class Solid(NamedTuple):
    """A surface of triangles, and the lines that stand out on it (m)."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    edges: Float[np.ndarray, "edges 2 3"]


def circle(radius: float, sides: int = SIDES, turn: float = 0.0) -> Float[np.ndarray, "sides 2"]:
    """Corners of a regular polygon, counter-clockwise from the x axis, or from a share of a turn on."""
    angles = (np.arange(sides) / sides + turn) * 2 * np.pi
    return radius * np.stack((np.cos(angles), np.sin(angles)), -1)


def outline_of(shape: Cylinder | Cuboid | Polygon) -> Float[np.ndarray, "corners 2"]:
    """The shape from above, in its own frame, counter-clockwise."""
    if isinstance(shape, Polygon):
        points = np.array(shape.points)
        return points if shapely.LinearRing(points).is_ccw else points[::-1]
    half_x, half_y, radius = shape.core
    if radius:
        return circle(radius)
    return np.array([[half_x, half_y], [-half_x, half_y], [-half_x, -half_y], [half_x, -half_y]])


def prism(outline: Float[np.ndarray, "corners 2"], low: float, high: float) -> Solid:
    """An upright prism over a simple outline, convex or not, from one height to another (m)."""
    count = len(outline)
    lower, upper = (np.column_stack((outline, np.full(count, z))) for z in (low, high))
    here, following = np.arange(count), np.roll(np.arange(count), -1)
    sides = np.concatenate(
        (np.stack((here, following, following + count), 1), np.stack((here, following + count, here + count), 1))
    )
    # Walls and lids have vertices of their own, so that light breaks at the rim.
    lid, triangles = _triangles(outline)
    lids = [np.column_stack((lid, np.full(len(lid), z))) for z in (low, high)]
    faces = np.concatenate((sides, triangles[:, ::-1] + 2 * count, triangles + 2 * count + len(lid)))
    rims = [np.stack((ring, ring[following]), 1) for ring in (lower, upper)]
    turned = _corners(outline)
    uprights = np.stack((lower, upper), 1)[turned]
    return Solid(np.concatenate((lower, upper, *lids)), faces, np.concatenate((*rims, uprights)))


def box(size: tuple[float, float, float]) -> Solid:
    """A box around its centre; full lengths (m)."""
    x, y, z = (length / 2 for length in size)
    return prism(np.array([[x, y], [-x, y], [-x, -y], [x, -y]]), -z, z)


def disc(sides: int = SIDES) -> Solid:
    """A flat disc of radius 1 that faces up, and its rim."""
    rim = np.column_stack((circle(1.0, sides), np.zeros(sides)))
    here, following = np.arange(sides), np.roll(np.arange(sides), -1)
    faces = np.stack((here, following, np.full(sides, sides)), 1)
    return Solid(np.vstack((rim, np.zeros(3))), faces, np.stack((rim, rim[following]), 1))


def _triangles(outline: Float[np.ndarray, "corners 2"]) -> tuple[np.ndarray, np.ndarray]:
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline)))
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    faces = np.arange(len(corners)).reshape(-1, 3)
    first, second, third = corners.reshape(-1, 3, 2).swapaxes(0, 1)
    (ax, ay), (bx, by) = (second - first).T, (third - first).T
    faces[ax * by - ay * bx < 0] = faces[ax * by - ay * bx < 0][:, ::-1]
    return corners, faces


def _corners(outline: Float[np.ndarray, "corners 2"]) -> np.ndarray:
    """Which vertices are corners rather than points of a curve: they turn by more than 25 degrees."""
    before, after = outline - np.roll(outline, 1, 0), np.roll(outline, -1, 0) - outline
    cosine = (before * after).sum(-1) / np.maximum(np.hypot(*before.T) * np.hypot(*after.T), 1e-12)
    return cosine < np.cos(np.radians(25))
