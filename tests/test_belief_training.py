"""Training of belief: sequences, what is shown of them, and a tiny training that learns and resumes."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pushgraph.belief import BeliefModel
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint, shipped
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.sequences import SequenceSampler
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import CheckpointError, DatasetError, TrainingError
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.training import belief, loop, watching
from pushgraph.training.belief import BeliefTask, BeliefTraining, belief_loss, train_belief
from pushgraph.training.masses import mass_loss, weighed
from pushgraph.training.processes import Processes
from pushgraph.training.run import TrainingRun
from pushgraph.training.watching import NOISE, watched

TINY = {"frames": 30, "batch": 4, "hidden": 8}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[str, str]:
    """Four trajectories of three bodies to learn from, two to choose by."""
    paths = {}
    for name, seed, count in (("data", 0, 4), ("validation", 1, 2)):
        path = tmp_path_factory.mktemp("training") / f"{name}.h5"
        columns = Columns.of([draw_trajectory("multiple-parts", 3, seed, k) for k in range(count)])
        recipe = Recipe(setup="multiple-parts", objects=3, seed=seed, first=0, count=count)
        Dataset.write(path, recipe, [columns])
        paths[name] = str(path)
    return paths


@pytest.fixture(autouse=True)
def short_validation(monkeypatch) -> None:
    monkeypatch.setattr(belief, "VALIDATION_FRAMES", 40)


def test_sequences_are_stretches_of_trajectories_and_depend_on_the_step_alone(data) -> None:
    dataset = Dataset(data["data"])
    sampler, again = SequenceSampler(dataset, 60, 8, seed=3), SequenceSampler(dataset, 60, 8, seed=3)
    batch = sampler.batch(5)
    again.batch(0)
    np.testing.assert_array_equal(batch.poses, again.batch(5).poses)
    assert not np.array_equal(batch.poses, sampler.batch(6).poses)
    tracks = [dataset[k] for k in range(len(dataset))]
    at_start = 0
    for scene, poses, down, lasts in zip(batch.scenes, batch.poses, batch.down, batch.lasts, strict=True):
        (track,) = [track for track in tracks if track.scene == scene]
        (first,) = np.flatnonzero((np.abs(track.poses[:, 1:] - poses[0, 1:]) < 1e-6).all((1, 2)) & track.push_start)[:1]
        count = int(lasts.sum())
        assert count == min(60, len(track.times) - first)
        np.testing.assert_allclose(poses[:count], track.poses[first : first + count], atol=1e-6)
        np.testing.assert_array_equal(down[:count], track.down[first : first + count])
        assert not down[count:].any()
        at_start += first == 0
    assert 0 < at_start < 8


def test_bad_settings_of_sequences_are_named(data) -> None:
    for wrong in ({"frames": 1}, {"batch": 0}, {"seed": -1}):
        with pytest.raises(DatasetError, match=next(iter(wrong))):
            SequenceSampler(Dataset(data["data"]), **{"frames": 5, "batch": 2, "seed": 0} | wrong)


def test_what_a_watcher_is_shown(data) -> None:
    sequences = SequenceSampler(Dataset(data["data"]), 40, 200, seed=0).batch(0)
    scenes = batch_scenes(sequences.scenes)
    seen = watched(sequences, torch.Generator().manual_seed(0))
    assert not seen.scenes.relations.kind.any()
    assert not seen.scenes.relations.known.any()
    assert set(seen.joint.unique().tolist()) <= set(JOINT_CODES.values())
    assert ((seen.joint == scenes.relations.kind) | (seen.joint == JOINT_CODES["fixed"])).all()
    known = seen.scenes.mass_known.all(1).float().mean()
    assert abs(float(known) - watching.MASSES_KNOWN) < 0.1
    blind = ~seen.scenes.yaw_known
    assert (blind <= scenes.is_cylinder).all()
    assert (seen.poses[..., 2].abs().amax(1)[blind] == 0).all()
    # A mirror keeps x; what is left is noise, up to 1 mm and 0.5 degree, and exactly none in a quarter.
    off = seen.poses[..., 0] - torch.from_numpy(sequences.poses)[:, :, 1:, 0]
    spread = off.std((1, 2))
    assert abs(float((spread == 0).float().mean()) - watching.CLEAN) < 0.1
    assert 0.8 * NOISE[0] < float(spread.max()) < 1.2 * NOISE[0]
    assert 0.02 < float((~seen.seen).float().mean()) < 0.1
    assert seen.seen[:, 0].all()


def test_the_loss_of_a_sure_right_answer_is_small_and_the_end_weighs_most(data, monkeypatch) -> None:
    sequences = SequenceSampler(Dataset(data["data"]), 30, 4, seed=0).batch(0)
    seen = watched(sequences, torch.Generator().manual_seed(0))
    dynamics = load_checkpoint(shipped("contact")).network.requires_grad_(False)
    network = belief.BELIEFS["belief"](hidden=8)
    told = belief.answers(network, dynamics, seen)
    joint = seen.joint[told.rows.scene, told.rows.pair]
    right = 20.0 * torch.nn.functional.one_hot(joint, 4).float()

    def loss_of(frames: slice) -> float:
        """Loss if the answers are right in these frames, and evenly unsure in the others."""
        log_odds = torch.zeros_like(told.log_odds)
        log_odds[frames] = right
        monkeypatch.setattr(belief, "answers", lambda *_: told._replace(log_odds=log_odds))
        return float(belief_loss(network, dynamics, seen).detach())

    unsure, early, late, sure = (loss_of(s) for s in (slice(0), slice(0, 15), slice(15, 30), slice(30)))
    assert unsure == pytest.approx(np.log(4), abs=1e-3)
    assert sure < 1e-3
    assert unsure - late > 2.5 * (unsure - early)


@pytest.mark.parametrize("model", ["belief", pytest.param("paper_recipe", marks=pytest.mark.slow)])
def test_training_learns_and_goes_on_where_it_stopped(model, data, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(loop, "SAVE_EVERY", 0.0)
    monkeypatch.setattr(BeliefTraining, "VALIDATIONS", 4)
    tiny = TINY | ({"hidden": 256} if model == "paper_recipe" else {})
    training = BeliefTraining(model=model, **data, samples=30 * 4 * 14, learning_rate=1e-2, **tiny)
    run, other = (TrainingRun(out=str(tmp_path / f"{name}.safetensors")) for name in ("whole", "pieces"))
    train_belief(training, run)
    whole = load_checkpoint(tmp_path / "whole.safetensors")
    curve = whole.record["curve"]
    assert curve[-1]["loss"] < curve[0]["loss"]
    assert whole.physics == load_checkpoint(shipped(whole.network.PHYSICS)).hash
    assert whole.record["samples"] == 30 * 4 * 14

    def stop(now, loss) -> None:
        if now.step == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_belief(training, other, tell=stop)
    train_belief(training, other)
    pieces = load_checkpoint(tmp_path / "pieces.safetensors")
    for name, values in whole.network.state_dict().items():
        assert torch.equal(pieces.network.state_dict()[name], values)


@pytest.fixture(scope="module")
def masses(tmp_path_factory) -> dict[str, str]:
    """Three trajectories to learn masses from, two to choose by."""
    paths = {}
    for name, seed, count in (("masses", 0, 3), ("masses_validation", 1, 2)):
        path = tmp_path_factory.mktemp("masses") / f"{name}.h5"
        columns = Columns.of([draw_trajectory("different-masses-mixed", 3, seed, k) for k in range(count)])
        recipe = Recipe(setup="different-masses-mixed", objects=3, seed=seed, first=0, count=count)
        Dataset.write(path, recipe, [columns])
        paths[name] = str(path)
    return paths


def test_masses_are_learnt_beside_joints_or_alone(data, masses, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(belief, "MASS_FRAMES", 30)
    monkeypatch.setattr(belief, "MASS_VALIDATION", 2)
    both = BeliefTraining(**data, **masses, **TINY)
    network = belief.BELIEFS["belief"](hidden=8)
    BeliefTask(both, Processes(), torch.device("cpu")).loss(network, 0).backward()
    assert all(parameter.grad is not None for parameter in network.parameters())

    start = tmp_path / "start.safetensors"
    train_belief(both.replace(samples=120, masses=None, masses_validation=None), TrainingRun(out=str(start)))
    alone = both.replace(samples=240, start_from=str(start), keep_joints=True)
    train_belief(alone, TrainingRun(out=str(tmp_path / "alone.safetensors")))
    before, after = (load_checkpoint(path).network.state_dict() for path in (start, tmp_path / "alone.safetensors"))
    for name, values in before.items():
        if not name.startswith("mass_noise"):
            torch.testing.assert_close(after[name], values)


def test_evidence_is_learnt_to_be_worth_what_it_is(masses) -> None:
    """The loss of a track is less where its evidence is taken for what it is worth than for nothing."""
    dynamics = load_checkpoint(shipped("contact")).network
    network = load_checkpoint(shipped("belief")).network.mass_noise.requires_grad_(False)
    sequences = SequenceSampler(Dataset(masses["masses"]), 60, 3, seed=1).batch(0)
    tracks = weighed(sequences, torch.Generator().manual_seed(0))
    told = mass_loss(network, dynamics, tracks)
    network.log_worth -= 20
    network.log_worth_of_wrench -= 20
    assert told < mass_loss(network, dynamics, tracks) - 0.1


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"masses": "nowhere.h5"}, "both or neither"),
        ({"masses": "nowhere.h5", "masses_validation": "nowhere.h5"}, "masses: no such dataset"),
        ({"keep_joints": True}, "needs masses to learn"),
    ],
)
def test_settings_about_masses_that_do_not_fit_are_refused(data, settings, reason: str) -> None:
    with pytest.raises(TrainingError, match=reason):
        BeliefTraining(**data, **TINY, **settings)


def test_the_physics_weights_stay_as_they_are(data) -> None:
    training = BeliefTraining(**data, **TINY)
    task = BeliefTask(training, Processes(), torch.device("cpu"))
    network = belief.BELIEFS["belief"](hidden=8)
    task.loss(network, 0).backward()
    of_masses = {id(parameter) for parameter in network.mass_noise.parameters()}
    assert all((parameter.grad is None) == (id(parameter) in of_masses) for parameter in network.parameters())
    assert all(parameter.grad is None for parameter in task._dynamics.parameters())
    names = set(network.state_dict())
    assert not any("solver" in name for name in names)


def test_bad_trainings_are_refused(data) -> None:
    with pytest.raises(TrainingError, match="no network 'magic' to train; valid: belief, paper_recipe"):
        BeliefTraining(model="magic", **data)
    with pytest.raises(TrainingError, match="no such dataset"):
        BeliefTraining(**data | {"data": str(Path("nowhere.h5"))})
    assert BeliefTraining(**data).frames == 200


def test_belief_is_trained_on_physics_of_one_s_own(data, tmp_path) -> None:
    own, out = str(tmp_path / "physics.safetensors"), str(tmp_path / "belief.safetensors")
    save_checkpoint(Checkpoint("contact", {"hidden": 8, "steps": 1}, ContactDynamics(8, 1), {}), own)
    training = BeliefTraining(model="belief", samples=240, physics=own, **data, **TINY)
    train_belief(training, TrainingRun(out=out))
    assert load_checkpoint(out).physics == load_checkpoint(own).hash
    assert load_checkpoint(out).record["training"]["physics"] == "physics.safetensors"
    assert BeliefModel.load(out, physics=own).network.hidden == 8
    with pytest.raises(CheckpointError, match="trained on other weights of contact than those shipped; name those"):
        BeliefModel.load(out)
    with pytest.raises(CheckpointError, match="holds 'belief'; this belief stands on 'contact'"):
        BeliefModel.load(out, physics=out)
