"""Contact between planar shapes: signed gap, normal and the two nearest contacts, batched and differentiable.

Every shape is a box rounded by a radius: a cuboid is a box of radius zero, a cylinder a box of zero extent.
So one computation serves every pairing: the signed distance of two boxes, less their radii.

Of the eight face normals of two boxes, the one along which they stand farthest apart says where they touch (separating
axis theorem): at the other box's lowest corner over that face, and at what is nearest to it on the face, be it one of
its ends. For how far two convex shapes stand apart has but one maximum over all directions. Overlapping boxes part by
the smallest translation along that normal. Ties go to the first candidate, so a symmetric scene always gives the same
answer.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pushgraph.pose import as_complex

TIE = {torch.float32: 1e-7, torch.float64: 1e-12}
"""A later candidate must be nearer than an earlier one by this much (m), so that rounding decides no tie."""

TURNED_AWAY = 1e-2
"""Faces whose second contact is farther apart than the first by this (m) touch at the first alone."""

LATER = {dtype: tie * torch.arange(8, dtype=dtype) for dtype, tie in TIE.items()}
"""What later candidates are handicapped by."""

CORNERS = torch.tensor(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)))
NORMALS = torch.tensor((1, 1j, -1, -1j), dtype=torch.complex64)


class RoundedBox(NamedTuple):
    """A batch of shapes, each centred in its own frame (m)."""

    half_extents: Float[Tensor, "*batch 2"]
    radius: Float[Tensor, "*batch"]


class Contact(NamedTuple):
    """Contact of shapes a and b, in the frame of a (m).

    gap: signed gap; if negative, minus the length of the smallest translation that parts the two.
    normal: unit vector from a to b.
    gaps: gap at each of the two nearest contacts; the first is `gap`.
    points_a, points_b: the contacts on the two surfaces.

    Two cuboids whose faces look at each other touch along a stretch: the second contact is its end farther
    from the first contact. Where there is but one contact (a cylinder, two corners), the second repeats it.
    """

    gap: Float[Tensor, "*batch"]
    normal: Float[Tensor, "*batch 2"]
    gaps: Float[Tensor, "*batch 2"]
    points_a: Float[Tensor, "*batch 2 2"]
    points_b: Float[Tensor, "*batch 2 2"]

    @property
    def middle(self) -> Float[Tensor, "*batch 2"]:
        """Middle of where the two face each other, in the frame of a (m).

        Between parallel faces that is the middle of the stretch along which they face. It goes to the first contact as
        the faces turn, smoothly (C1), and is there once the second gap is wider than the first by TURNED_AWAY.
        """
        wider = ((self.gaps[..., 1] - self.gaps[..., 0]) / TURNED_AWAY).clamp(0, 1)[..., None]
        share_of_second = (1 - wider) ** 2 * (1 + 2 * wider) / 2
        midpoints = (self.points_a + self.points_b) / 2
        return midpoints[..., 0, :] + share_of_second * (midpoints[..., 1, :] - midpoints[..., 0, :])


def contact_between(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Contact:
    """Return the contact of each pair; float32 or float64.

    Gradients are finite everywhere, and those of the gap exact and continuous wherever it is smooth: all but
    the poses at which nearest features tie (parallel faces that turn, coincident centres, two corners that
    touch), where they are those of one of them. Beside a corner the normal turns as fast as 1 / gap.
    """
    nearest = _nearest(a, b, pose_a_from_b)
    far_along, far_height, looks_at_other = _far_end(nearest)
    face, normal, of_a = nearest.face_height, nearest.face_normal, nearest.of_a
    # Points on the face and on the other box, of the first contact, then of the second.
    heights = torch.stack((face, face + nearest.other_height, face, face + far_height), -1)
    alongs = torch.stack((nearest.along, nearest.other_along, far_along, far_along), -1)
    cores = torch.complex(heights, alongs) * normal[..., None] + nearest.position[..., None]
    cores = cores.unflatten(-1, (2, 2))
    cores = torch.where(of_a[..., None, None], cores, cores.flip(-1))

    normal = torch.where(of_a, normal, -normal)
    between = (cores[..., 0, 1] - cores[..., 0, 0]) / torch.where(nearest.parted, nearest.distance, 1.0)
    normals = torch.stack((torch.where(nearest.parted, between, normal), normal), -1)
    radii = a.radius + b.radius
    has_second = looks_at_other & (a.half_extents.amin(-1) > 0) & (b.half_extents.amin(-1) > 0)
    gap = nearest.distance - radii
    points = cores + torch.stack((a.radius, -b.radius), -1)[..., None, :] * normals[..., None]
    second = torch.where(has_second[..., None], points[..., 1, :], points[..., 0, :])
    points = torch.view_as_real(torch.stack((points[..., 0, :], second), -2))
    return Contact(
        gap=gap,
        normal=torch.view_as_real(normals[..., 0]),
        gaps=torch.stack((gap, torch.where(has_second, far_height - radii, gap)), -1),
        points_a=points[..., 0, :],
        points_b=points[..., 1, :],
    )


def signed_gap(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Return only the signed gap of each pair (m), at two thirds of the cost."""
    return _nearest(a, b, pose_a_from_b).distance - a.radius - b.radius


class _Views(NamedTuple):
    """The two boxes as seen from a, then from b. Planar vectors are complex numbers, so that one product turns them."""

    half_extents: Float[Tensor, "*batch 2 2"]  # of the box whose view it is
    rotation: Complex[Tensor, "*batch 2"]  # of the other box
    position: Complex[Tensor, "*batch 2"]
    corners: Complex[Tensor, "*batch 2 4"]


