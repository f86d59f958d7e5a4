"""The command of `pushgraph evaluate` that is about what cameras record."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.output import BAR, console
from pushgraph.cli.recordings import prior_of
from pushgraph.cli.suites import CORES, Belief, Contact, Out, Seed, Workers, say_written

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results


def camera(
    count: Annotated[int, typer.Option(min=1, help="Scenes, of 2 to 5 cylinders in turn.")] = 102,
    seed: Seed = 1_000_000,
    out: Out = Path("evaluation-camera"),
    data: Annotated[
        list[Path] | None,
        typer.Option(
            help="Recordings that hold their scene: tracks (.h5), the paper's JSON, a folder of these; again.",
            show_default="a simulated camera's",
        ),
    ] = None,
    prior: Annotated[
        str, typer.Option(help="How likely joints of neighbours are beforehand; those not named cannot be.")
    ] = "none=1 fixed=1",
    contact: Contact = "contact",
    belief: Belief = "belief",
    workers: Workers = CORES,
) -> None:
    """The paper's protocol of a real robot: predict where a push ends from first contact on, and over observed frames,
    with true and with believed joints.

    Glued cylinders without yaw, pushed by a hammer, filmed by a simulated camera; or recordings, with --data.

    Examples:

    `pushgraph evaluate camera --count 102 --out result`

    `pushgraph evaluate camera --data recordings --out result`
    """
    from pushgraph.evaluation.camera import evaluate_camera, evaluate_recordings
    from pushgraph.evaluation.camera_figures import save_camera_curves

    models, expected = {"contact": contact, "belief": belief}, prior_of(prior)
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("recordings", total=None if data else count)

        def show(done: int) -> None:
            progress.update(task, completed=done)

        if data:
            results, scenes = evaluate_recordings(data, models, show, expected)
        else:
            results, scenes = evaluate_camera(count, seed, models, workers, show, expected)
    results.save(out / "results.json")
    save_camera_curves(scenes, out / "curves.png")
    console.print(_table(results))
    say_written(out, "curves.png")


COMMANDS: dict[str, Callable[..., None]] = {"camera": camera}


def _table(results: "Results") -> Table:
    from pushgraph.evaluation.camera import MODELS

    values = {(row["model"], row["metric"], row["start"]): row for row in results.rows}
    motion = values[MODELS[0], "motion_cm", "all"]["value"]
    table = Table(title=f"Final error (cm; 95 % interval) of bodies that move {motion:.1f} cm")
    table.add_column("predicted from")
    for model in MODELS:
        table.add_column(model.replace("_", " "), justify="right")
    starts = list(dict.fromkeys(row["start"] for row in results.rows if row["metric"] == "final_error_cm"))
    for start in starts:
        rows = [values[model, "final_error_cm", start] for model in MODELS]
        if start == next(start for start in starts if isinstance(start, int)):
            table.add_section()
        observed = start if isinstance(start, str) else f"{start} frames"
        table.add_row(observed, *(f"{row['value']:.2f} ({row['low']:.2f} to {row['high']:.2f})" for row in rows))
    return table
