"""Graphs: hand-worked features, and the laws that hold for any weights."""

import math

import numpy as np
import pytest
import torch
from scenes import body, workshop

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.graph.contact_graph import EDGE_FEATURES, LEVER, NODE_FEATURES, contact_graph
from pushgraph.graph.near import MARGIN, within_reach
from pushgraph.graph.pieces import gather_pieces, move_pieces, piece_index
from pushgraph.graph.propnet_graph import EDGE_FEATURES as PROPNET_EDGES
from pushgraph.graph.propnet_graph import propnet_graph
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes, pair_index, pairs_of, pairs_with_parts, remember
from pushgraph.graph.state import ADJACENT, Control, start
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Part, Tool


def state_of(*scenes: Scene):
    poses = torch.tensor(np.stack([scene.poses_world_from_body for scene in scenes]))
    return start(batch_scenes(scenes), poses)


def control(tool, motion, down: bool = True, batch: int = 1) -> Control:
    rows = [torch.tensor([values] * batch, dtype=torch.float64) for values in (tool, motion, (0.0, 0.0, 0.0))]
    return Control(*rows, torch.full((batch,), down))


def row_of_three() -> Scene:
    """Discs of radius 6 cm: the second 5 mm behind the first, the third far away."""
    return Scene(bodies=(body("first", 0.0, 0.0), body("second", 0.125, 0.0, mass=1.2), body("far", 0.6, 0.0)))


def test_a_graph_of_three_nodes_worked_by_hand() -> None:
    step = 0.01
    graph = contact_graph(state_of(row_of_three()), control((-0.111, 0.0, 0.0), (step, 0.0, 0.0)))
    assert graph.nodes.shape == (3, len(NODE_FEATURES))  # the far disc is not there
    by_mass = {round(float(mass), 3): k for k, mass in enumerate(graph.nodes[:, NODE_FEATURES.index("mass")].exp())}
    tool = int(graph.kinematic.nonzero())
    first, second = by_mass[round(0.5 / 0.6, 3)], by_mass[2.0]
    torch.testing.assert_close(graph.twist[tool], torch.tensor([1.0, 0.0, 0.0]))
    assert not graph.twist[[first, second]].any()
    edges = {(int(r), int(s)): k for k, (r, s) in enumerate(zip(graph.receiver, graph.sender, strict=True))}
    assert set(edges) == {(first, tool), (first, second), (second, first)}

    def feature(edge: tuple[int, int], name: str) -> float:
        return float(graph.edges[edges[edge], EDGE_FEATURES.index(name)])

    # The pusher, of radius 5 cm, is 1 mm from the first disc, which is 5 mm from the second.
    for edge, gap, normal, kinematic in (
        ((first, tool), 0.001, -1.0, 1.0),
        ((first, second), 0.005, 1.0, 0.0),
        ((second, first), 0.005, -1.0, 0.0),
    ):
        assert feature(edge, "gap_1_steps") == pytest.approx(gap / step, abs=1e-4)
        assert feature(edge, "gap_1") == pytest.approx(math.tanh(gap / 0.01), abs=1e-4)
        assert feature(edge, "sender_kinematic") == kinematic
        torch.testing.assert_close(graph.normal[edges[edge]], torch.tensor([normal, 0.0]), atol=1e-6, rtol=0)
        assert feature(edge, "receiver_lever_1_x") == pytest.approx(0.06 / LEVER, abs=1e-4)
        assert feature(edge, "receiver_lever_1_y") == pytest.approx(0.0, abs=1e-5)
    assert feature((first, tool), "sender_lever_1_x") == pytest.approx(-0.05 / LEVER, abs=1e-4)
    reach = MARGIN + 2 * step
    assert feature((first, tool), "fade") == pytest.approx(min(1.0, (reach - 0.001) / (reach / 3)))


def test_pairs_of_bodies_come_before_those_of_bodies_and_parts() -> None:
    assert pairs_with_parts(3, 2).T.tolist() == [
        *([0, 1], [0, 2], [1, 2]),
        *([0, 3], [0, 4], [1, 3], [1, 4], [2, 3], [2, 4]),
    ]


