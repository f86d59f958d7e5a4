"""Files of datasets, networks, trainings and adaptations: sound ones, how they are read, what they state."""

import dataclasses
import io
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from fuzz import of_bytes, of_hdf5, of_tensors, of_toml
from fuzz_pool import Kind
from fuzz_statements import agrees, has_line, reseal, strictly
from safetensors.torch import load as tensors_of

from pushgraph.adaptation.adapted import Adaptation, Adapted
from pushgraph.adaptation.correction import Correction
from pushgraph.adaptation.files import load_adaptation, save_adaptation
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.unknowns import COUNT, Estimate
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.dataset.lever_store import LeverColumns, LeverDataset
from pushgraph.dataset.ragged import RaggedFile, Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.network.registry import NETWORKS
from pushgraph.simulation.lever_setup import draw_interaction
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.training.configuration import read_configuration, save_configuration
from pushgraph.training.recipe import BeliefTraining, LeverTraining, PhysicsTraining, SpreadTraining
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress, RunningCheckpoint


def digest_of(tensors: Any) -> Any:
    return {
        name: (
            str(one.dtype),
            tuple(one.shape),
            one.detach().contiguous().reshape(-1).view(torch.uint8).numpy().tobytes(),
        )
        for name, one in tensors.items()
    }


def make_dataset(folder: Path) -> list[Path]:
    recipe = Recipe("planar", 3, 0, 0, 2, "of a test")
    Dataset.write(folder / "data.h5", recipe, [Columns.of([draw_trajectory("planar", 3, 0, k) for k in range(2)])])
    return [folder / "data.h5"]


def make_lever_dataset(folder: Path) -> list[Path]:
    recipe = Recipe("lever-up", 1, 5, 0, 2, "of a test")
    LeverDataset.write(folder / "lever.h5", recipe, [LeverColumns.of([draw_interaction(5, k) for k in range(2)])])
    return [folder / "lever.h5"]


def read_dataset(path: Path, kind: type[RaggedFile]) -> Any:
    with kind(path) as data:
        stretch = data.columns(0, len(data))
        tracks = [data[k].poses.shape for k in range(len(data))]  # type: ignore[index]
        arrays = {name: np.asarray(values) for name, values in vars(stretch).items()}
    content = {
        name: (a.shape, a.dtype.str, a.tolist() if a.dtype == object else a.tobytes()) for name, a in arrays.items()
    }
    return content | {"recipe": dataclasses.asdict(data.recipe), "tracks": tracks}


def states_dataset(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        for name in set(loaded) - {"recipe", "tracks"}:
            array = np.asarray(file[name][()])
            shown = array.tolist() if array.dtype == object else array.tobytes()
            if loaded[name] != (array.shape, array.dtype.str, shown) or file[name].is_virtual or file[name].external:
                return False
        return all(file.attrs[name] == value for name, value in loaded["recipe"].items())


def make_checkpoints(folder: Path) -> list[Path]:
    found = []
    for kind, network in NETWORKS.items():
        config = (
            {"hidden": 4, "steps": 2} if kind in ("contact", "propnet", "lever_up", "lever_propnet") else {"hidden": 4}
        )
        torch.manual_seed(0)
        record = {"samples": 5, "seconds": 0.5, "curve": [{"step": 0, "loss": 0.5}], "range": {"mass": [0.1, 2.0]}}
        physics = "a" * 64 if kind in ("belief", "paper_recipe", "spread") else None
        path = folder / f"{kind}.safetensors"
        save_checkpoint(Checkpoint(kind, config, network(**config), record, physics), path)
        found.append(path)
    return found


def read_checkpoint(path: Path) -> Any:
    one = load_checkpoint(path)
    header = {"kind": one.kind, "config": dict(one.config), "record": dict(one.record), "physics": one.physics}
    return header | {"tensors": digest_of(one.network.state_dict())}


def states_tensors(content: bytes, loaded: Any) -> bool:
    size = int.from_bytes(content[:8], "little")
    header = strictly(strictly(content[8 : 8 + size])["__metadata__"]["pushgraph"].encode())
    named = {name: value for name, value in loaded.items() if name != "tensors"}
    return digest_of(tensors_of(content)) == loaded["tensors"] and all(
        agrees(header.get(name), value) for name, value in named.items()
    )


RECIPE = {"model": "contact", "samples": 10, "learning_rate": 1e-3, "start_from": None, "processes": 1}


def small_training() -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    torch.manual_seed(1)
    network = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.Linear(4, 1))
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3)
    network(torch.ones(2, 3)).sum().backward()
    optimizer.step()
    return network, optimizer


def make_running(folder: Path) -> list[Path]:
    network, optimizer = small_training()
    best = {name: values.clone() for name, values in network.state_dict().items()}
    curve = [{"step": 0, "seconds": 0.0, "loss": 0.5}]
    RunningCheckpoint(folder, RECIPE).save(network, best, optimizer, Progress(1, 2.5, 0.5, curve, 0.25))
    return [folder / "running.safetensors"]