class _Nearest(NamedTuple):
    """Where two boxes are nearest, without their radii, at the face along whose normal they stand farthest apart.

    Along is counted from the middle of that face, height from the face. Points of the other box: the nearest one, its
    lowest corner, and where the lower of the two faces that meet there leads to.
    """

    of_a: Bool[Tensor, "*batch"]  # whether the face is one of a
    face_normal: Complex[Tensor, "*batch"]  # in the frame of a
    face_height: Float[Tensor, "*batch"]  # over the middle of its box
    half_length: Float[Tensor, "*batch"]
    position: Complex[Tensor, "*batch"]  # of its box, in the frame of a
    parted: Bool[Tensor, "*batch"]
    distance: Float[Tensor, "*batch"]  # signed
    along: Float[Tensor, "*batch"]  # of the nearest point of the face
    other_along: Float[Tensor, "*batch"]
    other_height: Float[Tensor, "*batch"]
    corner_along: Float[Tensor, "*batch"]
    corner_height: Float[Tensor, "*batch"]
    run: Float[Tensor, "*batch"]
    rise: Float[Tensor, "*batch"]


def _views(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> _Views:
    yaw = pose_a_from_b[..., 2]
    turn = torch.complex(yaw.cos(), yaw.sin())
    back = turn.conj()
    position = as_complex(pose_a_from_b[..., :2])
    rotation, position = torch.stack((turn, back), -1), torch.stack((position, -position * back), -1)
    half_extents = torch.stack((a.half_extents, b.half_extents), -2)
    corners = as_complex(half_extents.flip(-2)[..., None, :] * CORNERS.to(half_extents))
    return _Views(half_extents, rotation, position, corners * rotation[..., None] + position[..., None])


def _handicapped(values: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """Values to choose the smallest of, without gradient: a later one must be smaller by more than rounding."""
    return values.detach() + LATER[values.dtype][: values.shape[-1]].to(values.device)


def _separations(views: _Views) -> Float[Tensor, "*batch 8"]:
    """How far each box lies beyond each of the other's faces: the four of a, then the four of b.

    A point has no faces, but between two points the axes of their frames serve.
    """
    own, corners = views.half_extents, torch.view_as_real(views.corners)
    lowest, highest = corners.min(-2).values, corners.max(-2).values
    separation = torch.cat((lowest - own, -highest - own), -1)
    extent = own.amax(-1)
    faceless = (extent == 0) & (extent.flip(-1) > 0)
    return separation.masked_fill(faceless[..., None], -torch.inf).flatten(-2)


def _nearest(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> _Nearest:
    views = _views(a, b, pose_a_from_b)
    separations = _separations(views)
    face = _handicapped(-separations).argmin(-1)
    separation = separations.take_along_dim(face[..., None], -1).squeeze(-1)
    of_a = face < 4

    # Work in the frame of the box whose face it is, turned so that the face looks along x.
    normal = NORMALS.to(views.rotation)[face % 4]
    own = torch.where(of_a[..., None], views.half_extents[..., 0, :], views.half_extents[..., 1, :])
    face_height, half_length = torch.where((face % 2 == 0)[..., None], own, own.flip(-1)).unbind(-1)
    corners = torch.where(of_a[..., None], views.corners[..., 0, :], views.corners[..., 1, :])
    corners = torch.view_as_real(corners * normal.conj()[..., None])

    # The other box's nearest face joins its two lowest corners.
    edge = _handicapped(corners[..., 0]).topk(2, largest=False).indices
    corner, neighbour = corners.take_along_dim(edge[..., None], -2).unbind(-2)
    (height, along), (rise, run) = corner.unbind(-1), (neighbour - corner).unbind(-1)
    height = height - face_height

    # Parted boxes are nearest at the lowest corner and what is nearest to that on the face. Only where the two nearest
    # faces are parallel but for rounding may the corner lie beside the face, and a point behind it be nearer. So it is
    # with parallel faces that touch or overlap, too.
    parted = separation > 0
    on_face = parted | (rise.abs() <= TIE[rise.dtype])
    face_along = torch.where(on_face, along.clamp(-half_length, half_length), along)
    squared_length = (rise.square() + run.square()).clamp(min=torch.finfo(run.dtype).tiny)
    behind = ((face_along - along) * run - height * rise) / squared_length
    behind = torch.where(on_face, behind.clamp(0, 1), 0.0)
    other_height, other_along = height + behind * rise, along + behind * run
    squared = other_height.square() + (other_along - face_along).square()
    parted = parted & (squared > (32 * torch.finfo(squared.dtype).eps) ** 2)
    rotation = torch.where(of_a, 1.0, views.rotation[..., 0])
    return _Nearest(
        of_a=of_a,
        face_normal=normal * rotation,
        face_height=face_height,
        half_length=half_length,
        position=torch.where(of_a, 0.0, views.position[..., 0]),
        parted=parted,
        distance=torch.where(parted, torch.where(parted, squared, 1.0).sqrt(), separation),
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
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"], Bool[Tensor, "*batch"]]:
    """Where the stretch in which the two faces look at each other ends, of its two ends the one farther from where they
    are nearest: along the face, and the other box's height there. And whether there is such a stretch."""
    run, along, half_length = nearest.run, nearest.corner_along, nearest.half_length
    low = torch.maximum(torch.minimum(along, along + run), -half_length)
    high = torch.minimum(torch.maximum(along, along + run), half_length)
    tie = TIE[run.dtype]
    far_along = torch.where(nearest.other_along - low <= high - nearest.other_along + tie, high, low)
    slanted = run.abs() > tie
    slope = torch.where(slanted, nearest.rise, 0.0) / torch.where(slanted, run, 1.0)
    return far_along, nearest.corner_height + slope * (far_along - along), high > low + tie
