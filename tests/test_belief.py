"""Belief: evidence worked by hand, symmetries, one frame at a time against whole windows, and what is refused."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import body, workshop
from typer.testing import CliRunner

from pushgraph import cli, pose
from pushgraph.belief import BeliefModel, watch_windows
from pushgraph.belief_history import BeliefHistory, Watching
from pushgraph.body import Joint
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint, shipped
from pushgraph.errors import BeliefError, CheckpointError, TrackError
from pushgraph.graph.believed import believe
from pushgraph.graph.joint_fit import JointFits, RelativeMotion
from pushgraph.graph.joint_truth import adjacent_pairs, touched_pairs, true_joints, unaware
from pushgraph.graph.pair_evidence import FEATURES, FINE, pair_evidence
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes, pair_index, pairs_of
from pushgraph.graph.state import start
from pushgraph.graph.watching import first_look, look
from pushgraph.joint_answers import answer_together
from pushgraph.network.belief_network import BELIEFS, Memory, Rows
from pushgraph.physics import PhysicsPredictor
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import SLIDE, SWING, Scene
from pushgraph.shape import Cuboid
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.tool import Push

KINDS = list(JOINT_CODES)
GOLDEN = Path(__file__).parent / "golden" / "beliefs.json"


def untrained(name: str = "belief", seed: int = 0) -> BeliefModel:
    """A belief that knows nothing yet, on the shipped physics; its answers still depend on what it sees."""
    dynamics = load_checkpoint(shipped(BELIEFS[name].PHYSICS)).network
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = BELIEFS[name](hidden=16)
    return BeliefModel(network.eval().requires_grad_(False), dynamics.requires_grad_(False))


@pytest.fixture(scope="module", params=["belief", "paper_recipe"])
def model(request) -> BeliefModel:
    return untrained(request.param)


@pytest.fixture(scope="module")
def ours() -> BeliefModel:
    return untrained()


@pytest.fixture(scope="module")
def tracks():
    return [draw_trajectory("multiple-parts", number, 5, k).track for k, number in enumerate((5, 4, 5))]


def arrays(tracks, frames: int):
    """Batched arrays of the first frames of tracks, padded to the widest."""
    scenes = unaware(batch_scenes([track.scene for track in tracks]))
    room = scenes.mass.shape[1]
    bodies = np.zeros((len(tracks), frames, room, 3))
    seen = np.zeros(bodies.shape[:3], dtype=bool)
    for k, track in enumerate(tracks):
        n = len(track.scene.bodies)
        bodies[k, :, :n], seen[k, :, :n] = track.poses[:frames, 1:], True
    tool = np.stack([track.poses[:frames, 0] for track in tracks])
    down = np.stack([track.down[:frames] for track in tracks])
    return scenes, *(torch.from_numpy(array) for array in (bodies, tool, down, seen))


def observed(model, scenes, bodies, tool, down, seen) -> torch.Tensor:
    """Probabilities after every frame, one at a time."""
    watch = model.begin(scenes, bodies[:, 0], tool[:, 0], down[:, 0], seen[:, 0])
    answers = [model.probabilities(watch)]
    for k in range(1, bodies.shape[1]):
        watch = model.observe(watch, bodies[:, k], tool[:, k], down[:, k], seen[:, k])
        answers.append(model.probabilities(watch))
    return torch.stack(answers)


def test_one_frame_at_a_time_gives_the_numbers_of_whole_windows(model, tracks) -> None:
    scenes, bodies, tool, down, seen = arrays(tracks, 40)
    generator = torch.Generator().manual_seed(0)
    bodies += torch.randn(bodies.shape, generator=generator, dtype=bodies.dtype) * 5e-4
    seen[0, 10:17, 2] = seen[2, 30:, 0] = False
    single = observed(model, scenes, bodies, tool, down, seen)
    rows, _, memories = watch_windows(model.network, model.dynamics, scenes, bodies, tool, down, seen)
    for frame in (0, 9, 12, 20, 39):
        answers = model.network.answer(memories[frame], rows).softmax(-1)
        begun = torch.stack([memory.relations.abs().sum((1, 2)) > 0 for memory in memories[: frame + 1]]).any(0)
        of_begun = Rows(*(values[begun] for values in rows))
        together = answer_together(scenes, answers[begun], of_begun, torch.ones(4, dtype=torch.bool)).probabilities
        torch.testing.assert_close(together, single[frame], atol=1e-5, rtol=1e-4)
    assert single[-1].std(0).max() > 1e-4  # scenes differ


def test_numpy_in_gives_numpy_out_and_shapes_are_checked(ours, tracks) -> None:
    scenes, *tensors = arrays(tracks, 12)
    taken = [values.numpy() for values in tensors]
    told = observed(ours, scenes, *tensors)
    watch = None
    for k in range(12):
        frame = [values[:, k] for values in taken]
        watch = ours.begin(scenes, *frame) if watch is None else ours.observe(watch, *frame)
    answers = ours.probabilities(watch)
    assert isinstance(answers, np.ndarray)
    np.testing.assert_allclose(answers, told[-1].numpy(), atol=1e-7)
    blank = [track.scene.replace(joints=(), unknown_pairs="unlisted") for track in tracks]
    first, second = (ours.probabilities(ours.begin(some, *frame)) for some in (blank, scenes))
    there = scenes.present[:, pairs_of(scenes.present.shape[1])].all(1).numpy()
    np.testing.assert_allclose(first[there], second[there], atol=1e-7)
    with pytest.raises(BeliefError, match=r"tool: shape must be \(3, 3\), got \(2, 3\)"):
        ours.begin(scenes, frame[0], frame[1][:2], *frame[2:])
    with pytest.raises(BeliefError, match="seen: dtype must be bool, got int64"):
        ours.observe(watch, *frame[:3], frame[3].astype(int))


def test_scenes_side_by_side_do_not_change_each_other(model, tracks) -> None:
    together = observed(model, *arrays(tracks, 20))[-1]
    alone = observed(model, *arrays(tracks[1:2], 20))[-1, 0]
    few, room = len(tracks[1].scene.bodies), 5
    a, b = pairs_of(few)
    torch.testing.assert_close(together[1, pair_index(a, b, room)], alone, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("motion", [(10.0, -3.0, 0.0), (0.0, 0.0, 2.0), (-4.0, 8.0, -1.0)])
def test_moving_and_turning_the_scene_changes_nothing(ours, tracks, motion) -> None:
    scenes, bodies, tool, down, seen = arrays(tracks, 25)
    before = observed(ours, scenes, bodies, tool, down, seen)
    moved = [pose.compose(torch.tensor(motion, dtype=torch.float64), poses) for poses in (bodies, tool)]
    after = observed(ours, scenes, *moved, down, seen)
    torch.testing.assert_close(after, before, atol=1e-5, rtol=1e-4)


@torch.no_grad()
def test_what_one_pair_shows_tells_about_the_others_of_its_scene_and_of_no_other() -> None:
    network = untrained().network
    generator = torch.Generator().manual_seed(0)
    for weights in network.parameters():
        weights.copy_(torch.randn(weights.shape, generator=generator) / 4)
    chosen = torch.zeros(2, 6, dtype=torch.bool)
    chosen[:, [pair_index(0, 1, 4), pair_index(2, 3, 4)]] = True
    rows = Rows.of(chosen, 4)
    relations = torch.randn((4, 2, network.width), generator=generator)
    objects = torch.randn((8, network.hidden), generator=generator)
    before = network.answer(Memory(relations, objects), rows)
    relations[0] += 3.0
    after = network.answer(Memory(relations, objects), rows)
    assert (after[1] - before[1]).abs().max() > 1e-3
    assert torch.equal(after[2:], before[2:])


def test_the_order_of_bodies_changes_nothing(model, tracks) -> None:
    track = tracks[0]
    order = [3, 0, 4, 2, 1]
    scenes, bodies, tool, down, seen = arrays([track], 25)
    before = observed(model, scenes, bodies, tool, down, seen)[-1, 0]
    swapped = track.scene.replace(bodies=tuple(track.scene.bodies[k] for k in order))
    after = observed(model, unaware(batch_scenes([swapped])), bodies[:, :, order], tool, down, seen)[-1, 0]
    a, b = pairs_of(5)
    place = {old: new for new, old in enumerate(order)}
    other = [pair_index(*sorted((place[int(i)], place[int(j)])), 5) for i, j in zip(a, b, strict=True)]
    torch.testing.assert_close(after[other], before, atol=1e-5, rtol=1e-4)


def test_a_pause_changes_no_belief_whatever_the_camera_s_noise(ours, tracks) -> None:
    scenes, bodies, tool, down, seen = arrays(tracks, 30)
    watch = ours.begin(scenes, bodies[:, 0], tool[:, 0], down[:, 0], seen[:, 0])
    for k in range(1, 30):
        watch = ours.observe(watch, bodies[:, k], tool[:, k], down[:, k], seen[:, k])
    last, rest, lifted = bodies[:, -1], (tool[:, -1], torch.zeros_like(down[:, -1])), seen[:, -1]
    for _ in range(5):  # coasting ends, and its last frame is fitted
        watch = ours.observe(watch, last, *rest, lifted)
    before = watch
    for _ in range(70):  # how sure the places are where bodies rest is the only news
        watch = ours.observe(watch, last, *rest, lifted)
    assert (ours.probabilities(watch) - ours.probabilities(before)).abs().max() < 0.03
    assert torch.equal(watch.relations[..., : ours.network.hidden], before.relations[..., : ours.network.hidden])
    clean = noisy = watch
    generator = torch.Generator().manual_seed(0)
    for _ in range(40):
        clean = ours.observe(clean, last, *rest, lifted)
        noise = torch.randn(last.shape, generator=generator, dtype=last.dtype) * 5e-4
        noisy = ours.observe(noisy, last + noise, *rest, lifted)
    # That a camera has no noise becomes surer still.
    torch.testing.assert_close(ours.probabilities(clean), ours.probabilities(watch), atol=2e-4, rtol=0)
    recurrent = ours.network.hidden
    for paused in (clean, noisy):  # only what the last frame told is refreshed
        assert torch.equal(paused.objects, watch.objects)
        assert torch.equal(paused.relations[..., :recurrent], watch.relations[..., :recurrent])
    assert not torch.equal(noisy.relations, watch.relations)


def test_a_place_is_as_sure_as_the_sightings_that_it_is_the_mean_of(ours) -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0)))
    batch, beside = unaware(batch_scenes([scene])), torch.full((1, 3), 9.0, dtype=torch.float64)
    poses, down = torch.tensor(scene.poses_world_from_body[None]), torch.tensor([True])
    seen = torch.ones(poses.shape[:2], dtype=torch.bool)
    view, _ = first_look(batch, poses, beside, down, seen)
    for frame in range(1, 100):
        view, told = look(view, poses, beside, down, seen)
        assert float(told.resting) == float(view.fits.rested) == pytest.approx(min(frame + 1, 64))
    poses = poses + torch.tensor([[[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]]])
    for _ in range(5):  # one strays; what was before is as sure as it was
        view, told = look(view, poses, beside, down, seen)
    assert float(view.fits.rested) == 64
    assert 1 < float(told.resting) < 10


def test_memory_does_not_grow(ours, tracks) -> None:
    scenes, bodies, tool, down, seen = arrays(tracks[:1], 30)
    watch = ours.begin(scenes, bodies[:, 0], tool[:, 0], down[:, 0], seen[:, 0])
    begun = [tensor.shape for tensor in _leaves(watch)]
    for k in range(1, 30):
        watch = ours.observe(watch, bodies[:, k], tool[:, k], down[:, k], seen[:, k])
    assert [tensor.shape for tensor in _leaves(watch)] == begun


def _leaves(batch) -> list[torch.Tensor]:
    if isinstance(batch, torch.Tensor):
        return [batch]
    return [leaf for part in batch for leaf in _leaves(part)] if isinstance(batch, tuple) else []


def evidence(scene: Scene, moved: list[tuple[float, float, float]]) -> dict[str, list[float]]:
    """Features of the first pair of a scene whose bodies went to other poses in one frame; both directions."""
    batch = unaware(batch_scenes([scene]))
    poses = torch.tensor(scene.poses_world_from_body[None])
    beside, down = torch.full((1, 3), 9.0, dtype=torch.float64), torch.tensor([True])
    seen = torch.ones(poses.shape[:2], dtype=torch.bool)
    view, _ = first_look(batch, poses, beside, down, seen)
    _, frame = look(view, torch.tensor([moved], dtype=torch.float64), beside, down, seen)
    told = pair_evidence(frame, torch.zeros_like(poses), torch.zeros_like(frame.in_sight))
    return dict(zip(FEATURES, told[0, 0].T.tolist(), strict=True))


def test_evidence_of_a_hinge_by_hand() -> None:
    # Two discs of 12 cm that touch at (0.06, 0); the right one swings by 0.1 about that point.
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.12, 0.0)))
    swung = (0.06 + 0.06 * math.cos(0.1), 0.06 * math.sin(0.1), 0.1)
    told = evidence(scene, [(0.0, 0.0, 0.0), swung])
    for end in "xy":
        np.testing.assert_allclose(told[f"drift_{end}"], 0, atol=1e-3)
    np.testing.assert_allclose(told["turn"], np.arcsinh(np.array([0.1, -0.1]) * 0.05 / FINE), rtol=1e-5)
    np.testing.assert_allclose(told["sender_travel"][0], np.arcsinh(2 * 0.06 * math.sin(0.05) / FINE), rtol=1e-5)
    np.testing.assert_allclose(told["receiver_travel"][0], 0, atol=1e-6)
    np.testing.assert_allclose(told["receiver_anchor_x"], 0.06 / 0.05, rtol=1e-5)
    np.testing.assert_allclose(told["sender_anchor_x"], -0.06 / 0.05, rtol=1e-5)


def test_evidence_of_a_slider_by_hand() -> None:
    # Turned by 90 degrees, so that world and pair axes differ; the upper disc moves up by 1 cm and left by 2 mm.
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.0, 0.12)))
    told = evidence(scene, [(0.0, 0.0, 0.0), (-0.002, 0.13, 0.0)])
    # Away from each other is along for both; what is left of the one's axis is left of the other's, too.
    np.testing.assert_allclose(told["drift_x"], np.arcsinh([10, 10]), rtol=1e-4)
    np.testing.assert_allclose(told["drift_y"], np.arcsinh([2, 2]), rtol=1e-4)
    np.testing.assert_allclose(told["drifting_x"], told["drift_x"], rtol=1e-5)
    np.testing.assert_allclose(told["turn"], 0, atol=1e-6)
    np.testing.assert_allclose(told["sender_motion_x"], np.arcsinh([10, 0]), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(told["receiver_motion_x"], np.arcsinh([0, -10]), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(told["stretch"], np.arcsinh((math.hypot(0.13, 0.002) - 0.12) / FINE), rtol=1e-4)


def test_a_rigid_motion_of_both_shows_no_drift() -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.05, 0.125, Cuboid(size=(0.1, 0.1)), yaw=0.4)))
    motion = np.array([0.3, -0.2, 0.7])
    told = evidence(scene, pose.compose(motion, scene.poses_world_from_body).tolist())
    for name in ("drift_x", "drift_y", "turn", "stretch", "drifting_x", "drifting_y", "turning"):
        np.testing.assert_allclose(told[name], 0, atol=1e-4)


def test_truth_is_closed_over_rigid_pieces_and_touched_pairs_are_adjacent_ones_that_moved() -> None:
    scene = Scene(
        bodies=tuple(body(name, 0.125 * k, 0.0) for k, name in enumerate("abcd")),
        joints=(
            Joint(kind="fixed", parent="a", child="b"),
            Joint(kind="fixed", parent="b", child="c"),
            Joint(kind="revolute", parent="c", child="d"),
        ),
    )
    batch = batch_scenes([scene])
    kinds = [KINDS[k] for k in true_joints(batch)[0].tolist()]
    assert kinds == ["fixed", "fixed", "none", "fixed", "none", "revolute"]  # ab ac ad bc bd cd
    poses = torch.tensor(scene.poses_world_from_body)[None, None].repeat(1, 3, 1, 1)
    adjacent = adjacent_pairs(batch, poses[:, 0])
    assert adjacent[0].tolist() == [True, False, False, True, False, True]
    poses[0, 1, 0, 1] += 0.03  # a is pushed, and comes back
    touched = touched_pairs(adjacent, poses)
    assert touched[0].int().tolist() == [[0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0]]


def test_known_pairs_strangers_and_chains_complete_the_probabilities() -> None:
    scene = Scene(
        bodies=tuple(body(name, 0.3 * k, 0.0) for k, name in enumerate("abcd")),
        joints=(Joint(kind="fixed", parent="a", child="b"),),
        unknown_pairs=(("b", "c"), ("a", "c"), ("c", "d")),
    )
    batch = batch_scenes([scene])
    chosen = torch.zeros(1, 6, dtype=torch.bool)
    chosen[0, pair_index(1, 2, 4)] = True
    answers = torch.tensor([[0.1, 0.8, 0.06, 0.04]])
    done = answer_together(batch, answers, Rows.of(chosen, 4), torch.ones(4, dtype=torch.bool)).probabilities[0]
    pair = {
        names: done[pair_index(*("abcd".index(name) for name in names), 4)] for names in ("ab", "ac", "ad", "bc", "cd")
    }
    assert pair["ab"].tolist() == [0, 1, 0, 0]
    torch.testing.assert_close(pair["bc"], answers[0])
    assert pair["ad"].tolist() == [1, 0, 0, 0]
    assert float(pair["ac"][1]) == pytest.approx(0.8)  # over b
    assert float(pair["cd"][0]) == pytest.approx(0.999)
    torch.testing.assert_close(done.sum(-1), torch.ones(6))


def test_believed_joints_sit_where_a_scene_puts_them() -> None:
    joints = (
        Joint(kind="revolute", parent="a", child="b"),
        Joint(kind="prismatic", parent="b", child="c"),
        Joint(kind="fixed", parent="c", child="d"),
    )
    shape = Cuboid(size=(0.1, 0.08))
    scene = Scene(
        bodies=(
            body("a", 0.0, 0.0),
            body("b", 0.13, 0.01, shape, yaw=0.2),
            body("c", 0.14, 0.13, yaw=-0.3),
            body("d", 0.02, 0.135, yaw=1.0),
        ),
        joints=joints,
    )
    given = batch_scenes([scene])
    state = start(unaware(given), torch.tensor(scene.poses_world_from_body[None]))
    believed = believe(state, given.relations.kind, JointFits.begin(state.relations.known)).relations
    joined = given.relations.kind > 0
    for name in ("kind", "known", "anchor_a", "anchor_b", "yaw_offset", "limits"):
        torch.testing.assert_close(
            getattr(believed, name)[joined], getattr(given.relations, name)[joined], atol=1e-6, rtol=0
        )
    slider = given.relations.kind == JOINT_CODES["prismatic"]
    torch.testing.assert_close(believed.axis[slider], given.relations.axis[slider], atol=1e-6, rtol=0)


def test_what_was_seen_moves_a_believed_joint() -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0)))
    state = start(unaware(batch_scenes([scene])), torch.tensor(scene.poses_world_from_body[None]))
    moved = torch.ones(1, 1, dtype=torch.bool)

    def seen(places: list[list[float]]) -> JointFits:
        fits = JointFits.begin(moved)
        for place in places:
            poses = torch.tensor([[[0.0, 0.0, 0.0], place]], dtype=torch.float64)
            fits = fits.observe(RelativeMotion.of(state.relations, poses), moved)
        return fits

    # Slides sideways, not along the line of centres, so that nothing tells where it stops.
    slid = seen([[0.125, far, 0.0] for far in np.linspace(0.0, 0.12, 30)])
    relations = believe(state, torch.tensor([[JOINT_CODES["prismatic"]]]), slid).relations
    torch.testing.assert_close(relations.axis[0, 0].abs(), torch.tensor([0.0, 1.0]), atol=5e-3, rtol=0)
    assert sorted(relations.limits[0, 0].abs().tolist()) == pytest.approx([SLIDE, 0.12], abs=1e-4)
    # Swings about a point far from where the two touch, farther than a scene's hinge does.
    pivot = np.array([0.03, 0.08])
    turns = np.linspace(0, 1.8, 30)
    swung = seen([[*(pivot + pose.rotate(np.array([0.125, 0.0]) - pivot, turn)), turn] for turn in turns])
    relations = believe(state, torch.tensor([[JOINT_CODES["revolute"]]]), swung).relations
    np.testing.assert_allclose(relations.anchor_a[0, 0].numpy(), pivot, atol=2e-4)
    np.testing.assert_allclose(relations.anchor_b[0, 0].numpy(), pivot - [0.125, 0.0], atol=2e-4)
    assert relations.limits[0, 0].tolist() == pytest.approx([-SWING, 1.8])
    # Turns so little that noise explains where it sits stay in the middle.
    little = seen([[*(pose.rotate(np.array([0.125, 0.0]), turn)), turn] for turn in (0.0, 0.005, 0.01)])
    relations = believe(state, torch.tensor([[JOINT_CODES["revolute"]]]), little).relations
    torch.testing.assert_close(relations.anchor_a, state.relations.anchor_a)


def triangle() -> Scene:
    """Three discs, all adjacent."""
    return Scene(
        bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0), body("c", 0.0625, 0.108)),
        pushes=(Push(start=(-0.15, 0.02), end=(0.05, 0.02)),),
    )


@pytest.mark.parametrize("kinds", [("revolute",) * 3, ("fixed", "revolute", "prismatic"), ("fixed",) * 3])
def test_a_believed_cycle_of_joints_is_predicted_without_tearing(kinds) -> None:
    scene = triangle()
    state = start(unaware(batch_scenes([scene])), torch.tensor(scene.poses_world_from_body[None]))
    kind = torch.tensor([[JOINT_CODES[kind] for kind in kinds]])
    state = believe(state, kind, JointFits.begin(state.relations.known))
    track = PhysicsPredictor.load().predict(scene)
    tool, down = torch.from_numpy(track.poses[None, :, 0]), torch.from_numpy(track.down[None])
    poses = PhysicsPredictor.load().rollout(state, tool, down).poses[0]
    assert poses.isfinite().all()
    assert float((poses[-1] - poses[0]).norm(dim=-1).max()) > 0.05
    a, b = pairs_of(3)
    relations = state.relations
    for pair, kind in enumerate(kinds):
        anchors = [
            pose.transform(poses[:, end[pair]], anchor[0, pair].double())
            for end, anchor in ((a, relations.anchor_a), (b, relations.anchor_b))
        ]
        apart = anchors[1] - anchors[0]
        if kind == "prismatic":
            axis = pose.rotate(relations.axis[0, pair].double().expand(len(poses), 2), poses[:, a[pair], 2])
            apart = apart - (apart * axis).sum(-1, keepdim=True) * axis
        assert float(apart.norm(dim=-1).max()) < 0.005


@pytest.fixture
def regulator(ours) -> BeliefRegulator:
    return BeliefRegulator(triangle(), ours)


def still(regulator: BeliefRegulator) -> np.ndarray:
    return np.concatenate(([[-0.15, 0.02, 0.0]], regulator.original.poses_world_from_body))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda p: p[:3], r"shape must be \(4, 3\): robot, a, b, c"),
        (lambda p: _with(p, 0, 0, np.nan), "'robot' is missing in frame 1"),
        (lambda p: _with(p, 2, 2, np.nan), "pose of 'b' in frame 1"),
        (lambda p: _with(p, 2, 1, np.inf), "'b'.*must be finite"),
        (lambda p: _with(p, 3, 0, 0.4), "'c' jumps by 0.34 m in frame 1; at most 0.2 m"),
    ],
)
def test_what_cannot_be_is_refused_and_teaches_nothing(regulator, ours, change, says) -> None:
    poses = still(regulator)
    regulator.observe(poses)
    with pytest.raises(BeliefError, match=says):
        regulator.observe(change(poses.copy()))
    other = BeliefRegulator(triangle(), ours)
    other.observe(poses)
    nudged = poses + 0.01
    np.testing.assert_array_equal(regulator.observe(nudged), other.observe(nudged))
    assert regulator.frames == 2


def _with(poses: np.ndarray, node: int, column: int, value: float) -> np.ndarray:
    poses[node, column] = value
    return poses


def test_a_robot_that_leaps_was_lifted_whether_that_is_said_or_not(regulator, ours) -> None:
    poses = still(regulator)
    there = _with(poses.copy(), 0, 0, 0.6)
    regulator.observe(poses, down=True)
    other = BeliefRegulator(triangle(), ours)
    other.observe(poses, down=False)
    np.testing.assert_array_equal(regulator.observe(there, down=True), other.observe(there, down=True))


def test_nothing_observed_nothing_believed(regulator) -> None:
    with pytest.raises(BeliefError, match="nothing was observed yet"):
        regulator.scene()


def test_lost_tags_pause_only_their_own_pairs(ours) -> None:
    track = simulate(triangle())
    regulator = BeliefRegulator(triangle(), ours)
    begins = int(np.flatnonzero((np.diff(track.poses[:, 1], axis=0) != 0).any(1))[0])
    for frame, poses in enumerate(track.poses[begins : begins + 20]):
        shown = poses.copy()
        if 5 <= frame < 12:
            shown[3] = np.nan
        before = regulator._watch
        regulator.observe(shown)
        if frame:
            # Pairs ab, ac, bc: those of c, which is lost, wait.
            same = [torch.equal(before.relations[0, k], regulator._watch.relations[0, k]) for k in range(3)]
            assert same == [False, 5 <= frame < 12, 5 <= frame < 12]


def test_yaw_may_be_unknown_and_may_wrap(ours) -> None:
    scene = triangle()
    blind = scene.replace(bodies=(*scene.bodies[:2], scene.bodies[2].replace(yaw_known=False)))
    track = simulate(scene)
    one, other = BeliefRegulator(blind, ours), BeliefRegulator(blind, ours)
    for frame, poses in enumerate(track.poses[:15]):
        a, b = poses.copy(), poses.copy()
        a[3, 2], b[3, 2] = np.nan, 0.3 * frame
        b[1:3, 2] += 2 * np.pi * (frame % 3)
        np.testing.assert_allclose(one.observe(a), other.observe(b), atol=1e-5)


def test_given_joints_are_kept(ours) -> None:
    scene = workshop()
    poses = np.concatenate(([[-0.2, 0.0, 0.0]], scene.poses_world_from_body))
    regulator = BeliefRegulator(scene, ours, given=True)
    probabilities = regulator.observe(poses)
    believed = dict(zip(regulator.pairs, probabilities, strict=True))
    assert believed["plate", "lid"].tolist() == [0, 0, 0, 1]
    assert believed["cup", "handle"].tolist() == [0, 1, 0, 0]
    assert believed["plate", "cup"].tolist() == [1, 0, 0, 0]
    unknown = dict(zip(regulator.pairs, BeliefRegulator(scene, ours).observe(poses), strict=True))
    assert 0 < unknown["plate", "lid"][3] < 1
    assert unknown["cup", "handle"].tolist() == [0, 1, 0, 0]


def test_one_body_alone_is_no_trouble(ours) -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0),))
    regulator = BeliefRegulator(scene, ours)
    assert regulator.observe(np.array([[-0.2, 0.0, 0.0], [0.0, 0.0, 0.0]])).shape == (0, 4)
    assert regulator.scene().names == ("a",)


def convince(model: BeliefModel, kind: str, monkeypatch) -> None:
    """Let a model answer one joint for every pair."""
    log_odds = 9.0 * torch.nn.functional.one_hot(torch.tensor(JOINT_CODES[kind]), 4).float()
    monkeypatch.setattr(model.network, "answer", lambda memory, rows: log_odds.expand(len(rows.scene), 4))


@pytest.mark.parametrize("kind", ["none", "fixed", "prismatic", "revolute"])
def test_the_believed_scene_is_ready_for_prediction(ours, kind, monkeypatch, tmp_path) -> None:
    convince(ours, kind, monkeypatch)
    rng = np.random.default_rng(0)
    track = simulate(triangle())
    noisy = dataclasses.replace(track, poses=track.poses + rng.normal(size=track.poses.shape) * [0.001, 0.001, 0.01])
    history = BeliefHistory.watch(triangle(), noisy, ours)
    assert set(history.likeliest.values()) == {kind}
    assert {joint.kind for joint in history.scene.joints} == ({kind} - {"none"})
    history.save(tmp_path / "beliefs.json")
    read = BeliefHistory.load(tmp_path / "beliefs.json")
    assert read.scene == Scene.from_json(history.scene.to_json()) == history.scene
    np.testing.assert_allclose(read.probabilities, history.probabilities, atol=1e-5)
    end = np.array(history.scene.bodies[1].pose_world_from_body[:2])
    pushed = read.scene.replace(pushes=(Push(start=tuple(end + [0.0, -0.25]), direction=1.57, distance=0.2),))
    assert np.isfinite(PhysicsPredictor.load().predict(pushed).poses).all()
    assert np.isfinite(PhysicsPredictor.load().predict(read.apply_to(triangle())).poses).all()


def test_beliefs_move_with_their_scene(ours, monkeypatch) -> None:
    convince(ours, "revolute", monkeypatch)
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0)))
    regulator = BeliefRegulator(scene, ours)
    regulator.observe(np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 0.0], [0.125, 0.0, 0.0]]))
    pivot = np.array([0.0625, 0.0])
    for angle in (0.2, 0.4, 0.6):
        swung = [*(pivot + pose.rotate(np.array([0.0625, 0.0]), angle)), angle]
        regulator.observe(np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 0.0], swung]))
    (joint,) = regulator.scene().joints
    np.testing.assert_allclose(joint.anchor, pivot, atol=1e-6)
    np.testing.assert_allclose(joint.limits, (-math.pi / 2 - 0.6, math.pi / 2 - 0.6), atol=1e-6)
    history = BeliefHistory(regulator.pairs, np.zeros(1), regulator.probabilities[None], {}, [], regulator.scene())
    (carried,) = history.apply_to(scene.moved((1.0, 2.0, 0.5))).joints
    np.testing.assert_allclose(carried.anchor, pose.transform(np.array([1.0, 2.0, 0.5]), pivot), atol=1e-6)
    np.testing.assert_allclose(carried.limits, (-math.pi / 2, math.pi / 2), atol=1e-6)
    with pytest.raises(BeliefError, match="these beliefs are about a, b; the scene has a, b, c"):
        history.apply_to(triangle())


def unsealed(text: str, **changes: object) -> str:
    """Beliefs with other fields, changed on purpose."""
    content = json.loads(text) | changes
    del content["checksum"]
    return json.dumps(content)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda text: text[:50], "may be truncated"),
        (lambda text: "[]", "is a JSON object, got list"),
        (lambda text: text.replace('"version": 3', '"version": 2', 1), "version 2 of beliefs"),
        (lambda text: text.replace("0.5", "0.6", 1), "was damaged: its content does not fit its checksum"),
        (lambda text: unsealed(text, probabilities=[[[0.5]]]), "shape"),
        (lambda text: unsealed(text, joints=["none", "fixed", "revolute", "prismatic"]), "in this order"),
        (lambda text: unsealed(text, times=[1e400]), "finite"),
        (lambda text: json.dumps({k: v for k, v in json.loads(text).items() if k != "pairs"}), "damaged"),
    ],
)
def test_damaged_beliefs_are_refused(ours, tmp_path, edit, says) -> None:
    regulator = BeliefRegulator(triangle(), ours)
    regulator.observe(still(regulator))
    path = tmp_path / "beliefs.json"
    BeliefHistory(regulator.pairs, np.zeros(1), regulator.probabilities[None], {}, [], regulator.scene()).save(path)
    path.write_text(edit(path.read_text()))
    with pytest.raises(BeliefError, match=says):
        BeliefHistory.load(path)


@pytest.fixture(scope="module")
def checkpoint(ours, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("belief") / "tiny.safetensors"
    physics = load_checkpoint(shipped("contact")).hash
    save_checkpoint(Checkpoint("belief", {"hidden": 16}, ours.network, {}, physics), path)
    return str(path)


def test_a_belief_needs_the_physics_it_was_trained_on(ours, checkpoint, tmp_path) -> None:
    assert BeliefModel.load(checkpoint).network.hidden == 16
    path = tmp_path / "other.safetensors"
    save_checkpoint(Checkpoint("belief", {"hidden": 16}, ours.network, {}, "0" * 64), path)
    with pytest.raises(CheckpointError, match="trained on other weights of contact"):
        BeliefModel.load(path)
    with pytest.raises(CheckpointError, match="holds 'contact', no belief"):
        BeliefModel.load(shipped("contact"))
    with pytest.raises(CheckpointError, match="holds 'belief', no predictor"):
        PhysicsPredictor.load(checkpoint)


@pytest.mark.parametrize("suffix", ["h5", "csv"])
def test_observe_on_the_command_line(checkpoint, tmp_path, suffix) -> None:
    scene, seen = tmp_path / "scene.json", tmp_path / f"track.{suffix}"
    scene.write_text(triangle().to_json())
    track = simulate(triangle())
    lost = track.seen.copy()
    lost[10:14, 2] = False
    dataclasses.replace(track, seen=lost, poses=np.where(lost[..., None], track.poses, np.nan)).save(seen)
    command = ["observe", str(scene), str(seen), "--out", str(tmp_path / "out"), "--model", checkpoint]
    result = CliRunner().invoke(cli.app, command)
    assert result.exit_code == 0, result.output
    assert "b was not seen from 0.50 to 0.65 s." in result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"beliefs.json", "beliefs.png", "scene.json"}
    beliefs = str(tmp_path / "out" / "beliefs.json")
    predict = ["predict", str(scene), "--out", str(tmp_path / "predicted"), "--animation", "none"]
    result = CliRunner().invoke(cli.app, [*predict, "--relations", "believed", "--beliefs", beliefs])
    assert result.exit_code == 0, result.output
    assert CliRunner().invoke(cli.app, [*predict, "--relations", "believed"]).exit_code == 2
    assert CliRunner().invoke(cli.app, [*predict, "--beliefs", beliefs]).exit_code == 2
    refused = CliRunner().invoke(cli.app, [*command, "--camera-error", "0.02"]).exception
    assert isinstance(refused, BeliefError)
    assert "camera_error: must be" in str(refused)


def test_what_is_doubtful_about_a_track_is_said(checkpoint, tmp_path) -> None:
    scene, seen = tmp_path / "scene.json", tmp_path / "track.csv"
    scene.write_text(triangle().to_json())
    simulate(triangle()).save(seen)
    lines = seen.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("0.5,b,"))
    for bad, says in (
        ("0.5,b,0.9,0.5,0.0,", "b: 1 sighting away from those before and after"),
        ("0.5,nobody,0.1,0.1,0.0,", "nobody: not in the scene, ignored"),
        ("0.5,b,nan,0.1,0.0,", "b was not seen from 0.50 to 0.50 s"),
        ("0.4,b,0.1,0.1,0.0,", "1 row of a node and time that stood before"),
    ):
        seen.write_text("\n".join([*lines[:at], f"{bad},,,", *lines[at + 1 :]]))
        command = ["observe", str(scene), str(seen), "--out", str(tmp_path / "out"), "--model", checkpoint]
        result = CliRunner().invoke(cli.app, command)
        assert result.exit_code == 0, result.output
        assert says in " ".join(result.output.split())


def test_a_track_that_cannot_be_believed_is_refused(checkpoint, tmp_path) -> None:
    scene, seen = tmp_path / "scene.json", tmp_path / "track.csv"
    scene.write_text(triangle().to_json())
    track = simulate(triangle())
    dataclasses.replace(track, poses=track.poses * [1000.0, 1000.0, 1.0]).save(seen)
    command = ["observe", str(scene), str(seen), "--out", str(tmp_path / "out"), "--model", checkpoint]
    with pytest.raises(TrackError, match="cannot be believed as it is:\n- looks like millimetres"):
        CliRunner().invoke(cli.app, command, catch_exceptions=False)
    assert not (tmp_path / "out").exists()


def test_what_rests_is_averaged_and_what_may_move_is_not(ours) -> None:
    rng = np.random.default_rng(0)
    scene = Scene(bodies=(body("near", 0.0, 0.0), body("far", 0.5, 0.0), body("farther", 0.5, 0.125)))
    regulator = BeliefRegulator(scene, ours)
    noise = []
    for frame in range(30):
        poses = np.concatenate(([[-0.108, 0.0003 * frame, 0.0]], scene.poses_world_from_body))
        noise.append(rng.normal(size=(3, 3)) * [0.001, 0.001, 0.01])
        poses[1:] += noise[-1]
        regulator.observe(poses)
    state = regulator._watched.view.state
    off = state.poses[0].numpy() - scene.poses_world_from_body
    np.testing.assert_array_equal(regulator.scene().poses_world_from_body, state.poses[0].numpy())
    np.testing.assert_allclose(off[1:], np.mean(noise, 0)[1:], atol=1e-9)  # the tool is far from both
    np.testing.assert_allclose(off[0], noise[-1][0], atol=1e-9)  # the tool moves beside it
    # The anchors of the untouched pair follow: it shows no drift.
    pair = pair_index(1, 2, 3)
    relations = state.relations
    anchors = [
        pose.transform(state.poses[0, end], anchor[0, pair].double())
        for end, anchor in ((1, relations.anchor_a), (2, relations.anchor_b))
    ]
    np.testing.assert_allclose(anchors[0], anchors[1], atol=1e-6)


def test_a_body_that_moves_out_of_reach_is_believed(ours) -> None:
    scene = Scene(bodies=(body("a", 0.0, 0.0), body("b", 0.5, 0.0)))
    regulator = BeliefRegulator(scene, ours)
    for x in (0.5, 0.5, 0.5, 0.51):
        regulator.observe(np.array([[-0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [x, 0.0, 0.0]]))
    assert float(regulator._watched.view.state.poses[0, 1, 0]) == pytest.approx(0.51)


@pytest.mark.parametrize("name", BELIEFS)
def test_the_shipped_weights_believe_what_they_did_when_they_were_shipped(name) -> None:
    track = PhysicsPredictor.load().predict(workshop())
    believed = BeliefHistory.watch(workshop(), track, name).probabilities[-1]
    np.testing.assert_allclose(believed, json.loads(GOLDEN.read_text())[name], atol=5e-3)


@pytest.mark.parametrize("name", BELIEFS)
def test_a_shipped_belief_says_how_it_was_trained_and_holds_no_physics(name) -> None:
    model = BeliefModel.load(name)
    assert model.record["data"]["seed"] < 1_000_000
    assert model.record["samples"] > 1e5
    assert len(model.record["curve"]) >= 5
    assert not any("solver" in key or "encoder.object" in key for key in model.network.state_dict())


def test_the_shipped_belief_tells_a_glued_pair_from_a_loose_one() -> None:
    scene = Scene(
        bodies=(body("a", 0.0, 0.0), body("b", 0.0, 0.122), body("c", 0.0, -0.122)),
        joints=(Joint(kind="fixed", parent="a", child="b"),),
        pushes=(Push(start=(-0.2, 0.03), end=(0.1, 0.03)),),
    )
    believed = BeliefHistory.watch(scene, simulate(scene)).likeliest
    assert believed == {("a", "b"): "fixed", ("a", "c"): "none", ("b", "c"): "none"}


def test_watching_bit_by_bit_is_watching_at_once() -> None:
    scene, ours = workshop(), untrained()
    track = simulate(scene)
    whole = BeliefHistory.watch(scene, track, ours)
    watching = Watching(scene, track, ours)
    watching.until(7)
    earlier = watching.copied()
    watching.until(watching.end)
    assert np.array_equal(watching.history().probabilities, whole.probabilities)
    assert watching.history().scene == whole.scene
    assert earlier.done == 7
    assert np.array_equal(earlier.history().probabilities, whole.probabilities[:7])


def test_a_belief_is_corrected_by_hand(tmp_path: Path) -> None:
    scene = workshop()
    watching = Watching(scene, simulate(scene), untrained())
    watching.until(5)
    for kind in KINDS:
        watching.correct(("lid", "plate"), kind)
        history = watching.history()
        history.save(tmp_path / "beliefs.json")
        assert BeliefHistory.load(tmp_path / "beliefs.json").likeliest["plate", "lid"] == kind
        assert [joint.kind for joint in history.scene.joints if {joint.parent, joint.child} == {"plate", "lid"}] == [
            kind
        ] * (kind != "none")
    watching.until(9)
    assert watching.history().likeliest["plate", "lid"] == KINDS[-1]
    seen = Watching(scene, simulate(scene), untrained())
    seen.until(9)
    watching.correct(("plate", "lid"), None)
    assert np.array_equal(watching.history().probabilities[-1], seen.history().probabilities[-1])
    for pair, kind, fault in (
        (("plate", "nobody"), "fixed", "no pair"),
        (("plate", "plate"), "fixed", "no pair"),
        (("plate", "lid"), "ball", "no joint 'ball'"),
        (("plate", "cup"), "revolute", "never near"),
        (("cup", "handle"), "none", "the scene says"),
    ):
        with pytest.raises(BeliefError, match=fault):
            watching.correct(pair, kind)
