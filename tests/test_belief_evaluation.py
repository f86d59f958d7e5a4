"""The suites belief and coupled: figures worked by hand, laws between the models, and what is refused."""

import math

import numpy as np
import pytest
import torch
from scenes import body
from typer.testing import CliRunner

from pushgraph import cli, pose
from pushgraph.body import Joint
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint, shipped
from pushgraph.errors import EvaluationError
from pushgraph.evaluation import belief as belief_suite
from pushgraph.evaluation import coupled as coupled_suite
from pushgraph.evaluation.belief import (
    INFORMED,
    NOISES,
    OBSERVED,
    PAIRS,
    add_noise,
    close,
    evaluate_belief,
    place_errors,
)
from pushgraph.evaluation.blocks import Block
from pushgraph.evaluation.coupled import (
    FRAMES,
    MODELS,
    STARTS,
    all_fixed,
    assumptions,
    evaluate_coupled,
    mean_and_standard_error,
    predict_block,
    rollout_errors,
)
from pushgraph.evaluation.metrics import CALIBRATION_BINS, RolloutError, calibration_bin, reliability
from pushgraph.evaluation.recording import Recording, record
from pushgraph.evaluation.results import Results
from pushgraph.graph.believed import joint_places
from pushgraph.graph.joint_truth import adjacent_pairs, between_pieces, flush_pairs, touched_pairs, unaware
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes
from pushgraph.graph.watching import first_look, look
from pushgraph.network.belief_network import BELIEFS
from pushgraph.network.dynamics import Advance
from pushgraph.physics import PhysicsPredictor
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.simulation.setups import Trajectory, draw_trajectory
from pushgraph.track import Track

OBJECTS, COUNT, SEED = 6, 2, 1_000_003
WATCHED = 45
NONE, FIXED, REVOLUTE = (JOINT_CODES[name] for name in ("none", "fixed", "revolute"))


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory) -> dict[str, str]:
    """Untrained beliefs on the shipped physics."""
    folder, paths = tmp_path_factory.mktemp("beliefs"), {}
    for kind, config in (("belief", {"hidden": 8}), ("paper_recipe", {"hidden": 8})):
        torch.manual_seed(1)
        physics = load_checkpoint(shipped(BELIEFS[kind].PHYSICS)).hash
        paths[kind] = str(folder / f"{kind}.safetensors")
        save_checkpoint(Checkpoint(kind, config, BELIEFS[kind](**config), {}, physics), paths[kind])
    return paths


@pytest.fixture(scope="module")
def trajectories() -> list[Trajectory]:
    return [draw_trajectory("multiple-parts", OBJECTS, SEED, k) for k in range(COUNT)]


@pytest.fixture(scope="module")
def tracks(trajectories) -> list[Track]:
    return [trajectory.track for trajectory in trajectories]


@pytest.fixture(scope="module")
def believed(checkpoints, trajectories):
    """Beliefs about the first frames, which keep their last answer."""
    short = [trajectory._replace(track=first_frames(trajectory.track, WATCHED)) for trajectory in trajectories]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Block, "draw", lambda block: short)
        return evaluate_belief([OBJECTS], COUNT, SEED, checkpoints)


@pytest.fixture(scope="module")
def coupled(checkpoints):
    return evaluate_coupled([OBJECTS], COUNT, SEED, {"contact": "contact", "belief": checkpoints["belief"]})


def first_frames(track: Track, frames: int) -> Track:
    return Track(track.scene, *(values[:frames] for values in (track.times, track.poses, track.push, track.seen)))


def row(results: Results, **labels):
    (found,) = [r for r in results.rows if all(r[name] == value for name, value in labels.items())]
    return found


def discs(*gaps: float, joints: tuple[Joint, ...] = ()) -> Scene:
    """A row of discs with these gaps (m) between neighbours: a, b, c, ..."""
    places = np.cumsum([0.0, *(0.12 + gap for gap in gaps)])
    return Scene(bodies=tuple(body("abcdef"[k], x, 0.0) for k, x in enumerate(places)), joints=joints)