def test_edges_fade_to_nothing_before_they_vanish() -> None:
    step, reach = 0.01, MARGIN + 0.02
    fades = []
    for gap in np.linspace(0.5 * reach, 1.05 * reach, 40):
        graph = contact_graph(state_of(row_of_three()), control((-0.11 - gap, 0.0, 0.0), (step, 0.0, 0.0)))
        edge = graph.edges[graph.edges[:, EDGE_FEATURES.index("sender_kinematic")] > 0]
        fades.append(float(edge[0, 0]) if len(edge) else 0.0)
    assert fades[0] == 1
    assert fades[-1] == 0
    assert np.all(np.diff(fades) <= 1e-6)
    assert np.abs(np.diff(fades)).max() < 0.06


@pytest.mark.parametrize(("down", "motion"), [(True, (0.0, 0.0, 0.0)), (False, (0.01, 0.0, 0.0))])
def test_a_tool_that_rests_or_is_lifted_meets_nothing(down, motion) -> None:
    graph = contact_graph(state_of(row_of_three()), control((-0.111, 0.0, 0.0), motion, down))
    assert len(graph.nodes) == 0


def test_every_part_of_a_tool_has_its_edge_and_the_tool_is_one_node() -> None:
    wide = Tool(parts=tuple(Part(shape=Cylinder(diameter=0.04), pose_tool_from_part=(0, y, 0)) for y in (-0.02, 0.02)))
    scene = row_of_three().replace(tool=wide)
    graph = contact_graph(state_of(scene), control((-0.08, 0.0, 0.0), (0.01, 0.0, 0.0)))
    assert int(graph.kinematic.sum()) == 1
    assert int((graph.edges[:, EDGE_FEATURES.index("sender_kinematic")] > 0).sum()) == 2


def test_joints_are_told_alike_from_either_end() -> None:
    discs = (body("a", 0.0, 0.0), body("b", 0.13, 0.02, Cuboid(size=(0.1, 0.08)), yaw=0.4))
    place = {"anchor": (0.07, 0.01), "limits": (-0.3, 0.9)}
    there = Scene(bodies=discs, joints=(Joint(kind="revolute", parent="a", child="b", **place),))
    back = Scene(
        bodies=discs, joints=(Joint(kind="revolute", parent="b", child="a", anchor=(0.07, 0.01), limits=(-0.9, 0.3)),)
    )
    for one, other in zip(batch_scenes([there]).relations, batch_scenes([back]).relations, strict=True):
        torch.testing.assert_close(one, other)
    slider = {"anchor": (0.07, 0.01), "limits": (-0.01, 0.05)}
    there = Scene(bodies=discs, joints=(Joint(kind="prismatic", parent="a", child="b", axis=(1.0, 0.0), **slider),))
    back = Scene(bodies=discs, joints=(Joint(kind="prismatic", parent="b", child="a", axis=(-1.0, 0.0), **slider),))
    for one, other in zip(batch_scenes([there]).relations, batch_scenes([back]).relations, strict=True):
        torch.testing.assert_close(one, other)


