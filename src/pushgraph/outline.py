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
import math
import re
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

FLAT = 1e-4
"""How far (m) a facet may lie off the outline that it stands for."""
ROUND = 1.5e-4
"""How far (m) a disc may lie off the outline that it stands for."""
TURN = math.radians(3)
"""How far the normal of a facet or of a disc may be turned from that of the outline."""
ROUND_SHARE = 0.03
"""Where a disc serves this share of the outline, no facet is tried."""
CORNER = math.radians(25)
"""A vertex that turns by more is a corner; by less, it is a point of a curve."""
DEPTH = 5e-3
"""Parts are at least so deep (m) where the body allows."""
THINNEST = 1e-3
"""Least side or diameter of a part (m)."""
REACH = 3.5e-4
"""Tips are covered to within this (m)."""
PROTRUSION = 2e-5
"""How far (m) a rectangle along a straight edge may stick out of another edge."""
LARGEST = 20.0
"""Longest outline (m)."""
WINDOW = 1.5e-3
"""The heading at a point is that of the chord between the points so far (m) before and after it."""


class Cut(NamedTuple):
    """A rectangle (its full lengths; radius zero), or a disc (lengths zero), in the frame of the outline (m, rad)."""

    lengths: tuple[float, float]
    radius: float
    pose_outline_from_cut: tuple[float, float, float]


class _Parts(NamedTuple):
    """Rectangles and discs: rounded boxes, as in `pushgraph.contact` (m)."""

    centre: Float[np.ndarray, "parts 2"]
    yaw: Float[np.ndarray, " parts"]
    half: Float[np.ndarray, "parts 2"]
    radius: Float[np.ndarray, " parts"]

    def take(self, index: np.ndarray | list[int] | slice) -> "_Parts":
        return _Parts(*(values[index] for values in self))

    def local(self, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "parts points 2"]:
        """The points in the frame of each part."""
        x, y = np.moveaxis(points - self.centre[:, None], -1, 0)
        cos, sin = np.cos(self.yaw)[:, None], np.sin(self.yaw)[:, None]
        return np.stack((cos * x + sin * y, cos * y - sin * x), -1)

    def gap(self, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "parts points"]:
        """Signed distance of each point from each part, negative inside."""
        beyond = np.abs(self.local(points)) - self.half[:, None]
        return np.hypot(*np.moveaxis(beyond.clip(min=0), -1, 0)) + beyond.max(-1).clip(max=0) - self.radius[:, None]

    def contain(self, points: Float[np.ndarray, "points 2"]) -> Bool[np.ndarray, "parts points"]:
        """Whether each point lies inside each part."""
        return np.concatenate([self.take(some).gap(points) <= 1e-6 for some in self.slices()])

    def slices(self) -> list[slice]:
        """So few parts at a time that what is computed for them stays in the cache."""
        return [slice(start, start + 64) for start in range(0, max(len(self.yaw), 1), 64)]

    @property
    def area(self) -> Float[np.ndarray, " parts"]:
        return 4 * self.half.prod(-1) + np.pi * self.radius**2


def _join(*batches: _Parts) -> _Parts:
    return _Parts(*(np.concatenate(columns) for columns in zip(*batches, strict=True)))


class _Ring(NamedTuple):
    """The outline counter-clockwise, straight runs of points merged; edge k leads from vertex k to the next."""

    vertex: Float[np.ndarray, "n 2"]
    along: Float[np.ndarray, "n 2"]  # unit vector of each edge
    length: Float[np.ndarray, " n"]
    turn: Float[np.ndarray, " n"]  # at each vertex, from the edge before to its edge (rad)
    polygon: shapely.Polygon


class _Samples(NamedTuple):
    """Points on the outline; normals point inwards."""

    point: Float[np.ndarray, "samples 2"]
    edge_normal: Float[np.ndarray, "samples 2"]
    normal: Float[np.ndarray, "samples 2"]  # of the chord of `WINDOW`
    curved: Bool[np.ndarray, " samples"]  # on a curve, rather than on a straight edge
    weight: Float[np.ndarray, " samples"]  # length that it stands for (m)
    edge: Int[np.ndarray, " samples"]  # on which it lies


