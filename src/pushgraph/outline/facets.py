"""Straight runs of an outline, and the rectangles inside that have their faces there."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from pushgraph.outline.parts import Parts
from pushgraph.outline.ring import Ring, heading, left_of
from pushgraph.outline.tolerances import CORNER, DEPTH, FLAT, PROTRUSION, THINNEST, TURN


class Facet(NamedTuple):
    """A line along the outline from `start`; the outline lies within `off` of it."""

    start: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    length: float
    off: float


def facets_of(ring: Ring, edges: Int[np.ndarray, " edges"]) -> list[Facet]:
    """These edges, and every longest run of edges through one of them that is nearly straight."""
    n = len(ring.length)
    wanted = np.zeros(n, bool)
    wanted[edges] = True
    starts = np.concatenate(([0], np.cumsum(ring.length)))[:-1]
    headings = heading(ring, starts + ring.length / 2)
    facets, within = [], np.zeros(n, bool)
    last_end = -1
    for k in range(n):
        run, longest = None, 1
        for count in range(2, n):
            index = np.arange(k, k + count + 1) % n
            if abs(ring.turn[index[-2]]) > CORNER:
                break
            longer = _fit(ring.vertex[index], headings[index[:-1]])
            if longer is None:
                break
            run, longest = longer, count
        if run is not None and k + longest > last_end and wanted[np.arange(k, k + longest) % n].any():
            facets.append(run)
            within[np.arange(k, k + longest) % n] = True
        last_end = max(last_end, k + longest)
    # A short edge within a run needs no face of its own.
    single = np.flatnonzero(wanted & ~(within & (ring.length < DEPTH)))
    return facets + [Facet(ring.vertex[k], ring.along[k], ring.length[k], 0.0) for k in single]


def _fit(points: Float[np.ndarray, "n 2"], headings: Float[np.ndarray, "m 2"]) -> Facet | None:
    """The line along a run of points, if it is straight enough."""
    chord = points[-1] - points[0]
    length = np.hypot(*chord)
    if length < 1e-6:
        return None
    along = chord / length
    if length > THINNEST and (headings @ along).min() < math.cos(TURN):
        return None
    height = (points - points[0]) @ left_of(along)
    position = (points - points[0]) @ along
    low, high = height.min(), height.max()
    if high - low > 2 * FLAT or position.min() < -1e-9 or position.max() > length + 1e-9:
        return None
    return Facet(points[0] + left_of(along) * (low + high) / 2, along, length, (high - low) / 2)


def rectangles_along(ring: Ring, facets: list[Facet]) -> Parts:
    """Rectangles of several depths along each facet, each as long as it stays inside."""
    rows = []
    corners = np.abs(ring.turn) > CORNER
    for facet in facets:
        normal = left_of(facet.along)
        relative = ring.vertex - facet.start
        u, v = relative @ facet.along, relative @ normal
        for depth in _depths(facet, u, v, corners):
            for low, high in _free(facet, u, v, depth):
                if high - low >= THINNEST and depth >= THINNEST - 1e-9:
                    middle = facet.start + facet.along * (low + high) / 2 + normal * depth / 2
                    yaw = math.atan2(facet.along[1], facet.along[0])
                    rows.append((*middle, yaw, (high - low) / 2, max(depth, THINNEST) / 2))
    table = np.array(rows).reshape(-1, 5)
    parts = Parts(table[:, :2], table[:, 2], table[:, 3:], np.zeros(len(table)))
    inside = shapely.contains_xy(ring.polygon, *parts.centre.T)
    return parts.take(inside)


def _depths(facet: Facet, u: np.ndarray, v: np.ndarray, corners: np.ndarray) -> list[float]:
    """Depths worth a rectangle: doubled from the least, to what is opposite, and to corners in front."""
    following = np.roll(u, -1), np.roll(v, -1)
    front = math.inf
    for fraction in (0.02, 0.25, 0.5, 0.75, 0.98):
        front = min(front, _ray(fraction * facet.length, facet.off + 1e-6, u, v, *following))
    middle = _ray(0.5 * facet.length, facet.off + 1e-6, u, v, *following)
    most = v.max()
    doubled = [THINNEST * 2.0**k for k in range(14) if THINNEST * 2.0**k < most]
    at_corners = np.unique(np.round(v[corners & (v > THINNEST)], 6))
    if len(at_corners) > 12:
        at_corners = at_corners[np.linspace(0, len(at_corners) - 1, 12).astype(int)]
    depths = sorted({*doubled, *at_corners.tolist(), front, middle, most})
    return [depth for depth in depths if THINNEST - 1e-9 <= depth <= most]


def _ray(at: float, beyond: float, u: np.ndarray, v: np.ndarray, u_next: np.ndarray, v_next: np.ndarray) -> float:
    """Height of the first edge over a point of the facet."""
    crosses = (u <= at) != (u_next <= at)
    fraction = (at - u[crosses]) / (u_next[crosses] - u[crosses])
    heights = v[crosses] + fraction * (v_next[crosses] - v[crosses])
    return min(heights[heights > beyond], default=math.inf)


def _free(facet: Facet, u: np.ndarray, v: np.ndarray, depth: float) -> list[tuple[float, float]]:
    """Where along a facet no edge enters the strip between it and this depth."""
    low, high = facet.off + PROTRUSION, depth - PROTRUSION
    u_next, v_next = np.roll(u, -1), np.roll(v, -1)
    rise = v_next - v
    steep = np.abs(rise) > 1e-12
    slope = np.where(steep, rise, 1.0)
    enter, leave = (low - v) / slope, (high - v) / slope
    first = np.where(steep, np.minimum(enter, leave).clip(0, 1), 0.0)
    last = np.where(steep, np.maximum(enter, leave).clip(0, 1), 1.0)
    blocks = np.where(steep, last > first, (v > low) & (v < high))
    a, b = (u + f * (u_next - u) for f in (first, last))
    left, right = np.minimum(a, b)[blocks], np.maximum(a, b)[blocks]
    order = np.argsort(left)
    left, right = left[order], np.maximum.accumulate(right[order])
    starts = np.concatenate(([-np.inf], right))
    ends = np.concatenate((left, [np.inf]))
    keep = (ends - starts > 0) & (starts < facet.length - 1e-6) & (ends > 1e-6)
    keep &= np.isfinite(starts) & np.isfinite(ends)
    return list(zip(starts[keep].tolist(), ends[keep].tolist(), strict=True))
