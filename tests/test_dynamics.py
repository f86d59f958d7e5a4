"""Laws of the two predictors that hold for any weights, and their networks against plain loops."""

import math

import numpy as np
import pytest
import torch
from predictors import drawn_correction, no_correction
from scenes import body, workshop
from torch import nn

from pushgraph.body import Joint
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.propnet_graph import propnet_graph
from pushgraph.graph.state import Control, controls
from pushgraph.network.dynamics import PropnetDynamics
from pushgraph.network.propagation import PropagationNetwork
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid
from pushgraph.simulation.motion import plan_tool
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Push, Tool


@pytest.fixture(scope="module")
def contact() -> PhysicsPredictor:
    return drawn_correction()


@pytest.fixture(scope="module")
def laws() -> PhysicsPredictor:
    return no_correction()


@pytest.fixture(scope="module")
def propnet() -> PhysicsPredictor:
    torch.manual_seed(0)
    dynamics = PropnetDynamics(hidden=16, steps=3).eval()
    dynamics.network.head[-1].reset_parameters()  # which begins at zero, so that nothing would move
    return PhysicsPredictor(dynamics)


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    """Eight scenes in the middle of their first push, each with the rest of it ahead, and known speeds."""
    found = []
    for index in range(8):
        track = draw_trajectory("planar", 6, 5, index).track
        frame = int(np.flatnonzero(track.push == 0)[-1]) // 2
        bodies = tuple(
            b.replace(pose_world_from_body=tuple(p))
            for b, p in zip(track.scene.bodies, track.poses[frame, 1:].tolist(), strict=True)
        )
        found.append((track.scene, track.poses, frame, bodies))
    return found


@pytest.fixture
def tightly(monkeypatch) -> None:
    """Contact problems are solved to rounding, so that what the solver leaves does not count."""
    monkeypatch.setattr("pushgraph.network.newton.CONVERGED", 1e-9)
    monkeypatch.setattr("pushgraph.network.newton.ITERATIONS", 300)


def one_frame(predictor: PhysicsPredictor, scene: Scene, poses: np.ndarray, frame: int) -> np.ndarray:
    """Motion of every body in one frame, from the true poses before it."""
    state = predictor.start([scene]).observe(torch.tensor(poses[None, frame - 1, 1:]))
    state = state.observe(torch.tensor(poses[None, frame, 1:]))
    tool = torch.tensor(poses[None, frame - 1 : frame + 2, 0])
    control = controls(tool, torch.ones(1, 3, dtype=torch.bool))[1]
    with torch.no_grad():
        return predictor.dynamics(state, control).motion[0].numpy()


def moved_by(motion: np.ndarray, poses: np.ndarray) -> np.ndarray:
    from pushgraph import pose

    return pose.compose(motion, poses)


@pytest.mark.parametrize("kind", ["contact", "propnet"])
@pytest.mark.parametrize("motion", [(10.0, -7.0, 0.0), (0.0, 0.0, 2.1), (-3.0, 9.0, -1.0)])
def test_moving_and_turning_the_scene_changes_motions_by_less_than_10_micrometres(
    kind, motion, scenes, request
) -> None:
    predictor = request.getfixturevalue(kind)
    some = 0
    for scene, poses, frame, _ in scenes:
        there = one_frame(predictor, scene.replace(table=scene.table.replace(size=(20, 20))), poses, frame)
        placed = scene.replace(table=scene.table.replace(size=(20, 20))).moved(np.array(motion))
        here = one_frame(predictor, placed, moved_by(np.array(motion), poses), frame)
        cos, sin = math.cos(motion[2]), math.sin(motion[2])
        turned = there @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        np.testing.assert_allclose(here * [1, 1, LEVER], turned * [1, 1, LEVER], atol=1e-5, rtol=0)
        some += np.abs(there).max() > 1e-4
    assert some > 4


@pytest.mark.parametrize(("kind", "tolerance"), [("laws", 1e-6), ("contact", 1e-4), ("propnet", 1e-6)])
def test_the_order_of_bodies_does_not_matter(kind, tolerance, scenes, tightly, request) -> None:
    predictor = request.getfixturevalue(kind)
    for scene, poses, frame, _ in scenes:
        order = np.random.default_rng(0).permutation(len(scene.bodies))
        shuffled = scene.replace(bodies=tuple(scene.bodies[k] for k in order))
        there = one_frame(predictor, scene, poses, frame)
        here = one_frame(predictor, shuffled, poses[:, [0, *(1 + order)]], frame)
        np.testing.assert_allclose(here, there[order], atol=tolerance, rtol=0)