class _Facet(NamedTuple):
    """A line along the outline from `start`; the outline lies within `off` of it."""

    start: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    length: float
    off: float


@functools.lru_cache(maxsize=1024)
def fault_of(points: tuple[tuple[float, float], ...]) -> str | None:
    """What keeps these points from being an outline: what is wrong, where, and what is valid; None if nothing does."""
    array = np.array(points)
    same = np.flatnonzero((array == np.roll(array, -1, 0)).all(-1))
    if len(same):
        k, following = int(same[0]), (int(same[0]) + 1) % len(points)
        closing = "; an outline closes itself, so leave the last one out" if following == 0 else ""
        return f"points {k} and {following} are the same, {list(points[k])}; each must differ from the next{closing}"
    extent = np.ptp(array, axis=0)
    if extent.max() > LARGEST:
        return f"the outline is {extent.max():.3g} m long; at most {LARGEST:g} m is valid"
    polygon = shapely.Polygon(array)
    if shapely.minimum_rotated_rectangle(polygon).area < 1e-3 * THINNEST * extent.max():
        return "the points lie on one line; an outline must enclose an area"
    if not polygon.is_valid:
        x, y = (float(number) for number in re.findall(r"[^\s\[\]]+", shapely.is_valid_reason(polygon))[-2:])
        return f"the outline crosses or touches itself at [{x:.6g}, {y:.6g}] m; it must be simple"
    if polygon.area < THINNEST**2:
        return f"the outline encloses {polygon.area * 1e6:.3g} mm^2; at least {THINNEST**2 * 1e6:g} mm^2 is valid"
    return None


@functools.lru_cache(maxsize=1024)
def cut(points: tuple[tuple[float, float], ...]) -> tuple[Cut, ...]:
    """Cut a simple polygon (m; either winding) into parts that overlap: see the module."""
    ring = _ring(np.array(points, dtype=float))
    samples = _samples(ring)
    discs = _discs(ring, samples)
    along_disc = _covered_by_discs(discs, samples)[0]
    along_disc = along_disc[along_disc @ samples.weight > ROUND_SHARE * samples.weight.sum()].any(0)
    rectangles = _rectangles(ring, _facets(ring, samples.edge[~along_disc]))
    covers, depth = (
        np.concatenate(both)
        for both in zip(_covered_by_rectangles(rectangles, samples), _covered_by_discs(discs, samples), strict=True)
    )
    parts = _join(rectangles, discs)
    deepest = np.where(covers, depth, 0).max(0, initial=0)
    covers &= depth >= np.minimum(DEPTH, deepest / 2) - 1e-9
    near, inside = parts.contain(_inner_points(ring, samples)), parts.contain(_grid(ring))
    boundary = np.concatenate((samples.weight, np.full(near.shape[1], 0.2 * samples.weight.mean())))
    filling = _fill(inside)
    inside &= inside[filling].any(0)
    goals = np.concatenate((covers, near, inside), 1)
    weights = np.concatenate((boundary, np.full(inside.shape[1], 1e-9)))
    chosen = parts.take(_choose(goals, weights, parts.area / ring.polygon.area, filling))
    chosen = _join(chosen, _tips(ring, samples, chosen))
    return tuple(
        Cut(
            tuple((2 * half).tolist()) if radius == 0 else (0.0, 0.0),
            float(radius),
            (float(centre[0]), float(centre[1]), float(yaw)),
        )
        for centre, yaw, half, radius in zip(*chosen, strict=True)
    )


def _ring(points: Float[np.ndarray, "n 2"]) -> _Ring:
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
    return _Ring(vertex, along, length, turn, polygon)


def _left(vectors: np.ndarray) -> np.ndarray:
    return np.stack((-vectors[..., 1], vectors[..., 0]), -1)