def still(scene: Scene, frames: int) -> Track:
    """The scene with nothing moving, the tool lifted."""
    poses = np.concatenate((np.full((1, 3), 1.0), scene.poses_world_from_body))
    shape = (frames, len(poses))
    return Track(
        scene, np.arange(frames) * 0.05, np.tile(poses, (frames, 1, 1)), np.full(frames, -1), np.ones(shape, dtype=bool)
    )


def fixed(parent: str, child: str) -> Joint:
    return Joint(kind="fixed", parent=parent, child=child)


CHAIN = discs(
    *(0.01, 0.01, 0.01), joints=(fixed("a", "b"), fixed("b", "c"), Joint(kind="revolute", parent="c", child="d"))
)


# belief


def test_chains_of_fixed_are_closed_and_what_is_joined_inside_them_is_fixed() -> None:
    scenes = batch_scenes([CHAIN] * 2)
    # Pairs: ab ac ad bc bd cd.
    answers = torch.tensor([[[1, 0, 0, 1, 0, 3], [1, 3, 0, 1, 0, 0]], [[0, 0, 1, 0, 0, 1], [0, 0, 0, 0, 0, 0]]])
    closed = torch.tensor([[[1, 1, 0, 1, 0, 3], [1, 1, 0, 1, 0, 0]], [[0, 1, 1, 0, 0, 1], [0, 0, 0, 0, 0, 0]]])
    assert torch.equal(close(scenes, answers), closed)


def test_a_slider_counts_for_every_pair_of_the_pieces_that_it_joins() -> None:
    scenes = batch_scenes([CHAIN])
    # Pairs: ab ac ad bc bd cd. With a, b, c in one piece, all hinge on d; with b and c apart, none but c does.
    for kind, spread in (([1, 0, 0, 1, 0, 3], [1, 1, 3, 1, 3, 3]), ([1, 0, 0, 2, 0, 3], [1, 2, 0, 2, 0, 3])):
        assert between_pieces(scenes, torch.tensor([kind])).tolist() == [spread]


def test_flush_are_cuboids_with_parallel_sides() -> None:
    half = math.pi / 2
    square = Cuboid(size=(0.1, 0.08))
    bodies = [body("abcd"[k], 0.2 * k, 0.0, square, yaw) for k, yaw in enumerate((0.3, 0.3 + half, 0.305, 0.4))]
    scene = Scene(bodies=(*bodies, body("e", 1.0, 0.0)))
    # Pairs: ab ac ad ae bc bd be cd ce de.
    found = flush_pairs(batch_scenes([scene]), torch.tensor(scene.poses_world_from_body[None]))
    assert found.long().tolist() == [[1, 1, 0, 0, 1, 0, 0, 0, 0, 0]]


def test_a_believed_hinge_is_as_far_off_as_it_sits() -> None:
    pivot = np.array([0.05, 0.04])
    hinge = Joint(kind="revolute", parent="a", child="b", anchor=tuple(pivot.tolist()))
    scene = discs(0.01, joints=(hinge,))
    scenes = batch_scenes([scene])
    poses = np.tile(scene.poses_world_from_body, (40, 1, 1))
    for frame, turn in enumerate(np.linspace(0, 0.5, 40)):
        poses[frame, 1] = [*(pivot + pose.rotate(poses[0, 1, :2] - pivot, turn)), turn]
    bodies = torch.from_numpy(poses[None])
    tool, down, seen = torch.full((1, 3), 1.0).double(), torch.zeros(1, dtype=torch.bool), torch.ones(1, 2) > 0
    view, _ = first_look(unaware(scenes), bodies[:, 0], tool, down, seen)
    middle = place_errors(scenes.relations, joint_places(view.state, view.fits))[0]
    assert float(middle) == pytest.approx(math.hypot(0.05 - 0.065, 0.04), abs=1e-6)
    for frame in range(1, 40):
        view, _ = look(view, bodies[:, frame], tool, down, seen)
    anchor, axis = place_errors(scenes.relations, joint_places(view.state, view.fits))
    assert float(anchor) < 3e-4
    assert bool(axis.isnan().all())


