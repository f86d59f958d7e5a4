"""Joints that are held: by hand for two bodies, for chains, and without touching anything else."""

import math

import pytest
import torch
from scenes import body

from pushgraph.body import Joint
from pushgraph.graph.contact_graph import contact_graph, in_frame
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import Control, start
from pushgraph.network.joint_projection import hold_joints
from pushgraph.scene import Scene


def graph_of(scene: Scene):
    rows = [torch.tensor([row], dtype=torch.float64) for row in ((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))]
    poses = torch.tensor(scene.poses_world_from_body[None])
    return contact_graph(start(batch_scenes([scene]), poses), Control(*rows, torch.tensor([True])))


def row(*joints: Joint, masses=(0.5, 1.5, 0.3)) -> Scene:
    return Scene(
        bodies=tuple(body(n, 0.13 * k, 0.0, mass=m) for k, (n, m) in enumerate(zip("abc", masses, strict=True))),
        joints=joints,
    )


def parting(graph, twist: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """What every joint edge leaves between its anchors, contact frame, and between its angles, in steps."""
    joints = (graph.slack_axis != 0).any(-1).nonzero().squeeze(-1)
    ends = [in_frame(twist[end[joints]], graph.normal[joints]) for end in (graph.receiver, graph.sender)]
    points = []
    for end, levers in zip(ends, (graph.receiver_levers, graph.sender_levers), strict=True):
        x, y = levers[joints, 2].unbind(-1)
        points.append(end[:, :2] + end[:, 2:] * torch.stack((-y, x), -1))
    return graph.offsets[joints, 2] + points[1] - points[0], graph.turn[joints] + ends[1][:, 2] - ends[0][:, 2]


def test_a_hinge_is_closed_and_momentum_kept() -> None:
    graph = graph_of(row(Joint(kind="revolute", parent="a", child="b", anchor=(0.065, 0.03))))
    twist = torch.randn(graph.twist.shape, generator=torch.Generator().manual_seed(0)) * ~graph.kinematic[:, None]
    assert parting(graph, twist)[0].abs().max() > 0.1
    held = hold_joints(graph, twist)
    torch.testing.assert_close(parting(graph, held)[0], torch.zeros(2, 2), atol=1e-5, rtol=0)
    mass = graph.nodes[:, :1].exp()
    torch.testing.assert_close((mass * held[:, :2]).sum(0), (mass * twist[:, :2]).sum(0), atol=1e-5, rtol=0)


def test_a_slider_keeps_its_angle_and_its_line_and_slides_freely() -> None:
    graph = graph_of(row(Joint(kind="prismatic", parent="a", child="b", axis=(math.cos(0.3), math.sin(0.3)))))
    twist = torch.randn(graph.twist.shape, generator=torch.Generator().manual_seed(1)) * ~graph.kinematic[:, None]
    held = hold_joints(graph, twist)
    apart, turned = parting(graph, held)
    axis = graph.slack_axis[(graph.slack_axis != 0).any(-1), :2]
    across = torch.stack((-axis[:, 1], axis[:, 0]), -1)
    assert float((apart * across).sum(-1).abs().max()) < 0.02
    assert float(turned.abs().max()) < 0.02
    before = parting(graph, twist)[0]
    assert float((before * axis).sum(-1)[0].abs()) > 0.1
    straight = graph_of(row(Joint(kind="prismatic", parent="a", child="b", axis=(1.0, 0.0))))
    free = torch.zeros(len(straight.nodes), 3)
    free[0, 0] = 0.3
    torch.testing.assert_close(hold_joints(straight, free), free)


def test_a_chain_is_nearly_closed() -> None:
    graph = graph_of(
        row(
            Joint(kind="revolute", parent="a", child="b", anchor=(0.065, 0.03)),
            Joint(kind="revolute", parent="b", child="c", anchor=(0.195, -0.02)),
        )
    )
    twist = torch.randn(graph.twist.shape, generator=torch.Generator().manual_seed(0)) * ~graph.kinematic[:, None]
    before, after = (parting(graph, t)[0].norm(dim=-1).max() for t in (twist, hold_joints(graph, twist)))
    assert after < 0.2 * before


@pytest.mark.parametrize("kind", [None, "revolute"])
def test_what_has_no_joint_keeps_its_twist_bit_for_bit(kind) -> None:
    joints = () if kind is None else (Joint(kind=kind, parent="a", child="b"),)
    graph = graph_of(row(*joints).replace(bodies=(*row().bodies, body("d", 0.0, 0.125))))
    twist = torch.randn(graph.twist.shape, generator=torch.Generator().manual_seed(0))
    held = hold_joints(graph, twist)
    joined = torch.zeros(len(twist), dtype=torch.bool)
    edges = (graph.slack_axis != 0).any(-1)
    joined[graph.receiver[edges]] = True
    assert torch.equal(held[~joined], twist[~joined])
    assert int(joined.sum()) == (0 if kind is None else 2)
