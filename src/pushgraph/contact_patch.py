"""The patch in which two boxes touch, as up to twelve points with one normal.

The boxes are told apart along the axis with the largest gap. If that is a face, the other box's face against it is cut
to the first one's outline: corners of the patch are corners of either face and crossings of their outlines. If it goes
across an edge of each, they touch in one point.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph import pose_3d
from pushgraph.contact_axes import axes_between

PREFER_FACES = 1e-4
"""Edges count as the axis only if their gap is larger than the faces' by this (m): patches of faces say more."""
TIE = 1e-9
"""Of two faces that tell the same within this (m), the first counts: rounding must not choose."""
FLAT = 1e-12
"""Lengths (m) and determinants below this count as none."""
POINTS = 12
"""Ends of the four edges of the second face, cut to the first, and the four corners of the first."""


class ContactPatch(NamedTuple):
    """Points of contact of two boxes a and b; see the module.

    normal: from a to b, world. point: on b, world. gap: along the normal (m). touches: which points there are.
    """

    normal: Float[Tensor, "*batch 3"]
    point: Float[Tensor, "*batch 12 3"]
    gap: Float[Tensor, "*batch 12"]
    touches: Bool[Tensor, "*batch 12"]


def contact_patch(
    pose_a: Float[Tensor, "*batch 7"],
    half_a: Float[Tensor, "*batch 3"],
    pose_b: Float[Tensor, "*batch 7"],
    half_b: Float[Tensor, "*batch 3"],
    prefer_faces: float = PREFER_FACES,
) -> ContactPatch:
    """The patch along the axis with the largest gap; its points are on b."""
    axes = axes_between(pose_a, half_a, pose_b, half_b)
    favour = torch.zeros_like(axes.gap)
    favour[..., 6:] = prefer_faces
    favour[..., 3:6] = TIE
    best = (axes.gap - favour).argmax(-1)
    normal = axes.normal.gather(-2, best[..., None, None].expand(*best.shape, 1, 3))[..., 0, :]
    gap = axes.gap.gather(-1, best[..., None])
    of_b = ((best >= 3) & (best < 6))[..., None]
    # The face that tells: outward normal, and the box across.
    first, second = torch.where(of_b, pose_b, pose_a), torch.where(of_b, pose_a, pose_b)
    half_first, half_second = torch.where(of_b, half_b, half_a), torch.where(of_b, half_a, half_b)
    outward = torch.where(of_b, -normal, normal)
    point, depth, touches = _faces(first, half_first, second, half_second, outward)
    # Points on b: those found lie on the second box.
    point = torch.where(of_b[..., None], point + depth[..., None] * normal[..., None, :], point)
    crossing = _edges(pose_a, half_a, pose_b, half_b, normal, best)
    is_edge = (best >= 6)[..., None]
    only_first = torch.arange(POINTS, device=best.device) == 0
    return ContactPatch(
        normal,
        torch.where(is_edge[..., None], crossing[..., None, :], point),
        torch.where(is_edge, gap, depth),
        torch.where(is_edge, only_first, touches),
    )