def test_informed_knows_what_was_touched_and_every_number_is_as_by_hand(monkeypatch) -> None:
    # a moves in frame 12, b in frame 25; the track ends after 30 frames and keeps its last answer.
    track = still(CHAIN, 30)
    track.poses[12:, 1, 1] += 0.03
    track.poses[25:, 2, 1] += 0.03
    monkeypatch.setattr(Block, "draw", lambda block: [Trajectory(track, "dense", "paper", {})] * block.count)
    results, _ = evaluate_belief([4], 1, SEED, {})
    expected = {
        # Nothing known: none for all. Truth: ab, ac, bc fixed, cd revolute, ad and bd none.
        (10, "all", "accuracy", "all"): 2 / 6,
        (10, "all", "accuracy_raw", "all"): 3 / 6,
        (10, "adjacent", "accuracy", "all"): 0.0,
        (10, "touched", "accuracy", "all"): None,
        (10, "all", "precision", "fixed"): None,
        (10, "all", "precision", "none"): 2 / 6,
        # ab is known.
        (20, "all", "accuracy", "all"): 3 / 6,
        (20, "adjacent", "accuracy", "all"): 1 / 3,
        (20, "touched", "accuracy", "all"): 1.0,
        (20, "all", "precision", "none"): 2 / 5,
        (20, "all", "recall", "none"): 1.0,
        (20, "all", "precision", "fixed"): 1.0,
        (20, "all", "recall", "fixed"): 1 / 3,
        (20, "adjacent", "recall", "fixed"): 1 / 2,
    }
    for observed in (40, 200):
        # ab and bc are known, and so is ac, which nobody listed.
        expected |= {
            (observed, "all", "accuracy", "all"): 5 / 6,
            (observed, "all", "accuracy_raw", "all"): 5 / 6,
            (observed, "all", "recall", "fixed"): 1.0,
            (observed, "all", "recall", "revolute"): 0.0,
            (observed, "all", "recall", "prismatic"): None,
            (observed, "all", "precision", "none"): 2 / 3,
            (observed, "touched", "accuracy", "all"): 1.0,
        }
    for noise in NOISES:
        for (observed, pairs, metric, joint), value in expected.items():
            labels = {"observed_frames": observed, "pairs": pairs, "metric": metric, "joint": joint, "noise": noise}
            assert row(results, model=INFORMED, **labels)["value"] == pytest.approx(value), labels
    assert not [r for r in results.rows if r["metric"] == "ece"]


def test_answers_are_those_of_watching_scene_by_scene(believed, checkpoints, tracks) -> None:
    _, scenes = believed
    for scene, track in zip(scenes, tracks, strict=True):
        unweighed = tuple(one.replace(mass=None) for one in track.scene.bodies)
        regulator = BeliefRegulator(track.scene.replace(bodies=unweighed), checkpoints["belief"])
        for poses, down in zip(track.poses[:40], track.down[:40].tolist(), strict=True):
            probabilities = regulator.observe(poses, down)
        answers, time = scene.answers["belief", "none"], OBSERVED.index(40)
        np.testing.assert_allclose(answers.top[time], probabilities.max(1), atol=1e-5)
        told = probabilities[np.arange(len(probabilities)), answers.likeliest[time]]
        np.testing.assert_allclose(told, probabilities.max(1), atol=1e-5)


