"""The commands of `pushgraph train`."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import progress
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from pushgraph.cli.choices import Precision, networks, one_of
from pushgraph.cli.output import console
from pushgraph.cores import usable_cores

if TYPE_CHECKING:
    from pushgraph.training.recipe import Training
    from pushgraph.training.running import Progress

app = typer.Typer(help="Train the networks; killed or interrupted, the same command goes on.", no_args_is_help=True)

CORES = usable_cores()
_Data = Annotated[Path, typer.Option(help="Training data, from pushgraph generate planar.")]
_Validation = Annotated[Path, typer.Option(help="Scenes on which the weights are chosen.")]
_Out = Annotated[Path, typer.Option(help="The checkpoint, safetensors.")]
_Precision = Annotated[Precision, typer.Option(help="What networks compute in.")]
_Seed = Annotated[int, typer.Option(min=0, help="Of first weights and batches.")]
_StartFrom = Annotated[Path | None, typer.Option(help="A checkpoint whose weights to begin with.")]
_Processes = Annotated[int, typer.Option(min=1, help="Data-parallel.", show_default="one a core")]
_Device = Annotated[str, typer.Option(help="cpu or cuda.")]
_Cache = Annotated[Path | None, typer.Option(help="For the running training.", show_default="the user's cache folder")]


@app.callback()
def train() -> None:
    """Train the networks; killed or interrupted, the same command goes on."""


@app.command("physics")
def physics(
    data: _Data,
    validation: _Validation,
    out: _Out,
    model: Annotated[
        str, typer.Option(help="contact (ours) or propnet (the paper's).", **one_of(networks("physics")))
    ] = "contact",
    samples: Annotated[int, typer.Option(min=1, help="Predicted frames of training windows, all in all.")] = 20_000_000,
    frames: Annotated[int, typer.Option(min=1, help="Frames predicted in a row.")] = 4,
    batch: Annotated[int, typer.Option(min=1, help="Windows in a step, over all processes.")] = 256,
    learning_rate: Annotated[float, typer.Option(help="Its peak.")] = 2e-3,
    hidden: Annotated[int, typer.Option(min=1, help="Width of the network.")] = 48,
    propagation_steps: Annotated[int, typer.Option(min=1, help="Steps in which messages travel.")] = 2,
    precision: _Precision = Precision.FLOAT32,
    seed: _Seed = 0,
    start_from: _StartFrom = None,
    processes: _Processes = CORES,
    device: _Device = "cpu",
    cache: _Cache = None,
) -> None:
    """Train physics prediction on unrolled frames; the weights with the smallest rollout error are kept.

    Examples:

    `pushgraph train physics --data planar.h5 --validation validation.h5 --out contact.safetensors`

    `torchrun --nproc-per-node 8 -m pushgraph train physics --device cuda --data planar.h5 --validation validation.h5
    --out contact.safetensors`
    """
    from pushgraph.training.physics import PhysicsTraining, train_physics

    training = PhysicsTraining(
        model=model,
        data=str(data),
        validation=str(validation),
        samples=samples,
        frames=frames,
        batch=batch,
        learning_rate=learning_rate,
        hidden=hidden,
        propagation_steps=propagation_steps,
        precision=precision.value,
        seed=seed,
        start_from=None if start_from is None else str(start_from),
    )
    _conduct(training, train_physics, processes, device, cache, out, _PHYSICS_COLUMNS)


@app.command("belief")
def belief(
    data: _Data,
    validation: _Validation,
    out: _Out,
    model: Annotated[
        str, typer.Option(help="belief (ours) or paper_recipe.", **one_of(networks("belief")))
    ] = "belief",
    samples: Annotated[int, typer.Option(min=1, help="Observed frames of sequences, all in all.")] = 10_000_000,
    frames: Annotated[int, typer.Option(min=2, help="Frames observed in a row.")] = 200,
    batch: Annotated[int, typer.Option(min=1, help="Sequences in a step, over all processes.")] = 16,
    learning_rate: Annotated[float, typer.Option(help="Its peak.")] = 2e-3,
    hidden: Annotated[int, typer.Option(min=1, help="Width of the memory.")] = 64,
    precision: _Precision = Precision.FLOAT32,
    seed: _Seed = 0,
    start_from: _StartFrom = None,
    physics: Annotated[
        Path | None, typer.Option(help="Checkpoint of the physics below it.", show_default="the shipped one")
    ] = None,
    masses: Annotated[
        Path | None, typer.Option(help="Data in which masses are learnt, from pushgraph generate different-masses.")
    ] = None,
    masses_validation: Annotated[Path | None, typer.Option(help="Scenes on which that is validated.")] = None,
    keep_joints: Annotated[bool, typer.Option("--keep-joints", help="Learn about masses alone.")] = False,
    processes: _Processes = CORES,
    device: _Device = "cpu",
    cache: _Cache = None,
) -> None:
    """Train belief regulation, of joints and masses, on top of physics weights, which stay as they are.

    Examples:

    `pushgraph train belief --data jointed.h5 --validation validation.h5 --masses masses.h5 --masses-validation
    masses-validation.h5 --out belief.safetensors`

    `pushgraph train belief --data planar.h5 --validation validation.h5 --out belief.safetensors`

    `pushgraph train belief --model paper_recipe --hidden 256 --frames 100 --data planar.h5 --validation validation.h5
    --out paper_recipe.safetensors`
    """
    from pushgraph.training.belief import BeliefTraining, train_belief

    training = BeliefTraining(
        model=model,
        data=str(data),
        validation=str(validation),
        samples=samples,
        frames=frames,
        batch=batch,
        learning_rate=learning_rate,
        hidden=hidden,
        precision=precision.value,
        seed=seed,
        start_from=None if start_from is None else str(start_from),
        physics=None if physics is None else str(physics),
        masses=None if masses is None else str(masses),
        masses_validation=None if masses_validation is None else str(masses_validation),
        keep_joints=keep_joints,
    )
    _conduct(training, train_belief, processes, device, cache, out, _BELIEF_COLUMNS)


@app.command("spread")
def spread(
    data: _Data,
    validation: _Validation,
    out: _Out,
    samples: Annotated[int, typer.Option(min=1, help="Predicted frames of rollouts, all in all.")] = 8_000_000,
    rollouts: Annotated[int, typer.Option(min=1, help="Made once, and drawn from again and again.")] = 12_800,
    frames: Annotated[int, typer.Option(min=2, help="Frames of a rollout; of a tenth of them, 300.")] = 64,
    batch: Annotated[int, typer.Option(min=1, help="Rollouts in a step, over all processes.")] = 32,
    learning_rate: Annotated[float, typer.Option(help="Its peak.")] = 3e-3,
    hidden: Annotated[int, typer.Option(min=1, help="Width of the network.")] = 32,
    seed: _Seed = 0,
    start_from: _StartFrom = None,
    processes: _Processes = CORES,
    device: _Device = "cpu",
    cache: _Cache = None,
) -> None:
    """Train what says how far off predictions may be, on rollouts of the shipped physics and belief weights.

    Example:

    `pushgraph train spread --data planar.h5 --validation validation.h5 --out spread.safetensors`
    """
    from pushgraph.training.spread import SpreadTraining, train_spread

    training = SpreadTraining(
        model="spread",
        data=str(data),
        validation=str(validation),
        samples=samples,
        rollouts=rollouts,
        frames=frames,
        batch=batch,
        learning_rate=learning_rate,
        hidden=hidden,
        seed=seed,
        start_from=None if start_from is None else str(start_from),
    )
    _conduct(training, train_spread, processes, device, cache, out, _SPREAD_COLUMNS)


@app.command("lever-up")
def lever_up(
    data: Annotated[Path, typer.Option(help="Training data, from pushgraph generate lever-up.")],
    validation: Annotated[Path, typer.Option(help="Interactions on which the weights are chosen.")],
    out: _Out,
    model: Annotated[
        str, typer.Option(help="lever_up (ours) or lever_up_propnet (the paper's).", **one_of(networks("lever-up")))
    ] = "lever_up",
    interactions: Annotated[
        int | None, typer.Option(min=1, help="Use the first of the data alone.", show_default="all")
    ] = None,
    samples: Annotated[int, typer.Option(min=1, help="Predicted frames of training windows, all in all.")] = 200_000,
    frames: Annotated[int, typer.Option(min=1, help="Frames predicted in a row.")] = 4,
    batch: Annotated[int, typer.Option(min=1, help="Windows in a step, over all processes.")] = 64,
    learning_rate: Annotated[float, typer.Option(help="Its peak.")] = 1e-3,
    hidden: Annotated[int, typer.Option(min=1, help="Width of the network.")] = 64,
    propagation_steps: Annotated[int, typer.Option(min=1, help="Steps in which messages travel.")] = 2,
    seed: _Seed = 0,
    start_from: _StartFrom = None,
    processes: _Processes = CORES,
    device: _Device = "cpu",
    cache: _Cache = None,
) -> None:
    """Train the prediction of boards that are levered up; the weights with the smallest rollout error are kept.

    Example:

    `pushgraph train lever-up --data lever-up.h5 --validation lever-up-validation.h5 --out lever_up.safetensors`
    """
    from pushgraph.training.lever import LeverTraining, train_lever

    training = LeverTraining(
        model=model,
        data=str(data),
        validation=str(validation),
        interactions=interactions,
        samples=samples,
        frames=frames,
        batch=batch,
        learning_rate=learning_rate,
        hidden=hidden,
        propagation_steps=propagation_steps,
        seed=seed,
        start_from=None if start_from is None else str(start_from),
    )
    _conduct(training, train_lever, processes, device, cache, out, _LEVER_COLUMNS)


_LEVER_COLUMNS = {
    "bounded error (mm)": "bounded_error_mm",
    "final position (mm)": "final_position_error_mm",
    "final rotation (deg)": "final_rotation_error_deg",
}
_PHYSICS_COLUMNS = {
    "bounded error (cm)": "bounded_error_cm",
    "mean error (cm)": "mean_error_cm",
    "final error, moved (cm)": "final_error_moved_cm",
    "displacement (cm)": "displacement_moved_cm",
}
_BELIEF_COLUMNS = {
    "surprise, masses": "nll_masses",
    "surprise, adjacent": "nll_adjacent",
    "wrong at 40": "error_touched_40",
    "at 200": "error_touched_200",
    "at 40, noise": "error_touched_40_noisy",
    "at 200, noise": "error_touched_200_noisy",
}
_SPREAD_COLUMNS = {
    "loss": "loss_of_bodies",
    "within 68 %": "coverage_68",
    "95 %": "coverage_95",
    "yaw within 68 %": "yaw_coverage_68",
    "95 % of yaw": "yaw_coverage_95",
}
"""What a validation tells, by the names of its columns; belief's errors are shares of touched pairs."""


