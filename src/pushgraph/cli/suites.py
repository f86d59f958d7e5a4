"""What the commands of `pushgraph evaluate` share: their options, and how they run a suite."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from rich.progress import Progress

from pushgraph.cli.choices import drawn_setups, one_of
from pushgraph.cli.output import BAR, console
from pushgraph.cores import usable_cores

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results

Scenes = TypeVar("Scenes")

CORES = usable_cores()
COUNT, DRAWN = 120, "multiple-parts"
"""Scenes for each number of objects, and the setup that they are drawn from, unless told otherwise."""
Count = Annotated[
    int | None,
    typer.Option(min=1, help="Scenes for each number of objects.", show_default=f"{COUNT}, of --data all"),
]
Seed = Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test scenes.")]
Out = Annotated[Path, typer.Option(help="Folder for results.json and figures.")]
Objects = Annotated[
    list[int] | None,
    typer.Option(min=1, help="Number of objects; again.", show_default="6, 9 and 12, of --data all there are"),
]
Setup = Annotated[
    str,
    typer.Option(help="What scenes are drawn from, or one of your own: see --import.", **one_of(drawn_setups, "SETUP")),
]
Data = Annotated[
    Path | None,
    typer.Option(
        help="Measure on this dataset, from pg.write_dataset or pushgraph generate.", show_default="scenes are drawn"
    ),
]
Models = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        metavar="NAME[=FILE]",
        help="What to measure: a shipped checkpoint by its name, or your own, NAME=FILE; again.",
        show_default="those shipped",
    ),
]
Contact = Annotated[str, typer.Option(help="Checkpoint that predicts.")]
Belief = Annotated[str, typer.Option(help="Checkpoint that watches.")]
Workers = Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")]


def without_data(reason: str) -> Any:
    """The option --data of a suite that has no use for it: whoever gives it is told why."""

    def refuse(value: str | None) -> None:
        from pushgraph.errors import EvaluationError

        if value is not None:
            raise EvaluationError(f"--data: this suite cannot measure on a dataset: {reason}")

    return typer.Option("--data", hidden=True, callback=refuse)


def models_of(given: Sequence[str] | None, shipped: Sequence[str], taken: Sequence[str] = ()) -> dict[str, str]:
    """Checkpoints to measure, by name, in the order of the command line: those shipped, if none is given.

    taken: names that results of the suite have already. Raises EvaluationError if one is no NAME or NAME=FILE, or
    CheckpointError if it cannot be read.
    """
    from pushgraph.checkpoint import load_checkpoint
    from pushgraph.checkpoint import shipped as path_of
    from pushgraph.errors import EvaluationError

    models: dict[str, str] = {}
    for text in given or shipped:
        name, equals, file = text.partition("=")
        if not re.fullmatch(r"[A-Za-z0-9_.-]{1,32}", name) or (equals and not file):
            raise EvaluationError(f"--model {text}: must be NAME or NAME=FILE, NAME of letters, digits and _ . -")
        if name in models or name in taken:
            raise EvaluationError(f"--model {text}: there is a {name!r} in these results already; name it otherwise")
        if not equals and name not in shipped:
            raise EvaluationError(
                f"--model {text}: no such shipped checkpoint here, valid: {', '.join(shipped)}; give NAME=FILE"
            )
        load_checkpoint(file if equals else path_of(name))
        models[name] = file or name
    return models


def numbers_of(
    objects: Sequence[int] | None, setup: str = DRAWN, data: Path | None = None
) -> tuple[int, ...]:
    """The numbers of objects that are asked for: of data all that are there, if none is given.

    Raises EvaluationError if scenes shall be drawn and read.
    """
    if data is not None and setup != DRAWN:
        from pushgraph.errors import EvaluationError

        raise EvaluationError(f"--setup {setup}: scenes are either drawn from it, or read from --data")
    if objects or data is not None:
        return tuple(dict.fromkeys(objects or ()))
    from pushgraph.simulation.setups import OBJECTS

    return OBJECTS.get(setup, (6, 9, 12))


def measure(
    suite: Callable[..., tuple["Results", Scenes]],
    numbers: tuple[int, ...],
    count: int | None,
    seed: int,
    models: dict[str, str],
    workers: int,
    data: Path | None = None,
    **settings: Any,
) -> tuple["Results", Scenes]:
    """Run a suite behind a progress bar; `data` and `settings` are handed on to it."""
    from pushgraph.evaluation import blocks

    count = COUNT if count is None and data is None else count
    there = blocks.numbers_of(numbers, data)
    settings |= {} if data is None else {"data": data}
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("scenes", total=sum(blocks.scenes_of(there, count, data)))
        told = suite(
            numbers, count, seed, models, workers, lambda done: progress.update(task, completed=done), **settings
        )
        progress.update(task, total=progress.tasks[task].completed)  # a suite may leave out scenes of one body
    return told


def numbers_measured(results: "Results") -> list[int]:
    """The numbers of objects in the rows of results."""
    return list(dict.fromkeys(row["objects"] for row in results.rows))


def say_written(out: Path, *figures: str) -> None:
    """Tell where the files are."""
    written = ", ".join(str(out / name) for name in ("results.json", *figures))
    console.print(f"Written: {written}", soft_wrap=True, markup=False)
