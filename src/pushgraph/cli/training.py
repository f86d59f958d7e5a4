"""The commands of `pushgraph train`: one for each recipe, with its settings as options."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pushgraph import own_modules
from pushgraph.cli.choices import networks, one_of
from pushgraph.cli.options import with_options
from pushgraph.cli.output import INTERRUPTED, console
from pushgraph.errors import TrainingError, TrainingInterrupted
from pushgraph.training.recipe import BeliefTraining, LeverTraining, PhysicsTraining, SpreadTraining, Training
from pushgraph.training.run import TrainingRun

if TYPE_CHECKING:
    from pushgraph.training.running import Progress

app = typer.Typer(help="Train the networks; killed or interrupted, the same command goes on.", no_args_is_help=True)

_Config = Annotated[
    Path | None, typer.Option(help="A run's config.toml: its settings, where no option says otherwise.")
]


@app.callback()
def train() -> None:
    """Train the networks; killed or interrupted, the same command goes on."""


def _train_command(recipe: type[Training], module: str, help: str) -> None:
    """Add the command of a task, whose module has a function `train_MODULE`."""

    def command(config: _Config = None, **given: Any) -> None:
        from pushgraph.training.configuration import read_configuration
        from pushgraph.training.processes import default_count

        settings = {} if config is None else read_configuration(config, recipe)
        settings |= {name: value for name, value in given.items() if value is not None}
        own_modules.use(settings.get("imports", ()))  # beside those of pushgraph --import
        settings["imports"] = own_modules.used()
        settings.setdefault("processes", default_count(settings.get("device", "cpu")))
        fields = recipe.model_fields | TrainingRun.model_fields
        if missing := [f"--{name}" for name, one in fields.items() if one.is_required() and name not in settings]:
            raise TrainingError(f"{', '.join(missing)}: must be given, or stand in a --config")
        run = TrainingRun(**{name: settings.pop(name) for name in TrainingRun.model_fields if name in settings})
        train = getattr(importlib.import_module(f"pushgraph.training.{module}"), f"train_{module}")
        _conduct(recipe(**settings), train, run)

    model = one_of(networks(recipe.TASK))
    del model["parser"]  # what is to be imported registers more
    more: dict[str, dict[str, Any]] = {
        "model": model,
        "processes": {"show_default": "one a core, or one a GPU"},
    }
    app.command(recipe.TASK, help=help)(with_options(command, (recipe, TrainingRun), more, leave_out=("imports",)))


_train_command(
    PhysicsTraining,
    "physics",
    """Train physics prediction on unrolled frames; the weights with the smallest rollout error are kept.

    Examples:

    `pushgraph train physics --data planar.h5 --validation validation.h5 --out contact.safetensors`

    `pushgraph train physics --config contact.run/config.toml --batch 512 --out larger.safetensors`

    `torchrun --nproc-per-node 8 -m pushgraph train physics --device cuda --data planar.h5 --validation validation.h5
    --out contact.safetensors`
    """,
)
_train_command(
    BeliefTraining,
    "belief",
    """Train belief regulation, of joints and masses, on top of physics weights, which stay as they are.

    Examples:

    `pushgraph train belief --data jointed.h5 --validation validation.h5 --masses masses.h5 --masses-validation
    masses-validation.h5 --out belief.safetensors`

    `pushgraph train belief --data planar.h5 --validation validation.h5 --out belief.safetensors`

    `pushgraph train belief --model paper_recipe --hidden 256 --frames 100 --data planar.h5 --validation validation.h5
    --out paper_recipe.safetensors`
    """,
)
_train_command(
    SpreadTraining,
    "spread",
    """Train what says how far off predictions may be, on rollouts of the shipped physics and belief weights.

    Example:

    `pushgraph train spread --data planar.h5 --validation validation.h5 --out spread.safetensors`
    """,
)
_train_command(
    LeverTraining,
    "lever",
    """Train the prediction of boards that are levered up; the weights with the smallest rollout error are kept.

    Example:

    `pushgraph train lever-up --data lever-up.h5 --validation lever-up-validation.h5 --out lever_up.safetensors`
    """,
)


def _conduct(training: Training, train: "Callable[..., Progress | None]", run: TrainingRun) -> None:
    from pushgraph.cli.training_report import TrainingReport, validation_table
    from pushgraph.viewer.curve import save_curve

    report = TrainingReport(training)
    try:
        now = train(training, run, report.tell, report.say)
    except TrainingInterrupted:  # how to go on was said
        raise typer.Exit(INTERRUPTED) from None
    except KeyboardInterrupt:
        report.say("Stopped between two savings: the same command goes on from the last one, or begins anew")
        raise typer.Exit(INTERRUPTED) from None
    finally:
        report.close()
    if now is None:
        return
    console.print(validation_table(now))
    curve = run.folder / "curve.png"
    first = list(now.curve[0])[3]  # after step, seconds and loss
    save_curve(now.curve, first, first, curve)
    console.print(f"Written: {run.out}, {curve.parent}", soft_wrap=True, markup=False)