def test_the_figures_of_beliefs_are_those_of_the_protocol(believed) -> None:
    results, scenes = believed
    for model, noise, pairs, observed in (
        ("belief", "none", "all", 40),
        ("belief", "1mm", "adjacent", 200),
        ("paper_recipe", "none", "touched", 200),
    ):
        time = OBSERVED.index(observed)
        said, raw, true, listed, tops = [], [], [], [], []
        for scene in scenes:
            for pair in np.flatnonzero(scene.chosen[pairs][time]):
                answers = scene.answers[model, noise]
                said.append(answers.closed[time, pair])
                raw.append(answers.likeliest[time, pair])
                tops.append(answers.top[time, pair])
                true.append(scene.joint[pair])
                listed.append(scene.listed[pair])
        said, raw, true, listed, tops = map(np.array, (said, raw, true, listed, tops))
        calibration = 0.0
        for k in range(CALIBRATION_BINS):
            inside = (tops >= k / CALIBRATION_BINS) & (tops < (k + 1) / CALIBRATION_BINS)
            if inside.any():
                calibration += inside.mean() * abs((raw == true)[inside].mean() - tops[inside].mean())
        labels = {"model": model, "noise": noise, "pairs": pairs, "observed_frames": observed}
        for metric, expected in (
            ("accuracy", (said == true).mean()),
            ("accuracy_raw", (raw == listed).mean()),
            ("ece", calibration),
        ):
            assert row(results, metric=metric, joint="all", **labels)["value"] == pytest.approx(expected, abs=1e-6)
        for joint, code in JOINT_CODES.items():
            for metric, of in (("precision", said), ("recall", true)):
                found = row(results, metric=metric, joint=joint, **labels)
                if (of == code).any():
                    assert found["value"] == pytest.approx((said == true)[of == code].mean())
                    assert found["low"] <= found["value"] <= found["high"]
                else:
                    assert found["value"] is None


def test_informed_is_right_about_touched_pairs_and_noise_matters_to_beliefs_alone(believed) -> None:
    _, scenes = believed
    for scene in scenes:
        told = scene.answers[INFORMED, "none"]
        assert (told.closed == scene.joint)[scene.chosen["touched"]].all()
        assert (told.likeliest == NONE)[~scene.chosen["touched"]].all()
        assert np.array_equal(told.closed, scene.answers[INFORMED, "1mm"].closed)
        assert not np.array_equal(scene.answers["belief", "none"].top, scene.answers["belief", "1mm"].top)
        assert (scene.chosen["touched"] <= scene.chosen["adjacent"]).all()
        assert (np.diff(scene.chosen["touched"].astype(int), axis=0) >= 0).all()
    assert sum(scene.chosen["touched"][-1].sum() for scene in scenes) > 5


def test_every_row_of_belief_carries_every_label_once(believed) -> None:
    results, _ = believed
    names = ("model", "metric", "objects", "observed_frames", "pairs", "noise", "joint")
    seen = [tuple(r[name] for name in names) for r in results.rows]
    for r in results.rows:
        assert set(r) == {*names, "value", "low", "high", "unit"}
    assert len(set(seen)) == len(seen)
    wanted = {
        (model, metric, OBJECTS, observed, pairs, noise, joint)
        for model in ("belief", "paper_recipe", INFORMED)
        for metric in ("accuracy", "accuracy_raw", "accuracy_pieces", "ece", "precision", "recall")
        for observed in (10, 20, 40, 60, 80, 100, 120, 140, 160, 180, 200)
        for pairs in PAIRS
        for noise in ("none", "1mm")
        for joint in (JOINT_CODES if metric in ("precision", "recall") else ("all",))
        if (model, metric) != (INFORMED, "ece")
    } | {
        (model, metric, OBJECTS, 200, pairs, noise, joint)
        for model in ("belief", "paper_recipe")
        for metric, joint in (("anchor_error_mm", "revolute"), ("axis_error_deg", "prismatic"))
        for pairs in ("touched", "touched_anywhere", "touched_flush")
        for noise in ("none", "1mm")
    }
    assert set(seen) == wanted


def test_noise_has_its_size_and_is_a_scene_s_own(tracks) -> None:
    seen = record(tracks, 200)
    noisy = add_noise(seen, NOISES["1mm"], Block(OBJECTS, SEED, 0, 2, ()))
    off = (noisy.bodies - seen.bodies).flatten(0, 2)
    assert torch.equal(noisy.tool, seen.tool)
    assert off.std(0).tolist() == pytest.approx([1e-3, 1e-3, np.radians(0.5)], rel=0.05)
    assert abs(np.corrcoef(off[:-OBJECTS, 0], off[OBJECTS:, 0])[0, 1]) < 0.08
    alone = add_noise(record(tracks[1:], 200), NOISES["1mm"], Block(OBJECTS, SEED, 1, 1, ()))
    assert torch.equal(alone.bodies[0], noisy.bodies[1])


