"""Training of boards: it learns, goes on after a kill, and keeps a correction only if that is better than none."""

import pytest
import torch

from pushgraph import pose_3d
from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.dataset.lever_store import LeverColumns, LeverDataset
from pushgraph.dataset.ragged import Recipe
from pushgraph.errors import CheckpointError, TrainingError
from pushgraph.lever_physics import LeverPredictor
from pushgraph.network.lever_dynamics import LEVERS
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.lever_setup import LEVER_UP, draw_interaction
from pushgraph.track_frames import FRAME
from pushgraph.training.lever import LeverTask, LeverTraining, train_lever, velocity_between
from pushgraph.training.processes import Processes
from pushgraph.training.run import TrainingRun

TINY = {"samples": 16, "frames": 2, "batch": 4, "hidden": 8}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[str, str]:
    """Two interactions to learn from, the beginning of one to choose by."""
    paths = {}
    for name, seed, count in (("data", 0, 2), ("validation", 1, 1)):
        path = tmp_path_factory.mktemp("lever") / f"{name}.h5"
        interactions = [draw_interaction(seed, k) for k in range(count)]
        if name == "validation":
            scene = interactions[0].track.scene
            track = simulate_lever(scene.replace(path=scene.path[:2]))
            interactions = [interactions[0]._replace(track=track)]
        columns = LeverColumns.of(interactions)
        LeverDataset.write(path, Recipe(setup=LEVER_UP, objects=1, seed=seed, first=0, count=count), [columns])
        paths[name] = str(path)
    return paths


@pytest.mark.parametrize("model", LEVERS)
def test_training_writes_what_predicts(model, data, tmp_path) -> None:
    training = LeverTraining(model=model, **data, **TINY, interactions=1)
    now = train_lever(training, TrainingRun(out=str(tmp_path / "out.safetensors")))
    assert now.step == 2
    checkpoint = load_checkpoint(tmp_path / "out.safetensors")
    assert checkpoint.record["data"]["interactions"] == 1
    if model == "lever_up":
        best = min(row["bounded_error_mm"] for row in now.curve) / now.curve[0]["bounded_error_mm"]
        assert checkpoint.network.is_silent == (best > 0.95)
        assert now.curve[0]["final_position_error_mm"] < 2
    true = LeverDataset(data["validation"])[0]
    track = LeverPredictor.load(tmp_path / "out.safetensors").predict(true.scene)
    assert track.poses.shape == true.poses.shape


def test_training_goes_on_to_the_same_weights(data, tmp_path) -> None:
    training = LeverTraining(model="lever_up_propnet", **data, **TINY)

    class Killed(Exception):
        pass

    def kill(now, loss) -> None:
        if now.step == 1:
            raise Killed

    run, other = (TrainingRun(out=str(tmp_path / f"{name}.safetensors")) for name in ("whole", "parts"))
    train_lever(training, run)
    with pytest.raises(Killed):
        train_lever(training, other, tell=kill)
    train_lever(training, other)
    whole, parts = (load_checkpoint(tmp_path / f"{name}.safetensors").network for name in ("whole", "parts"))
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), parts.parameters(), strict=True))


def test_the_true_velocity_is_told_from_two_frames() -> None:
    before = torch.tensor([[0, 0, 0, 1.0, 0, 0, 0]], dtype=torch.float64)
    velocity = torch.tensor([[0.1, 0, -0.2, 0, 0, 1.0]], dtype=torch.float64)
    turn = pose_3d.from_rotation_vector(velocity[:, 3:] * FRAME)
    after = torch.cat((velocity[:, :3] * FRAME, -turn), 1)
    torch.testing.assert_close(velocity_between(before, after), velocity)
    assert not velocity_between(before, before + 1e-6).any()


def test_what_does_not_fit_is_refused(data, tmp_path) -> None:
    with pytest.raises(TrainingError, match="interactions: Input should be greater than or equal to 1"):
        LeverTraining(model="lever_up", **data, interactions=0)
    with pytest.raises(TrainingError, match="frames: at most"):
        LeverTask(LeverTraining(model="lever_up", **data, frames=1000), Processes(), torch.device("cpu"))
    with pytest.raises(CheckpointError, match="holds 'contact'"):
        LeverPredictor.load(shipped("contact"))
