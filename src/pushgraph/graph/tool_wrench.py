"""What bodies exert on the tool, from how they move: friction with the table and inertia, as Newton's laws have it."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.contact_graph import GRAVITY, friction_metric
from pushgraph.graph.scene_batch import SceneBatch
from pushgraph.graph.state import STILL
from pushgraph.track import FRAME

LEAST_SLIP = 1e-5
"""Feet that slip less than this in a frame (m) bear less than their full friction."""
CREEP = 3e-4
"""Bodies that move less than this in a frame (m) may be held by less than their full friction."""
BLURRED = 2.0
"""The same of bodies that move less than this times how far poses may be off."""


class ToolWrench(NamedTuple):
    """What bodies exert on the tool.

    wrench: force (N, world frame) and moment about the tool's origin (N m), on average over a frame. doubt: force that
    may as well be missing (N): of bodies that hardly move, and of those that get faster, maybe within the frame.
    """

    wrench: Float[Tensor, "batch 3"]
    doubt: Float[Tensor, " batch"]


def wrench_on_tool(
    scenes: SceneBatch,
    poses: Float[Tensor, "batch bodies 3"],
    last_motions: Float[Tensor, "batch bodies 3"],
    motions: Float[Tensor, "batch bodies 3"],
    tool: Float[Tensor, "batch 3"],
    blur: Float[Tensor, " batch"],
) -> ToolWrench:
    """From how bodies move in a frame.

    poses: at its beginning. last_motions, motions: how they changed in the frame before and change in this one. tool:
    pose_world_from_tool in its middle. blur: how far poses may be off (m). The bodies' masses and the table's friction
    are those of `scenes`.
    """
    mass = torch.where(scenes.present & ~scenes.immovable, scenes.mass, 0.0).to(poses.dtype)
    middle = poses + motions / 2
    arms = pose.rotate(scenes.feet.points.to(poses.dtype), middle[..., None, 2].expand(scenes.feet.shares.shape))
    turn = motions[..., None, 2]
    slip_x, slip_y = motions[..., None, 0] - arms[..., 1] * turn, motions[..., None, 1] + arms[..., 0] * turn
    spin = scenes.feet.radii * turn
    m_xx, m_xy, m_yy = friction_metric(scenes.anisotropy.to(poses.dtype))[..., None, None]
    along_x, along_y = m_xx * slip_x + m_xy * slip_y, m_xy * slip_x + m_yy * slip_y
    squared = along_x * slip_x + along_y * slip_y + spin.square() + LEAST_SLIP**2
    over = scenes.feet.shares / squared.sqrt()
    weight = mass * GRAVITY * scenes.table_friction.to(poses.dtype)[:, None]
    friction_x, friction_y = (over * along_x).sum(-1) * weight, (over * along_y).sum(-1) * weight
    torque = (over * (arms[..., 0] * along_y - arms[..., 1] * along_x + scenes.feet.radii * spin)).sum(-1) * weight
    acceleration = (motions - last_motions) / FRAME**2
    force_x = friction_x + mass * acceleration[..., 0]
    force_y = friction_y + mass * acceleration[..., 1]
    torque = torque + mass * scenes.gyration.to(poses.dtype) * acceleration[..., 2]
    x, y = (middle[..., axis] - tool[:, None, axis] for axis in (0, 1))
    moment = x * force_y - y * force_x + torque
    inertia = mass * acceleration[..., :2].norm(dim=-1)
    way = motions[..., :2].norm(dim=-1)
    creep = CREEP + BLURRED * blur[:, None]
    creeping = torch.where(way > STILL, weight * torch.exp(-way / creep), 0.0)
    wrench = -torch.stack((force_x.sum(1), force_y.sum(1), moment.sum(1)), -1)
    return ToolWrench(wrench, inertia.sum(1) + creeping.sum(1))