def test_the_calibration_error_and_its_interval_by_hand() -> None:
    results = Results("belief", {}, ())
    # Scene 3: two answers at 0.95, one right: off by 0.45. Scene 8: two at 0.35, both wrong: off by 0.35.
    top, right = np.array([0.95, 0.35, 0.95, 0.35]), np.array([True, False, False, False])
    results.add_calibration_error("belief", top, right, np.array([3, 8, 3, 8]))
    found = results.rows[-1]
    assert (found["metric"], found["unit"]) == ("ece", "1")
    assert (found["low"], found["value"], found["high"]) == pytest.approx((0.35, 0.40, 0.45))
    # Within a bin, answers make up for each other; across bins they do not.
    results.add_calibration_error("belief", np.array([0.5, 0.5]), np.array([True, False]), np.array([0, 1]))
    assert results.rows[-1]["value"] == 0.0
    results.add_calibration_error("belief", np.array([0.25, 0.75]), np.array([True, False]), np.array([0, 0]))
    assert results.rows[-1]["value"] == pytest.approx(0.75)
    assert calibration_bin(np.array([0.0, 1 / 15 - 1e-9, 1 / 15 + 1e-9, 0.999, 1.0])).tolist() == [0, 0, 1, 14, 14]


def test_the_reliability_diagram_by_hand() -> None:
    bins = reliability(np.array([0.91, 0.93, 0.25]), np.array([True, False, True]))
    assert bins.sure[13] == pytest.approx(0.92)
    assert bins.right[13] == 0.5
    assert bins.share[[3, 13]].tolist() == pytest.approx([1 / 3, 2 / 3])
    assert np.isnan(bins.right[0])


# coupled


def test_the_oracle_is_the_prediction_of_evaluate_physics_at_the_start(coupled, tracks) -> None:
    results, scenes = coupled
    predicted = PhysicsPredictor.load("contact").predict_many([track.scene for track in tracks], FRAMES)
    errors = [RolloutError(guess, track, FRAMES).mean for guess, track in zip(predicted, tracks, strict=True)]
    assert [scene.errors["oracle"][0] for scene in scenes] == pytest.approx(errors, rel=0.02)
    found = row(results, model="oracle", observed_frames=0)
    assert found["value"] == pytest.approx(100 * np.mean(errors), rel=0.02)
    assert found["low"] < found["value"] < found["high"]
    mean, error = mean_and_standard_error(scenes, OBJECTS, "oracle")
    assert mean[0] == found["value"]
    assert error[0] == pytest.approx(100 * abs(errors[0] - errors[1]) / 2, rel=0.02)


def test_informed_has_no_joint_at_first_and_is_the_oracle_when_every_joint_was_touched(coupled, tracks) -> None:
    _, scenes = coupled
    informed_of_all = 0
    for scene, track in zip(scenes, tracks, strict=True):
        assert scene.errors["informed_oracle"][0] == pytest.approx(scene.errors["no_joint"][0], rel=1e-6)
        batch, bodies = batch_scenes([track.scene]), record([track], 151).bodies
        joined = batch.relations.kind > 0
        touched = touched_pairs(adjacent_pairs(batch, bodies[:, 0]), bodies)
        for k, start in enumerate(STARTS):
            if (touched[:, start] >= joined).all():
                informed_of_all += 1
                assert scene.errors["informed_oracle"][k] == pytest.approx(scene.errors["oracle"][k], rel=1e-4)
            assert scene.errors["oracle"][k] < 0.1
    assert informed_of_all


