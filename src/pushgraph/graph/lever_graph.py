"""The graph of scenes in space: every box a node, an edge where the surfaces of the board and a box are near.

All vectors are in the frame of the box that they are told to, so nothing depends on where a scene stands or how it is
turned, and nothing on the signs of quaternions; which way gravity points is a feature.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose_3d
from pushgraph.contact_3d import contact_between
from pushgraph.contact_axes import axes_between
from pushgraph.graph.lever_batch import LeverState, displacement
from pushgraph.track_frames import FRAME

NEAR = 0.02
"""Boxes whose surfaces are nearer than this share two edges (m)."""
REACH = 0.002
"""A tool nearer than this may touch (m)."""
LENGTH, GAP, DISPLACEMENT, TURN = 0.1, 0.005, 0.001, 0.02
"""Units of positions and sizes, of gaps, of motions in a frame (m), of turns in a frame (rad)."""

NODE_FEATURES = (
    *("board", "of_tool", "fixed"),
    *("size_x", "size_y", "size_z"),
    *("velocity_x", "velocity_y", "velocity_z", "turning_x", "turning_y", "turning_z"),
    *("gravity_x", "gravity_y", "gravity_z"),
)
EDGE_FEATURES = (
    *("gap", "friction"),
    *("point_x", "point_y", "point_z"),
    *("normal_x", "normal_y", "normal_z"),
    *("control_x", "control_y", "control_z"),
    *("turn_x", "turn_y", "turn_z"),
)
CONSTANTS = {"near": NEAR, "length": LENGTH, "gap": GAP, "displacement": DISPLACEMENT, "turn": TURN}
"""What the weights depend on beside the features' names."""


class LeverGraph(NamedTuple):
    """One flat graph of many scenes; the first nodes are the boards. touched: boards that a tool may touch, or that
    move."""

    nodes: Float[Tensor, "nodes node_features"]
    edges: Float[Tensor, "edges edge_features"]
    receiver: Int[Tensor, " edges"]
    sender: Int[Tensor, " edges"]
    touched: Bool[Tensor, " batch"]


def lever_graph(state: LeverState, tool: Float[Tensor, "batch 7"], next_tool: Float[Tensor, "batch 7"]) -> LeverGraph:
    """The graph of one frame. tool, next_tool: pose_world_from_tool at its start and end."""
    scenes, board = state.scenes, state.pose
    boxes, batch = scenes.boxes_with(tool), len(board)
    scene, box = scenes.present.nonzero(as_tuple=True)
    number = torch.full_like(scenes.present, -1, dtype=torch.long)
    number[scene, box] = batch + torch.arange(len(scene), device=scene.device)

    # How boxes move, about the origin of the tool; only those of the tool do.
    moves = displacement(tool, next_tool)
    poses = torch.cat((board, boxes[scene, box]))
    of_tool = torch.cat((torch.zeros(batch, dtype=torch.bool, device=board.device), scenes.of_tool[scene, box]))
    owner = torch.cat((torch.arange(batch, device=scene.device), scene))
    carried = moves[owner, :3] + pose_3d.cross(moves[owner, 3:], poses[:, :3] - tool[owner, :3])
    motion = torch.cat((carried, moves[owner, 3:]), -1) * of_tool[:, None]
    motion = torch.cat((state.velocity * FRAME, motion[batch:]))

    back = pose_3d.conjugate(poses[:, 3:])
    is_board = torch.arange(len(poses), device=board.device) < batch
    half = torch.cat((scenes.board_half, scenes.half[scene, box]))
    gravity = scenes.gravity / scenes.gravity.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    nodes = torch.cat(
        (
            torch.stack((is_board, of_tool, ~is_board & ~of_tool), -1).to(board),
            half / LENGTH,
            pose_3d.rotate(motion[:, :3], back) / DISPLACEMENT,
            pose_3d.rotate(motion[:, 3:], back) / TURN,
            pose_3d.rotate(gravity[owner], back),
        ),
        -1,
    )

    pairs = board[scene], scenes.board_half[scene], boxes[scene, box], scenes.half[scene, box]
    near = axes_between(*pairs).gap.amax(-1) < NEAR
    scene, box = scene[near], box[near]
    contact = contact_between(*(values[near] for values in pairs))
    node, friction = number[scene, box], scenes.friction[scene, box]
    ends = ((scene, node, contact.point_b, contact.normal), (node, scene, contact.point_a, -contact.normal))
    edges = []
    for receiver, sender, point, normal in ends:
        to = back[receiver]
        at_sender = motion[sender, :3] + pose_3d.cross(motion[sender, 3:], point - poses[sender, :3])
        at_receiver = motion[receiver, :3] + pose_3d.cross(motion[receiver, 3:], point - poses[receiver, :3])
        edges.append(
            torch.cat(
                (
                    torch.stack((contact.gap / GAP, friction), -1),
                    pose_3d.rotate(point - poses[receiver, :3], to) / LENGTH,
                    pose_3d.rotate(normal, to),
                    pose_3d.rotate(at_sender - at_receiver, to) / DISPLACEMENT,
                    pose_3d.rotate(motion[sender, 3:], to) / TURN,
                ),
                -1,
            )
        )
    meets = (contact.gap < REACH + moves[scene].norm(dim=-1)) & scenes.of_tool[scene, box]
    touched = (state.velocity != 0).any(-1).index_fill(0, scene[meets], True)
    receivers, senders = torch.cat((scene, node)), torch.cat((node, scene))
    return LeverGraph(nodes, torch.cat(edges), receivers, senders, touched)
