"""Conduct a training, whatever its task: from its recipe to a checkpoint."""

import contextlib
import dataclasses
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, overload

import torch

from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.cores import usable_cores
from pushgraph.dataset.ragged import RaggedFile
from pushgraph.dataset.store import Dataset
from pushgraph.errors import PushGraphError, TrainingError
from pushgraph.network.registry import build_network
from pushgraph.simulation.setups import FIRST_TEST_SEED
from pushgraph.storage import check_replaceable
from pushgraph.training.loop import Schedule, Task, train
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import Training
from pushgraph.training.running import Progress, RunningCheckpoint

Data = TypeVar("Data", bound=RaggedFile)


def conduct(
    training: Training,
    make_task: Callable[[Any, Processes, torch.device], Task],
    cache: Path,
    out: Path,
    device: str,
    tell: Callable[[Progress, float], None],
    finish: Callable[[Any, Any], None] = lambda network, task: None,
) -> Progress | None:
    """Train a network and write its checkpoint to `out`; the same call goes on after a kill.

    finish: what is left to do, with the weights that were kept and the leading process's task.

    Under torchrun every process calls this; all but the leading one return None.
    """
    check_replaceable(out)
    place = torch.device(device)
    processes = Processes.join(place)
    running = RunningCheckpoint(training.folder(cache), dataclasses.asdict(training) | {"processes": processes.count})
    with running.locked() if processes.leads else contextlib.nullcontext():
        processes.wait()
        with torch.random.fork_rng():
            torch.manual_seed(training.seed)
            network = build_network(training.model, training.config).to(place)
        if training.start_from:
            network.load_state_dict(load_checkpoint(training.start_from).network.state_dict())
        task = make_task(training, processes, place)
        if processes.leads:
            _rehearse(Checkpoint(training.model, training.config, network, {}, task.physics), running.folder)
        schedule = Schedule(
            training.steps, training.learning_rate, training.VALIDATIONS, amsgrad=training.model == "propnet"
        )
        now = train(network, task, schedule, running, processes, tell)
        processes.leave()
        if not processes.leads:
            return None
        finish(network, task)
        record = {
            "training": training.without_folders() | {"processes": processes.count},
            "data": task.data_recipe,
            "validation": task.validation_recipe,
            "range": task.range,
            "samples": now.step * training.batch * training.frames,
            "seconds": round(now.seconds, 1),
            "hardware": f"{platform.processor() or platform.machine()}, {usable_cores()} cores, {device}",
            "curve": now.curve,
        }
        save_checkpoint(Checkpoint(training.model, training.config, network, record, task.physics), out)
    return now


def _rehearse(checkpoint: Checkpoint, folder: Path) -> None:
    """Save and load the network as it is before training: what fails at the end fails at the beginning."""
    path = folder / "rehearsal.safetensors"
    try:
        save_checkpoint(checkpoint, path)
        load_checkpoint(path)
    except (PushGraphError, TypeError, ValueError) as error:
        name = type(checkpoint.network).__qualname__
        raise TrainingError(f"{checkpoint.kind!r}: {name} cannot be saved and loaded again: {error}") from error
    finally:
        path.unlink(missing_ok=True)


@overload
def open_dataset(path: str) -> Dataset: ...
@overload
def open_dataset(path: str, kind: type[Data]) -> Data: ...
def open_dataset(path: str, kind: type[RaggedFile] = Dataset) -> RaggedFile:
    """A dataset to train on or validate with; raises TrainingError if it is for tests."""
    data = kind(path)
    if data.recipe.seed >= FIRST_TEST_SEED:
        raise TrainingError(f"{path}: seeds from {FIRST_TEST_SEED:,} on are for tests; train on smaller ones")
    return data
