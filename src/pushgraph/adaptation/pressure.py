"""Where an object presses on the table, from two unknowns: how far out its weight stands, and about which centre."""

import functools

import numpy as np
from jaxtyping import Float

from pushgraph.outline import centroid
from pushgraph.real_pushes import outline_of
from pushgraph.shape import BodyShape, Point

RINGS, AROUND = 2, 9
"""Feet stand on so many rings, copies of the outline, and at so many points of each."""
SUPPORT_RINGS, SUPPORT_AROUND = 4, 16
"""And those that stand for the same pressure in a scene."""


def feet(
    shape: BodyShape, concentration: float, centre: Point, rings: int = RINGS, around: int = AROUND
) -> tuple[Float[np.ndarray, "feet 2"], Float[np.ndarray, " feet"]]:
    """Points in the body's frame (m), and the share of the weight on each.

    A uniform pressure has as much weight in equal areas: each of the points around stands for an equal triangle from
    the centroid, each ring for its share of s^2, s being the way from the centroid to the outline, by Gauss's rule.
    """
    middle, boundary = _boundary(shape, around)
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    ways = np.sqrt((1 + nodes) / 2) ** concentration
    shares = np.repeat(weights / 2, around) / around
    points = (ways[:, None, None] * boundary).reshape(-1, 2)
    return points - shares @ points + middle + np.array(centre), shares


def support(shape: BodyShape, concentration: float, centre: Point) -> tuple[Point, ...]:
    """Points on which a body of a scene presses nearly so: they bear equal loads, and so stand where these are."""
    middle, boundary = _boundary(shape, SUPPORT_AROUND)
    ways = np.sqrt((np.arange(SUPPORT_RINGS) + 0.5) / SUPPORT_RINGS) ** concentration
    points = (ways[:, None, None] * boundary).reshape(-1, 2)
    return tuple((x, y) for x, y in (points - points.mean(0) + middle + np.array(centre)).tolist())


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
