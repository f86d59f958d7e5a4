"""Contact between planar shapes: signed gap, normal and the two nearest contacts, batched and differentiable.

Every shape is a box rounded by a radius: a cuboid is a box of radius zero, a cylinder a box of zero extent.
So one computation serves every pairing: the signed distance of two boxes, less their radii.

Separated boxes are nearest at a corner of one of them (eight candidates). Overlapping boxes part by the
smallest translation along one of their eight face normals (separating axis theorem). Ties go to the first
candidate, so a symmetric scene always gives the same answer.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor

from pushgraph.pose import as_complex

TIE = {torch.float32: 1e-7, torch.float64: 1e-12}
"""A later candidate must be nearer than an earlier one by this much (m), so that rounding decides no tie."""

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


def contact_between(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Contact:
    """Return the contact of each pair; float32 or float64.

    Gradients are finite everywhere, and those of the gap exact and continuous wherever it is smooth: all but
    the poses at which nearest features tie (parallel faces that turn, coincident centres, two corners that
    touch), where they are those of one of them. Beside a corner the normal turns as fast as 1 / gap.
    """
    views = _views(a, b, pose_a_from_b)
    cores = _nearest_points(views)
    separation, best = _largest(_separations(views))
    face = _reference_face(views, best)

    distance, parted = _distance(cores[..., 1] - cores[..., 0], separation)
    along = (cores[..., 1] - cores[..., 0]) / torch.where(parted, distance, 1.0)
    normal = torch.where(parted, along, face.normal)
    gap = distance - a.radius - b.radius
    cores = torch.where(parted[..., None], cores, face.first)

    from_ends = torch.view_as_real(cores[..., None, 0] - face.ends[..., 0]).square().sum(-1)
    first_is_near = from_ends[..., 0] <= from_ends[..., 1] + TIE[from_ends.dtype]
    far = torch.where(first_is_near[..., None], face.ends[..., 1, :], face.ends[..., 0, :])
    far_gap = ((far[..., 1] - far[..., 0]) * face.normal.conj()).real - a.radius - b.radius
    has_second = face.looks_at_other & (a.half_extents.amin(-1) > 0) & (b.half_extents.amin(-1) > 0)

    outward = torch.stack((a.radius, -b.radius), -1)
    first = cores + outward * normal[..., None]
    second = torch.where(has_second[..., None], far + outward * face.normal[..., None], first)
    points = torch.view_as_real(torch.stack((first, second), -1))
    return Contact(
        gap=gap,
        normal=torch.view_as_real(normal),
        gaps=torch.stack((gap, torch.where(has_second, far_gap, gap)), -1),
        points_a=points[..., 0, :, :],
        points_b=points[..., 1, :, :],
    )


def signed_gap(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Return only the signed gap of each pair (m), at half the cost of `contact_between`."""
    views = _views(a, b, pose_a_from_b)
    cores = _nearest_points(views)
    separation, _ = _largest(_separations(views))
    distance, _ = _distance(cores[..., 1] - cores[..., 0], separation)
    return distance - a.radius - b.radius


class _Views(NamedTuple):
    """The two boxes as seen from a, then from b. Planar vectors are complex numbers, so that one product turns them."""

    half_extents: Float[Tensor, "*batch 2 2"]  # of the box whose view it is
    rotation: Complex[Tensor, "*batch 2"]  # of the other box
    position: Complex[Tensor, "*batch 2"]
    corners: Complex[Tensor, "*batch 2 4"]

    def in_frame_a(self, from_a: Bool[Tensor, "*batch"]) -> tuple[Complex[Tensor, "*batch"], Complex[Tensor, "*batch"]]:
        """Rotation and position of the box whose view it is, in the frame of a."""
        return torch.where(from_a, 1.0, self.rotation[..., 0]), torch.where(from_a, 0.0, self.position[..., 0])


class _Face(NamedTuple):
    """The face of largest separation between two boxes, in the frame of a, without the radii."""

    normal: Complex[Tensor, "*batch"]  # from a to b
    first: Complex[Tensor, "*batch 2"]  # the other box's corner nearest to the face and its foot on it, on a and on b
    ends: Complex[Tensor, "*batch 2 2"]  # ends of the stretch where the face looks at the other box, each on a and b
    looks_at_other: Bool[Tensor, "*batch"]  # whether there is such a stretch


def _views(a: RoundedBox, b: RoundedBox, pose_a_from_b: Float[Tensor, "*batch 3"]) -> _Views:
    yaw = pose_a_from_b[..., 2]
    turn = torch.complex(yaw.cos(), yaw.sin())
    back = turn.conj()
    position = as_complex(pose_a_from_b[..., :2])
    rotation, position = torch.stack((turn, back), -1), torch.stack((position, -position * back), -1)
    half_extents = torch.stack((a.half_extents, b.half_extents), -2)
    corners = as_complex(half_extents.flip(-2)[..., None, :] * CORNERS.to(half_extents))
    return _Views(half_extents, rotation, position, corners * rotation[..., None] + position[..., None])


