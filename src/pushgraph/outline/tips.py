"""Parts for what is too sharp or too thin for a rectangle of 1 mm."""

import math

import numpy as np
import shapely
from jaxtyping import Float

from pushgraph.outline.covering import choose
from pushgraph.outline.parts import Parts, join
from pushgraph.outline.ring import Ring, Samples, left_of
from pushgraph.outline.tolerances import PROTRUSION, THINNEST

REACH = 3.5e-4
"""Tips are covered to within this (m)."""


def tips(ring: Ring, samples: Samples, chosen: Parts) -> Parts:
    """Parts of 1 mm that may stick out, for stretches of the outline that no part reaches to within `REACH`.

    They are centred in the middle of the body's width, so they stick out by half a millimetre at most.
    """
    gap = chosen.gap(samples.point).min(0) if len(chosen.yaw) else np.full(len(samples.point), np.inf)
    missing = gap > 2 * PROTRUSION
    stretch = np.cumsum(missing & ~np.roll(missing, 1))
    stretch[stretch == 0] = stretch[-1]  # around the start of the ring
    far = np.unique(stretch[missing & (gap > REACH)])
    missing &= np.isin(stretch, far)
    for steps in (1, 2, -1, -2):  # tips overlap what they join on to
        missing |= np.roll(missing, steps)
    if not missing.any():
        return chosen.take([])
    point, inwards = samples.point[missing], samples.normal[missing]
    half = THINNEST / 2
    middle = _middle(ring, samples, point, inwards)
    centre = point + inwards * np.minimum(middle, half)[:, None]
    candidates = join(
        Parts(centre, np.zeros(len(point)), np.zeros((len(point), 2)), np.full(len(point), half)),
        _thin_rectangles(ring, centre, -left_of(inwards)),
    )
    corner = _corners_of(candidates)
    out = shapely.distance(ring.polygon, shapely.points(corner.reshape(-1, 2))).reshape(corner.shape[:2]).max(1)
    out = np.where(
        candidates.radius > 0, half - shapely.distance(ring.polygon.exterior, shapely.points(candidates.centre)), out
    )
    candidates, out = candidates.take(out < 0.99 * half), out[out < 0.99 * half]
    goals = candidates.gap(point) <= np.where(middle < REACH / 2, REACH, 1e-6)
    return candidates.take(choose(goals, np.ones(len(point)), -4 * out / half, []))


def _middle(ring: Ring, samples: Samples, point: np.ndarray, inwards: np.ndarray) -> Float[np.ndarray, " points"]:
    """Radius of the largest disc inside that touches at each point."""
    boundary = np.concatenate((samples.point, ring.vertex))
    away = boundary - point[:, None]
    height = (away * inwards[:, None]).sum(-1)
    ahead = height > 1e-2 * np.hypot(*np.moveaxis(away, -1, 0)) + 1e-9
    return np.where(ahead, (away**2).sum(-1) / np.where(ahead, 2 * height, 1), np.inf).min(1, initial=1.0)


def _thin_rectangles(ring: Ring, centre: np.ndarray, along: np.ndarray) -> Parts:
    """Rectangles of the least width through some of the centres, along either edge or between them, of many lengths."""
    pick = np.arange(0, len(centre), max(1, len(centre) // 40))
    reaches = [THINNEST / 2 * 2.0**k for k in range(9)]
    rows = []
    for k in pick:
        heading = math.atan2(along[k, 1], along[k, 0])
        near = np.argsort(np.hypot(*(centre - centre[k]).T))[:12]
        other = max(near, key=lambda j: -along[j] @ along[k])
        opposite = -along[other]
        between = along[k] + opposite if along[k] @ opposite > 0.5 else along[k]
        for yaw in {heading, math.atan2(between[1], between[0])}:
            direction = np.array((math.cos(yaw), math.sin(yaw)))
            for back in reaches:
                for ahead in reaches:
                    middle = centre[k] + direction * (ahead - back) / 2
                    rows.append((*middle, yaw, (ahead + back) / 2, THINNEST / 2))
    table = np.array(rows)
    return Parts(table[:, :2], table[:, 2], table[:, 3:], np.zeros(len(table)))


def _corners_of(parts: Parts, count: int = 9) -> Float[np.ndarray, "parts points 2"]:
    """Points along both long sides of rectangles."""
    u = np.tile(np.linspace(-1, 1, count), 2)
    v = np.repeat([-1.0, 1.0], count)
    x, y = parts.half[:, :1] * u, parts.half[:, 1:] * v
    cos, sin = np.cos(parts.yaw)[:, None], np.sin(parts.yaw)[:, None]
    return parts.centre[:, None] + np.stack((cos * x - sin * y, sin * x + cos * y), -1)