def read_running(path: Path) -> Any:
    network, optimizer = small_training()
    now, best = RunningCheckpoint(path.parent, RECIPE).load(network, optimizer)
    state = optimizer.state_dict()["state"]
    tensors = {f"network.{name}": one for name, one in network.state_dict().items()}
    tensors |= {f"best.{name}": one for name, one in best.items()}
    tensors |= {f"optimizer.{k}.{name}": one for k, values in state.items() for name, one in values.items()}
    return {"recipe": RECIPE, "progress": vars(now), "tensors": digest_of(tensors)}


def make_configuration(folder: Path) -> list[Path]:
    found = []
    for kind in (PhysicsTraining, BeliefTraining, SpreadTraining, LeverTraining):
        data, found = folder / "data.h5", [*found, folder / f"{kind.TASK}.toml"]
        data.touch()
        run = TrainingRun(out=str(folder / "out.safetensors"), imports=("own",))
        save_configuration(kind(data=str(data), validation=str(data)), run, found[-1])
    return found


def read_run_configuration(path: Path) -> Any:
    kinds = (PhysicsTraining, BeliefTraining, SpreadTraining, LeverTraining)
    return read_configuration(path, next(kind for kind in kinds if path.stem == kind.TASK))


def states_configuration(content: bytes, loaded: Any) -> bool:
    """Each key stands in a line of its own, with its value."""
    lines = [line.partition("#")[0].strip() for line in content.decode().splitlines()]
    stated = {line.partition("=")[0].strip(" '\""): line.partition("=")[2].strip() for line in lines if "=" in line}
    stated.pop("task", None)
    assert set(stated) == set(loaded)
    for name, text in stated.items():
        value = tomllib.loads(f"value = {text}")["value"]
        assert type(value) is type(loaded[name])
        assert value == loaded[name]
    return True


def make_adaptation(folder: Path) -> list[Path]:
    rng = np.random.default_rng(0)
    places, logs = torch.from_numpy(rng.normal(size=(5, 11))), torch.zeros(13, dtype=torch.float64)
    process = partial(GaussianProcess.conditioned, places, logs=logs)
    correction = Correction(
        process(torch.from_numpy(rng.normal(size=(5, 2)))), process(torch.from_numpy(rng.normal(size=(5, 1)))), 0.5
    )
    own = Adapted(Estimate(rng.normal(size=COUNT), np.eye(COUNT) * 0.3), correction, (1.0, 1.5), 12)
    plain = Adapted(Estimate.prior(), None, (1.0, 1.0), 3)
    adaptation = Adaptation(plain, {("abs", "box"): own}, {"abs": plain})
    save_adaptation(adaptation, folder / "adaptation.safetensors", "hash", {"pushes": 15})
    return [folder / "adaptation.safetensors"]


def read_adaptation(path: Path) -> Any:
    adaptation = load_adaptation(path)
    everything = [("shared", adaptation.shared), *adaptation.surfaces.items(), *adaptation.materials.items()]
    tensors, learnt = {}, []
    for k, (name, own) in enumerate(everything):
        tensors |= {f"{k} mean": torch.from_numpy(own.estimate.mean)}
        tensors |= {f"{k} covariance": torch.from_numpy(own.estimate.covariance)}
        if own.correction is not None:
            for part in ("position", "yaw"):
                process = getattr(own.correction, part)._asdict()
                tensors |= {f"{k} {part} {field}": values for field, values in process.items()}
        strength = None if own.correction is None else own.correction.strength
        learnt.append([name, own.pushes, list(own.widening), strength])
    return {"learnt": learnt, "tensors": digest_of(tensors)}


def states_adaptation(content: bytes, loaded: Any) -> bool:
    """The numbers are those of the tensors, which have one type and are finite."""
    size = int.from_bytes(content[:8], "little")
    header = strictly(strictly(content[8 : 8 + size])["__metadata__"]["pushgraph"].encode())
    stored = digest_of(tensors_of(content))
    assert all(kind == "torch.float64" for kind, *_ in stored.values())
    assert all(np.isfinite(np.frombuffer(one)).all() for *_, one in stored.values())
    assert sorted(one for *_, one in stored.values()) == sorted(one for *_, one in loaded["tensors"].values())
    stated = sorted(([one["pushes"], one["widening"], one["strength"]] for one in header["learnt"]), key=repr)
    return stated == sorted((row[1:] for row in loaded["learnt"]), key=repr)


TOML = (of_bytes, of_toml, of_toml)
HDF5, TENSORS = (of_bytes, of_hdf5(reseal)), (of_bytes, of_tensors, of_tensors)


def dataset(name: str, make: Callable[[Path], Sequence[Path]], kind: type[RaggedFile]) -> Kind:
    return Kind(name, make, partial(read_dataset, kind=kind), HDF5, states_dataset, has_line)


def of_network(name: str, make: Any, read: Any, states: Any = states_tensors) -> Kind:
    return Kind(name, make, read, TENSORS, states, lambda content: True)


KINDS = [
    dataset("dataset", make_dataset, Dataset),
    dataset("lever dataset", make_lever_dataset, LeverDataset),
    of_network("checkpoint", make_checkpoints, read_checkpoint),
    of_network("training state", make_running, read_running),
    Kind("run configuration", make_configuration, read_run_configuration, TOML, states_configuration),
    of_network("adaptation", make_adaptation, read_adaptation, states_adaptation),
]