def _heading(ring: _Ring, at: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 2"]:
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


def _samples(ring: _Ring) -> _Samples:
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
    return _Samples(
        point,
        _left(ring.along[edge]),
        _left(_heading(ring, starts[edge] + fraction * ring.length[edge])),
        curve[edge],
        np.concatenate(weights),
        edge,
    )


def _facets(ring: _Ring, edges: Int[np.ndarray, " edges"]) -> list[_Facet]:
    """These edges, and every longest run of edges through one of them that is nearly straight."""
    n = len(ring.length)
    wanted = np.zeros(n, bool)
    wanted[edges] = True
    starts = np.concatenate(([0], np.cumsum(ring.length)))[:-1]
    headings = _heading(ring, starts + ring.length / 2)
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
    return facets + [_Facet(ring.vertex[k], ring.along[k], ring.length[k], 0.0) for k in single]


def _fit(points: Float[np.ndarray, "n 2"], headings: Float[np.ndarray, "m 2"]) -> _Facet | None:
    """The line along a run of points, if it is straight enough."""
    chord = points[-1] - points[0]
    length = np.hypot(*chord)
    if length < 1e-6:
        return None
    along = chord / length
    if length > THINNEST and (headings @ along).min() < math.cos(TURN):
        return None
    height = (points - points[0]) @ _left(along)
    position = (points - points[0]) @ along
    low, high = height.min(), height.max()
    if high - low > 2 * FLAT or position.min() < -1e-9 or position.max() > length + 1e-9:
        return None
    return _Facet(points[0] + _left(along) * (low + high) / 2, along, length, (high - low) / 2)


def _rectangles(ring: _Ring, facets: list[_Facet]) -> _Parts:
    """Rectangles of several depths along each facet, each as long as it stays inside."""
    rows = []
    corners = np.abs(ring.turn) > CORNER
    for facet in facets:
        normal = _left(facet.along)
        relative = ring.vertex - facet.start
        u, v = relative @ facet.along, relative @ normal
        for depth in _depths(facet, u, v, corners):
            for low, high in _free(facet, u, v, depth):
                if high - low >= THINNEST and depth >= THINNEST - 1e-9:
                    middle = facet.start + facet.along * (low + high) / 2 + normal * depth / 2
                    yaw = math.atan2(facet.along[1], facet.along[0])
                    rows.append((*middle, yaw, (high - low) / 2, max(depth, THINNEST) / 2))
    table = np.array(rows).reshape(-1, 5)
    parts = _Parts(table[:, :2], table[:, 2], table[:, 3:], np.zeros(len(table)))
    inside = shapely.contains_xy(ring.polygon, *parts.centre.T)
    return parts.take(inside)


def _depths(facet: _Facet, u: np.ndarray, v: np.ndarray, corners: np.ndarray) -> list[float]:
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


def _free(facet: _Facet, u: np.ndarray, v: np.ndarray, depth: float) -> list[tuple[float, float]]:
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


def _discs(ring: _Ring, samples: _Samples) -> _Parts:
    """The largest disc inside that touches at each of some samples of curves.

    A disc of radius r that touches at p, with normal n, holds q not deeper than t if |p + r n - q| >= r - t, which is
    r <= (|q - p|^2 - t^2) / (2 (n (q - p) - t)).
    """
    at = np.flatnonzero(samples.curved)
    at = at[:: max(1, len(at) // 300)]
    point, normal = samples.point[at], samples.normal[at]
    boundary = np.concatenate((samples.point, ring.vertex))
    away = boundary - point[:, None]
    height = (away * normal[:, None]).sum(-1) - FLAT / 2
    limit = ((away**2).sum(-1) - (FLAT / 2) ** 2) / np.where(height > 0, 2 * height, 1)
    radius = np.where(height > 0, limit, np.inf).min(1, initial=10.0)
    keep = radius >= THINNEST / 2
    radius, centre = radius[keep], (point + radius[:, None] * normal)[keep]
    inside = shapely.contains_xy(ring.polygon, *centre.T) if len(centre) else np.zeros(0, bool)
    radius, centre = radius[inside], centre[inside]
    return _Parts(centre, np.zeros(len(radius)), np.zeros((len(radius), 2)), radius)


def _covered_by_rectangles(parts: _Parts, samples: _Samples) -> tuple[np.ndarray, np.ndarray]:
    """Which rectangle runs along the outline at which sample, and how deep (m) it is there."""
    covers, depths = zip(*(_covered_by_some(parts.take(index), samples) for index in parts.slices()), strict=True)
    return np.concatenate(covers), np.concatenate(depths)


def _covered_by_some(parts: _Parts, samples: _Samples) -> tuple[np.ndarray, np.ndarray]:
    local = parts.local(samples.point)
    beyond = np.abs(local) - parts.half[:, None]
    tolerance = np.where(samples.curved, 1.5 * FLAT, 2 * PROTRUSION)
    covers = np.zeros(beyond.shape[:2], bool)
    depth = np.zeros(beyond.shape[:2])
    cos, sin = np.cos(parts.yaw), np.sin(parts.yaw)
    for axis, face in enumerate((np.stack((cos, sin), -1), np.stack((-sin, cos), -1))):
        on_face = (np.abs(beyond[..., axis]) < tolerance) & (beyond[..., 1 - axis] < PROTRUSION)
        part, sample = on_face.nonzero()
        inwards = face[part] * -np.sign(local[part, sample, axis])[:, None]
        alike = np.maximum((inwards * samples.edge_normal[sample]).sum(-1), (inwards * samples.normal[sample]).sum(-1))
        part, sample = part[alike > math.cos(1.02 * TURN)], sample[alike > math.cos(1.02 * TURN)]
        covers[part, sample] = True
        depth[part, sample] = np.maximum(depth[part, sample], 2 * parts.half[part, axis])
    return covers, depth


def _covered_by_discs(parts: _Parts, samples: _Samples) -> tuple[np.ndarray, np.ndarray]:
    """Which disc runs along the outline at which sample, and how deep (m) it is there."""
    from_sample = parts.centre[:, None] - samples.point
    distance = np.hypot(*np.moveaxis(from_sample, -1, 0))
    turned = np.maximum(TURN, FLAT / parts.radius)[:, None]
    alike = (from_sample * samples.normal).sum(-1) > np.cos(turned) * distance
    near = np.abs(distance - parts.radius[:, None]) < np.where(samples.curved, ROUND, PROTRUSION)
    return near & alike, np.broadcast_to(2 * parts.radius[:, None], distance.shape)


def _inner_points(ring: _Ring, samples: _Samples) -> Float[np.ndarray, "points 2"]:
    """Points a little inside the outline, and around its reflex corners."""
    found = [samples.point[k::2] + samples.normal[k::2] * depth for k, depth in enumerate((0.7e-3, 2.5e-3))]
    for k in np.flatnonzero(ring.turn < -math.radians(5)):
        fan = np.linspace(0, 1, 5) * ring.turn[k]
        heading = math.atan2(*_left(ring.along[k - 1])[::-1])
        found += [
            ring.vertex[k] + r * np.stack((np.cos(heading + fan), np.sin(heading + fan)), -1) for r in (1e-3, 3e-3)
        ]
    points = np.concatenate(found)
    points = points[shapely.contains_xy(ring.polygon, *points.T)]
    return points[shapely.distance(ring.polygon.exterior, shapely.points(points)) > 0.6e-3]


def _grid(ring: _Ring, count: int = 400) -> Float[np.ndarray, "points 2"]:
    """Points all over the inside."""
    spacing = math.sqrt(ring.polygon.area / count)
    left, bottom, right, top = ring.polygon.bounds
    x, y = np.meshgrid(np.arange(left + spacing / 2, right, spacing), np.arange(bottom + spacing / 2, top, spacing))
    points = np.stack((x.ravel(), y.ravel()), -1)
    return points[shapely.contains_xy(ring.polygon, *points.T)]


def _fill(inside: Bool[np.ndarray, "parts points"], least: float = 0.06) -> list[int]:
    """The largest parts: each adds this share of the points inside, at least."""
    missing = np.ones(inside.shape[1], bool)
    chosen: list[int] = []
    while len(inside):
        gain = inside[:, missing].sum(1)
        if gain.max() <= least * len(missing):
            break
        chosen.append(int(gain.argmax()))
        missing &= ~inside[chosen[-1]]
    return chosen


def _choose(
    goals: Bool[np.ndarray, "parts goals"],
    weights: Float[np.ndarray, " goals"],
    preference: Float[np.ndarray, " parts"],
    chosen: list[int],
) -> list[int]:
    """Few parts, the chosen ones first, that together cover every goal that any covers; the preferred one of equals."""
    chosen = list(chosen)
    missing = goals.any(0) & ~goals[chosen].any(0)
    value = np.where(goals, weights, 0)
    while missing.any():
        gain = (value @ missing) * (1 + 0.1 * preference)
        chosen.append(int(gain.argmax()))
        missing &= ~goals[chosen[-1]]
    count = goals[chosen].sum(0)
    for part in sorted(chosen, key=lambda part: value[part].sum()):
        if (count - goals[part] >= (count > 0)).all():
            count = count - goals[part]
            chosen.remove(part)
    return chosen


def _tips(ring: _Ring, samples: _Samples, chosen: _Parts) -> _Parts:
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
    candidates = _join(
        _Parts(centre, np.zeros(len(point)), np.zeros((len(point), 2)), np.full(len(point), half)),
        _thin_rectangles(ring, centre, -_left(inwards)),
    )
    corner = _corners_of(candidates)
    out = shapely.distance(ring.polygon, shapely.points(corner.reshape(-1, 2))).reshape(corner.shape[:2]).max(1)
    out = np.where(
        candidates.radius > 0, half - shapely.distance(ring.polygon.exterior, shapely.points(candidates.centre)), out
    )
    candidates, out = candidates.take(out < 0.99 * half), out[out < 0.99 * half]
    goals = candidates.gap(point) <= np.where(middle < REACH / 2, REACH, 1e-6)
    return candidates.take(_choose(goals, np.ones(len(point)), -4 * out / half, []))


def _middle(ring: _Ring, samples: _Samples, point: np.ndarray, inwards: np.ndarray) -> Float[np.ndarray, " points"]:
    """Radius of the largest disc inside that touches at each point."""
    boundary = np.concatenate((samples.point, ring.vertex))
    away = boundary - point[:, None]
    height = (away * inwards[:, None]).sum(-1)
    ahead = height > 1e-2 * np.hypot(*np.moveaxis(away, -1, 0)) + 1e-9
    return np.where(ahead, (away**2).sum(-1) / np.where(ahead, 2 * height, 1), np.inf).min(1, initial=1.0)


def _thin_rectangles(ring: _Ring, centre: np.ndarray, along: np.ndarray) -> _Parts:
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
    return _Parts(table[:, :2], table[:, 2], table[:, 3:], np.zeros(len(table)))


def _corners_of(parts: _Parts, count: int = 9) -> Float[np.ndarray, "parts points 2"]:
    """Points along both long sides of rectangles."""
    u = np.tile(np.linspace(-1, 1, count), 2)
    v = np.repeat([-1.0, 1.0], count)
    x, y = parts.half[:, :1] * u, parts.half[:, 1:] * v
    cos, sin = np.cos(parts.yaw)[:, None], np.sin(parts.yaw)[:, None]
    return parts.centre[:, None] + np.stack((cos * x - sin * y, sin * x + cos * y), -1)


def centroid(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """Centre of the area within an outline (m)."""
    return np.array(shapely.Polygon(points).centroid.coords[0])
