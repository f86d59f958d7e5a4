"""The command `pushgraph`."""

import os
import sys
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from pushgraph.errors import PushGraphError, SceneError

app = typer.Typer(
    help="See what a push will do: scenes of pushed objects, simulated, predicted and learned from.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
console = Console()
SHIPPED_SCENES = Path(str(files("pushgraph"))) / "scenes"


def main(arguments: list[str] | None = None) -> None:
    """Run the command; our errors become a message and exit status 1."""
    try:
        app(arguments)
    except PushGraphError as error:
        Console(stderr=True, soft_wrap=True).print(f"[bold red]Error:[/] {escape(str(error))}", highlight=False)
        sys.exit(1)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("demo"),
) -> None:
    """Simulate the shipped scene and draw it.

    Example: `pushgraph demo --out demo`
    """
    _simulate("demo", out, "gif")


@app.command()
def simulate(
    scene: Annotated[str, typer.Argument(help="A scene file (JSON), or the name of a shipped scene: demo.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results.", show_default="the scene's name")] = None,
    animation: Annotated[str, typer.Option(help="gif, mp4 (needs ffmpeg) or none.")] = "gif",
) -> None:
    """Simulate a scene's pushes in MuJoCo: track (HDF5, CSV), picture, animation, table of final poses.

    Examples:

    `pushgraph simulate scene.json --out result`

    `pushgraph simulate demo --animation none`
    """
    _simulate(scene, out or Path(Path(scene).stem), animation)


@app.command()
def generate(
    setup: Annotated[str, typer.Argument(help="multiple-parts, or planar: the training mixture.")],
    count: Annotated[int, typer.Option(min=1, help="Trajectories.")],
    out: Annotated[Path, typer.Option(help="The dataset, HDF5.")],
    objects: Annotated[int, typer.Option(min=1, help="Objects in a scene.")] = 9,
    seed: Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test data.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")] = os.cpu_count() or 1,
    engine: Annotated[str, typer.Option(help="processes, or ray (the cluster at RAY_ADDRESS, or a local one).")] = (
        "processes"
    ),
) -> None:
    """Generate a dataset; killed or interrupted, the same command goes on where it was.

    Examples:

    `pushgraph generate multiple-parts --objects 9 --count 1000 --seed 1 --out train.h5`

    `pushgraph generate planar --count 30000 --out mixture.h5 --workers 16`
    """
    from pushgraph.dataset.generate import generate as generate_dataset
    from pushgraph.dataset.store import Dataset
    from pushgraph.dataset.summary import table

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(setup, total=count)
        try:
            path = generate_dataset(
                setup, objects, count, seed, out, workers, engine, lambda done: progress.update(task, completed=done)
            )
        except KeyboardInterrupt:
            progress.console.print("Interrupted: what is done is kept, the same command goes on from there.")
            raise typer.Exit(130) from None
    with Dataset(path) as written:
        rows = table(written.summary)
    summary = Table(title=f"{setup}, {objects} objects, seed {seed}", show_header=False)
    for name, value in rows.items():
        summary.add_row(name, value)
    console.print(summary)
    console.print(f"Dataset: {path} ({path.stat().st_size / 2**20:.1f} MiB)", soft_wrap=True, markup=False)


def _simulate(source: str, out: Path, animation: str) -> None:
    from pushgraph.simulation.planar import simulate
    from pushgraph.viewer.animation import check_animation, save_animation
    from pushgraph.viewer.picture import save_picture

    if animation not in ("gif", "mp4", "none"):
        raise typer.BadParameter(f"{animation!r}; valid: gif, mp4, none", param_hint="--animation")
    if animation != "none":
        check_animation(out / f"animation.{animation}")
    scene = _load_scene(source)
    known = scene.with_nominal_values()
    if known != scene:
        console.print("Unknown masses and frictions are simulated at their nominal values.")
    if scene.unknown_pairs:
        console.print("Unknown pairs are simulated as not joined.")
    outputs = [out / "track.h5", out / "track.csv", out / "picture.png"]
    with console.status(f"Simulating {len(known.pushes)} pushes"):
        track = simulate(known)
    with console.status("Drawing"):
        track.save(outputs[0])
        track.save(outputs[1])
        save_picture(track, outputs[2])
        if animation != "none":
            outputs.append(out / f"animation.{animation}")
            save_animation(track, outputs[-1])
    console.print(_final_poses(track))
    console.print("Written: " + ", ".join(str(path) for path in outputs), soft_wrap=True, markup=False)


def _load_scene(source: str):
    from pushgraph.scene import Scene

    shipped = {path.stem: path for path in SHIPPED_SCENES.glob("*.json")}
    if source in shipped and not Path(source).is_file():
        return Scene.load(shipped[source])
    try:
        return Scene.load(source)
    except SceneError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise SceneError(f"{error}; shipped scenes: {', '.join(sorted(shipped))}") from None
        raise


def _final_poses(track) -> Table:
    table = Table(title=f"Final poses after {len(track.scene.pushes)} pushes, {track.times[-1]:.2f} s")
    for name in ("body", "x (m)", "y (m)", "yaw (deg)", "moved (cm)", "turned (deg)"):
        table.add_column(name, justify="left" if name == "body" else "right")
    change = track.poses[-1] - track.poses[0]
    for node, name in enumerate(track.nodes[1:], start=1):
        x, y, yaw = track.poses[-1, node]
        moved, turned = np.hypot(*change[node, :2]) * 100, np.degrees(change[node, 2])
        table.add_row(name, f"{x:.4f}", f"{y:.4f}", f"{np.degrees(yaw):.1f}", f"{moved:.1f}", f"{turned:.1f}")
    return table
