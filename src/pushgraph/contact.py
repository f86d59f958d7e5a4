"""Contact between planar shapes: signed gap, normal and the two nearest contacts, batched and differentiable.

Every shape is a box rounded by a radius: a cuboid is a box of radius zero, a cylinder a box of zero extent.
So one computation serves every pairing: the signed distance of two boxes, less their radii.

Separated boxes are nearest at a corner of one of them (eight candidates). Overlapping boxes part by the
smallest translation along one of their eight face normals (separating axis theorem). Ties go to the first
candidate, so a symmetric scene always gives the same answer.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.pose import inverse, rotate, transform

TIE = {torch.float32: 1e-7, torch.float64: 1e-12}
"""A later candidate must be nearer than an earlier one by this much (m), so that rounding decides no tie."""

CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
NORMALS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


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


def contact_between(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Contact:
    """Return the contact of each pair; float32 or float64.

    Gradients are finite everywhere, and those of the gap exact and continuous wherever it is smooth: all but
    the poses at which nearest features tie (parallel faces that turn, coincident centres, two corners that
    touch), where they are those of one of them. Beside a corner the normal turns as fast as 1 / gap.
    """
    core_a, core_b = _nearest_points(a, b, pose_a_from_b)
    separation, best = _largest(_separations(a, b, pose_a_from_b))
    face = _reference_face(a, b, pose_a_from_b, best)

    distance, parted = _distance(core_b - core_a, separation)
    along = (core_b - core_a) / torch.where(parted, distance, 1.0)[..., None]
    normal = torch.where(parted[..., None], along, face.normal)
    gap = distance - a.radius - b.radius
    core_a = torch.where(parted[..., None], core_a, face.first_a)
    core_b = torch.where(parted[..., None], core_b, face.first_b)

    first_is_near = (core_a - face.ends_a[..., 0, :]).square().sum(-1) <= (
        core_a - face.ends_a[..., 1, :]
    ).square().sum(-1) + TIE[core_a.dtype]
    end = first_is_near.long()
    far_a, far_b = _pick(face.ends_a, end), _pick(face.ends_b, end)
    far_gap = ((far_b - far_a) * face.normal).sum(-1) - a.radius - b.radius
    has_second = face.looks_at_other & (a.half_extents.amin(-1) > 0) & (b.half_extents.amin(-1) > 0)

    def on_surfaces(first: Tensor, second: Tensor, outward: Tensor) -> Tensor:
        second = torch.where(has_second[..., None], second + outward * face.normal, first + outward * normal)
        return torch.stack((first + outward * normal, second), -2)

    return Contact(
        gap=gap,
        normal=normal,
        gaps=torch.stack((gap, torch.where(has_second, far_gap, gap)), -1),
        points_a=on_surfaces(core_a, far_a, a.radius[..., None]),
        points_b=on_surfaces(core_b, far_b, -b.radius[..., None]),
    )


def signed_gap(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Return only the signed gap of each pair (m), at half the cost of `contact_between`."""
    core_a, core_b = _nearest_points(a, b, pose_a_from_b)
    separation, _ = _largest(_separations(a, b, pose_a_from_b))
    distance, _ = _distance(core_b - core_a, separation)
    return distance - a.radius - b.radius


class _Face(NamedTuple):
    """The face of largest separation between two boxes, in the frame of a, without the radii."""

    normal: Float[Tensor, "*batch 2"]  # from a to b
    first_a: Float[Tensor, "*batch 2"]  # the other box's corner nearest to the face, and its foot on the face
    first_b: Float[Tensor, "*batch 2"]
    ends_a: Float[Tensor, "*batch 2 2"]  # ends of the stretch where the face looks at the other box
    ends_b: Float[Tensor, "*batch 2 2"]
    looks_at_other: Bool[Tensor, "*batch"]  # whether there is such a stretch


def _corners(half_extents: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 4 2"]:
    return half_extents[..., None, :] * half_extents.new_tensor(CORNERS)


def _first_smallest(values: Float[Tensor, "*batch n"]) -> Int[Tensor, "*batch"]:
    order = torch.arange(values.shape[-1], dtype=values.dtype, device=values.device)
    return (values.detach() + TIE[values.dtype] * order).argmin(-1)


def _pick(rows: Float[Tensor, "*batch n k"], index: Int[Tensor, "*batch"]) -> Float[Tensor, "*batch k"]:
    return rows.take_along_dim(index[..., None, None], -2).squeeze(-2)


def _nearest_points(
    a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]
) -> tuple[Float[Tensor, "*batch 2"], Float[Tensor, "*batch 2"]]:
    """Nearest points of two separated boxes: a corner of one and its projection onto the other."""
    corners_a = _corners(a.half_extents)
    corners_b = transform(pose_a_from_b[..., None, :], _corners(b.half_extents))
    corners_a_in_b = transform(inverse(pose_a_from_b)[..., None, :], corners_a)
    half_a, half_b = a.half_extents[..., None, :], b.half_extents[..., None, :]
    projected_on_a = corners_b.clamp(-half_a, half_a)
    projected_on_b = transform(pose_a_from_b[..., None, :], corners_a_in_b.clamp(-half_b, half_b))
    points_a = torch.cat((corners_a, projected_on_a), -2)
    points_b = torch.cat((projected_on_b, corners_b), -2)
    nearest = _first_smallest(torch.linalg.vector_norm((points_b - points_a).detach(), dim=-1))
    return _pick(points_a, nearest), _pick(points_b, nearest)


