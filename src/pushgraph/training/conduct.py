"""Conduct a training, whatever its task: from its recipe to a checkpoint."""

import contextlib
import platform
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, overload

import torch

from pushgraph import own_modules
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.cores import usable_cores
from pushgraph.dataset.ragged import RaggedFile
from pushgraph.dataset.store import Dataset
from pushgraph.device import device_of
from pushgraph.errors import PushGraphError, TrainingError, TrainingInterrupted
from pushgraph.network.registry import build_network
from pushgraph.simulation.setups import FIRST_TEST_SEED
from pushgraph.storage import check_replaceable
from pushgraph.training.loop import Schedule, Task, train
from pushgraph.training.processes import Processes, run_in_processes, started_by_torchrun
from pushgraph.training.recipe import Training
from pushgraph.training.recorder import CONFIG, Recorder
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress, RunningCheckpoint
from pushgraph.training.seeds import seed_of

AnyTraining = TypeVar("AnyTraining", bound=Training)
AnyTask = TypeVar("AnyTask", bound=Task)
Data = TypeVar("Data", bound=RaggedFile)


def nothing(*_: Any) -> None:
    """Do nothing: for those who want to be told nothing."""


def conduct(
    training: AnyTraining,
    make_task: Callable[[AnyTraining, Processes, torch.device], AnyTask],
    run: TrainingRun,
    tell: Callable[[Progress, float], None] = nothing,
    say: Callable[[str], None] = nothing,
    finish: Callable[[Any, AnyTask], None] = nothing,
) -> Progress | None:
    """Train a network and write its checkpoint; the same call goes on after a kill.

    tell: called after every step with the progress and the loss. say: called with what the log says. finish: what is
    left to do, with the weights that were kept and the leading process's task. Where there are several processes, all
    of these are pickled.

    Under torchrun every process calls this; all but the leading one return None.
    """
    own_modules.use(run.imports)
    check_replaceable(run.out)
    device_of(run.device)
    arguments = (training, make_task, run, tell, say, finish)
    if run.processes > 1 and not started_by_torchrun():
        return run_in_processes(run.processes, _conduct, *arguments)
    return _conduct(Processes.of_torchrun(), "env://", *arguments)


def _conduct(
    processes: Processes,
    meeting: str,
    training: AnyTraining,
    make_task: Callable[[AnyTraining, Processes, torch.device], AnyTask],
    run: TrainingRun,
    tell: Callable[[Progress, float], None],
    say: Callable[[str], None],
    finish: Callable[[Any, AnyTask], None],
) -> Progress | None:
    device = processes.device(run.device)
    with processes.joined(device, meeting):
        with torch.random.fork_rng():
            torch.manual_seed(seed_of("first weights", seed=training.seed))
            network = build_network(training.model, training.config).to(device)
        start = load_checkpoint(training.start_from).network.state_dict() if training.start_from else {}
        if start:
            network.load_state_dict(start)
        if training.batch < processes.count:
            raise TrainingError(f"batch: {training.batch} cannot be shared by {processes.count} processes")
        task = make_task(training, processes, device)
        recipes = {"data": task.data_recipe, "validation": task.validation_recipe, "physics": task.physics}
        settings = training.with_names()
        running = RunningCheckpoint(run.folder, settings | {f"{name} recipe": one for name, one in recipes.items()})
        schedule = Schedule(
            training.steps,
            training.learning_rate,
            training.VALIDATIONS,
            amsgrad=training.model == "propnet",
            least_gain=training.least_gain,
            keeps_last=training.share_of_start > 0,
        )
        if not processes.leads:
            with contextlib.suppress(TrainingInterrupted):
                train(network, task, schedule, running, processes, None)
            return None
        with running.locked():
            _rehearse(Checkpoint(training.model, training.config, network, {}, task.physics), run.folder)
            recorder = Recorder(training, run, task.numbers, schedule.rate, tell, say)
            try:
                now = train(network, task, schedule, running, processes, recorder)
            except TrainingInterrupted as interrupted:
                message = f"{interrupted} in {run.folder}; to go on: {_command(training, run, processes)}"
                recorder.say(message)
                raise TrainingInterrupted(message) from None
            finally:
                recorder.close()
            if training.share_of_start:
                for name, weights in network.state_dict().items():
                    if weights.is_floating_point():
                        weights.lerp_(start[name].to(weights), training.share_of_start)
            finish(network, task)
            record = {
                "training": settings | {"processes": processes.count},
                "data": task.data_recipe,
                "validation": task.validation_recipe,
                "range": task.range,
                "samples": now.step * training.batch * training.frames,
                "seconds": round(now.seconds, 1),
                "hardware": f"{platform.processor() or platform.machine()}, {usable_cores()} cores, {run.device}",
                "curve": now.curve,
            }
            save_checkpoint(Checkpoint(training.model, training.config, network, record, task.physics), run.out)
            kept = "mean of the first and last weights" if training.share_of_start else "weights that validated best"
            recorder.say(f"done: in {run.out}, the {kept}")
    return now


def _command(training: Training, run: TrainingRun, processes: Processes) -> str:
    """What goes on with a run."""
    arguments = ["train", training.TASK, "--config", str(run.folder / CONFIG)]
    launcher = ["torchrun", f"--nproc-per-node={processes.count}", "-m"] if started_by_torchrun() else []
    return shlex.join([*launcher, "pushgraph", *arguments])


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