def _first_smallest(values: Float[Tensor, "*batch n"]) -> Int[Tensor, "*batch"]:
    return (values.detach() + LATER[values.dtype][: values.shape[-1]].to(values.device)).argmin(-1)


def _nearest_points(views: _Views) -> Complex[Tensor, "*batch 2"]:
    """Nearest points of two separated boxes, on a and on b: a corner of one and its foot on the other; frame of a."""
    corners = torch.view_as_real(views.corners)
    half_extents = views.half_extents[..., None, :]
    feet = corners.clamp(-half_extents, half_extents)
    apart = torch.linalg.vector_norm((corners - feet).detach(), dim=-1)
    # Corners of a, which are seen from b, come first where there is a tie.
    nearest = _first_smallest(apart.flip(-2).flatten(-2)) ^ 4
    feet, corners = as_complex(feet).flatten(-2), views.corners.flatten(-2)
    points = torch.stack((feet, corners), -1).take_along_dim(nearest[..., None, None], -2).squeeze(-2)
    from_a = nearest < 4
    rotation, position = views.in_frame_a(from_a)
    points = points * rotation[..., None] + position[..., None]
    return torch.where(from_a[..., None], points, points.flip(-1))


def _distance(
    offset: Complex[Tensor, "*batch"], separation: Float[Tensor, "*batch"]
) -> tuple[Float[Tensor, "*batch"], Bool[Tensor, "*batch"]]:
    """Signed distance of two boxes, and whether it is that of their nearest points, an offset apart."""
    squared = torch.view_as_real(offset).square().sum(-1)
    parted = (separation > 0) & (squared > (32 * torch.finfo(squared.dtype).eps) ** 2)
    return torch.where(parted, torch.where(parted, squared, 1.0).sqrt(), separation), parted


def _separations(views: _Views) -> Float[Tensor, "*batch 8"]:
    """How far each box lies beyond each of the other's faces: the four of a, then the four of b.

    A point has no faces, but between two points the axes of their frames serve.
    """
    own, other = views.half_extents, views.half_extents.flip(-2)
    cos, sin = _magnitude(torch.view_as_real(views.rotation)).split(1, -1)
    reach = own + cos * other + sin * other.flip(-1)
    position = torch.view_as_real(views.position)
    separation = torch.cat((position - reach, -position - reach), -1)
    faceless = (own.amax(-1) == 0) & (other.amax(-1) > 0)
    return separation.masked_fill(faceless[..., None], -torch.inf).flatten(-2)


def _magnitude(values: Tensor) -> Tensor:
    """Absolute values, with the slope of one side at zero, where `abs` has none."""
    return torch.where(values < 0, -values, values)


def _largest(separations: Float[Tensor, "*batch 8"]) -> tuple[Float[Tensor, "*batch"], Int[Tensor, "*batch"]]:
    face = _first_smallest(-separations)
    return separations.take_along_dim(face[..., None], -1).squeeze(-1), face


def _reference_face(views: _Views, face: Int[Tensor, "*batch"]) -> _Face:
    """Geometry of one face: 0 to 3 are those of a, 4 to 7 those of b."""
    of_a = face < 4
    # Work in the frame of the box whose face it is, turned so that the face looks along x: height above the face is
    # along x, position along it is y.
    normal = NORMALS.to(views.rotation)[face % 4]
    own = torch.where(of_a[..., None], views.half_extents[..., 0, :], views.half_extents[..., 1, :])
    own = torch.where((face % 2 == 0)[..., None], own, own.flip(-1))
    face_height, face_half_length = own.unbind(-1)
    corners = torch.where(of_a[..., None], views.corners[..., 0, :], views.corners[..., 1, :])
    corners = torch.view_as_real(corners * normal.conj()[..., None])
    height, along = corners[..., 0] - face_height[..., None], corners[..., 1]

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

    heights = face_height[..., None, None] + torch.stack((torch.zeros_like(stops_height), stops_height), -1)
    rotation, position = views.in_frame_a(of_a)
    normal = normal * rotation
    points = torch.complex(heights, stops_along[..., None].expand_as(heights)) * normal[..., None, None]
    points = points + position[..., None, None]
    points = torch.where(of_a[..., None, None], points, points.flip(-1))
    return _Face(
        normal=torch.where(of_a, normal, -normal),
        first=points[..., 0, :],
        ends=points[..., 1:, :],
        looks_at_other=high > low + TIE[low.dtype],
    )