def test_drift_turn_and_slack_of_a_hinge_by_hand() -> None:
    scene = Scene(
        bodies=(body("a", 0.0, 0.0), body("b", 0.13, 0.0)),
        joints=(Joint(kind="revolute", parent="a", child="b", anchor=(0.065, 0.0), limits=(-0.5, 1.0)),),
    )
    state = start(batch_scenes([scene]), torch.tensor(scene.poses_world_from_body[None]))
    # b turns by 0.2 rad about the anchor, and slips by 1 mm along y.
    turned = np.array([0.065 + 0.065 * math.cos(0.2), 0.065 * math.sin(0.2) + 0.001, 0.2])
    state = state.observe(torch.tensor(np.array([[scene.poses_world_from_body[0], turned]])))
    step = 0.01
    graph = contact_graph(state, control((-0.111, 0.0, 0.0), (step, 0.0, 0.0)))
    for k in range(len(graph.edges)):
        if graph.kinematic[graph.sender[k]]:
            continue
        forth = bool(graph.receiver_levers[k, 2, 0] > 0) and graph.normal[k, 0] > 0  # receiver a
        x, y = graph.normal[k]
        drift = torch.stack((0.001 * y, 0.001 * x)) if forth else -torch.stack((0.001 * y, 0.001 * x))
        torch.testing.assert_close(graph.offsets[k, 2], drift / step, atol=1e-4, rtol=0)
        assert float(graph.turn[k]) == pytest.approx((1 if forth else -1) * 0.2 * LEVER / step, abs=1e-4)
        room = (0.7, 0.8) if forth else (0.8, 0.7)
        torch.testing.assert_close(
            graph.slack[k], (torch.tensor(room) * LEVER / step).clamp(max=4.0), atol=1e-3, rtol=0
        )


def test_unknown_pairs_remember_where_they_first_met() -> None:
    scene = row_of_three().replace(unknown_pairs="unlisted")
    state = state_of(scene)
    a, b = pairs_of(3)
    met = dict(zip(zip(a.tolist(), b.tolist(), strict=True), state.relations.remembered[0].tolist(), strict=True))
    assert met == {(0, 1): True, (0, 2): False, (1, 2): False}
    torch.testing.assert_close(state.relations.anchor_a[0, 0], torch.tensor([0.0625, 0.0]))
    torch.testing.assert_close(state.relations.anchor_b[0, 0], torch.tensor([-0.0625, 0.0]))
    later = state.observe(torch.tensor([[[0.0, 0.0, 0.0], [0.4, 0.0, 0.3], [0.53, 0.0, 0.0]]], dtype=torch.float64))
    torch.testing.assert_close(later.relations.anchor_b[0, 0], torch.tensor([-0.0625, 0.0]))  # kept
    assert later.relations.remembered[0, pair_index(1, 2, 3)]
    assert float(later.relations.yaw_offset[0, pair_index(1, 2, 3)]) == pytest.approx(-0.3)


def test_asking_only_about_what_moved_remembers_the_same() -> None:
    track = draw_trajectory("multiple-parts", 6, seed=3, index=0).track
    state = state_of(track.scene.replace(joints=(), unknown_pairs="unlisted"))
    relations, begun = state.relations, int(state.relations.remembered.sum())
    for poses in torch.tensor(track.poses[1:, None, 1:]):
        state = state.observe(poses)
        relations = remember(state.scenes, relations, poses, ADJACENT)
    assert int(state.relations.remembered.sum()) > begun
    assert all(torch.equal(ours, all_asked) for ours, all_asked in zip(state.relations, relations, strict=True))


def test_what_the_tool_can_reach_is_what_a_chain_of_near_bodies_ties_to_it() -> None:
    push = control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0))
    assert within_reach(state_of(row_of_three()), push).may_move.tolist() == [[True, True, False]]
    joined = row_of_three().replace(joints=(Joint(kind="revolute", parent="second", child="far"),))
    assert within_reach(state_of(joined), push).may_move.all()
    away = control((-0.2, 0.0, 0.0), (0.01, 0.0, 0.0))
    lifted = control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0), down=False)
    for nothing in (away, lifted):
        assert not within_reach(state_of(row_of_three()), nothing).may_move.any()


def test_an_extended_slider_that_nobody_told_of_keeps_its_edge() -> None:
    scene = row_of_three().replace(unknown_pairs=(("first", "second"),))
    state = state_of(scene).observe(torch.tensor([[[0.0, 0.0, 0.0], [0.20, 0.0, 0.0], [0.6, 0.0, 0.0]]]).double())
    graph = contact_graph(state, control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0)))
    assert len(graph.edges) == 3
    assert (
        len(contact_graph(state_of(row_of_three()).observe(state.poses), control((-0.111, 0, 0), (0.01, 0, 0))).edges)
        == 1
    )


