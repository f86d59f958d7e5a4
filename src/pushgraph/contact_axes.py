"""The axes along which two boxes in space may be apart: the faces of either, and across an edge of each."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph import pose_3d

PARALLEL = 1e-3
"""Edges that enclose a smaller angle (rad) span no axis of their own: faces tell as much."""


class Axes(NamedTuple):
    """What the faces and edges of two boxes tell: 3 faces of a, 3 of b, 9 pairs of edges (those of a slowest).

    gap: distance along the axis (m), negative where they overlap on it; -inf along no axis. normal: from a to b, world.
    """

    gap: Float[Tensor, "*batch 15"]
    normal: Float[Tensor, "*batch 15 3"]


def axes_between(
    pose_a: Float[Tensor, "*batch 7"],
    half_a: Float[Tensor, "*batch 3"],
    pose_b: Float[Tensor, "*batch 7"],
    half_b: Float[Tensor, "*batch 3"],
) -> Axes:
    """Gaps along every axis that may separate two boxes; the largest is the negative depth where they overlap, and at
    most the distance where they do not."""
    matrix_a, matrix_b = pose_3d.rotation_matrix(pose_a[..., 3:]), pose_3d.rotation_matrix(pose_b[..., 3:])
    faces_a, faces_b = matrix_a.mT, matrix_b.mT  # rows are axes
    across = pose_3d.cross(faces_a[..., :, None, :], faces_b[..., None, :, :]).flatten(-3, -2)
    sine = across.norm(dim=-1, keepdim=True)
    is_axis = sine > PARALLEL
    across = across / torch.where(is_axis, sine, 1.0)
    axes = torch.cat((faces_a, faces_b, across), -2)
    apart = axes @ (pose_b[..., :3] - pose_a[..., :3])[..., None]
    extent = (axes @ matrix_a).abs() @ half_a[..., None] + (axes @ matrix_b).abs() @ half_b[..., None]
    gap = (apart.abs() - extent)[..., 0]
    parallel = torch.cat((torch.zeros_like(gap[..., :6], dtype=torch.bool), ~is_axis[..., 0]), -1)
    return Axes(gap.masked_fill(parallel, -torch.inf), torch.where(apart < 0, -axes, axes))