def test_every_row_of_coupled_carries_every_label_once(coupled) -> None:
    results, _ = coupled
    for r in results.rows:
        assert set(r) == {"model", "metric", "value", "low", "high", "unit", "objects", "observed_frames"}
        assert (r["metric"], r["unit"], r["objects"]) == ("error_cm", "cm", OBJECTS)
    seen = [(r["model"], r["observed_frames"]) for r in results.rows]
    assert sorted(seen) == sorted((model, start) for model in MODELS for start in range(0, 101, 10))
    assert set(MODELS) == {"oracle", "informed_oracle", "belief", "no_joint", "all_fixed", "all_fixed_5cm"}


def test_a_belief_that_knows_everything_is_the_oracle_and_one_in_nothing_has_no_joint(
    checkpoints, trajectories, tracks, monkeypatch
) -> None:
    kind = batch_scenes([track.scene for track in tracks]).relations.kind
    kind[1] = NONE  # all is known of the first scene, nothing believed in the second
    monkeypatch.setattr(Block, "draw", lambda block: trajectories)
    monkeypatch.setattr(coupled_suite.BeliefModel, "joints", lambda model, watched: kind)
    monkeypatch.setattr(coupled_suite, "STARTS", (0, 10))
    models = (("contact", "contact"), ("belief", checkpoints["belief"]))
    for scene, like in zip(predict_block(Block(OBJECTS, SEED, 0, COUNT, models)), ("oracle", "no_joint"), strict=True):
        np.testing.assert_allclose(scene.errors["belief"], scene.errors[like], rtol=1e-2)
        assert not np.allclose(scene.errors["oracle"], scene.errors["no_joint"], rtol=0.1)


def test_all_fixed_joins_what_stands_near_now() -> None:
    scene = discs(0.01, 0.04, 0.06, joints=(Joint(kind="revolute", parent="a", child="b"),))
    scenes = batch_scenes([scene])
    bodies = torch.from_numpy(np.tile(scene.poses_world_from_body, (1, 3, 1, 1)))
    bodies[:, 2, 3, 0] -= 0.05  # d has come to 1 cm from c
    # Pairs: ab ac ad bc bd cd.
    for frame, gap, pairs in (
        (0, 0.02, [1, 0, 0, 0, 0, 0]),
        (0, 0.05, [1, 0, 0, 1, 0, 0]),
        (2, 0.02, [1, 0, 0, 0, 0, 1]),
        (2, 0.05, [1, 0, 0, 1, 0, 1]),
    ):
        relations = all_fixed(scenes, bodies[:, frame], gap)
        assert relations.kind[0].tolist() == [FIXED * near for near in pairs]
        assert relations.known.all()
        assert relations.remembered[0].tolist() == [bool(near) for near in pairs]
    assumed = assumptions(scenes, bodies)
    assert assumed["all_fixed"].kind[0].tolist() == [FIXED, 0, 0, 0, 0, FIXED]
    assert assumed["all_fixed_5cm"].kind[0].tolist() == [FIXED, 0, 0, FIXED, 0, FIXED]
    assert assumed["oracle"].kind[0].tolist() == [REVOLUTE, 0, 0, 0, 0, 0]
    assert not assumed["informed_oracle"].kind.any()
    bodies[:, 1, 0, 1] += 0.03  # a was touched, and went back
    assert assumptions(scenes, bodies)["informed_oracle"].kind[0].tolist() == [REVOLUTE, 0, 0, 0, 0, 0]
    assert not assumptions(scenes, bodies)["no_joint"].kind.any()


