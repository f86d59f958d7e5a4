"""What a body, or a piece of several, presses on the table with, and how its mass is spread.

A body presses uniformly over its outline. Bodies of one piece may overlap: where k of them cover a point, it counts as
1 / k of a point for each, so a body of mass m has the share s = integral of 1 / k over its outline, and presses there
with m / (k s) per area, and so is its mass spread. Then n copies of one disc are one disc, and a bar in ten cells is
the bar. A body with a `support` presses on those points instead, so loaded that it balances about its centre of mass.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pushgraph import pose
from pushgraph.body import Body
from pushgraph.contact import signed_gap
from pushgraph.errors import SceneError
from pushgraph.shape import Cuboid, Cylinder, PlacedShape, Polygon, Pose, rounded_boxes, take

POINTS_OF_BODY = 256
POINTS_OF_PIECE = 1500
"""So many points stand for a body, and at most about so many for a piece."""
POINTS_OF_UNION = 600
"""Where bodies of a piece overlap, about so many points stand for their union."""
TOUCH = 1e-6
"""Bodies that overlap less deeply (m) only touch."""
SIDES = 48
"""Where a cylinder overlaps another body, it is a polygon of so many sides and of the same area."""


class Patch(NamedTuple):
    """Where a piece presses on the table: points (m) and the share of its weight on each; the shares add up to 1."""

    points: Float[np.ndarray, "n 2"]
    weights: Float[np.ndarray, " n"]

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Centre of pressure (m)."""
        return self.weights @ self.points

    @property
    def second_moments(self) -> Float[np.ndarray, "2 2"]:
        """Mean of (p - centre) (p - centre)^T (m^2)."""
        away = self.points - self.centre
        return (away * self.weights[:, None]).T @ away

    @property
    def mean_radius(self) -> float:
        """Mean distance from the centre (m): friction torque in spin is mu m g times this."""
        return float(self.weights @ np.hypot(*(self.points - self.centre).T))


class MassProperties(NamedTuple):
    """Mass (kg), its centre (m), and its moment of inertia about it (kg m^2)."""

    mass: float
    centre_of_mass: Float[np.ndarray, "2"]
    moment_of_inertia: float


def patch_of(bodies: Sequence[Body]) -> Patch:
    """Where the members of one piece press on the table, in the world frame at their poses in the scene.

    Raises SceneError if a mass is unknown, or a body's support cannot balance it.
    """
    spread = _spread_of(bodies)
    all_points, all_weights = [spread.points], [spread.weights[:, [body.support is None for body in bodies]].sum(1)]
    for k, body in enumerate(bodies):
        if body.support is not None:
            feet = pose.transform(np.array(body.pose_world_from_body, dtype=float), np.array(body.support, dtype=float))
            own = spread.weights[:, k]
            loads = _loads(feet, own @ spread.points / own.sum(), body.name)
            all_points.append(feet)
            all_weights.append(own.sum() * loads)
    points, weights = np.concatenate(all_points), np.concatenate(all_weights)
    return Patch(points[weights > 0], weights[weights > 0])


def mass_properties(bodies: Sequence[Body]) -> MassProperties:
    """Mass of the members of one piece, in the world frame at their poses in the scene; a support changes nothing.

    Raises SceneError if a mass is unknown.
    """
    spread = _spread_of(bodies)
    patch = Patch(spread.points, spread.weights.sum(1))
    mass = float(sum(body.mass or 0.0 for body in bodies))
    return MassProperties(mass, patch.centre, mass * float(np.trace(patch.second_moments)))


class BodyPatch(NamedTuple):
    """How the mass of one body is spread, and where it presses, in its own frame; shares of each add up to 1."""

    mass: Patch
    pressure: Patch


def patches_of_members(bodies: Sequence[Body]) -> list[BodyPatch]:
    """Patch of each member of one piece: together they are that of the piece, whatever the members weigh."""
    spread = _spread_of([body.replace(mass=1.0) for body in bodies])
    found = []
    for k, body in enumerate(bodies):
        weights = spread.weights[:, k] / spread.weights[:, k].sum()
        pose_body_from_world = pose.inverse(np.array(body.pose_world_from_body, dtype=float))
        covered = weights > 0
        mass = Patch(pose.transform(pose_body_from_world, spread.points[covered]), weights[covered])
        pressure = mass
        if body.support is not None:
            points = np.array(body.support, dtype=float)
            loads = _loads(points, mass.centre, body.name)
            pressure = Patch(points[loads > 0], loads[loads > 0])
        found.append(BodyPatch(mass, pressure))
    return found


