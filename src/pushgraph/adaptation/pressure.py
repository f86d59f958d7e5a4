"""Where an object presses on the table: on its corners, if it has any, and on the rest of its outline, about a centre.

Plates stand on what sticks out: burrs of their corners, and wherever they bulge. How much so differs from object to
object; the unknowns say it in two numbers.
"""

import functools

import numpy as np
from jaxtyping import Float

from pushgraph.outline import CORNER, centroid
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import outline_of
from pushgraph.shape import BodyShape, Point

RINGS, AROUND = 2, 9
"""Feet stand on so many rings, copies of the outline, and at so many points of each; and on its corners."""
SUPPORT_RINGS, SUPPORT_POINTS = 4, 64
"""Rings, and points at most, corners among them, that stand for the same pressure in a scene."""


def feet(
    shape: BodyShape,
    concentration: float,
    corner_share: float,
    centre: Point,
    rings: int = RINGS,
    around: int = AROUND,
) -> tuple[Float[np.ndarray, "feet 2"], Float[np.ndarray, " feet"]]:
    """Points in the body's frame (m), and the share of the weight on each; corners last.

    A uniform pressure has as much weight in equal areas: each of the points around stands for an equal triangle from
    the centroid, each ring for its share of s^2, s being the way from the centroid to the outline, by Gauss's rule.
    """
    middle, boundary = _boundary(shape, around)
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    ways = np.sqrt((1 + nodes) / 2) ** concentration
    corners = corners_of(shape) - middle
    on_corners = corner_share if len(corners) else 0.0
    shares = np.repeat(weights / 2, around) / around * (1 - on_corners)
    shares = np.concatenate((shares, np.full(len(corners), on_corners / max(len(corners), 1))))
    points = np.concatenate(((ways[:, None, None] * boundary).reshape(-1, 2), corners))
    return points - shares @ points + middle + np.array(centre), shares


def support(shape: BodyShape, concentration: float, corner_share: float, centre: Point) -> tuple[Point, ...]:
    """Points on which a body of a scene presses nearly so: they bear equal loads, so as many stand on each corner, and
    so many elsewhere, as there is weight."""
    corners = corners_of(shape)
    copies = round(corner_share * SUPPORT_POINTS / max(len(corners), 1))
    around = (SUPPORT_POINTS - copies * len(corners)) // SUPPORT_RINGS
    middle, boundary = _boundary(shape, max(around, 3))
    ways = np.sqrt((np.arange(SUPPORT_RINGS) + 0.5) / SUPPORT_RINGS) ** concentration
    points = (ways[:, None, None] * boundary).reshape(-1, 2)
    points = np.concatenate((points, np.repeat(corners - middle, copies, 0)))
    return tuple((x, y) for x, y in (points - points.mean(0) + middle + np.array(centre)).tolist())


def corners_of(shape: BodyShape) -> Float[np.ndarray, "corners 2"]:
    """Vertices of the outline that are no points of a curve (m)."""
    outline = outline_of(shape)
    edges = np.roll(outline, -1, 0) - outline
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    return outline[np.abs(wrap_angle(heading - np.roll(heading, 1))) > CORNER]


@functools.lru_cache(maxsize=256)
def _boundary(shape: BodyShape, around: int) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "around 2"]]:
    """The centroid, and points of the outline as seen from there, in steps of equal area."""
    corners = outline_of(shape)
    middle = centroid(corners)
    first = corners - middle
    second = np.roll(first, -1, 0)
    areas = np.cross(np.pad(first, ((0, 0), (0, 1))), np.pad(second, ((0, 0), (0, 1))))[:, 2].clip(min=0) / 2
    upto = np.concatenate(([0.0], np.cumsum(areas)))
    wanted = (np.arange(around) + 0.5) / around * upto[-1]
    edge = np.searchsorted(upto, wanted, side="right") - 1
    share = ((wanted - upto[edge]) / areas[edge])[:, None]
    return middle, first[edge] + share * (second[edge] - first[edge])