def test_what_the_tool_cannot_reach_stays_bit_for_bit(contact) -> None:
    scene = Scene(
        bodies=(
            body("pushed", 0.0, 0.0),
            body("next", 0.123, 0.0, Cuboid(size=(0.11, 0.1)), yaw=0.1),
            body("away", 0.1234567, 0.3, yaw=0.3),
            body("far", 0.7, 0.123),
        ),
        joints=(Joint(kind="revolute", parent="away", child="far", anchor=(0.4, 0.2)),),
        pushes=(Push(start=(-0.12, 0.0), end=(-0.06, 0.01)),),
    )
    track = contact.predict(scene)
    assert np.abs(track.poses[-1, 1:3] - track.poses[0, 1:3]).max() > 1e-4
    assert (track.poses[:, 3:] == track.poses[0, 3:]).all()


@pytest.mark.parametrize("push", [Push(start=(-0.12, 0.0), end=(-0.12, 0.0)), Push(start=(-0.5, 0.0), end=(-0.3, 0.0))])
def test_no_push_and_no_contact_move_nothing(push, contact) -> None:
    track = contact.predict(workshop(), [push])
    assert (track.poses[:, 1:] == track.poses[0, 1:]).all()


def test_pieces_stay_rigid_and_a_triangle_of_fixed_joints_does_not_tear(contact, propnet) -> None:
    side = 0.125
    corners = [(0.0, 0.0), (side, 0.0), (side / 2, side * math.sqrt(3) / 2)]
    bodies = tuple(body(name, *place) for name, place in zip("abc", corners, strict=True))
    push = (Push(start=(-0.12, 0.02), end=(0.1, 0.02)),)
    fixed = tuple(Joint(kind="fixed", parent=p, child=c) for p, c in ("ab", "bc", "ca"))
    group = Scene(bodies=bodies, rigid_groups=(("a", "b", "c"),), pushes=push)
    for predictor, scene in (
        (contact, group.replace(rigid_groups=(), joints=fixed)),
        (contact, group),
        (propnet, group),
    ):
        poses = predictor.predict(scene).poses
        assert np.abs(poses[-1] - poses[0]).max() > 1e-3
        for a, b in ((1, 2), (2, 3), (3, 1)):
            apart = np.hypot(*(poses[:, a, :2] - poses[:, b, :2]).T)
            np.testing.assert_allclose(apart, apart[0], atol=1e-9)
            np.testing.assert_allclose(poses[:, a, 2] - poses[:, b, 2], 0, atol=1e-9)


def test_a_triangle_of_hinges_is_predicted_without_running_away(contact) -> None:
    bodies = tuple(body(name, *place) for name, place in (("a", (0, 0)), ("b", (0.125, 0)), ("c", (0.0625, 0.108))))
    hinges = tuple(Joint(kind="revolute", parent=p, child=c) for p, c in ("ab", "bc", "ca"))
    track = contact.predict(Scene(bodies=bodies, joints=hinges, pushes=(Push(start=(-0.12, 0), end=(0.1, 0)),)))
    assert np.isfinite(track.poses).all()


def test_predicting_side_by_side_is_predicting_alone(contact) -> None:
    scenes = [workshop(), Scene(bodies=(body("a", 0.0, 0.0),), pushes=(Push(start=(-0.12, 0), end=(0.0, 0)),))]
    for scene, together in zip(scenes, contact.predict_many(scenes), strict=True):
        alone = contact.predict(scene)
        np.testing.assert_allclose(together.poses, alone.poses, atol=1e-6)
        assert (together.push == alone.push).all()


def test_predicted_frames_are_those_of_the_simulator(contact) -> None:
    simulated, predicted = simulate(workshop()), contact.predict(workshop())
    np.testing.assert_array_equal(simulated.times, predicted.times)
    np.testing.assert_array_equal(simulated.push, predicted.push)
    np.testing.assert_allclose(simulated.poses[:, 0], predicted.poses[:, 0], atol=1e-12)
    np.testing.assert_allclose(simulated.poses[0], predicted.poses[0], atol=1e-12)