def test_pieces_are_rigid_groups_and_fixed_joints_however_long_the_chain() -> None:
    bodies = tuple(body(name, 0.121 * k, 0.0) for k, name in enumerate("fedcba"))
    joints = tuple(Joint(kind="fixed", parent=p, child=c) for p, c in ("ab", "bc", "cd"))
    scene = Scene(bodies=bodies, joints=joints, rigid_groups=(("d", "e"),))
    batch = batch_scenes([scene])
    assert piece_index(batch, batch.relations).tolist() == [[0, 1, 1, 1, 1, 1]]


def test_a_piece_turns_about_its_centre_of_mass() -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0, mass=1.0), body("b", 0.13, 0.0, mass=3.0)), rigid_groups=(("a", "b"),))
    batch, poses = batch_scenes([scene]), torch.tensor(scene.poses_world_from_body[None])
    pieces = gather_pieces(batch, piece_index(batch, batch.relations), poses[..., :2])
    torch.testing.assert_close(pieces.centre[0, 0], torch.tensor([0.0975, 0.0], dtype=torch.float64))
    assert float(pieces.mass[0, 0]) == 4
    arm = torch.tensor([0.0975, 0.0325])
    patch = (arm.square() + (2 * 0.06 / 3) ** 2).sqrt()
    assert float(pieces.patch_radius[0, 0]) == pytest.approx(float((patch * torch.tensor([0.25, 0.75])).sum()))
    twist = torch.zeros(1, 2, 3, dtype=torch.float64)
    twist[0, 0] = torch.tensor([0.01, 0.0, math.pi / 2])
    moved = poses + move_pieces(pieces, poses, twist)
    expected = torch.tensor([[[0.1075, -0.0975, math.pi / 2], [0.1075, 0.0325, math.pi / 2]]], dtype=torch.float64)
    torch.testing.assert_close(moved, expected)


def test_propnet_joins_what_is_near_whatever_lies_between() -> None:
    scene = row_of_three().replace(joints=(Joint(kind="fixed", parent="second", child="first"),))
    graph = propnet_graph(state_of(scene), control((-0.111, 0.0, 0.3), (0.01, 0.0, 0.0)))
    assert len(graph.nodes) == 4
    pairs = set(zip(graph.receiver.tolist(), graph.sender.tolist(), strict=True))
    assert pairs == {(0, 1), (1, 0), (0, 3), (1, 3)}  # the tool is row 3, and receives nothing
    features = {
        pair: graph.edges[k] for k, pair in enumerate(zip(graph.receiver.tolist(), graph.sender.tolist(), strict=True))
    }
    fixed = PROPNET_EDGES.index("fixed")
    assert features[0, 1][fixed] == features[1, 0][fixed] == 1
    assert features[0, 3][PROPNET_EDGES.index("none")] == 1
    assert float(features[0, 3][PROPNET_EDGES.index("control_x")]) == pytest.approx(1.0)
    assert float(features[1, 0][PROPNET_EDGES.index("x")]) == pytest.approx(-1.25)


def test_batches_of_ragged_scenes_are_what_each_scene_is_alone() -> None:
    small, large = row_of_three(), workshop()
    together = batch_scenes([small, large])
    assert together.present.tolist() == [[True, True, True, False], [True] * 4]
    pair = pair_index(0, 1, 4)
    assert int(together.relations.kind[1, pair]) == JOINT_CODES["revolute"]
    alone = batch_scenes([large])
    torch.testing.assert_close(together.take(torch.tensor([1])).relations.anchor_b, alone.relations.anchor_b)


def test_an_anchor_is_where_the_scene_puts_it() -> None:
    scene = workshop()
    relations = batch_scenes([scene]).relations
    pair = pair_index(0, 1, 4)
    poses = torch.tensor(scene.poses_world_from_body)
    for body_index, anchors in ((0, relations.anchor_a), (1, relations.anchor_b)):
        world = pose.transform(poses[body_index], anchors[0, pair].double())
        torch.testing.assert_close(world, torch.tensor([0.06, 0.0525], dtype=torch.float64), atol=1e-7, rtol=0)