def _conduct(
    training: "Training",
    train: "Callable[[Any, Path, Path, str, Callable[[Progress, float], None]], Progress | None]",
    processes: int,
    device: str,
    cache: Path | None,
    out: Path,
    columns: dict[str, str],
) -> None:
    from pushgraph.storage import cache_folder
    from pushgraph.training.processes import become_torchrun, started_by_torchrun
    from pushgraph.viewer.curve import save_curve

    if processes > 1 and not started_by_torchrun():
        become_torchrun(processes, sys.argv[1:])
    place = cache or cache_folder()
    reporter = _TrainingReporter(training, columns)
    with reporter.progress:
        now = train(training, place, out, device, reporter.tell)
    if now is None:
        return
    console.print(reporter.table(now))
    curve = training.folder(place) / "curve.png"
    save_curve(now.curve, next(iter(columns.values())), next(iter(columns)), curve)
    console.print(f"Written: {out}, {curve}", soft_wrap=True, markup=False)


class _TrainingReporter:
    """Shows how a training goes: a bar with the time left, a line a validation, at the end curve and table."""

    def __init__(self, training: "Training", columns: dict[str, str]) -> None:
        self._training, self._columns = training, columns
        self._leads = os.environ.get("RANK", "0") == "0"
        self.progress = progress.Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.percentage:.1f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[loss]}", markup=False),
            console=console,
            disable=not self._leads,
        )
        self._bar = self.progress.add_task(f"{training.TASK}, {training.model}", total=training.steps, loss="")
        self._told: int | None = None

    def tell(self, now: "Progress", loss: float) -> None:
        if not self._leads:
            return
        if self._told is None:
            self._told = len(now.curve)
            self.progress.update(self._bar, completed=now.step - 1)
        self.progress.update(self._bar, completed=now.step, loss=f"loss {loss:.3f}")
        if len(now.curve) > self._told:
            self._told = len(now.curve)
            last = now.curve[-1]
            left = (self._training.steps - now.step) * now.seconds / now.step
            numbers = ", ".join(f"{name} {last[key]:.3f}" for name, key in self._columns.items())
            console.print(
                f"step {now.step} of {self._training.steps}, {now.seconds:.0f} s, {left:.0f} s left: "
                f"loss {last['loss']:.4f}; validation: {numbers}",
                highlight=False,
                soft_wrap=True,
            )

    def table(self, now: "Progress") -> Table:
        table = Table(title="Validation")
        for name in ("step", "time (s)", "loss", *self._columns):
            table.add_column(name, justify="right")
        for row in now.curve:
            numbers = [row[key] for key in self._columns.values()]
            best = " *" if numbers[0] == now.best else ""
            columns = [f"{row['seconds']:.0f}", f"{row['loss']:.4f}", *(f"{number:.3f}" for number in numbers)]
            table.add_row(f"{row['step']}{best}", *columns)
        table.caption = "*: the weights that were kept"
        return table
