"""Surface distance of boxes in space: gap or depth, normal, and the points where they are closest.

Boxes are poses (`pushgraph.pose_3d`) and half sizes (m). Everything is batched and differentiable. Boxes that lie in
each other are told apart along the axis on which they overlap least: a face of either, or across an edge of each.
Boxes apart are closest at a corner of one, or at an edge of each.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph import pose_3d
from pushgraph.contact_axes import PARALLEL, axes_between
from pushgraph.contact_patch import contact_patch

CORNERS = torch.tensor([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Corners of a box, in half sizes."""
EDGES = torch.tensor([[a, b] for a in range(8) for b in range(a, 8) if (CORNERS[a] != CORNERS[b]).sum() == 1])
"""Corners at both ends of every edge."""


class Contact(NamedTuple):
    """Where two boxes are closest.

    gap: m, negative if they lie in each other. normal: from a to b, world. point_a, point_b: on their surfaces, world;
    point_b - point_a is gap * normal.
    """

    gap: Float[Tensor, "*batch"]
    normal: Float[Tensor, "*batch 3"]
    point_a: Float[Tensor, "*batch 3"]
    point_b: Float[Tensor, "*batch 3"]


def corners(pose: Float[Tensor, "*batch 7"], half: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 8 3"]:
    """World positions of a box's corners."""
    return pose_3d.transform(pose[..., None, :], CORNERS.to(half) * half[..., None, :])


def closest(
    pose_a: Float[Tensor, "*batch 7"],
    half_a: Float[Tensor, "*batch 3"],
    pose_b: Float[Tensor, "*batch 7"],
    half_b: Float[Tensor, "*batch 3"],
) -> Contact:
    """Where boxes that lie apart are closest; means nothing where they overlap."""
    corners_a, corners_b = corners(pose_a, half_a), corners(pose_b, half_b)
    on_a, on_b = _nearest(pose_a, half_a, corners_b), _nearest(pose_b, half_b, corners_a)
    edges_a, edges_b = corners_a[..., EDGES, :], corners_b[..., EDGES, :]
    between_a, between_b = _nearest_on_segments(edges_a[..., :, None, :, :], edges_b[..., None, :, :, :])
    points_a = torch.cat((on_a, corners_a, between_a.flatten(-3, -2)), -2)
    points_b = torch.cat((corners_b, on_b, between_b.flatten(-3, -2)), -2)
    best = (points_b - points_a).square().sum(-1).argmin(-1)[..., None, None].expand(*points_a.shape[:-2], 1, 3)
    point_a, point_b = points_a.gather(-2, best)[..., 0, :], points_b.gather(-2, best)[..., 0, :]
    gap = (point_b - point_a).norm(dim=-1)
    return Contact(gap, (point_b - point_a) / gap.clamp(min=1e-12)[..., None], point_a, point_b)


def _nearest(
    pose: Float[Tensor, "*batch 7"], half: Float[Tensor, "*batch 3"], points: Float[Tensor, "*batch n 3"]
) -> Float[Tensor, "*batch n 3"]:
    """The points of a box nearest to others."""
    local = pose_3d.transform(pose_3d.inverse(pose)[..., None, :], points)
    half = half[..., None, :]
    return pose_3d.transform(pose[..., None, :], torch.minimum(torch.maximum(local, -half), half))


def _nearest_on_segments(
    a: Float[Tensor, "*#batch 2 3"], b: Float[Tensor, "*#batch 2 3"]
) -> tuple[Float[Tensor, "... 3"], Float[Tensor, "... 3"]]:
    """Where two segments, given by their ends, are closest."""
    along_a, along_b = a[..., 1, :] - a[..., 0, :], b[..., 1, :] - b[..., 0, :]
    offset = a[..., 0, :] - b[..., 0, :]
    aa, bb = along_a.square().sum(-1), along_b.square().sum(-1)
    ab, ao, bo = (along_a * along_b).sum(-1), (along_a * offset).sum(-1), (along_b * offset).sum(-1)
    determinant = aa * bb - ab * ab
    is_parallel = determinant < PARALLEL**2 * aa * bb
    share_a = torch.where(is_parallel, 0.0, (ab * bo - ao * bb) / torch.where(is_parallel, 1.0, determinant))
    share_a = share_a.clamp(0, 1)
    share_b = ((ab * share_a + bo) / bb).clamp(0, 1)
    share_a = ((ab * share_b - ao) / aa).clamp(0, 1)
    return a[..., 0, :] + share_a[..., None] * along_a, b[..., 0, :] + share_b[..., None] * along_b


def contact_between(
    pose_a: Float[Tensor, "*batch 7"],
    half_a: Float[Tensor, "*batch 3"],
    pose_b: Float[Tensor, "*batch 7"],
    half_b: Float[Tensor, "*batch 3"],
) -> Contact:
    """Where two boxes are closest, or lie deepest in each other along the axis on which they overlap least."""
    patch = contact_patch(pose_a, half_a, pose_b, half_b, prefer_faces=0.0)
    depth = patch.gap.masked_fill(~patch.touches, torch.inf)
    deepest = depth.argmin(-1, keepdim=True)
    on_b = patch.point.gather(-2, deepest[..., None].expand(*deepest.shape, 3))[..., 0, :]
    gap = axes_between(pose_a, half_a, pose_b, half_b).gap.amax(-1)
    inside = Contact(gap, patch.normal, on_b - gap[..., None] * patch.normal, on_b)
    outside = closest(pose_a, half_a, pose_b, half_b)
    return Contact(*(_where(gap < 0, *both) for both in zip(inside, outside, strict=True)))


def _where(condition: Bool[Tensor, "*batch"], yes: Tensor, no: Tensor) -> Tensor:
    return torch.where(condition.view(*condition.shape, *[1] * (yes.dim() - condition.dim())), yes, no)
