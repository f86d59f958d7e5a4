"""Cutting an outline into rectangles and discs that touch as it touches.

Contact is computed between rectangles and discs (`pushgraph.contact`), so an outline of any form is covered with them:

1. Candidates. Every *facet*, an edge or a run of edges that is straight within `FLAT` and turns by at most 6 degrees,
   is the face of rectangles of several depths, each as long as it stays inside. At samples of the boundary stands the
   largest disc inside that touches there: along an arc of a circle it is the disc of that circle.
2. Goals. A sample of the boundary is covered by a face or a disc that runs along it, with a normal within 3 degrees,
   and that is 5 mm deep there, or half as deep as any candidate. Samples a little inside only have to be covered.
3. Choice. First the largest rectangles and discs, while each adds much of the area. Then greedily what covers most of
   the boundary, until all is covered; then what has become superfluous is dropped. In an acute corner this makes a
   staircase of rectangles along either edge, each half as deep as the one before.
4. Tips. What is too sharp or too thin for a rectangle of 1 mm is covered with parts of 1 mm that may stick out.
"""

import functools
from typing import NamedTuple

import numpy as np

from pushgraph.outline.covering import choose, covered_by_discs, covered_by_rectangles, fill
from pushgraph.outline.discs import discs_within
from pushgraph.outline.facets import facets_of, rectangles_along
from pushgraph.outline.parts import join
from pushgraph.outline.ring import grid, inner_points, ring_of, samples_of
from pushgraph.outline.tips import tips
from pushgraph.outline.tolerances import DEPTH

ROUND_SHARE = 0.03
"""Where a disc serves this share of the outline, no facet is tried."""


class Cut(NamedTuple):
    """A rectangle (its full lengths; radius zero), or a disc (lengths zero), in the frame of the outline (m, rad)."""

    lengths: tuple[float, float]
    radius: float
    pose_outline_from_cut: tuple[float, float, float]


@functools.lru_cache(maxsize=1024)
def cut(points: tuple[tuple[float, float], ...]) -> tuple[Cut, ...]:
    """Cut a simple polygon (m; either winding) into parts that overlap: see the module."""
    ring = ring_of(np.array(points, dtype=float))
    samples = samples_of(ring)
    discs = discs_within(ring, samples)
    along_disc = covered_by_discs(discs, samples)[0]
    along_disc = along_disc[along_disc @ samples.weight > ROUND_SHARE * samples.weight.sum()].any(0)
    rectangles = rectangles_along(ring, facets_of(ring, samples.edge[~along_disc]))
    covers, depth = (
        np.concatenate(both)
        for both in zip(covered_by_rectangles(rectangles, samples), covered_by_discs(discs, samples), strict=True)
    )
    parts = join(rectangles, discs)
    deepest = np.where(covers, depth, 0).max(0, initial=0)
    covers &= depth >= np.minimum(DEPTH, deepest / 2) - 1e-9
    near, inside = parts.contain(inner_points(ring, samples)), parts.contain(grid(ring))
    boundary = np.concatenate((samples.weight, np.full(near.shape[1], 0.2 * samples.weight.mean())))
    filling = fill(inside)
    inside &= inside[filling].any(0)
    goals = np.concatenate((covers, near, inside), 1)
    weights = np.concatenate((boundary, np.full(inside.shape[1], 1e-9)))
    chosen = parts.take(choose(goals, weights, parts.area / ring.polygon.area, filling))
    chosen = join(chosen, tips(ring, samples, chosen))
    return tuple(
        Cut(
            tuple((2 * half).tolist()) if radius == 0 else (0.0, 0.0),
            float(radius),
            (float(centre[0]), float(centre[1]), float(yaw)),
        )
        for centre, yaw, half, radius in zip(*chosen, strict=True)
    )