def overlap_in_piece(bodies: Sequence[Body]) -> bool:
    """Whether members of one piece overlap, so that each bears but a part of where it stands."""
    places = tuple((body.shape, body.pose_world_from_body) for body in bodies)
    return len(_overlapping(places)) < len(bodies)


class _Spread(NamedTuple):
    """Points (m), and the share of the piece's mass that each body has there; all add up to 1."""

    points: Float[np.ndarray, "n 2"]
    weights: Float[np.ndarray, "n bodies"]


class _Rule(NamedTuple):
    """Points (m) that stand for an area, and the area (m^2) that each stands for."""

    points: Float[np.ndarray, "n 2"]
    areas: Float[np.ndarray, " n"]


def _spread_of(bodies: Sequence[Body]) -> _Spread:
    for body in bodies:
        if body.mass is None:
            raise SceneError(
                f"body {body.name!r}: mass: unknown; its pressure needs one, see Scene.with_nominal_values"
            )
    # In the frame of the first body, so that nothing is lost far from the origin and moved pieces are found again.
    poses = np.array([body.pose_world_from_body for body in bodies], dtype=float)
    relative = pose.relative(poses[:1], poses).round(12)
    placed = tuple((body.shape, tuple(row)) for body, row in zip(bodies, relative.tolist(), strict=True))
    rule, shares = _shares(placed)
    mass = np.array([body.mass for body in bodies])
    return _Spread(pose.transform(poses[0], rule.points), shares * mass / mass.sum())


@functools.lru_cache(maxsize=256)
def _shares(placed: tuple[tuple[Cuboid | Cylinder | Polygon, Pose], ...]) -> tuple[_Rule, np.ndarray]:
    """Points of the union of shapes, and how each shape's unit mass is spread over them, one column a shape."""
    rule, cover = _covered(placed)
    share = cover * (rule.areas / cover.sum(1))[:, None]
    return rule, share / share.sum(0)


