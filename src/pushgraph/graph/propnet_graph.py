"""The graph of `propnet`, the paper's: every body and tool part a node, an edge where centres are near."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.broad_phase import node_poses, node_shapes, part_motions
from pushgraph.graph.pieces import Pieces, gather_pieces
from pushgraph.graph.scene_batch import pair_index
from pushgraph.graph.state import Control, State
from pushgraph.scene import NOMINAL_MASS

NEAR = 0.35
"""Nodes whose centres are nearer than this share two edges (m)."""
LENGTH, SIZE, DISPLACEMENT = 0.1, 0.1, 0.01
"""Units of positions, sizes and of motions in a frame (m), in which features are of order one."""
TURN = DISPLACEMENT / 0.05
"""Unit of turns in a frame (rad)."""

NODE_FEATURES = ("velocity_x", "velocity_y", "velocity_yaw", "kinematic", "cylinder", "mass", "size_x", "size_y")
EDGE_FEATURES = (
    *("x", "y", "sin_2_yaw", "cos_2_yaw"),
    *("velocity_difference_x", "velocity_difference_y", "velocity_difference_yaw"),
    *("control_x", "control_y", "control_yaw"),
    *(f"{end}_{what}" for end in ("receiver", "sender") for what in ("cylinder", "size_x", "size_y")),
    *("none", "fixed", "prismatic", "revolute"),
)
CONSTANTS = {"near": NEAR, "length": LENGTH, "size": SIZE, "displacement": DISPLACEMENT, "turn": TURN}
"""What the weights depend on beside the features' names."""


class PropnetGraph(NamedTuple):
    """One flat graph of many scenes. slot: which of [batch * (bodies + parts)] a node is.

    relation: where an edge stands in [batch * pairs * 2], the pair's later body being the receiver of the second; -1
    for those of the tool.
    """

    nodes: Float[Tensor, "nodes node_features"]
    edges: Float[Tensor, "edges edge_features"]
    receiver: Int[Tensor, " edges"]
    sender: Int[Tensor, " edges"]
    slot: Int[Tensor, " nodes"]
    yaw: Float[Tensor, " nodes"]
    relation: Int[Tensor, " edges"]
    pieces: Pieces


def propnet_graph(state: State, control: Control) -> PropnetGraph:
    """Build the graph of one frame; the tool's parts are in it only while it is down."""
    scenes, poses = state.scenes, state.poses
    batch, bodies = poses.shape[:2]
    parts = scenes.parts.radius.shape[1]
    width = bodies + parts
    all_poses = node_poses(state, control).flatten(0, 1)
    velocity = torch.cat((state.motions, part_motions(state, control, control.last_motion)), 1).flatten(0, 1)
    steer = torch.cat((torch.zeros_like(state.motions), part_motions(state, control, control.motion)), 1)
    steer = steer.flatten(0, 1)
    half_extents, radius = (values.flatten(0, 1) for values in node_shapes(scenes))
    size = 2 * (half_extents + radius[:, None]) / SIZE
    cylinder = (radius > 0).float()
    mass = torch.cat((scenes.mass / NOMINAL_MASS, torch.zeros_like(scenes.parts.radius)), 1).flatten()
    kinematic = torch.arange(width, device=poses.device).repeat(batch) >= bodies

    present = torch.cat((scenes.present, scenes.part_present & control.down[:, None]), 1)
    flat = all_poses.view(batch, width, 3)
    apart = (flat[:, :, None, :2] - flat[:, None, :, :2]).square().sum(-1)
    near = (apart < NEAR**2) & present[:, :, None] & present[:, None, :]
    near &= ~torch.eye(width, dtype=torch.bool, device=poses.device)
    near[:, bodies:] = False  # what the tool's parts feel moves nothing
    scene, receiver, sender = near.nonzero(as_tuple=True)
    kind = torch.zeros_like(scene)
    both = sender < bodies
    low, high = torch.minimum(receiver, sender)[both], torch.maximum(receiver, sender)[both]
    pair = pair_index(low, high, bodies)
    kind[both] = state.relations.kind[scene[both], pair]
    relation = torch.full_like(scene, -1)
    relation[both] = 2 * (scene[both] * state.relations.kind.shape[1] + pair) + (receiver[both] == high)
    receiver, sender = scene * width + receiver, scene * width + sender

    unit = velocity.new_tensor([DISPLACEMENT, DISPLACEMENT, TURN])
    relative = pose.relative(all_poses[receiver], all_poses[sender]).float()
    turn = -all_poses[receiver, 2]
    edges = torch.cat(
        (
            relative[:, :2] / LENGTH,
            (2 * relative[:, 2:]).sin(),
            (2 * relative[:, 2:]).cos(),
            (_turned(velocity[sender] - velocity[receiver], turn) / unit).float(),
            (_turned(steer[sender], turn) / unit).float(),
            cylinder[receiver, None],
            size[receiver],
            cylinder[sender, None],
            size[sender],
            torch.nn.functional.one_hot(kind, 4).float(),
        ),
        -1,
    )
    own = (_turned(velocity, -all_poses[:, 2]) / unit).float()
    nodes = torch.cat((own, torch.stack((kinematic.float(), cylinder, mass), -1), size), -1)
    slot = present.flatten().nonzero().squeeze(-1)
    place = present.flatten().cumsum(0) - 1
    return PropnetGraph(
        nodes=nodes[slot].float(),
        edges=edges.float(),
        receiver=place[receiver],
        sender=place[sender],
        slot=slot,
        yaw=all_poses[slot, 2],
        relation=relation,
        pieces=gather_pieces(scenes, scenes.group, poses),
    )


def _turned(twist: Tensor, yaw: Tensor) -> Tensor:
    return torch.cat((pose.rotate(twist[..., :2], yaw), twist[..., 2:]), -1)
