"""The commands of `pushgraph evaluate`."""

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.output import BAR, console

app = typer.Typer(help="Measure the shipped networks, or your own.", no_args_is_help=True)


@app.callback()
def evaluate() -> None:
    """Measure the shipped networks, or your own."""


@app.command("physics")
def physics(
    count: Annotated[int, typer.Option(min=1, help="Scenes for each number of objects.")] = 120,
    seed: Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for results.json and figures.")] = Path("evaluation-physics"),
    objects: Annotated[int | None, typer.Option(help="6, 9 or 12.", show_default="all three")] = None,
    contact: Annotated[str, typer.Option(help="Checkpoint to measure as contact.")] = "contact",
    propnet: Annotated[str, typer.Option(help="Checkpoint to measure as propnet.")] = "propnet",
    workers: Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")] = os.cpu_count() or 1,
) -> None:
    """Roll out `contact` and `propnet` against simulation, beside standing still and the noise floor.

    Examples:

    `pushgraph evaluate physics --count 1000 --objects 9 --out result`

    `pushgraph evaluate physics --count 120 --contact my.safetensors`
    """
    from pushgraph.evaluation.figures import save_histogram
    from pushgraph.evaluation.physics import evaluate_physics

    if objects not in (None, 6, 9, 12):
        raise typer.BadParameter(f"{objects}; valid: 6, 9, 12", param_hint="--objects")
    numbers = (6, 9, 12) if objects is None else (objects,)
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task("scenes", total=count * len(numbers))
        results, scenes = evaluate_physics(
            numbers,
            count,
            seed,
            {"propnet": propnet, "contact": contact},
            workers,
            lambda done: progress.update(task, completed=done),
        )
    results.save(out / "results.json")
    save_histogram(scenes, ("still", "propnet", "contact", "noise_floor"), out / "histogram.png")
    for number in numbers:
        console.print(_physics_table(results, number))
    console.print(f"Written: {out / 'results.json'}, {out / 'histogram.png'}", soft_wrap=True, markup=False)


def _physics_table(results, objects: int) -> Table:
    table = Table(title=f"Rollouts, {objects} objects (cm; 95 % interval over scenes in results.json)")
    metrics = ("mean_error_cm", "final_error_moved_cm", "median_final_error_moved_cm", "displacement_moved_cm")
    table.add_column("scenes")
    for name in ("frames", "model", "mean error", "final, moved", "median of that", "they moved", "yaw, cuboids (deg)"):
        table.add_column(name, justify="left" if name == "model" else "right")
    values = {
        (row["density"], row["frames"], row["model"], row["metric"]): row["value"]
        for row in results.rows
        if row["objects"] == objects
    }
    last = None
    for density, frames, model in dict.fromkeys(key[:3] for key in values):
        numbers = [values[density, frames, model, metric] for metric in (*metrics, "yaw_error_cuboid_deg")]
        if last not in (None, (density, frames)):
            table.add_section()
        last = density, frames
        table.add_row(density, str(frames), model, *("-" if v is None else f"{v:.2f}" for v in numbers))
    return table