@pytest.mark.parametrize("table", [Table(), Table(anisotropy=0.4, grain=0.6)], ids=["even", "grained"])
def test_gradients_of_a_rollout_agree_with_finite_differences(table: Table, contact, tightly) -> None:
    scene = Scene(
        table=table,
        bodies=(body("a", 0.0, 0.0, Cuboid(size=(0.1, 0.08)), yaw=0.3), body("b", 0.125, 0.02)),
        tool=Tool.round(0.04),
        pushes=(Push(start=(-0.085, 0.01), end=(0.0, 0.01)),),
    )
    poses, push = plan_tool(scene.pushes, scene.tool)
    tool, down = torch.tensor(poses[None, :8]), torch.tensor(push[None, :8] >= 0)
    state = contact.start([scene])
    weights = torch.tensor([[1.0, -0.7, 0.05], [0.4, 0.9, -0.03]], dtype=torch.float64)

    def outcome(start_poses: torch.Tensor, shift: torch.Tensor) -> torch.Tensor:
        moved = tool + shift * torch.linspace(0, 1, tool.shape[1], dtype=torch.float64)[None, :, None]
        return (contact.rollout(state._replace(poses=start_poses), moved, down).poses[0, -1] * weights).sum()

    start_poses, shift = state.poses.clone().requires_grad_(), torch.zeros(1, 1, 3).double().requires_grad_()
    gradients = torch.autograd.grad(outcome(start_poses, shift), (start_poses, shift))
    rng, small = torch.Generator().manual_seed(0), 2e-5
    for _ in range(4):
        along = [torch.randn(v.shape, generator=rng, dtype=torch.float64) for v in (start_poses, shift)]
        with torch.no_grad():
            ends = [outcome(start_poses + s * small * along[0], shift + s * small * along[1]) for s in (1, -1)]
        measured = float(ends[0] - ends[1]) / (2 * small)
        expected = sum(float((g * a).sum()) for g, a in zip(gradients, along, strict=True))
        assert measured == pytest.approx(expected, rel=0.005, abs=0.002)


def test_what_was_predicted_without_gradients_may_be_learnt_from_later(contact) -> None:
    scene = workshop()
    tool, push = plan_tool(scene.pushes, scene.tool)
    down = torch.tensor(push >= 0)[None, :8]
    with torch.no_grad():
        poses = contact.rollout(contact.start([scene]), torch.tensor(tool)[None, :8], down).poses
    scale = torch.ones((), dtype=torch.float64, requires_grad=True)
    (poses * scale).square().sum().backward()
    assert float(scale.grad) == pytest.approx(2 * float(poses.square().sum()))


def small_state(scene: Scene, predictor: PhysicsPredictor, tool=(-0.112, 0.0, 0.0)):
    rows = [torch.tensor([row], dtype=torch.float64) for row in (tool, (0.01, 0.002, 0.0), (0.0, 0.0, 0.0))]
    return predictor.start([scene]), Control(*rows, torch.tensor([True]))


def test_the_papers_network_begins_at_rest(propnet) -> None:
    assert not PropnetDynamics(hidden=16, steps=3)(*small_state(workshop(), propnet)).motion.any()


def test_the_propagation_network_is_the_papers_worked_relation_by_relation(propnet) -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0, Cuboid(size=(0.1, 0.08)), yaw=0.3)))
    graph = propnet_graph(*small_state(scene, propnet))
    network: PropagationNetwork = propnet.dynamics.network
    objects, relations = network.object_encoder(graph.nodes), network.relation_encoder(graph.edges)
    own, pair = network.relation_from_relation, network.relation_from_objects.weight
    hidden = objects.shape[1]
    # One layer over relation, receiver and sender put side by side.
    joined = nn.Linear(3 * hidden, hidden)
    joined.weight = nn.Parameter(torch.cat((own.weight, pair[:hidden], pair[hidden:]), 1))
    joined.bias = own.bias
    effect = objects
    for _ in range(network.steps):
        total = [torch.zeros(hidden) for _ in graph.nodes]
        for k, (receiver, sender) in enumerate(zip(graph.receiver.tolist(), graph.sender.tolist(), strict=True)):
            total[receiver] = (
                total[receiver] + joined(torch.cat((relations[k], effect[receiver], effect[sender]))).relu()
            )
        rows = zip(objects, total, effect, strict=True)
        effect = torch.stack([(network.object_propagator(torch.cat((o, t))) + e).relu() for o, t, e in rows])
    torch.testing.assert_close(network(graph).motion, network.head(effect), atol=1e-5, rtol=1e-5)