def _faces(
    first: Float[Tensor, "*batch 7"],
    half_first: Float[Tensor, "*batch 3"],
    second: Float[Tensor, "*batch 7"],
    half_second: Float[Tensor, "*batch 3"],
    outward: Float[Tensor, "*batch 3"],
) -> tuple[Float[Tensor, "*batch 12 3"], Float[Tensor, "*batch 12"], Bool[Tensor, "*batch 12"]]:
    """Points on the second box's face against the first one's, their gaps, and which there are."""
    frame = _face_frame(first, outward)
    extent = _sides(first, half_first, frame)
    facing = _face_frame(second, -outward)
    sides = _sides(second, half_second, facing)
    to_first = frame.mT
    centre = (to_first @ (second[..., :3] - first[..., :3])[..., None])[..., 0]
    turned = to_first @ facing  # columns: the second face's axes in the first one's frame
    u, v, n = (turned[..., k] * sides[..., k, None] for k in range(3))
    centre = centre + n
    signs = centre.new_tensor([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corner = centre[..., None, :] + signs[:, :1] * u[..., None, :] + signs[:, 1:] * v[..., None, :]
    along = corner.roll(-1, -2) - corner
    # Cut every edge to the outline: the shares of it between both pairs of sides.
    outline = extent[..., None, :2]
    flat = along[..., :2].abs() < FLAT
    safe = torch.where(flat, 1.0, along[..., :2])
    one, other = (-outline - corner[..., :2]) / safe, (outline - corner[..., :2]) / safe
    inside = corner[..., :2].abs() <= outline
    enters = torch.where(flat, torch.where(inside, -torch.inf, torch.inf), torch.minimum(one, other)).amax(-1)
    leaves = torch.where(flat, torch.where(inside, torch.inf, -torch.inf), torch.maximum(one, other)).amin(-1)
    begin, end = enters.clamp(min=0), leaves.clamp(max=1)
    there = begin <= end
    begin, end = torch.where(there, begin, 0.0), torch.where(there, end, 0.0)
    begins = corner + begin[..., None] * along
    ends = corner + end[..., None] * along
    # An end that is not cut is the beginning of the next edge.
    is_cut = there & (leaves < 1)
    # Corners of the first face within the second: in coordinates (s, t) along its sides.
    on_plane, within = _corners_within(signs * outline, centre, u, v)
    local = torch.cat((begins, ends, on_plane), -2)
    touches = torch.cat((there, is_cut, within), -1)
    gap = local[..., 2] - extent[..., None, 2]
    return first[..., None, :3] + local @ frame.mT, gap, touches


def _corners_within(
    corner: Float[Tensor, "*batch 4 2"],
    centre: Float[Tensor, "*batch 3"],
    u: Float[Tensor, "*batch 3"],
    v: Float[Tensor, "*batch 3"],
) -> tuple[Float[Tensor, "*batch 4 3"], Bool[Tensor, "*batch 4"]]:
    """Corners moved along z onto the parallelogram centre + s u + t v, and whether they meet its inside."""
    determinant = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    determinant = torch.where(determinant.abs() < FLAT, FLAT, determinant)[..., None]
    from_centre = corner - centre[..., None, :2]
    s = (from_centre[..., 0] * v[..., None, 1] - from_centre[..., 1] * v[..., None, 0]) / determinant
    t = (from_centre[..., 1] * u[..., None, 0] - from_centre[..., 0] * u[..., None, 1]) / determinant
    within = (s.abs() < 1) & (t.abs() < 1)
    height = centre[..., None, 2] + s * u[..., None, 2] + t * v[..., None, 2]
    return torch.cat((corner, height[..., None]), -1), within


def _face_frame(pose: Float[Tensor, "*batch 7"], outward: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Axes of the face that looks most into a direction, as columns: along two sides, and outward."""
    matrix = pose_3d.rotation_matrix(pose[..., 3:])
    cosine = (matrix * outward[..., None]).sum(-2)
    axis = cosine.abs().argmax(-1, keepdim=True)
    order = (axis + torch.tensor([1, 2, 3], device=axis.device)) % 3
    columns = matrix.gather(-1, order[..., None, :].expand(*order.shape[:-1], 3, 3))
    sign = torch.where(cosine.gather(-1, axis) < 0, -1.0, 1.0)
    flip = torch.stack((torch.ones_like(sign), sign, sign), -1)
    return columns * flip


def _sides(
    pose: Float[Tensor, "*batch 7"], half: Float[Tensor, "*batch 3"], frame: Float[Tensor, "*batch 3 3"]
) -> Float[Tensor, "*batch 3"]:
    """Half sizes along the axes of a face's frame."""
    return ((pose_3d.rotation_matrix(pose[..., 3:]).mT @ frame).abs().round() * half[..., None]).sum(-2)


def _edges(
    pose_a: Float[Tensor, "*batch 7"],
    half_a: Float[Tensor, "*batch 3"],
    pose_b: Float[Tensor, "*batch 7"],
    half_b: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    best: Tensor,
) -> Float[Tensor, "*batch 3"]:
    """The point of b's edge nearest to a's, for the pair of edges number best - 6."""
    pair = (best - 6).clamp(min=0)[..., None]
    on_a, along_a = _edge(pose_a, half_a, normal, pair // 3)
    on_b, along_b = _edge(pose_b, half_b, -normal, pair % 3)
    cosine = (along_a * along_b).sum(-1)
    offset = on_b - on_a
    sine = (1 - cosine * cosine).clamp(min=FLAT)
    share = (cosine * (along_a * offset).sum(-1) - (along_b * offset).sum(-1)) / sine
    return on_b + share[..., None] * along_b


def _edge(
    pose: Float[Tensor, "*batch 7"], half: Float[Tensor, "*batch 3"], direction: Float[Tensor, "*batch 3"], axis: Tensor
) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3"]]:
    """Middle and direction of the edge along an axis of a box that lies farthest in a direction."""
    matrix = pose_3d.rotation_matrix(pose[..., 3:])
    sign = torch.where((matrix * direction[..., None]).sum(-2) < 0, -1.0, 1.0)
    local = (sign * half).scatter(-1, axis, 0.0)
    along = matrix.gather(-1, axis[..., None, :].expand(*axis.shape[:-1], 3, 1))[..., 0]
    return pose_3d.transform(pose, local), along
