"""Contact between planar shapes: signed gap, normal and the two nearest contacts, batched and differentiable.

Every shape is a box rounded by a radius: a cuboid is a box of radius zero, a cylinder a box of zero extent.
So one computation serves every pairing: the signed distance of two boxes, less their radii.

Of the eight face normals of two boxes, the one along which they stand farthest apart says where they touch (separating
axis theorem): at the other box's lowest corner over that face, and at what is nearest to it on the face, be it one of
its ends. For how far two convex shapes stand apart has but one maximum over all directions. Overlapping boxes part by
the smallest translation along that normal. Ties go to the first candidate, so a symmetric scene always gives the same
answer.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from pushgraph.arrays import Array, is_tensor, namespace
from pushgraph.errors import GeometryError
from pushgraph.pose import as_complex, as_real, complex_of

TIE = {32: 1e-7, 64: 1e-12}
"""A later candidate must be nearer than an earlier one by this much (m), so that rounding decides no tie; by bits."""

TURNED_AWAY = 1e-2
"""Faces whose second contact is farther apart than the first by this (m) touch at the first alone."""

CORNERS = np.array(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)))
NORMALS = np.array(((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)))


class RoundedBox(NamedTuple):
    """A batch of shapes, each centred in its own frame (m); of NumPy or torch."""

    half_extents: Float[Any, "*batch 2"]
    radius: Float[Any, "*batch"]


class Contact(NamedTuple):
    """Contact of shapes a and b, in the frame of a (m); of NumPy or torch, as the shapes are.

    gap: signed gap; if negative, minus the length of the smallest translation that parts the two.
    normal: unit vector from a to b.
    gaps: gap at each of the two nearest contacts; the first is `gap`.
    points_a, points_b: the contacts on the two surfaces.

    Two cuboids whose faces look at each other touch along a stretch: the second contact is its end farther
    from the first contact. Where there is but one contact (a cylinder, two corners), the second repeats it.
    """

    gap: Float[Any, "*batch"]
    normal: Float[Any, "*batch 2"]
    gaps: Float[Any, "*batch 2"]
    points_a: Float[Any, "*batch 2 2"]
    points_b: Float[Any, "*batch 2 2"]

    @property
    def middle(self) -> Float[Any, "*batch 2"]:
        """Middle of where the two face each other, in the frame of a (m).

        Between parallel faces that is the middle of the stretch along which they face. It goes to the first contact as
        the faces turn, smoothly (C1), and is there once the second gap is wider than the first by TURNED_AWAY.
        """
        wider = ((self.gaps[..., 1] - self.gaps[..., 0]) / TURNED_AWAY).clip(0, 1)[..., None]
        share_of_second = (1 - wider) ** 2 * (1 + 2 * wider) / 2
        midpoints = (self.points_a + self.points_b) / 2
        return midpoints[..., 0, :] + share_of_second * (midpoints[..., 1, :] - midpoints[..., 0, :])


def contact_between(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Array, "*batch 3"]) -> Contact:
    """Return the contact of each pair; float32 or float64, of NumPy or torch.

    Gradients are finite everywhere, and those of the gap exact and continuous wherever it is smooth: all but
    the poses at which nearest features tie (parallel faces that turn, coincident centres, two corners that
    touch), where they are those of one of them. Beside a corner the normal turns as fast as 1 / gap.
    """
    _check_alike(a, b, pose_a_from_b)
    xp, nearest = namespace(pose_a_from_b), _nearest(a, b, pose_a_from_b)
    far_along, far_height, looks_at_other = _far_end(nearest)
    face, normal, of_a = nearest.face_height, nearest.face_normal, nearest.of_a
    # Points on the face and on the other box, of the first contact, then of the second.
    heights = xp.stack((face, face + nearest.other_height, face, face + far_height), -1)
    alongs = xp.stack((nearest.along, nearest.other_along, far_along, far_along), -1)
    cores = complex_of(heights, alongs) * normal[..., None] + nearest.position[..., None]
    cores = cores.reshape(*cores.shape[:-1], 2, 2)
    cores = xp.where(of_a[..., None, None], cores, xp.flip(cores, (-1,)))

    normal = xp.where(of_a, normal, -normal)
    between = (cores[..., 0, 1] - cores[..., 0, 0]) / xp.where(nearest.parted, nearest.distance, 1.0)
    normals = xp.stack((xp.where(nearest.parted, between, normal), normal), -1)
    radii = a.radius + b.radius
    has_second = looks_at_other & (xp.amin(a.half_extents, -1) > 0) & (xp.amin(b.half_extents, -1) > 0)
    gap = nearest.distance - radii
    points = cores + xp.stack((a.radius, -b.radius), -1)[..., None, :] * normals[..., None]
    second = xp.where(has_second[..., None], points[..., 1, :], points[..., 0, :])
    points = as_real(xp.stack((points[..., 0, :], second), -2))
    return Contact(
        gap=gap,
        normal=as_real(normals[..., 0]),
        gaps=xp.stack((gap, xp.where(has_second, far_height - radii, gap)), -1),
        points_a=points[..., 0, :],
        points_b=points[..., 1, :],
    )


def signed_gap(
    a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Array, "*batch 3"]
) -> Float[Array, "*batch"]:
    """Return only the signed gap of each pair (m), at two thirds of the cost."""
    _check_alike(a, b, pose_a_from_b)
    return _nearest(a, b, pose_a_from_b).distance - a.radius - b.radius


def _check_alike(a: RoundedBox, b: RoundedBox, pose_a_from_b: Array) -> None:
    """Raise GeometryError unless all are arrays of one library and dtype, each as long at its end as it must be."""
    named: list[tuple[str, Any, int | None]] = [("pose_a_from_b", pose_a_from_b, 3)]
    for name, box in (("a", a), ("b", b)):
        named += [(f"{name}.half_extents", box.half_extents, 2), (f"{name}.radius", box.radius, None)]
    for name, values, length in named:
        if not (isinstance(values, np.ndarray | np.generic) or is_tensor(values)):
            raise GeometryError(f"{name}: must be an array of NumPy or torch, got {type(values).__name__}")
        if (is_tensor(values), values.dtype) != (is_tensor(pose_a_from_b), pose_a_from_b.dtype):
            raise GeometryError(
                f"{name}: {_kind_of(values)}, but pose_a_from_b is {_kind_of(pose_a_from_b)}; all must be alike"
            )
        if length is not None and values.shape[-1:] != (length,):
            raise GeometryError(f"{name}: shape must end with {length}, got {tuple(values.shape)}")
    if not str(pose_a_from_b.dtype).endswith(("float32", "float64")):
        raise GeometryError(f"pose_a_from_b: dtype must be float32 or float64, got {_kind_of(pose_a_from_b)}")


def _kind_of(values: Any) -> str:
    return f"{'torch' if is_tensor(values) else 'NumPy'} {str(values.dtype).removeprefix('torch.')}"


class _Views(NamedTuple):
    """The two boxes as seen from a, then from b. Planar vectors are complex numbers, so that one product turns them."""

    half_extents: Float[Any, "*batch 2 2"]  # of the box whose view it is
    rotation: Complex[Any, "*batch 2"]  # of the other box
    position: Complex[Any, "*batch 2"]
    corners: Complex[Any, "*batch 2 4"]


class _Nearest(NamedTuple):
    """Where two boxes are nearest, without their radii, at the face along whose normal they stand farthest apart.

    Along is counted from the middle of that face, height from the face. Points of the other box: the nearest one, its
    lowest corner, and where the lower of the two faces that meet there leads to.
    """

    of_a: Bool[Any, "*batch"]  # whether the face is one of a
    face_normal: Complex[Any, "*batch"]  # in the frame of a
    face_height: Float[Any, "*batch"]  # over the middle of its box
    half_length: Float[Any, "*batch"]
    position: Complex[Any, "*batch"]  # of its box, in the frame of a
    parted: Bool[Any, "*batch"]
    distance: Float[Any, "*batch"]  # signed
    along: Float[Any, "*batch"]  # of the nearest point of the face
    other_along: Float[Any, "*batch"]
    other_height: Float[Any, "*batch"]
    corner_along: Float[Any, "*batch"]
    corner_height: Float[Any, "*batch"]
    run: Float[Any, "*batch"]
    rise: Float[Any, "*batch"]


def _views(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Array, "*batch 3"]) -> _Views:
    xp, yaw = namespace(pose_a_from_b), pose_a_from_b[..., 2]
    turn = complex_of(xp.cos(yaw), xp.sin(yaw))
    back = turn.conj()
    position = as_complex(pose_a_from_b[..., :2])
    rotation, position = xp.stack((turn, back), -1), xp.stack((position, -position * back), -1)
    half_extents = xp.stack((a.half_extents, b.half_extents), -2)
    corners = as_complex(xp.flip(half_extents, (-2,))[..., None, :] * _like(half_extents, CORNERS))
    return _Views(half_extents, rotation, position, corners * rotation[..., None] + position[..., None])


def _like(values: Any, constant: np.ndarray) -> Any:
    """A constant as an array of the same library, type and device."""
    return values.new_tensor(constant) if is_tensor(values) else constant.astype(values.dtype)


def _tie(values: Any) -> float:
    return TIE[namespace(values).finfo(values.dtype).bits]


def _taken(values: Any, index: Any, axis: int) -> Any:
    return values.take_along_dim(index, axis) if is_tensor(values) else np.take_along_axis(values, index, axis)


def _two_lowest(values: Any) -> Any:
    """Indices of the two smallest along the last axis."""
    return values.topk(2, largest=False).indices if is_tensor(values) else np.argsort(values, -1)[..., :2]


def _handicapped(values: Any) -> Any:
    """Values to choose the smallest of, without gradient: a later one must be smaller by more than rounding."""
    fixed = values.detach() if is_tensor(values) else values
    return fixed + _tie(values) * _like(values, np.arange(values.shape[-1]))


def _separations(views: _Views) -> Float[Any, "*batch 8"]:
    """How far each box lies beyond each of the other's faces: the four of a, then the four of b.

    A point has no faces, but between two points the axes of their frames serve.
    """
    xp, own, corners = namespace(views.half_extents), views.half_extents, as_real(views.corners)
    lowest, highest = xp.amin(corners, -2), xp.amax(corners, -2)
    separation = xp.concatenate((lowest - own, -highest - own), -1)
    extent = xp.amax(own, -1)
    faceless = (extent == 0) & (xp.flip(extent, (-1,)) > 0)
    separation = xp.where(faceless[..., None], -xp.inf, separation)
    return separation.reshape(*separation.shape[:-2], 8)


def _nearest(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Array, "*batch 3"]) -> _Nearest:
    xp, views = namespace(pose_a_from_b), _views(a, b, pose_a_from_b)
    separations = _separations(views)
    face = _handicapped(-separations).argmin(-1)
    separation = _taken(separations, face[..., None], -1)[..., 0]
    of_a = face < 4

    # Work in the frame of the box whose face it is, turned so that the face looks along x.
    normal = as_complex(_like(views.half_extents, NORMALS))[face % 4]
    own = xp.where(of_a[..., None], views.half_extents[..., 0, :], views.half_extents[..., 1, :])
    own = xp.where((face % 2 == 0)[..., None], own, xp.flip(own, (-1,)))
    face_height, half_length = own[..., 0], own[..., 1]
    corners = xp.where(of_a[..., None], views.corners[..., 0, :], views.corners[..., 1, :])
    corners = as_real(corners * normal.conj()[..., None])

    # The other box's nearest face joins its two lowest corners.
    ends = _taken(corners, _two_lowest(_handicapped(corners[..., 0]))[..., None], -2)
    corner, edge = ends[..., 0, :], ends[..., 1, :] - ends[..., 0, :]
    height, along = corner[..., 0] - face_height, corner[..., 1]
    rise, run = edge[..., 0], edge[..., 1]

    # Parted boxes are nearest at the lowest corner and what is nearest to that on the face. Only where the two nearest
    # faces are parallel but for rounding may the corner lie beside the face, and a point behind it be nearer. So it is
    # with parallel faces that touch or overlap, too.
    parted = separation > 0
    on_face = parted | (abs(rise) <= _tie(rise))
    face_along = xp.where(on_face, along.clip(-half_length, half_length), along)
    squared_length = (xp.square(rise) + xp.square(run)).clip(xp.finfo(run.dtype).tiny, None)
    behind = ((face_along - along) * run - height * rise) / squared_length
    behind = xp.where(on_face, behind.clip(0, 1), 0.0)
    other_height, other_along = height + behind * rise, along + behind * run
    squared = xp.square(other_height) + xp.square(other_along - face_along)
    parted = parted & (squared > (32 * xp.finfo(squared.dtype).eps) ** 2)
    rotation = xp.where(of_a, 1.0, views.rotation[..., 0])
    return _Nearest(
        of_a=of_a,
        face_normal=normal * rotation,
        face_height=face_height,
        half_length=half_length,
        position=xp.where(of_a, 0.0, views.position[..., 0]),
        parted=parted,
        distance=xp.where(parted, xp.sqrt(xp.where(parted, squared, 1.0)), separation),
        along=face_along,
        other_along=other_along,
        other_height=other_height,
        corner_along=along,
        corner_height=height,
        run=run,
        rise=rise,
    )


def _far_end(
    nearest: _Nearest,
) -> tuple[Float[Any, "*batch"], Float[Any, "*batch"], Bool[Any, "*batch"]]:
    """Where the stretch in which the two faces look at each other ends, of its two ends the one farther from where they
    are nearest: along the face, and the other box's height there. And whether there is such a stretch."""
    xp, run, along, half_length = namespace(nearest.run), nearest.run, nearest.corner_along, nearest.half_length
    low = xp.maximum(xp.minimum(along, along + run), -half_length)
    high = xp.minimum(xp.maximum(along, along + run), half_length)
    tie = _tie(run)
    far_along = xp.where(nearest.other_along - low <= high - nearest.other_along + tie, high, low)
    slanted = abs(run) > tie
    slope = xp.where(slanted, nearest.rise, 0.0) / xp.where(slanted, run, 1.0)
    return far_along, nearest.corner_height + slope * (far_along - along), high > low + tie
