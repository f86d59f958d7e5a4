"""The command predict, and what the shipped weights predict."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import body, workshop

from pushgraph import load
from pushgraph.body import Joint
from pushgraph.checkpoint import Checkpoint, save_checkpoint
from pushgraph.cli import main
from pushgraph.errors import CheckpointError, PredictionError
from pushgraph.network.dynamics import DYNAMICS
from pushgraph.physics import MODELS, PhysicsPredictor
from pushgraph.precision import PRECISIONS, fastest_precision
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import Track

GOLDEN = Path(__file__).parent / "golden" / "predictions.json"


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        main(list(arguments))
    return exit_.value.code


@pytest.mark.parametrize("model", MODELS)
def test_the_shipped_weights_predict_what_they_did_when_they_were_shipped(model) -> None:
    track = load(model).predict(workshop())
    golden = json.loads(GOLDEN.read_text())[model]
    np.testing.assert_allclose(track.poses[-1], golden, atol=2e-4)
    assert np.abs(track.poses[-1, 1:] - track.poses[0, 1:]).max() > 0.02


@pytest.mark.parametrize("model", MODELS)
def test_a_shipped_checkpoint_says_how_it_was_trained_and_is_small(model) -> None:
    record = load(model).record
    # The paper's networks' last stages, on its own setup.
    paper = {"image": ("multiple-parts", 9e4), "propnet": ("multiple-parts", 3e5)}
    setup, samples = paper.get(model, ("planar", 2e5))
    assert record["data"]["setup"] == setup
    assert record["data"]["seed"] < 1_000_000
    assert record["samples"] > samples
    assert record["seconds"] > 60
    assert len(record["curve"]) >= 10
    assert not re.search("/root|/work", json.dumps(record))


@pytest.mark.parametrize("model", MODELS)
def test_bfloat16_predicts_nearly_what_float32_does(model) -> None:
    exact, rounded = (load(model, precision=precision).predict(workshop()).poses for precision in PRECISIONS)
    assert rounded.dtype == exact.dtype
    off = np.abs(rounded - exact)[:, 1:, :2].max()
    assert off < 0.05 * np.abs(exact[-1] - exact[0])[1:, :2].max()
    assert (off > 0) == (model != "contact")  # without a correction nothing of `contact` is rounded


def test_the_fastest_precision_is_one_of_both_and_timed_once() -> None:
    assert fastest_precision() in PRECISIONS
    assert fastest_precision.cache_info().currsize >= 1
    kept = load("propnet", precision="auto").dynamics.network.head[0].weight.dtype
    assert kept == PRECISIONS[fastest_precision("cpu")]


def test_a_precision_that_there_is_not_is_named_with_those_there_are() -> None:
    with pytest.raises(PredictionError, match=r"no precision 'float8'; valid: float32, bfloat16, auto"):
        load(precision="float8")


def two_discs(joint: str | None) -> Scene:
    """Table 1 of the paper: the robot pushes between two objects, one above the other, a centimetre apart."""
    joints = () if joint is None else (Joint(kind=joint, parent="upper", child="lower"),)
    return Scene(
        bodies=(body("upper", 0.0, 0.065), body("lower", 0.0, -0.065)),
        joints=joints,
        tool=Tool.round(0.05),
        pushes=(Push(start=(-0.12, -0.04), end=(0.10, -0.04), speed=0.2),),
    )


def test_table_1_of_the_paper_in_prediction() -> None:
    predictor = load()
    for joint in (None, "fixed", "revolute", "prismatic"):
        scene = two_discs(joint)
        predicted, true = (
            track.poses[-1, 1:] - track.poses[0, 1:] for track in (predictor.predict(scene), simulate(scene))
        )
        off = np.hypot(*(predicted - true)[:, :2].T)
        moved = np.hypot(*true[:, :2].T)
        assert (off < 0.012 + 0.2 * moved).all(), (joint, predicted, true)
        if joint == "fixed":
            assert predicted[0, 2] == pytest.approx(predicted[1, 2], abs=1e-9)
        if joint is None:
            assert moved.max() > 5 * moved.min()  # they part
        if joint == "prismatic":
            assert predicted[0, 2] == pytest.approx(predicted[1, 2], abs=0.1)  # it slides, and does not turn
        if joint == "revolute":  # the lower turns about the upper
            turned, truly = (motion[1, 2] - motion[0, 2] for motion in (predicted, true))
            assert truly > 0.4
            assert turned > 0.2


def test_a_predicted_hinge_turns_as_far_as_in_simulation() -> None:
    scene = two_discs("revolute")
    ends = [track.poses[-1, 1:, 2] for track in (load().predict(scene), simulate(scene))]
    turned, truly = (yaw[1] - yaw[0] for yaw in ends)
    assert turned == pytest.approx(truly, abs=0.1)


def test_predict_writes_a_track_that_says_what_the_table_says(tmp_path, capsys) -> None:
    path = tmp_path / "scene.json"
    path.write_text(workshop().to_json())
    assert run("predict", str(path), "--out", str(tmp_path / "out"), "--animation", "none") == 0
    printed = capsys.readouterr().out
    track = Track.load(tmp_path / "out" / "track.h5")
    np.testing.assert_array_equal(track.poses, load().predict(workshop()).poses)
    row = re.search(r"lid\s+│\s+(\S+) │", printed)
    assert float(row[1]) == pytest.approx(track.poses[-1, 2, 0], abs=1e-4)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"track.h5", "track.csv", "picture.png"}


def test_what_is_not_given_is_not_used(tmp_path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(workshop().to_json())
    tracks = {}
    for name, options in {"given": (), "none": ("--relations", "none"), "mean": ("--masses", "mean")}.items():
        assert run("predict", str(path), "--out", str(tmp_path / name), "--animation", "none", *options) == 0
        tracks[name] = Track.load(tmp_path / name / "track.h5")
    assert tracks["none"].scene.joints == ()
    assert all(body.mass is None for body in tracks["mean"].scene.bodies)
    for name in ("none", "mean"):
        assert np.abs(tracks[name].poses - tracks["given"].poses).max() > 1e-4


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("predict", "demo", "--relations", "guessed"), "is not one of 'given', 'none', 'believed'"),
        (("predict", "demo", "--masses", "heavy"), "is not one of 'given', 'mean', 'believed'"),
        (("predict", "demo", "--model", "best.safetensors"), "no such file"),
        (("predict", "nothing.json"), "shipped scenes: demo"),
        (("evaluate", "physics", "--seed", "5", "--count", "1", "--objects", "6"), "seeds below 1,000,000"),
        (("evaluate", "physics", "--setup", "camera", "--objects", "7"), "no scene of 7 objects; valid: 2, 3, 4, 5"),
    ],
)
def test_what_does_not_fit_is_said_and_the_exit_status_is_not_zero(
    arguments, says, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) != 0
    assert says in re.sub(r"[│╭╮╰╯─\s]+", " ", capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_a_scene_without_pushes_is_one_frame() -> None:
    track = load().predict(workshop(), [])
    assert track.poses.shape == (1, 5, 3)
    assert not track.down[0]


def test_a_pose_that_is_not_finite_stops_the_rollout_and_is_kept(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path))
    dynamics = DYNAMICS["contact"](hidden=8, steps=2)
    with torch.no_grad():
        dynamics.network.of_node.bias.fill_(float("nan"))
    with pytest.raises(PredictionError, match=r"body \d is not finite at frame \d+"):
        PhysicsPredictor(dynamics).predict(workshop())
    assert (tmp_path / "failures" / "rollout.safetensors").is_file()


def test_a_checkpoint_of_ones_own_is_loaded_by_its_path(tmp_path) -> None:
    torch.manual_seed(0)
    made = DYNAMICS["contact"](hidden=8, steps=2)
    save_checkpoint(Checkpoint("contact", {"hidden": 8, "steps": 2}, made, {}), tmp_path / "mine.safetensors")
    predictor = load(str(tmp_path / "mine.safetensors"))
    assert all(torch.equal(a, b) for a, b in zip(made.parameters(), predictor.dynamics.parameters(), strict=True))
    with pytest.raises(CheckpointError):
        load("yours")


def test_unknown_pairs_may_meet_for_the_first_time_in_a_prediction() -> None:
    scene = Scene(
        bodies=(body("first", 0.0, 0.0), body("second", 0.2, 0.0)),
        unknown_pairs=(("first", "second"),),
        pushes=(Push(start=(-0.15, 0.0), end=(0.1, 0.0)),),
    )
    met, known = (load().predict(told).poses[-1] for told in (scene, scene.replace(unknown_pairs=())))
    assert met[2, 0] > 0.24
    np.testing.assert_allclose(met, known, atol=1e-9)
