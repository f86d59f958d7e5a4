"""Graphs: hand-worked features, and the laws that hold for any weights."""

import math

import numpy as np
import pytest
import torch
from scenes import body, workshop

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.graph.broad_phase import LEVER, MARGIN, reachable
from pushgraph.graph.contact_graph import contact_graph
from pushgraph.graph.pieces import gather_pieces, move_pieces, piece_index
from pushgraph.graph.propnet_graph import EDGE_FEATURES as PROPNET_EDGES
from pushgraph.graph.propnet_graph import propnet_graph
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes, pair_index, pairs_of, pairs_with_parts, remember
from pushgraph.graph.state import ADJACENT, Control, start
from pushgraph.patch import mass_properties, patch_of
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.feet import feet_of
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
    nodes, contacts = graph.nodes, graph.contacts
    assert len(nodes.mass) == 3  # the far disc is not there
    tool = int(nodes.is_tool.nonzero())
    first, second = (int(k) for k in nodes.mass[~nodes.is_tool].argsort())
    assert nodes.mass[[first, second]].tolist() == pytest.approx([0.5 / 1.7, 1.2 / 1.7])
    assert nodes.given.tolist() == nodes.is_tool.tolist()
    assert nodes.last_twist[:, tool].tolist() == [1.0, 0.0, 0.0]
    assert float(nodes.inertia[0]) == pytest.approx(step / (9.81 * 0.45 * 0.05**2))
    assert float(nodes.gyration[first]) == pytest.approx(0.06**2 / 2 / LEVER**2)

    # The pusher, of radius 5 cm, is 1 mm from the first disc, which is 5 mm from the second.
    assert contacts.share.tolist() == [1, 1]
    for k, (one, other) in enumerate(zip(contacts.points.first.tolist(), contacts.points.second.tolist(), strict=True)):
        with_tool = tool in (one, other)
        assert {one, other} == ({first, tool} if with_tool else {first, second})
        assert float(contacts.gap[k]) == pytest.approx((0.001 if with_tool else 0.005) / step, abs=1e-4)
        assert contacts.normal[:, k].tolist() == pytest.approx([-1.0 if with_tool else 1.0, 0.0])
        assert float(contacts.friction[k]) == pytest.approx(0.25)
    with_tool = int((contacts.points.second == tool).nonzero())
    assert contacts.points.first_arm[:, with_tool].tolist() == pytest.approx([-0.06 / LEVER, 0.0], abs=1e-5)
    assert contacts.points.second_arm[:, with_tool].tolist() == pytest.approx([0.05 / LEVER, 0.0], abs=1e-5)
    assert graph.edges.fade.tolist() == [1, 1]


def test_feet_carry_the_weight_of_their_pieces_and_resist_a_spin_as_uniform_pressure_does() -> None:
    graph = contact_graph(state_of(row_of_three()), control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0)))
    for node in (~graph.nodes.given).nonzero().squeeze(-1):
        own = graph.feet.node == node
        weight, arm = graph.feet.weight[own], graph.feet.arm[:, own]
        assert float(weight.sum()) == pytest.approx(float(graph.nodes.mass[node]))
        assert (weight * arm).sum(1).tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
        mean_radius = (weight * (arm.square().sum(0) + graph.feet.radius[own].square()).sqrt()).sum() / weight.sum()
        assert float(mean_radius) * LEVER == pytest.approx(2 / 3 * 0.06, rel=0.03)


def test_feet_of_cuboids_and_cylinders_are_those_of_the_simulator() -> None:
    shapes = [Cuboid(size=(0.2, 0.03)), Cuboid(size=(0.05, 0.12)), Cuboid(size=(0.1, 0.1)), Cylinder(diameter=0.07)]
    scene = Scene(bodies=tuple(body(f"{k}", 0.3 * k, 0.0, shape) for k, shape in enumerate(shapes)))
    feet = batch_scenes([scene]).feet
    for k, shape in enumerate(shapes):
        expected = feet_of(patch_of([body("alone", 0.0, 0.0, shape)]))
        # Cuboids are parted exactly; the simulator parts points that stand for them.
        order = [np.lexsort(points.round(4).T) for points in (expected.points, feet.points[0, k].numpy())]
        np.testing.assert_allclose(feet.points[0, k].numpy()[order[1]], expected.points[order[0]], atol=1.5e-3)
        np.testing.assert_allclose(feet.radii[0, k].numpy()[order[1]], expected.radii[order[0]], rtol=0.05)


def test_members_of_a_piece_that_overlap_share_what_they_stand_on() -> None:
    arms = (
        body("along", 0.0, 0.0, Cuboid(size=(0.2, 0.04)), mass=1.0),
        body("across", 0.08, 0.0, Cuboid(size=(0.04, 0.2)), mass=1.0),
    )
    scene = Scene(bodies=arms, rigid_groups=(("along", "across"),))
    state = state_of(scene)
    pieces = gather_pieces(state.scenes, piece_index(state.scenes, state.relations), state.poses)
    whole = mass_properties(arms)
    torch.testing.assert_close(pieces.centre[0, 0], torch.tensor(whole.centre_of_mass), atol=1e-4, rtol=0)
    assert float(pieces.gyration[0, 0]) == pytest.approx(whole.moment_of_inertia / 2.0, rel=0.01)


