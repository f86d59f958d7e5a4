"""An outline as a closed ring of edges, and samples of it."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pushgraph.outline.tolerances import CORNER, ROUND

WINDOW = 1.5e-3
"""The heading at a point is that of the chord between the points so far (m) before and after it."""


class Ring(NamedTuple):
    """The outline counter-clockwise, straight runs of points merged; edge k leads from vertex k to the next."""

    vertex: Float[np.ndarray, "n 2"]
    along: Float[np.ndarray, "n 2"]  # unit vector of each edge
    length: Float[np.ndarray, " n"]
    turn: Float[np.ndarray, " n"]  # at each vertex, from the edge before to its edge (rad)
    polygon: shapely.Polygon


class Samples(NamedTuple):
    """Points on the outline; normals point inwards."""

    point: Float[np.ndarray, "samples 2"]
    edge_normal: Float[np.ndarray, "samples 2"]
    normal: Float[np.ndarray, "samples 2"]  # of the chord of `WINDOW`
    curved: Bool[np.ndarray, " samples"]  # on a curve, rather than on a straight edge
    weight: Float[np.ndarray, " samples"]  # length that it stands for (m)
    edge: Int[np.ndarray, " samples"]  # on which it lies


def ring_of(points: Float[np.ndarray, "n 2"]) -> Ring:
    """The ring of a simple polygon (m; either winding)."""
    polygon = shapely.Polygon(points)
    if not polygon.exterior.is_ccw:
        points = points[::-1]
    # Start at a vertex that stands out, so that no straight run hides it.
    first = int(np.argmax(np.hypot(*(points - points.mean(0)).T)))
    size = np.ptp(points, axis=0).max()
    simpler = shapely.Polygon(np.roll(points, -first, 0)).simplify(min(1e-5, 1e-4 * size))
    vertex = shapely.get_coordinates(simpler)[:-1]
    edge = np.roll(vertex, -1, 0) - vertex
    length = np.hypot(*edge.T)
    along = edge / length[:, None]
    before = np.roll(along, 1, 0)
    turn = np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], (before * along).sum(-1))
    return Ring(vertex, along, length, turn, polygon)


def left_of(vectors: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """The vectors, turned by 90 degrees counter-clockwise."""
    return np.stack((-vectors[..., 1], vectors[..., 0]), -1)


def heading(ring: Ring, at: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 2"]:
    """Unit vector along the outline at these arc lengths: of the chord that reaches `WINDOW` to either side, or as far
    as to the next corner."""
    ends = np.concatenate(([0], np.cumsum(ring.length)))
    total = ends[-1]
    corners = ends[:-1][np.abs(ring.turn) > CORNER]
    reach = np.full(len(at), min(WINDOW, total / 20))
    if len(corners):
        away = np.abs((at[:, None] - corners + total / 2) % total - total / 2).min(1)
        reach = np.clip(away, 1e-7, reach)

    def point(s: np.ndarray) -> np.ndarray:
        s = s % total
        edge = np.clip(np.searchsorted(ends, s, "right") - 1, 0, len(ring.length) - 1)
        return ring.vertex[edge] + ring.along[edge] * (s - ends[edge])[:, None]

    chord = point(at + reach) - point(at - reach)
    return chord / np.hypot(*chord.T)[:, None].clip(min=1e-12)


def samples_of(ring: Ring) -> Samples:
    """Samples all along the outline, denser towards the ends of its edges."""
    spacing = max(ring.length.sum() / 600, 2e-4)
    starts = np.concatenate(([0], np.cumsum(ring.length)))[:-1]
    edges, fractions, weights = [], [], []
    for k, length in enumerate(ring.length):
        count = max(1, math.ceil(length / spacing))
        own = (np.arange(count) + 0.5) / count
        ends = np.array([2e-5, 3e-4, 1e-3, 2.5e-3])
        ends = ends[ends < length / 2] / length
        own = np.sort(np.concatenate((own, ends, 1 - ends)))
        edges.append(np.full(len(own), k))
        fractions.append(own)
        middles = np.concatenate(([0], (own[1:] + own[:-1]) / 2, [1]))
        weights.append(np.diff(middles) * length)
    edge, fraction = np.concatenate(edges), np.concatenate(fractions)
    point = ring.vertex[edge] + ring.along[edge] * (fraction * ring.length[edge])[:, None]
    # An edge is a chord of a curve if it turns the same way at both ends and its sagitta is small.
    before, after = ring.turn, np.roll(ring.turn, -1)
    curve = (np.abs(before) < CORNER) | (np.abs(after) < CORNER)
    bend = np.where(np.abs(before) < CORNER, before, after), np.where(np.abs(after) < CORNER, after, before)
    curve &= (bend[0] * bend[1] > 0) & (np.minimum(*np.abs(bend)) * ring.length / 8 < ROUND)
    return Samples(
        point,
        left_of(ring.along[edge]),
        left_of(heading(ring, starts[edge] + fraction * ring.length[edge])),
        curve[edge],
        np.concatenate(weights),
        edge,
    )


def inner_points(ring: Ring, samples: Samples) -> Float[np.ndarray, "points 2"]:
    """Points a little inside the outline, and around its reflex corners."""
    found = [samples.point[k::2] + samples.normal[k::2] * depth for k, depth in enumerate((0.7e-3, 2.5e-3))]
    for k in np.flatnonzero(ring.turn < -math.radians(5)):
        fan = np.linspace(0, 1, 5) * ring.turn[k]
        heading = math.atan2(*left_of(ring.along[k - 1])[::-1])
        found += [
            ring.vertex[k] + r * np.stack((np.cos(heading + fan), np.sin(heading + fan)), -1) for r in (1e-3, 3e-3)
        ]
    points = np.concatenate(found)
    points = points[shapely.contains_xy(ring.polygon, *points.T)]
    return points[shapely.distance(ring.polygon.exterior, shapely.points(points)) > 0.6e-3]


def grid(ring: Ring, count: int = 400) -> Float[np.ndarray, "points 2"]:
    """Points all over the inside."""
    spacing = math.sqrt(ring.polygon.area / count)
    left, bottom, right, top = ring.polygon.bounds
    x, y = np.meshgrid(np.arange(left + spacing / 2, right, spacing), np.arange(bottom + spacing / 2, top, spacing))
    points = np.stack((x.ravel(), y.ravel()), -1)
    return points[shapely.contains_xy(ring.polygon, *points.T)]