def test_rollouts_start_from_the_truth_as_it_moves_and_count_what_the_track_has() -> None:
    scenes = batch_scenes([CHAIN] * 2)
    seen = record([still(CHAIN, 100), still(CHAIN, 100)], 100)
    seconds = torch.arange(100, dtype=torch.float64)
    seen.bodies[0, :, :, 0] += 0.001 * seconds[:, None]  # all go on at 1 mm a frame
    seen.tool[:, :, 0] += 0.002 * seconds
    seen = Recording(seen.tool, seen.bodies, torch.ones_like(seen.down), torch.tensor([100, 30]))
    seen.bodies[1, 12:, 0, 1] += 0.04  # one body leaps, of four
    told = []

    class Coasting:
        LONGEST_STEP = np.inf

        def __call__(self, state, control) -> Advance:
            told.append(control)
            return Advance(state.motions, torch.ones(len(state.poses)))

    errors = rollout_errors(Coasting(), seen, torch.tensor([[10, 10], [0, 0]]), [[scenes] * 2] * 2)
    assert errors.shape == (2, 2, 2)
    assert torch.equal(errors[:, 0], errors[:, 1])
    assert errors[0, 0, 0].item() == pytest.approx(0.0, abs=1e-9)
    # Frames 10 to 29 count; in the last 18 of these 20 one body of four is 4 cm off.
    assert errors[0, 0, 1].item() == pytest.approx(0.04 / 4 * 18 / 20)
    # In frame 0 no motion is known yet, so all stay where they are.
    assert errors[1, 0].tolist() == pytest.approx([0.001 * np.arange(FRAMES).mean(), 0.04 / 4 * 18 / 30])
    assert len(told) == FRAMES - 1
    assert told[0].motion[:, 0].tolist() == pytest.approx([0.002] * 8)
    assert told[0].pose[:, 0].tolist() == pytest.approx([1.02] * 4 + [1.0] * 4)


# both


def test_training_seeds_are_refused() -> None:
    for suite in (evaluate_belief, evaluate_coupled):
        with pytest.raises(EvaluationError, match="seed 999999: seeds below 1,000,000 are for training"):
            suite([3], 1, 999_999, {})


def test_the_commands_write_results_and_figures_and_print_the_numbers(believed, coupled, tmp_path, monkeypatch) -> None:
    asked, mine = [], str(shipped("belief"))
    for name, measured in (("belief", believed), ("coupled", coupled)):

        def suite(numbers, count, seed, models, workers, progress, measured=measured, setup=None):
            asked.append((numbers, count, seed, models, workers))
            return measured

        monkeypatch.setattr({"belief": belief_suite, "coupled": coupled_suite}[name], f"evaluate_{name}", suite)
    arguments = ["--objects", "6", "--count", "2", "--seed", str(SEED), "--workers", "1"]
    printed = {}
    for name, options, figures in (
        ("belief", ["--model", "belief", "--model", f"paper_recipe={mine}"], {"curves.png", "reliability.png"}),
        ("coupled", ["--belief", "mine"], {"coupled.png"}),
    ):
        out = tmp_path / name
        done = CliRunner().invoke(cli.app, ["evaluate", name, *arguments, *options, "--out", str(out)])
        assert done.exit_code == 0, done.output
        assert {path.name for path in out.iterdir()} == {"results.json", *figures}
        assert all((out / figure).stat().st_size > 10_000 for figure in figures)
        printed[name] = done.output
    assert asked == [
        ((6,), 2, SEED, {"belief": "belief", "paper_recipe": mine}, 1),
        ((6,), 2, SEED, {"contact": "contact", "belief": "mine"}, 1),
    ]
    accuracy = row(
        believed[0],
        **{"model": "belief", "metric": "accuracy", "observed_frames": 40, "pairs": "all", "noise": "none"},
    )
    (line,) = [line for line in printed["belief"].splitlines() if line.split()[1:6:2] == ["40", "none", "belief"]]
    assert line.split()[7] == f"{accuracy['value']:.3f}"
    mean, error = mean_and_standard_error(coupled[1], OBJECTS, "oracle")
    assert f"{mean[4]:.2f}±{error[4]:.2f}" in printed["coupled"]
    for model, says in (
        ("best", "no such shipped checkpoint here, valid: belief, paper_recipe; give NAME=FILE"),
        ("informed=" + mine, "there is a 'informed' in these results already"),
        ("my model=" + mine, "must be NAME or NAME=FILE"),
        ("mine=nothing.safetensors", "no such file"),
    ):
        wrong = CliRunner().invoke(cli.app, ["evaluate", "belief", "--model", model])
        assert wrong.exit_code == 1
        assert says in str(wrong.exception)
