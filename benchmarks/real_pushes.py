"""The simulator against recorded pushes of single objects by a round probe, beside two analytic models on the same.

The recordings: Yu, Bauza, Fazeli, Rodriguez, "More than a million ways to be pushed", IROS 2016, as a table of poses
before and after, with what a fourth-order polynomial limit surface (poly4) and an ellipsoid predict. One side friction
serves all pushes; it may be chosen on the even rows of the file, and the odd ones tell how good it is.

.venv/bin/python benchmarks/real_pushes.py --data pushes.csv.gz --outlines outlines.json --scan 0.1,0.15,0.2,0.25,0.3
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph.adaptation.scenes import scene_of
from pushgraph.adaptation.unknowns import Unknowns
from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.real import errors_of, spread_out
from pushgraph.real_pushes import RealPushes, read_pushes
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planar_reference import reference_ends

BLOCK = 20
"""Pushes that one process handles at a time."""
MODELS = ("poly4", "ellipsoid")


class Task(NamedTuple):
    number: int
    engine: str
    scenes: tuple[Scene, ...]


def chosen(pushes: RealPushes, shapes: Sequence[str], rows: str, count: int | None) -> RealPushes:
    """Pushes of these shapes on even or odd rows of the file, `count` of each shape and surface, or all."""
    for name in shapes:
        if name not in pushes.shapes:
            raise typer.BadParameter(f"{name}: no shape of this name; valid: {', '.join(pushes.shapes)}")
    every = {"even": slice(0, None, 2), "odd": slice(1, None, 2), "all": slice(None)}[rows]
    some = np.arange(len(pushes))[every]
    found = pushes.take(some[np.isin(pushes.shape[some], shapes)])
    return found if count is None else found.take(spread_out(found, count))


def replay(task: Task) -> np.ndarray:
    if task.engine == "reference":
        return np.array([end[0] for end in reference_ends(task.scenes)])
    return np.array([simulate(scene).poses[-1, 1] for scene in task.scenes])


def replay_all(pushes: RealPushes, engine: str, side_friction: float, workers: int) -> np.ndarray:
    """Final poses, [pushes, 3]."""
    scenes = [scene_of(pushes, k, Unknowns(side_friction)) for k in range(len(pushes))]
    tasks = [Task(k, engine, tuple(scenes[k : k + BLOCK])) for k in range(0, len(scenes), BLOCK)]
    done = run_in_processes(replay, tasks, workers)
    found = {
        task.number: ends
        for task, ends in progress(done, description=f"side friction {side_friction:g}", total=len(tasks))
    }
    return np.concatenate([found[number] for number in sorted(found)])


def errors(ends: np.ndarray, pushes: RealPushes) -> np.ndarray:
    return errors_of(ends, pushes.after)


def columns_of(pushes: RealPushes) -> dict[str, np.ndarray]:
    """How far bodies went, and errors of other models as far as the data states their poses (mm, degrees)."""
    stated = {model: errors(pushes.stated[model], pushes) for model in MODELS if model in pushes.stated}
    return {"motion": errors(pushes.before, pushes)} | stated


def unit_of(columns: Mapping[str, np.ndarray]) -> str:
    """What errors are divided by."""
    return "poly4" if "poly4" in columns else "motion"


def show_scan(found: dict[float, np.ndarray], unit: str, units: np.ndarray) -> None:
    table = Table(title=f"Side friction, {len(units)} pushes of even rows")
    for column in ("side friction", "mm", "degrees", f"mm / {unit}", f"degrees / {unit}"):
        table.add_column(column, justify="right")
    for friction, error in found.items():
        ratio = error.mean(0) / units.mean(0)
        table.add_row(f"{friction:g}", *(f"{value:.2f}" for value in error.mean(0)), *(f"{r:.3f}" for r in ratio))
    Console(width=120).print(table)


def show(title: str, columns: Mapping[str, np.ndarray], names: np.ndarray) -> None:
    unit = unit_of(columns)
    table = Table(title=title)
    for name in ("shape", "pushes", *columns, f"ours / {unit}"):
        table.add_column(name, justify="right")
    for shape in (*dict.fromkeys(names.tolist()), "all"):
        of_shape = np.full(len(names), True) if shape == "all" else names == shape
        means = {name: column[of_shape].mean(0) for name, column in columns.items()}
        ratio = means["ours"] / means[unit]
        cells = [f"{mm:.2f} / {degrees:.2f}" for mm, degrees in means.values()]
        table.add_row(shape, str(of_shape.sum()), *cells, f"{ratio[0]:.3f} / {ratio[1]:.3f}")
    Console(width=120).print(table)


def main(
    data: Annotated[Path, typer.Option(help="Recorded pushes, CSV packed with gzip.")],
    outlines: Annotated[Path, typer.Option(help="Outlines of the shapes, JSON.")],
    shapes: Annotated[str, typer.Option(help="By name.")] = "rect1,rect3,ellip1",
    side_friction: Annotated[float, typer.Option(help="Between probe and object, for all pushes.")] = 0.2,
    scan: Annotated[str, typer.Option(help="Side frictions of which even rows choose one, by least error.")] = "",
    split: Annotated[Literal["even", "odd", "all"], typer.Option(help="Rows to report.")] = "odd",
    count: Annotated[
        int | None, typer.Option(help="Pushes per shape and surface, spread evenly; all if left out.")
    ] = None,
    engine: Annotated[
        Literal["simulator", "reference"], typer.Option(help="reference: exact planar time stepping, uniform pressure.")
    ] = "simulator",
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
) -> None:
    names, everything = shapes.split(","), read_pushes(data, outlines)
    if scan:
        pushes = chosen(everything, names, "even", count)
        found = {
            friction: errors(replay_all(pushes, engine, friction, workers), pushes)
            for friction in map(float, scan.split(","))
        }
        columns = columns_of(pushes)
        unit = unit_of(columns)
        show_scan(found, unit, columns[unit])
        side_friction = min(found, key=lambda friction: (found[friction].mean(0) / columns[unit].mean(0)).sum())
    pushes = chosen(everything, names, split, count)
    motion, *others = columns_of(pushes).items()
    ours = ("ours", errors(replay_all(pushes, engine, side_friction, workers), pushes))
    show(
        title=f"Real pushes, {split} rows, {engine}, side friction {side_friction:g}: mean error, mm / degrees",
        columns=dict((motion, ours, *others)),
        names=pushes.shape,
    )


if __name__ == "__main__":
    typer.run(main)