def _covered(
    placed: Sequence[tuple[Cuboid | Cylinder | Polygon, Pose]],
) -> tuple[_Rule, Bool[np.ndarray, "n shapes"]]:
    """Points of the union of shapes, and which shapes cover each; copies in one place count as one shape."""
    different = list(dict.fromkeys(placed))
    if len(different) < len(placed):
        rule, cover = _covered(different)
        return rule, cover[:, [different.index(one) for one in placed]]
    count = max(4, min(POINTS_OF_BODY, POINTS_OF_PIECE // len(placed)))
    rules, covers = [], []
    for members in _overlapping(placed):
        if len(members) == 1:
            shape, pose_piece_from_body = placed[members[0]]
            own = _rule_of(shape, count)
            rule = _Rule(pose.transform(np.array(pose_piece_from_body), own.points), own.areas)
            cover = np.zeros((len(own.areas), len(placed)), bool)
            cover[:, members] = True
        else:
            rule, cover = _faces(placed, members, count)
        rules.append(rule)
        covers.append(cover)
    rule = _Rule(*(np.concatenate(columns) for columns in zip(*rules, strict=True)))
    return rule, np.concatenate(covers)


@functools.lru_cache(maxsize=1024)
def area_shares(parts: tuple[PlacedShape, ...]) -> Float[np.ndarray, " parts"]:
    """The share of their union's area that each of some parts has; a point that k of them cover counts as 1 / k."""
    rule, cover = _covered(parts)
    shares = (cover * (rule.areas / cover.sum(1))[:, None]).sum(0)
    return shares / shares.sum()


def _overlapping(placed: Sequence[tuple[Cuboid | Cylinder | Polygon, Pose]]) -> list[list[int]]:
    """The shapes in groups that overlap, those that overlap none alone."""
    group = np.arange(len(placed))
    if len(placed) > 1:
        parts = [(k, part) for k, (shape, _) in enumerate(placed) for part in shape.parts]
        owner = np.array([k for k, _ in parts])
        poses = np.array([placed[k][1] for k, _ in parts])
        poses = pose.compose(poses, np.array([part.pose_body_from_part for _, part in parts]))
        boxes = rounded_boxes([part.shape for _, part in parts])
        reach = np.hypot(*boxes.half_extents.T) + boxes.radius
        away = np.hypot(*np.moveaxis(poses[:, None, :2] - poses[None, :, :2], -1, 0))
        a, b = np.nonzero((away < reach[:, None] + reach) & (owner[:, None] < owner))
        if len(a):
            gap = signed_gap(take(boxes, a), take(boxes, b), pose.relative(poses[a], poses[b]))
            for i, j in {*zip(owner[a[gap < -TOUCH]].tolist(), owner[b[gap < -TOUCH]].tolist(), strict=True)}:
                group[group == group[j]] = group[i]
    return [np.flatnonzero(group == one).tolist() for one in dict.fromkeys(group.tolist())]


@functools.lru_cache(maxsize=1024)
def _rule_of(shape: Cuboid | Cylinder | Polygon, count: int) -> _Rule:
    """Points of one shape, in its own frame: exact for its area, centre and second moments."""
    if isinstance(shape, Polygon):
        return _rule_of_areas([shapely.Polygon(shape.points)], np.zeros(1, int), count)[0]
    side = max(2, round(math.sqrt(count)))
    if isinstance(shape, Cuboid):
        nodes, weights = np.polynomial.legendre.leggauss(side)
        x, y = np.meshgrid(nodes * shape.size[0] / 2, nodes * shape.size[1] / 2, indexing="ij")
        areas = np.outer(weights, weights) / 4 * math.prod(shape.size)
    else:
        # Gauss in the radius, equal steps in the angle.
        nodes, weights = np.polynomial.legendre.leggauss(max(2, side // 2))
        around = max(4, count // len(nodes))
        radius = (1 + nodes) / 2 * shape.diameter / 2
        angle = 2 * np.pi * np.arange(around) / around
        x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
        areas = np.outer(radius * weights / 2 * shape.diameter / 2, np.full(around, 2 * np.pi / around))
    return _Rule(np.stack((x.ravel(), y.ravel()), -1), areas.ravel())


def _rule_of_areas(
    areas: Sequence[shapely.Polygon], kinds: Int[np.ndarray, " areas"], count: int
) -> tuple[_Rule, Int[np.ndarray, " n"]]:
    """Points of areas, some `count` in all, and the kind of each: centroids of what lies in the squares of a grid, for
    each kind stretched about its centre so that its second moments are exact."""
    found, area = shapely.get_parts(shapely.constrained_delaunay_triangles(np.array(areas)), return_index=True)
    triangles = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    kind = kinds[area]
    sizes = _area(triangles)
    total = np.bincount(kind, sizes)
    centre = _sums(kind, sizes[:, None] * triangles.mean(1)) / total[:, None]
    # The mean of p p^T over a triangle is (sum of the corners' products + 9 times that of the centroid) / 12.
    corners = triangles - centre[kind, None]
    middle = corners.mean(1)
    products = (sum(map(_squares, corners.swapaxes(0, 1))) + 9 * _squares(middle)) / 12
    exact = _sums(kind, sizes[:, None, None] * products)

    cell = math.sqrt(total.sum() / count)
    triangles, kind = _subdivided(triangles, kind, cell)
    sizes, middle = _area(triangles), triangles.mean(1)
    square = np.floor((middle - centre[kind]) / cell + 0.5).astype(np.int64)
    _, first, index = np.unique(
        (kind * 100_003 + square[:, 0]) * 100_003 + square[:, 1], return_index=True, return_inverse=True
    )
    kind, size = kind[first], np.bincount(index, sizes)
    away = _sums(index, sizes[:, None] * middle) / size[:, None] - centre[kind]
    gathered = _sums(kind, size[:, None, None] * _squares(away))
    # Too few points to say how wide an area is: left as they are.
    narrow = np.linalg.eigvalsh(gathered)[:, 0] <= 1e-3 * np.linalg.eigvalsh(exact)[:, 0]
    exact, gathered = (np.where(narrow[:, None, None], np.eye(2), moments) for moments in (exact, gathered))
    stretch = np.linalg.cholesky(exact) @ np.linalg.inv(np.linalg.cholesky(gathered))
    return _Rule(centre[kind] + (stretch[kind] @ away[..., None])[..., 0], size), kind


def _subdivided(
    triangles: Float[np.ndarray, "n 3 2"], kind: Int[np.ndarray, " n"], cell: float
) -> tuple[Float[np.ndarray, "m 3 2"], Int[np.ndarray, " m"]]:
    """Triangles halved across their longest sides, until none is longer than `cell`."""
    done = []
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    while len(kind):
        squared = np.stack([((q - p) ** 2) @ np.ones(2) for p, q in ((a, b), (b, c), (c, a))])
        small = squared.max(0) <= cell**2
        done.append((np.stack((a[small], b[small], c[small]), 1), kind[small]))
        a, b, c, longest, kind = a[~small], b[~small], c[~small], squared.argmax(0)[~small, None], kind[~small]
        a, b, c = (np.choose(longest, corner) for corner in ((a, b, c), (b, c, a), (c, a, b)))
        middle = (a + b) / 2
        a, b, c = np.concatenate((a, middle)), np.concatenate((middle, b)), np.concatenate((c, c))
        kind = np.concatenate((kind, kind))
    small_triangles, kinds = zip(*done, strict=True)
    return np.concatenate(small_triangles), np.concatenate(kinds)


def _squares(vectors: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2 2"]:
    return vectors[:, :, None] * vectors[:, None, :]


def _area(triangles: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, " n"]:
    (x, y), (u, v) = (triangles[:, 1] - triangles[:, 0]).T, (triangles[:, 2] - triangles[:, 0]).T
    return np.abs(x * v - y * u) / 2


def _sums(index: Int[np.ndarray, " n"], values: Float[np.ndarray, "n *rest"]) -> Float[np.ndarray, "groups *rest"]:
    """Sums of the rows that have the same index."""
    columns = [np.bincount(index, column) for column in values.reshape(len(values), -1).T]
    return np.stack(columns, -1).reshape(-1, *values.shape[1:])


def _faces(
    placed: Sequence[tuple[Cuboid | Cylinder | Polygon, Pose]], members: list[int], count: int
) -> tuple[_Rule, Bool[np.ndarray, "n shapes"]]:
    """Points of the union of overlapping shapes, and which shapes cover each.

    Their outlines cut the union into faces; a point stands for faces that the same shapes cover.
    """
    outlines = [shapely.Polygon(_outline(*placed[k])) for k in members]
    lines = shapely.union_all([one.exterior for one in outlines], grid_size=1e-8)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    inside = shapely.point_on_surface(faces)
    shapely.prepare(outlines)
    covers = shapely.contains(np.array(outlines)[:, None], inside)
    kept = covers.any(0) & (shapely.area(faces) > 1e-12)
    covers, kinds = np.unique(covers[:, kept], axis=1, return_inverse=True)
    rule, kind = _rule_of_areas(faces[kept].tolist(), kinds, min(count * len(members), POINTS_OF_UNION))
    cover = np.zeros((len(kind), len(placed)), bool)
    cover[:, members] = covers[:, kind].T
    return rule, cover


def _outline(shape: Cuboid | Cylinder | Polygon, pose_piece_from_body: Pose) -> Float[np.ndarray, "n 2"]:
    if isinstance(shape, Polygon):
        points = np.array(shape.points)
    elif isinstance(shape, Cuboid):
        points = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.array(shape.size) / 2
    else:
        angle = 2 * np.pi * np.arange(SIDES) / SIDES
        equal_area = math.sqrt(np.pi / (SIDES / 2 * math.sin(2 * np.pi / SIDES)))
        # Unturned, so that cylinders in one place are the same polygon.
        angle = angle - pose_piece_from_body[2]
        points = shape.diameter / 2 * equal_area * np.stack((np.cos(angle), np.sin(angle)), -1)
    return pose.transform(np.array(pose_piece_from_body), points)


def _loads(points: Float[np.ndarray, "n 2"], centre: Float[np.ndarray, "2"], name: str) -> Float[np.ndarray, " n"]:
    """Shares of a weight on points, none negative, that balance about the centre: the smallest in the least squares.

    Minimize |l|^2 / 2 subject to A l = b and l >= 0, rows of A being 1, x and y about the centre, b = (1, 0, 0): the
    loads are l = max(0, A^T y), where y maximizes b y - |max(0, A^T y)|^2 / 2. Newton's method finds it.
    """
    away = points - centre
    size = max(np.abs(away).max(), 1e-9)
    table = np.concatenate((np.ones((1, len(points))), away.T / size))
    wanted = np.array([1.0, 0.0, 0.0])
    y = wanted / len(points)

    def dual(at: np.ndarray) -> float:
        return float(at[0] - (np.maximum(table.T @ at, 0) ** 2).sum() / 2)

    for _ in range(200):
        loads = np.maximum(table.T @ y, 0)
        gradient = wanted - table @ loads
        if np.abs(gradient).max() < 1e-10:
            return loads / loads.sum()
        active = table[:, loads > 0]
        step = np.linalg.solve(active @ active.T + 1e-9 * np.eye(3), gradient)
        length = 1.0
        while dual(y + length * step) < dual(y) + 1e-4 * length * (gradient @ step) and length > 1e-9:
            length /= 2
        y = y + length * step
    hull = shapely.MultiPoint(points).convex_hull
    out = shapely.distance(hull, shapely.Point(centre))
    raise SceneError(
        f"body {name!r}: support: its centre of mass lies {out * 1e3:.1f} mm outside these points; no loads on them "
        f"balance it"
    )
