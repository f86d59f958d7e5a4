"""The command `pushgraph evaluate real`."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID
from rich.table import Table

from pushgraph.cli.output import BAR, console
from pushgraph.cli.suites import CORES, Contact, Out, Workers, say_written

if TYPE_CHECKING:
    from pushgraph.evaluation.results import Results

Data = Annotated[Path, typer.Option(help="Recorded pushes: CSV, packed with gzip or not.")]
Outlines = Annotated[Path, typer.Option(help="Outlines of the objects: JSON.")]


def real(
    data: Data,
    outlines: Outlines,
    count: Annotated[int | None, typer.Option(min=1, help="Pushes, spread over all.", show_default="all")] = None,
    simulated: Annotated[
        int | None, typer.Option(min=1, help="Of these, how many of each shape and surface MuJoCo simulates.")
    ] = 20,
    adapt: Annotated[bool, typer.Option("--adapt", help="Adapted, too: splits and learning curves. An hour.")] = False,
    adaptation: Annotated[
        Path | None, typer.Option(help="What pushgraph adapt wrote about other pushes, measured, too.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the splits of --adapt.")] = 0,
    out: Out = Path("evaluation-real"),
    contact: Contact = "contact",
    workers: Workers = CORES,
) -> None:
    """Compare where pushes of a real robot ended with predictions, the simulator, and what repeated pushes allow.

    Examples:

    `pushgraph evaluate real --data pushes.csv.gz --outlines outlines.json --out result`

    `pushgraph evaluate real --data pushes.csv.gz --outlines outlines.json --adapt`
    """
    from pushgraph.adaptation.files import load_adaptation
    from pushgraph.evaluation.real import evaluate_real, results_of
    from pushgraph.evaluation.real_figures import save_learning_curve, save_shapes
    from pushgraph.evaluation.real_splits import evaluate_splits

    learnt = None if adaptation is None else load_adaptation(adaptation)
    figures = ["shapes.png"]
    with Progress(*BAR, console=console) as progress:
        bars: dict[str, TaskID] = {}

        def show(what: str, done: int, total: int) -> None:
            if what not in bars:
                bars[what] = progress.add_task(what, total=total)
            progress.update(bars[what], completed=done, total=total)

        results, measures = evaluate_real(data, outlines, count, contact, learnt, simulated, workers, show)
        if adapt:
            measures.measured += evaluate_splits(measures.pushes, seed, contact, out / "splits", workers, show)
            results = results_of(measures, {**results.protocol, "seed": seed})
            save_learning_curve(results.rows, out / "learning_curve.png")
            figures.append("learning_curve.png")
    results.save(out / "results.json")
    save_shapes(results.rows, out / "shapes.png")
    console.print(_table(results))
    if adapt:
        console.print(_splits_table(results))
    say_written(out, *figures)


COMMANDS: dict[str, Callable[..., None]] = {"real": real}


def _table(results: "Results") -> Table:
    protocol = results.protocol
    rows = [row for row in results.rows if row["split"] == "all"]
    values = {
        (row["model"], row["metric"], *(row[n] for n in ("shape", "surface", "speed"))): row["value"] for row in rows
    }
    models = list(dict.fromkeys(row["model"] for row in rows))
    table = Table(
        title=f"{protocol['count']} pushes: mean errors, mm / degrees (95 % intervals in results.json)", pad_edge=False
    )
    table.add_column("pushes of")
    for model in models:
        table.add_column(model.replace("_", " "), justify="right")
    table.caption = f"mujoco: {protocol['simulated']} pushes; floor: {protocol['pairs']} pairs of repeated pushes"
    singles = [("all", "all", "all")]
    singles += [key for key in dict.fromkeys(key[2:] for key in values) if key.count("all") == 2]
    for key in singles:
        cells = [
            tuple(values.get((model, metric, *key)) for metric in ("position_error_mm", "rotation_error_deg"))
            for model in models
        ]
        name = next((str(part) for part in key if part != "all"), "all")
        name += " mm/s" if key[2] != "all" else ""
        table.add_row(name, *("-" if None in cell else f"{cell[0]:.2f} / {cell[1]:.2f}" for cell in cells))
    held = [
        tuple(values.get((model, metric, "all", "all", "all")) for metric in ("coverage_68", "yaw_coverage_68"))
        for model in models
    ]
    table.add_section()
    table.add_row("within 68 %", *("-" if None in cell else f"{cell[0]:.2f} / {cell[1]:.2f}" for cell in held))
    return table


def _splits_table(results: "Results") -> Table:
    rows = [row for row in results.rows if row["split"] != "all"]
    rows = [row for row in rows if (row["shape"], row["surface"], row["speed"]) == ("all", "all", "all")]
    values = {(row["split"], row["pushes"], row["model"], row["metric"]): row["value"] for row in rows}
    table = Table(title="Held-out pushes: mean errors, mm / degrees", pad_edge=False)
    for name in ("split", "pushes", "model", "position", "rotation", "within 68 %", "yaws"):
        table.add_column(name, justify="right" if name not in ("split", "model") else "left")
    metrics = ("position_error_mm", "rotation_error_deg", "coverage_68", "yaw_coverage_68")
    for split, pushes, model in dict.fromkeys(key[:3] for key in values):
        cells = [values.get((split, pushes, model, metric)) for metric in metrics]
        table.add_row(split, str(pushes), model, *("-" if value is None else f"{value:.2f}" for value in cells))
    return table
