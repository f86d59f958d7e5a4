"""A short step of boards among boxes: contacts are found, the velocity is solved, the board moves by it."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose_3d
from pushgraph.contact_axes import axes_between
from pushgraph.contact_patch import contact_patch
from pushgraph.graph.lever_batch import LeverBatch, LeverState, displacement
from pushgraph.network.body_problem import SOFTNESS, BodyProblem, solve_body

MARGIN = 2e-3
"""Boxes nearer than this (m), and than what they may move in a step, may touch in it."""
RECOVERY = 0.2
"""Share of an overlap that is to be undone in a step."""
REST = 2e-3
"""m/s: what is not faster after a step from rest, and is not touched by the tool, stays at rest."""
FEW = 16
"""Fewer boards than this are not worth compiling for, which takes a quarter of a minute once on a machine."""
CONSTANTS = {"softness": SOFTNESS, "recovery": RECOVERY, "rest": REST}
"""What predictions depend on."""


class Contacts(NamedTuple):
    """Points where boards may touch boxes, of all scenes. normal: from the board to the box. point: on the box, world.
    other: how fast the box moves there (m/s)."""

    scene: Int[Tensor, " contacts"]
    box: Int[Tensor, " contacts"]
    normal: Float[Tensor, "contacts 3"]
    point: Float[Tensor, "contacts 3"]
    gap: Float[Tensor, " contacts"]
    other: Float[Tensor, "contacts 3"]


def step(
    state: LeverState,
    tool: Float[Tensor, "batch 7"],
    next_tool: Float[Tensor, "batch 7"],
    seconds: float,
    wrench: Float[Tensor, "batch 6"] | None = None,
) -> LeverState:
    """Move boards on while tools move from one pose to the next.

    wrench: force (N) and torque (N m), world axes, that acts on boards besides gravity and contacts.
    Boards at rest that tools do not touch stay as they are, bit for bit. Differentiable in the pose, the velocity and
    the wrench, at the contacts there are.
    """
    if _can_be_compiled(state, wrench):
        # Not before it is used: importing numba takes a second.
        from pushgraph.network.compiled.body_step import solve_step

        return solve_step(state, tool, next_tool, seconds, wrench)
    scenes, pose = state.scenes, state.pose
    contacts = find_contacts(scenes, pose.detach(), state.velocity.detach(), tool, next_tool, seconds)
    matrix = pose_3d.rotation_matrix(pose.detach()[:, 3:])
    inertia = (matrix * scenes.inertia[:, None]) @ matrix.mT
    mass_matrix = pose.new_zeros(len(pose), 6, 6)
    mass_matrix[:, :3, :3] = torch.diag_embed(scenes.mass[:, None].expand(-1, 3))
    mass_matrix[:, 3:, 3:] = inertia
    inverse = (matrix / scenes.inertia[:, None]) @ matrix.mT
    turning = state.velocity[:, 3:]
    momentum = (inertia @ turning[..., None])[..., 0]
    torque = -pose_3d.cross(turning, momentum)
    force = torch.zeros_like(torque)
    if wrench is not None:
        force, torque = force + wrench[:, :3], torque + wrench[:, 3:]
    faster = torch.cat((scenes.gravity + force / scenes.mass[:, None], (inverse @ torque[..., None])[..., 0]), -1)
    free = state.velocity + seconds * faster
    problem = _problem(scenes, pose.detach(), contacts, mass_matrix, inverse, free, seconds)
    velocity = solve_body(problem, state.velocity)
    return _moved(state, velocity, _is_touched(scenes, contacts), seconds)


def _can_be_compiled(state: LeverState, wrench: Tensor | None) -> bool:
    """Whether boards are many, no gradients are wanted, and tensors are on a processor."""
    if len(state.pose) < FEW:
        return False
    tensors = [state.pose, state.velocity] if wrench is None else [state.pose, state.velocity, wrench]
    wanted = torch.is_grad_enabled() and any(values.requires_grad for values in tensors)
    return not wanted and all(values.device.type == "cpu" and values.dtype == torch.float64 for values in tensors)


def find_contacts(
    scenes: LeverBatch,
    pose: Float[Tensor, "batch 7"],
    velocity: Float[Tensor, "batch 6"],
    tool: Float[Tensor, "batch 7"],
    next_tool: Float[Tensor, "batch 7"],
    seconds: float,
) -> Contacts:
    """Where boards touch boxes, or may within a step."""
    boxes = scenes.boxes_with(tool)
    moves = displacement(tool, next_tool) / seconds
    at_box = boxes[..., :3] - tool[:, None, :3]
    swing = moves[:, None, :3] + pose_3d.cross(moves[:, None, 3:], at_box)
    radius, board_radius = scenes.half.norm(dim=-1), scenes.board_half.norm(dim=-1)
    box_speed = swing.norm(dim=-1) + moves[:, None, 3:].norm(dim=-1) * radius
    board_speed = velocity[:, :3].norm(dim=-1) + velocity[:, 3:].norm(dim=-1) * board_radius
    margin = MARGIN + seconds * (torch.where(scenes.of_tool, box_speed, 0.0) + board_speed[:, None])
    near = (boxes[..., :3] - pose[:, None, :3]).norm(dim=-1) < radius + board_radius[:, None] + margin
    scene, box = (near & scenes.present).nonzero(as_tuple=True)
    pairs = pose[scene], scenes.board_half[scene], boxes[scene, box], scenes.half[scene, box]
    close = axes_between(*pairs).gap.amax(-1) < margin[scene, box]
    scene, box = scene[close], box[close]
    board, board_half, place, half = (values[close] for values in pairs)
    patch = contact_patch(board, board_half, place, half)
    pair, _ = slots = (patch.touches & (patch.gap < margin[scene, box][:, None])).nonzero(as_tuple=True)
    point, scene, box = patch.point[slots], scene[pair], box[pair]
    other = moves[scene, :3] + pose_3d.cross(moves[scene, 3:], point - tool[scene, :3])
    other = torch.where(scenes.of_tool[scene, box, None], other, 0.0)
    return Contacts(scene, box, patch.normal[pair], point, patch.gap[slots], other)


def _problem(
    scenes: LeverBatch,
    pose: Float[Tensor, "batch 7"],
    contacts: Contacts,
    mass_matrix: Float[Tensor, "batch 6 6"],
    inverse: Float[Tensor, "batch 3 3"],
    free: Float[Tensor, "batch 6"],
    seconds: float,
) -> BodyProblem:
    arm = contacts.point - pose[contacts.scene, :3]
    # Rows: how the point moves, v + omega x arm.
    identity = torch.eye(3, dtype=arm.dtype, device=arm.device)
    lever = torch.stack([pose_3d.cross(axis.expand_as(arm), arm) for axis in identity], -1)
    jacobian = torch.cat((identity.expand(len(arm), 3, 3), lever), -1)
    lightness = 1 / scenes.mass[contacts.scene]
    lightness = lightness + (lever @ inverse[contacts.scene] * lever).sum((-2, -1)) / 3
    apart = -contacts.gap / seconds * torch.where(contacts.gap < 0, RECOVERY, 1.0)
    return BodyProblem(
        mass_matrix=mass_matrix,
        free=free,
        scene=contacts.scene,
        jacobian=jacobian,
        push=-contacts.normal,
        aim=contacts.other - apart[:, None] * contacts.normal,
        friction=scenes.friction[contacts.scene, contacts.box],
        softness=SOFTNESS * lightness,
    )


def _is_touched(scenes: LeverBatch, contacts: Contacts) -> Bool[Tensor, " batch"]:
    """Whether the tool is near enough to a board to touch it in this step."""
    by_tool = scenes.of_tool[contacts.scene, contacts.box]
    count = torch.zeros_like(scenes.mass).index_add(0, contacts.scene, by_tool.to(scenes.mass))
    return count > 0


def _moved(
    state: LeverState, velocity: Float[Tensor, "batch 6"], touched: Bool[Tensor, " batch"], seconds: float
) -> LeverState:
    speed = velocity[:, :3].norm(dim=-1) + velocity[:, 3:].norm(dim=-1) * state.scenes.board_half.norm(dim=-1)
    rests = ~touched & (state.velocity == 0).all(-1) & (speed < REST)
    turn = pose_3d.from_rotation_vector(seconds * velocity[:, 3:])
    position = state.pose[:, :3] + seconds * velocity[:, :3]
    moved = pose_3d.normalized(torch.cat((position, pose_3d.multiply(turn, state.pose[:, 3:])), -1))
    return LeverState(
        state.scenes,
        torch.where(rests[:, None], state.pose, moved),
        torch.where(rests[:, None], torch.zeros_like(velocity), velocity),
    )