def test_pairs_of_bodies_come_before_those_of_bodies_and_parts() -> None:
    assert pairs_with_parts(3, 2).T.tolist() == [
        *([0, 1], [0, 2], [1, 2]),
        *([0, 3], [0, 4], [1, 3], [1, 4], [2, 3], [2, 4]),
    ]


def test_edges_fade_to_nothing_before_they_vanish() -> None:
    step, reach = 0.01, MARGIN + 0.02
    fades = []
    for gap in np.linspace(0.3 * reach, 1.3 * reach, 40):
        graph = contact_graph(state_of(row_of_three()), control((-0.11 - gap, 0.0, 0.0), (step, 0.0, 0.0)))
        fade = graph.edges.fade[graph.edges.is_tool]
        fades.append(float(fade[0]) if len(fade) else 0.0)
    assert fades[0] == 1
    assert fades[-1] == 0
    assert np.all(np.diff(fades) <= 1e-6)
    # Circles that stand for discs are their outlines: beyond their reach there is no edge.
    assert np.sort(np.abs(np.diff(fades)))[-2] < 0.1


@pytest.mark.parametrize(("down", "motion"), [(True, (0.0, 0.0, 0.0)), (False, (0.01, 0.0, 0.0))])
def test_a_tool_that_rests_or_is_lifted_meets_nothing(down, motion) -> None:
    graph = contact_graph(state_of(row_of_three()), control((-0.111, 0.0, 0.0), motion, down))
    assert len(graph.nodes.mass) == 0


def test_every_part_of_a_tool_has_its_edge_and_the_tool_is_one_node() -> None:
    wide = Tool(parts=tuple(Part(shape=Cylinder(diameter=0.04), pose_tool_from_part=(0, y, 0)) for y in (-0.02, 0.02)))
    scene = row_of_three().replace(tool=wide)
    graph = contact_graph(state_of(scene), control((-0.08, 0.0, 0.0), (0.01, 0.0, 0.0)))
    assert int(graph.nodes.is_tool.sum()) == 1
    assert int(graph.edges.is_tool.sum()) == 2


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
    poses = torch.tensor(np.array([[scene.poses_world_from_body[0], turned]]))
    state = state.observe(poses).observe(poses)
    step = 0.01
    graph = contact_graph(state, control((-0.111, 0.0, 0.0), (step, 0.0, 0.0)))
    joints = graph.joints
    assert joints.revolute.tolist() == [True]
    assert joints.drift[:, 0].tolist() == pytest.approx([0.0, 0.1], abs=2e-3)
    assert float(joints.turn[0]) == pytest.approx(0.2 * LEVER / step, abs=1e-4)
    assert float(joints.low[0]) == pytest.approx(0.7 * LEVER / step, abs=1e-3)
    assert float(joints.high[0]) == pytest.approx(0.8 * LEVER / step, abs=1e-3)


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
    assert reachable(state_of(row_of_three()), push).may_move.tolist() == [[True, True, False]]
    joined = row_of_three().replace(joints=(Joint(kind="revolute", parent="second", child="far"),))
    assert reachable(state_of(joined), push).may_move.all()
    away = control((-0.2, 0.0, 0.0), (0.01, 0.0, 0.0))
    lifted = control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0), down=False)
    for nothing in (away, lifted):
        assert not reachable(state_of(row_of_three()), nothing).may_move.any()


def test_an_extended_slider_that_nobody_told_of_keeps_its_edge() -> None:
    scene = row_of_three().replace(unknown_pairs=(("first", "second"),))
    state = state_of(scene).observe(torch.tensor([[[0.0, 0.0, 0.0], [0.20, 0.0, 0.0], [0.6, 0.0, 0.0]]]).double())
    graph = contact_graph(state, control((-0.111, 0.0, 0.0), (0.01, 0.0, 0.0)))
    assert len(graph.edges.fade) == 2
    known = state_of(row_of_three()).observe(state.poses).observe(state.poses)
    assert len(contact_graph(known, control((-0.111, 0, 0), (0.01, 0, 0))).edges.fade) == 1


def test_pieces_are_rigid_groups_and_fixed_joints_however_long_the_chain() -> None:
    bodies = tuple(body(name, 0.121 * k, 0.0) for k, name in enumerate("fedcba"))
    joints = tuple(Joint(kind="fixed", parent=p, child=c) for p, c in ("ab", "bc", "cd"))
    scene = Scene(bodies=bodies, joints=joints, rigid_groups=(("d", "e"),))
    batch = batch_scenes([scene])
    assert piece_index(batch, batch.relations).tolist() == [[0, 1, 1, 1, 1, 1]]


def test_a_piece_turns_about_its_centre_of_mass() -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0, mass=1.0), body("b", 0.13, 0.0, mass=3.0)), rigid_groups=(("a", "b"),))
    batch, poses = batch_scenes([scene]), torch.tensor(scene.poses_world_from_body[None])
    pieces = gather_pieces(batch, piece_index(batch, batch.relations), poses)
    torch.testing.assert_close(pieces.centre[0, 0], torch.tensor([0.0975, 0.0], dtype=torch.float64))
    assert float(pieces.mass[0, 0]) == 4
    arm = torch.tensor([0.0975, 0.0325])
    gyration = arm.square() + 0.06**2 / 2
    assert float(pieces.gyration[0, 0]) == pytest.approx(float((gyration * torch.tensor([0.25, 0.75])).sum()))
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
