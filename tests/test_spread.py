"""Spreads: the distribution, what it is computed from, and what the shipped weights state."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import body, workshop
from typer.testing import CliRunner

from pushgraph import BeliefHistory, cli, load
from pushgraph.body import Joint
from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.errors import CheckpointError, PredictionError, TrackError
from pushgraph.evaluation.results import Results
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes
from pushgraph.graph.track_features import FRAMES_APART, _gaps, doubt_of, track_features
from pushgraph.network.spread_network import LEAST, LEAST_YAW, SpreadNetwork
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.spread import Spread
from pushgraph.spread_model import spread_at_knots, spread_in_frames
from pushgraph.tool import Push
from pushgraph.track import Track

GOLDEN = Path(__file__).parent / "golden" / "spreads.json"
SURE, UNSURE = (0.97, 0.01, 0.01, 0.01), (0.5, 0.3, 0.1, 0.1)


def constant(**values: float) -> Spread:
    """The same spread of two bodies in three frames."""
    given = {"direction": 0.4, "along": 0.02, "across": 0.01, "degrees": 2.0, "farthest": 9.0, "yaw": 0.1}
    given |= {"yaw_degrees": 3.0} | values
    return Spread(**{name: np.full((3, 2), value) for name, value in given.items()})


def pushed_row() -> Scene:
    """Three discs in a row, the first of which is pushed at the second, and one that nothing reaches."""
    discs = (body("a", 0.0, 0.0), body("b", 0.125, 0.005), body("c", 0.25, 0.0), body("far", 0.0, 0.6))
    return Scene(bodies=discs, pushes=(Push(start=(-0.13, 0.0), end=(0.05, 0.0)),))


@pytest.fixture(scope="module")
def predictor() -> PhysicsPredictor:
    return load()


# the distribution


def test_quantiles_are_as_by_hand() -> None:
    # n = 2: 1 - 1 / (1 + R^2 / 2) = 1/2 at R^2 = 2. n = 3: 1 - (1 + Z / 3)^-3 = 7/8 at Z = 3.
    spread = constant()
    ellipse = spread.ellipse(0.5)
    np.testing.assert_allclose(ellipse.along, 0.02 * math.sqrt(2))
    np.testing.assert_allclose(ellipse.across, 0.01 * math.sqrt(2))
    np.testing.assert_allclose(ellipse.direction, 0.4)
    np.testing.assert_allclose(spread.yaw_interval(7 / 8), 0.3)
    np.testing.assert_allclose(spread.position_level(np.array([0.0, 0.0])), 0)
    along = 0.02 * math.sqrt(2) * np.array([math.cos(0.4), math.sin(0.4)])
    np.testing.assert_allclose(spread.position_level(along), 0.5)
    np.testing.assert_allclose(spread.yaw_level(np.full((3, 2), -0.3 + 2 * math.pi)), 7 / 8)


@pytest.mark.parametrize(("degrees", "yaw_degrees"), [(1.0, 1.2), (2.5, 4.0), (30.0, 30.0)])
def test_samples_lie_within_regions_as_often_as_stated(degrees, yaw_degrees) -> None:
    spread = constant(degrees=degrees, yaw_degrees=yaw_degrees, yaw=0.01).take((slice(1), slice(1)))
    samples = spread.sample(np.random.default_rng(0), 40_000)
    level, yaw_level = spread.position_level(samples[..., :2]), spread.yaw_level(samples[..., 2])
    for probability in (0.2, 0.68, 0.9):
        assert abs((level < probability).mean() - probability) < 0.01
        assert abs((yaw_level < probability).mean() - probability) < 0.01
    ellipse = spread.ellipse(0.68)
    x, y = samples[:, 0, 0, :2].T
    along, across = math.cos(0.4) * x + math.sin(0.4) * y, math.cos(0.4) * y - math.sin(0.4) * x
    inside = (along / ellipse.along[0, 0]) ** 2 + (across / ellipse.across[0, 0]) ** 2 < 1
    assert abs(inside.mean() - 0.68) < 0.01
    assert abs(np.sign(samples[..., 2]).mean()) < 0.02


def test_no_error_is_beyond_what_can_be() -> None:
    spread = constant(degrees=1.0, farthest=0.05, yaw_degrees=1.0)
    samples = spread.sample(np.random.default_rng(0), 5000)
    assert np.hypot(samples[..., 0], samples[..., 1]).max() <= 0.05 + 1e-9
    assert np.abs(samples[..., 2]).max() <= math.pi
    assert spread.ellipse(1.0).along.max() == pytest.approx(0.05)


def test_within_a_sample_errors_of_a_body_belong_together_and_of_two_bodies_do_not() -> None:
    samples = constant().sample(np.random.default_rng(0), 4)
    assert samples.shape == (4, 3, 2, 3)
    np.testing.assert_array_equal(samples[:, 0], samples[:, 2])
    assert (samples[:, 0, 0] != samples[:, 0, 1]).all()


def test_tensors_and_arrays_give_the_same_and_gradients_flow() -> None:
    arrays = constant()
    tensors = Spread(*(torch.tensor(values, requires_grad=True) for values in arrays))
    uniform = np.random.default_rng(0).random((5, 3, 2, 3))
    errors = tensors.errors(torch.tensor(uniform))
    np.testing.assert_allclose(errors.detach().numpy(), arrays.errors(uniform))
    errors.square().sum().backward()
    assert (tensors.along.grad > 0).all()
    np.testing.assert_array_equal(tensors.numpy().along, arrays.along)


# what it is computed from


def test_gaps_are_as_by_hand() -> None:
    # A box of 4 by 2 cm at the origin, one turned by 90 degrees 6 cm to its right, a disc of 1 cm radius 5 cm above it.
    nodes = torch.tensor([[[[0.0, 0.0, 0.0], [0.06, 0.0, math.pi / 2], [0.0, 0.05, 0.3]]]])
    half_extents = torch.tensor([[[0.02, 0.01], [0.02, 0.01], [0.0, 0.0]]])
    gaps = _gaps(nodes, half_extents, torch.tensor([[0.0, 0.0, 0.01]]))[0, 0]
    assert float(gaps[0, 1]) == pytest.approx(0.03, abs=1e-6)
    assert float(gaps[0, 2]) == pytest.approx(0.03, abs=1e-6)
    torch.testing.assert_close(gaps, gaps.t())


def features_of_track(track: Track, order: list[int] | None = None, sign: float = 1.0, place=(0.0, 0.0, 0.0)):
    """Features of a track whose bodies are told in another order, mirrored, then moved and turned."""
    order = order or list(range(len(track.scene.bodies)))
    scenes = batch_scenes([track.scene.replace(bodies=tuple(track.scene.bodies[k] for k in order))])
    poses = track.poses * np.array([1.0, sign, sign])
    x, y, turn = place
    cos, sin = math.cos(turn), math.sin(turn)
    moved = poses @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + np.array([x, y, turn])
    nodes = torch.from_numpy(moved[None])
    bodies = nodes[:, :, 1:][:, :, order]
    pairs = scenes.relations.kind.shape[1]
    still = torch.zeros_like(bodies[:, 0])
    down = torch.from_numpy(track.down[None])
    return track_features(scenes, scenes.relations, bodies, nodes[:, :, 0], down, torch.zeros(1, pairs), still)


def test_spreads_move_and_turn_with_the_scene_and_neither_mirrors_nor_the_order_of_bodies_matter(predictor) -> None:
    torch.manual_seed(0)
    network = SpreadNetwork(hidden=8).requires_grad_(False)
    torch.nn.init.normal_(network.answer.weight, std=0.3)
    track = predictor.predict(workshop())
    features = features_of_track(track)
    scales = network(features)
    order = [2, 0, 3, 1]
    for changed, bodies in (
        (features_of_track(track, place=(5.0, -3.0, 1.2)), [0, 1, 2, 3]),
        (features_of_track(track, sign=-1.0), [0, 1, 2, 3]),
        (features_of_track(track, order), order),
    ):
        for name, before, after in zip(scales._fields, scales, network(changed), strict=True):
            torch.testing.assert_close(after, before[..., bodies], rtol=2e-3, atol=1e-6, msg=name)
    turned = (features_of_track(track, place=(0.0, 0.0, 1.2)).direction - features.direction)[:, 1:]  # all rests first
    torch.testing.assert_close(torch.cos(turned - 1.2), torch.ones_like(turned), atol=1e-4, rtol=0)


def test_a_prediction_is_no_less_sure_of_a_frame_if_it_goes_on(predictor) -> None:
    track = predictor.predict(pushed_row())
    frames = len(track.times) // FRAMES_APART // 2 * FRAMES_APART + 1
    short = Track(track.scene, *(values[:frames] for values in (track.times, track.poses, track.push, track.seen)))
    network = SpreadNetwork(hidden=8).requires_grad_(False)
    whole, part = (network(features_of_track(some)) for some in (track, short))
    knots = part.along.shape[1]
    torch.testing.assert_close(part.along, whole.along[:, :knots])


def test_between_knots_scales_grow_evenly(predictor) -> None:
    features = features_of_track(predictor.predict(pushed_row()))
    network = SpreadNetwork(hidden=8).requires_grad_(False)
    scales = network(features)
    at_knots, frames = spread_at_knots(scales, features), int(features.knots[-1]) + 1
    everywhere = spread_in_frames(scales, features, frames)
    torch.testing.assert_close(everywhere.along[:, features.knots], at_knots.along)
    torch.testing.assert_close(everywhere.along[:, FRAMES_APART // 2], at_knots.along[:, :2].mean(1))


def test_doubt_is_what_belief_gives_to_other_joints_and_rigid_pieces_count_as_fixed() -> None:
    chain = Scene(
        bodies=(body("a", 0.0, 0.0), body("b", 0.125, 0.0), body("c", 0.25, 0.0)),
        joints=(Joint(kind="fixed", parent="a", child="b"), Joint(kind="fixed", parent="b", child="c")),
    )
    scenes = batch_scenes([chain])
    probabilities = torch.tensor([[[0.1, 0.9, 0.0, 0.0], [0.2, 0.8, 0.0, 0.0], [0.3, 0.4, 0.2, 0.1]]])
    torch.testing.assert_close(doubt_of(scenes, scenes.relations, probabilities), torch.tensor([[0.1, 0.2, 0.6]]))


# what the shipped weights state


def test_nothing_is_doubtful_where_nothing_moves(predictor) -> None:
    spread = predictor.predict(pushed_row(), spread=True).spread
    np.testing.assert_allclose(spread.along[0], LEAST, rtol=1e-3)
    np.testing.assert_allclose(spread.along[-1, 3], LEAST, rtol=0.05)
    np.testing.assert_allclose(spread.yaw[-1, 3], LEAST_YAW, rtol=0.05)
    assert (spread.ellipse(0.68).along[-1, :2] > 2e-4).all()


@pytest.mark.parametrize("unknown", ["masses", "side_friction", "joints"])
def test_what_is_not_known_widens_the_spread(predictor, unknown) -> None:
    # Discs that are pushed along the line of their centres hardly feel friction.
    scene, beliefs = workshop() if unknown == "side_friction" else pushed_row(), None
    if unknown == "masses":
        other = scene.replace(bodies=tuple(one.replace(mass=None) for one in scene.bodies))
    elif unknown == "side_friction":
        other = scene.replace(side_friction=None)
    else:
        other, beliefs = scene, {("b", "a"): UNSURE, ("b", "c"): UNSURE}
    known = predictor.predict(scene, spread=True).spread
    wider = predictor.predict(other, spread=True, beliefs=beliefs).spread
    size, wider_size = (some.ellipse(0.68).along[-1, :3].sum() for some in (known, wider))
    assert wider_size > 1.05 * size


def test_the_surer_the_belief_the_narrower_the_spread(predictor) -> None:
    tracks = [
        predictor.predict(pushed_row(), spread=True, beliefs={("a", "b"): row, ("b", "c"): row})
        for row in (SURE, UNSURE)
    ]
    np.testing.assert_array_equal(tracks[0].poses, tracks[1].poses)
    sure, unsure = (track.spread.ellipse(0.95).along[-1, 1] for track in tracks)
    assert unsure > 2 * sure


def test_the_shipped_weights_state_what_they_did_when_they_were_shipped(predictor) -> None:
    final = predictor.predict(workshop(), spread=True).spread.take(-1)
    for name, values in json.loads(GOLDEN.read_text()).items():
        np.testing.assert_allclose(getattr(final, name), values, rtol=0.02, atol=2e-4, err_msg=name)


def test_a_rollout_without_spread_is_the_same_and_states_none(predictor) -> None:
    states = predictor.start([pushed_row()])
    tool = torch.zeros(1, 12, 3, dtype=torch.float64)
    tool[0, :, 0] = torch.linspace(-0.1, 0.0, 12)
    down = torch.ones(1, 12, dtype=torch.bool)
    with torch.no_grad():
        plain, stated = predictor.rollout(states, tool, down), predictor.rollout(states, tool, down, spread=True)
    assert plain.spread is None
    torch.testing.assert_close(plain.poses, stated.poses)
    assert all(values.shape == (1, 12, 4) and values.isfinite().all() for values in stated.spread)
    with pytest.raises(PredictionError, match="needs spread=True"):
        predictor.rollout(states, tool, down, doubt=torch.zeros(1, 6))


def test_weights_of_others_state_no_spread() -> None:
    with pytest.raises(CheckpointError, match="other physics weights than those that predict"):
        load("propnet").predict(pushed_row(), spread=True)
    assert not load("propnet").states_spread
    with pytest.raises(CheckpointError, match="holds 'contact', no spread; valid: spread"):
        PhysicsPredictor.load(spread=shipped("contact")).predict(pushed_row(), spread=True)
    spread, contact = load_checkpoint(shipped("spread")), load_checkpoint(shipped("contact"))
    assert spread.physics == contact.hash
    assert len(spread.record["curve"]) >= 10


@pytest.mark.parametrize(
    ("beliefs", "says"),
    [
        ({("a", "cup"): SURE}, r"\('a', 'cup'\) is no pair of bodies of scene 0: a, b, c, far"),
        ({("a", "a"): SURE}, "is no pair"),
        ({("a", "b"): (0.5, 0.5)}, "must be probabilities of none, fixed, prismatic, revolute"),
        ({("a", "b"): (2.0, -1.0, 0.0, 0.0)}, "must be probabilities"),
    ],
)
def test_beliefs_that_cannot_be_are_refused(predictor, beliefs, says) -> None:
    with pytest.raises(PredictionError, match=says):
        predictor.predict(pushed_row(), spread=True, beliefs=beliefs)


def test_tracks_keep_their_spread_in_hdf5(predictor, tmp_path) -> None:
    track = predictor.predict(pushed_row(), spread=True)
    track.save(tmp_path / "track.h5")
    read = Track.load(tmp_path / "track.h5")
    for before, after in zip(track.spread, read.spread, strict=True):
        np.testing.assert_array_equal(before, after)
    with pytest.raises(TrackError, match=r"spread, direction: shape must be"):
        Track(track.scene, track.times, track.poses, track.push, track.seen, spread=track.spread.take(slice(3)))


def test_the_command_prints_the_spread_and_takes_what_is_believed(predictor, tmp_path) -> None:
    scene = pushed_row()
    (tmp_path / "scene.json").write_text(scene.to_json())
    history = BeliefHistory.watch(scene, predictor.predict(scene))
    history.save(tmp_path / "beliefs.json")
    common = ["predict", str(tmp_path / "scene.json"), "--animation", "none", "--out", str(tmp_path / "out")]
    believed = ["--relations", "believed", "--beliefs", str(tmp_path / "beliefs.json")]
    for arguments in (common, common + believed):
        said = CliRunner().invoke(cli.app, arguments, env={"COLUMNS": "160"})
        assert said.exit_code == 0, said.output
        assert "± (cm)" in said.output
        assert Track.load(tmp_path / "out" / "track.h5").spread is not None
    said = CliRunner().invoke(cli.app, [*common, "--model", "propnet"], env={"COLUMNS": "160"})
    assert said.exit_code == 0, said.output
    assert "±" not in said.output


def test_rotated_boxes_and_joints_do_not_break_it(predictor) -> None:
    bodies = (body("a", 0.0, 0.0, Cuboid(size=(0.1, 0.1)), 0.3), body("b", 0.13, 0.0, mass=None))
    joint = Joint(kind="prismatic", parent="a", child="b")
    scene = Scene(bodies=bodies, joints=(joint,), pushes=(Push(start=(-0.15, 0.02), end=(0.0, 0.02)),))
    spread = predictor.predict(scene, spread=True).spread
    assert all(np.isfinite(values).all() for values in spread)
    assert (spread.degrees >= 1).all()


def test_rank_correlation_is_spearmans() -> None:
    results = Results("spread", {}, ())
    first, second = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([10.0, 30.0, 20.0, 50.0, 400.0])
    results.add_rank_correlation("contact", "spread_correlation", first, second, np.arange(5))
    assert results.rows[0]["value"] == pytest.approx(0.9)  # 1 - 6 * (1 + 1) / (5 * 24)
    assert list(JOINT_CODES) == ["none", "fixed", "prismatic", "revolute"]