def _distance(
    offset: Float[Tensor, "*batch 2"], separation: Float[Tensor, "*batch"]
) -> tuple[Float[Tensor, "*batch"], Bool[Tensor, "*batch"]]:
    """Signed distance of two boxes, and whether it is that of their nearest points, an offset apart."""
    squared = offset.square().sum(-1)
    parted = (separation > 0) & (squared > (32 * torch.finfo(offset.dtype).eps) ** 2)
    return torch.where(parted, torch.where(parted, squared, 1.0).sqrt(), separation), parted


def _separations(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 8"]:
    """How far each box lies beyond each of the other's faces: the four of a, then the four of b.

    A point has no faces, but between two points the axes of their frames serve.
    """

    def beyond(box: RoundedBox, other: RoundedBox, pose_box_from_other: Tensor) -> Tensor:
        position, yaw = pose_box_from_other[..., :2], pose_box_from_other[..., 2]
        cos, sin = _magnitude(yaw.cos()), _magnitude(yaw.sin())
        x, y = other.half_extents.unbind(-1)
        reach = box.half_extents + torch.stack((cos * x + sin * y, sin * x + cos * y), -1)
        separation = torch.cat((position - reach, -position - reach), -1)
        faceless = (box.half_extents.amax(-1) == 0) & (other.half_extents.amax(-1) > 0)
        return torch.where(faceless[..., None], -torch.inf, separation)

    return torch.cat((beyond(a, b, pose_a_from_b), beyond(b, a, inverse(pose_a_from_b))), -1)


def _magnitude(values: Tensor) -> Tensor:
    """Absolute values, with the slope of one side at zero, where `abs` has none."""
    return torch.where(values < 0, -values, values)


def _largest(separations: Float[Tensor, "*batch 8"]) -> tuple[Float[Tensor, "*batch"], Int[Tensor, "*batch"]]:
    face = _first_smallest(-separations)
    return separations.take_along_dim(face[..., None], -1).squeeze(-1), face


def _reference_face(
    a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"], face: Int[Tensor, "*batch"]
) -> _Face:
    """Geometry of one face: 0 to 3 are those of a, 4 to 7 those of b."""
    pose_b_from_a = inverse(pose_a_from_b)
    face_of_a = (face < 4)[..., None]

    # Work in the frame of the box whose face it is: height above the face, and position along it.
    half_extents = torch.where(face_of_a, a.half_extents, b.half_extents)
    other_half_extents = torch.where(face_of_a, b.half_extents, a.half_extents)
    pose_face_from_other = torch.where(face_of_a, pose_a_from_b, pose_b_from_a)
    normal = pose_a_from_b.new_tensor(NORMALS)[face % 4]
    tangent = torch.stack((-normal[..., 1], normal[..., 0]), -1)
    face_height = (normal.abs() * half_extents).sum(-1)
    face_half_length = (tangent.abs() * half_extents).sum(-1)
    corners = transform(pose_face_from_other[..., None, :], _corners(other_half_extents))
    height = (corners * normal[..., None, :]).sum(-1) - face_height[..., None]
    along = (corners * tangent[..., None, :]).sum(-1)

    # The other box's nearest face joins its lowest corner to the lower of that corner's two neighbours.
    lowest = _first_smallest(height)
    neighbours = torch.stack(((lowest + 1) % 4, (lowest + 3) % 4), -1)
    second_lowest = neighbours.take_along_dim(_first_smallest(height.take_along_dim(neighbours, -1))[..., None], -1)
    edge = torch.cat((lowest[..., None], second_lowest), -1)
    edge_along, edge_height = along.take_along_dim(edge, -1), height.take_along_dim(edge, -1)

    low = torch.maximum(edge_along.amin(-1), -face_half_length)
    high = torch.minimum(edge_along.amax(-1), face_half_length)
    run, rise = edge_along[..., 1] - edge_along[..., 0], edge_height[..., 1] - edge_height[..., 0]
    slanted = run.abs() > TIE[run.dtype]
    slope = torch.where(slanted, rise, 0.0) / torch.where(slanted, run, 1.0)
    stops_along = torch.stack((edge_along[..., 0], low, high), -1)
    stops_height = edge_height[..., :1] + slope[..., None] * (stops_along - edge_along[..., :1])

    pose_a_from_face = torch.where(face_of_a, torch.zeros_like(pose_a_from_b), pose_a_from_b)

    def in_frame_a(height_above_face: Tensor) -> Tensor:
        total = face_height[..., None] + height_above_face
        points = stops_along[..., None] * tangent[..., None, :] + total[..., None] * normal[..., None, :]
        return transform(pose_a_from_face[..., None, :], points)

    on_face, on_other = in_frame_a(torch.zeros_like(stops_height)), in_frame_a(stops_height)
    on_a = torch.where(face_of_a[..., None], on_face, on_other)
    on_b = torch.where(face_of_a[..., None], on_other, on_face)
    normal_in_a = rotate(normal, pose_a_from_face[..., 2])
    return _Face(
        normal=torch.where(face_of_a, normal_in_a, -normal_in_a),
        first_a=on_a[..., 0, :],
        first_b=on_b[..., 0, :],
        ends_a=on_a[..., 1:, :],
        ends_b=on_b[..., 1:, :],
        looks_at_other=high > low + TIE[low.dtype],
    )
