"""Networks and setups of one's own, as the examples have them: registered, trained, saved, loaded and measured."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from scenes import workshop
from torch import nn

import pushgraph as pg
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.cli import main
from pushgraph.errors import CheckpointError, NetworkError, SetupError, TrainingError
from pushgraph.network.registry import NETWORKS, networks_of

EXAMPLES = Path(__file__).parents[1] / "examples"


def example(name: str) -> ModuleType:
    """An example as a module, imported once: it registers what is its own."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, next(EXAMPLES.glob(f"*{name}.py")))
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def test_an_own_network_is_trained_saved_loaded_and_measured(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    own = example("own_network")
    own.main(count=2, samples=512, scenes=1)
    printed = capsys.readouterr().out
    assert [line.split(":")[0] for line in printed.splitlines()] == ["still", "mlp", "contact", "noise_floor"]
    predictor = pg.load("mlp.safetensors")
    assert isinstance(predictor.dynamics, own.MlpDynamics)
    assert not predictor.solves
    track = predictor.predict(workshop())
    assert np.isfinite(track.poses).all()
    # Another process knows no such network until it imports what registers it.
    monkeypatch.delitem(networks_of("physics"), "mlp")
    with pytest.raises(CheckpointError, match=r"no network 'mlp'; valid: .*contact.*; import what registers your own"):
        pg.load("mlp.safetensors")
    # Trained by the command as well: what is registered there is a valid choice.
    pg.register_network("mlp", own.MlpDynamics)
    arguments = ["train", "physics", "--model", "mlp", "--data", "train.h5", "--validation", "validation.h5"]
    small = ["--samples", "64", "--batch", "8", "--hidden", "8", "--processes", "1"]
    with pytest.raises(SystemExit) as stop:
        main([*arguments, *small, "--out", "again.safetensors"])
    assert stop.value.code == 0
    assert load_checkpoint("again.safetensors").kind == "mlp"


@pytest.mark.slow
def test_an_own_setup_is_generated_trained_on_and_measured_in(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    example("own_setup").main(count=2, samples=64, scenes=1)
    printed = capsys.readouterr().out
    assert [line.split(":")[0] for line in printed.splitlines()] == ["still", "own", "contact", "noise_floor"]
    with pg.Dataset("dominoes.h5") as dataset:
        assert dataset.recipe.setup == "dominoes"
        assert {body.name for body in dataset[0].scene.bodies} == {f"plate{k}" for k in range(5)}
    assert pg.load("dominoes.safetensors").record["data"]["setup"] == "dominoes"


class Lacking(nn.Module):
    LONGEST_STEP = 1.0

    def __init__(self, hidden: int, steps: int) -> None:
        super().__init__()
        self.layer = nn.Linear(hidden, steps)

    @staticmethod
    def schema() -> dict:
        return {}


class Unsavable(Lacking):
    FRAMES_PER_STEP = (1,)
    SMALL = 0.01
    CHAOS = 1.0
    VELOCITY_NOISE = 0.0

    @staticmethod
    def schema() -> dict:
        return {"unit": torch.ones(1)}

    @staticmethod
    def error_unit(step):
        return step


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (Lacking, r"'own': Lacking lacks CHAOS, FRAMES_PER_STEP, SMALL, VELOCITY_NOISE, error_unit; see pushgraph"),
        (Unsavable, "'own': Unsavable cannot be saved and loaded again"),
        (type("Other", (Lacking,), {"__init__": lambda self: None}), r"'own': cannot be built from {'hidden': 8"),
    ],
)
def test_what_does_not_keep_the_contract_is_refused_before_training(network, says, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(networks_of("physics"), "own", network)
    path = pg.generate("multiple-parts", objects=3, count=1, seed=0, out=tmp_path / "data.h5")
    training = pg.PhysicsTraining(model="own", data=str(path), validation=str(path), samples=8, hidden=8, batch=2)
    run, begun = pg.TrainingRun(out=str(tmp_path / "own.safetensors")), []
    with pytest.raises((NetworkError, TrainingError), match=says):
        pg.train_physics(training, run, lambda now, loss: begun.append(now))
    assert not begun
    assert not list(tmp_path.rglob("*.safetensors"))


def test_names_are_taken_once(monkeypatch) -> None:
    with pytest.raises(NetworkError, match="'contact': there is a network of this name already, ContactDynamics"):
        pg.register_network("contact", Unsavable)
    with pytest.raises(NetworkError, match=r"'belief': there is a network"):
        pg.register_network("belief", Unsavable, task="physics")
    with pytest.raises(NetworkError, match=r"must be a class derived from torch\.nn\.Module"):
        pg.register_network("own", type("NoModule", (), {"schema": Unsavable.schema}))
    with pytest.raises(NetworkError, match="no task 'motion'; valid: physics, belief, spread, lever-up"):
        networks_of("motion")
    for name in ("planar", "lever-up"):
        with pytest.raises(SetupError, match=f"'{name}': there is a setup of this name already"):
            pg.register_setup(name, lambda rng, objects, index: None)


def test_every_network_is_known_to_checkpoints_whenever_it_is_registered(tmp_path: Path, monkeypatch) -> None:
    for task in ("physics", "belief", "spread", "lever-up"):
        assert set(networks_of(task)) <= set(NETWORKS)
    own = example("own_network")
    monkeypatch.setitem(networks_of("physics"), "late", own.MlpDynamics)
    config = {"hidden": 8, "steps": 1}
    save_checkpoint(Checkpoint("late", config, own.MlpDynamics(**config), {}), tmp_path / "late.safetensors")
    assert load_checkpoint(tmp_path / "late.safetensors").config == config
