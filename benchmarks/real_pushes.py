"""The simulator against recorded pushes of single objects by a round probe, beside two analytic models on the same.

The recordings: Yu, Bauza, Fazeli, Rodriguez, "More than a million ways to be pushed", IROS 2016, as a table of poses
before and after, with what a fourth-order polynomial limit surface (poly4) and an ellipsoid predict. One side friction
serves all pushes; it may be chosen on the even rows of the file, and the odd ones tell how good it is.

.venv/bin/python benchmarks/real_pushes.py --data pushes.csv.gz --outlines outlines.json --scan 0.1,0.15,0.2,0.25,0.3
"""

import csv
import gzip
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph.body import Body
from pushgraph.dataset.engines import run_in_processes
from pushgraph.pose import wrap_angle
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planar_reference import reference_ends

PROBE_DIAMETER = 2 * 0.00475
PARTED, FARTHEST_BACK = 1e-6, 0.01
"""A probe that starts inside the object moves back until this far from it, and at most so far (m)."""
BLOCK = 20
"""Pushes that one process handles at a time."""
MODELS = ("poly4", "ellipsoid")

Shape = Cuboid | Cylinder


class Recorded(NamedTuple):
    """A recorded push: poses (m, m, rad) of the object before and after, and what the analytic models make of it."""

    shape_name: str
    shape: Shape
    before: tuple[float, float, float]
    after: tuple[float, float, float]
    probe_start: tuple[float, float]
    probe_end: tuple[float, float]
    speed: float
    predicted: tuple[tuple[float, float, float], ...]


class Task(NamedTuple):
    engine: str
    side_friction: float
    pushes: tuple[Recorded, ...]


class Replayed(NamedTuple):
    """Where replayed objects end, and how far the probe's start was moved back (m)."""

    ends: np.ndarray
    moved_back: np.ndarray


def read(data: Path, outlines: Path, shapes: Sequence[str]) -> list[list[Recorded]]:
    """Recorded pushes of these shapes, those of the even rows of the file, then those of the odd ones."""
    described = json.loads(outlines.read_text())
    known = {name: shape_of(outline) for name, outline in described.items()}
    valid = [name for name, shape in known.items() if shape]
    for name in shapes:
        if name not in valid:
            raise typer.BadParameter(f"{name}: no rectangle or disk of this name in {outlines}; valid: {valid}")
    split: list[list[Recorded]] = [[], []]
    with gzip.open(data, "rt", newline="") as file:
        for number, row in enumerate(csv.DictReader(file)):
            if row["shape"] in shapes:
                split[number % 2].append(recorded(row, known[row["shape"]]))
    return split


def shape_of(outline: dict[str, list]) -> Shape | None:
    """The shape of an outline; None if it is neither a centred rectangle nor a disk."""
    if "ellipse" in outline:
        along_x, along_y = outline["ellipse"]
        return Cylinder(diameter=along_x) if along_x == along_y else None
    corners = np.array(outline["polygon"])
    size = np.ptp(corners, axis=0)
    centred = len(corners) == 4 and np.allclose(np.abs(corners), size / 2)
    return Cuboid(size=tuple(size.tolist())) if centred else None


def recorded(row: dict[str, str], shape: Shape) -> Recorded:
    def numbers(*names: str) -> tuple[float, ...]:
        return tuple(float(row[name]) for name in names)

    return Recorded(
        shape_name=row["shape"],
        shape=shape,
        before=numbers("x0", "y0", "yaw0"),
        after=numbers("x1", "y1", "yaw1"),
        probe_start=numbers("tip_x0", "tip_y0"),
        probe_end=numbers("tip_x1", "tip_y1"),
        speed=float(row["speed_mm_s"]) / 1e3,
        predicted=tuple(numbers(f"{model}_x1", f"{model}_y1", f"{model}_yaw1") for model in MODELS),
    )


def scene_of(push: Recorded, side_friction: float) -> tuple[Scene, float]:
    """The push as a scene of nominal mass and table friction, and how far the probe's start was moved back (m)."""
    scene = Scene(
        bodies=(Body(name=push.shape_name, shape=push.shape, pose_world_from_body=push.before),),
        tool=Tool.round(PROBE_DIAMETER),
        side_friction=side_friction,
    ).with_nominal_values()
    start, end = np.array(push.probe_start), np.array(push.probe_end)
    ahead = (end - start) / np.hypot(*(end - start))
    back = 0.0
    while back < FARTHEST_BACK:
        there = np.array([[*(start - back * ahead), 0.0]])
        gap = float(scene.tool_gaps(there, scene.poses_world_from_body).min())
        if gap >= 0:
            break
        back += PARTED - gap
    probe = Push(start=tuple((start - back * ahead).tolist()), end=push.probe_end, speed=push.speed)
    return scene.replace(pushes=(probe,)), back


def replay(task: Task) -> Replayed:
    scenes, moved_back = zip(*(scene_of(push, task.side_friction) for push in task.pushes), strict=True)
    if task.engine == "reference":
        ends = [end[0] for end in reference_ends(scenes)]
    else:
        ends = [simulate(scene).poses[-1, 1] for scene in scenes]
    return Replayed(np.array(ends), np.array(moved_back))


def replay_all(pushes: Sequence[Recorded], engine: str, side_friction: float, workers: int) -> Replayed:
    blocks = [tuple(pushes[first : first + BLOCK]) for first in range(0, len(pushes), BLOCK)]
    tasks = [Task(engine, side_friction, block) for block in blocks]
    done = run_in_processes(replay, tasks, workers)
    found = dict(progress(done, description=f"side friction {side_friction:g}", total=len(tasks)))
    return Replayed(*(np.concatenate(column) for column in zip(*(found[task] for task in tasks), strict=True)))


def errors(ends: np.ndarray, pushes: Sequence[Recorded]) -> np.ndarray:
    """Errors of position (mm) and rotation (degrees), [pushes, 2]."""
    apart = ends - np.array([push.after for push in pushes])
    return np.stack((1e3 * np.hypot(apart[:, 0], apart[:, 1]), np.degrees(np.abs(wrap_angle(apart[:, 2])))), -1)


def spread_out(pushes: Sequence[Recorded], shapes: Sequence[str], count: int | None) -> list[Recorded]:
    """`count` pushes of each shape, spread evenly over the file; all if None."""
    chosen = []
    for name in shapes:
        of_shape = [push for push in pushes if push.shape_name == name]
        some = len(of_shape) if count is None else min(count, len(of_shape))
        chosen += [of_shape[k] for k in np.linspace(0, len(of_shape) - 1, some).round().astype(int)]
    return chosen


def show_scan(found: dict[float, np.ndarray], poly4: np.ndarray, pushes: int) -> None:
    table = Table(title=f"Side friction, {pushes} pushes of even rows")
    for name in ("side friction", "mm", "degrees", "mm / poly4", "degrees / poly4"):
        table.add_column(name, justify="right")
    for friction, error in found.items():
        ratio = error.mean(0) / poly4.mean(0)
        table.add_row(f"{friction:g}", *(f"{value:.2f}" for value in error.mean(0)), *(f"{r:.3f}" for r in ratio))
    Console(width=120).print(table)


def show(title: str, ours: np.ndarray, models: Sequence[np.ndarray], motion: np.ndarray, names: np.ndarray) -> None:
    table = Table(title=title)
    for name in ("shape", "pushes", "motion", "ours", *MODELS, "ours / poly4"):
        table.add_column(name, justify="right")
    for shape in (*dict.fromkeys(names.tolist()), "all"):
        of_shape = np.full(len(names), True) if shape == "all" else names == shape
        means = [column[of_shape].mean(0) for column in (motion, ours, *models)]
        ratio = means[1] / means[2]
        cells = [f"{mm:.2f} / {degrees:.2f}" for mm, degrees in means]
        table.add_row(shape, str(of_shape.sum()), *cells, f"{ratio[0]:.3f} / {ratio[1]:.3f}")
    Console(width=120).print(table)


def main(
    data: Annotated[Path, typer.Option(help="Recorded pushes, CSV packed with gzip.")],
    outlines: Annotated[Path, typer.Option(help="Outlines of the shapes, JSON.")],
    shapes: Annotated[str, typer.Option(help="Rectangles and disks, by name.")] = "rect1,rect3,ellip1",
    side_friction: Annotated[float, typer.Option(help="Between probe and object, for all pushes.")] = 0.2,
    scan: Annotated[str, typer.Option(help="Side frictions of which even rows choose one, by least error.")] = "",
    split: Annotated[Literal["even", "odd", "all"], typer.Option(help="Rows to report.")] = "odd",
    count: Annotated[int | None, typer.Option(help="Pushes per shape, spread evenly; all if left out.")] = None,
    engine: Annotated[
        Literal["simulator", "reference"], typer.Option(help="reference: exact planar time stepping, uniform pressure.")
    ] = "simulator",
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
) -> None:
    names = shapes.split(",")
    even, odd = read(data, outlines, names)
    if scan:
        pushes = spread_out(even, names, count)
        found = {
            friction: errors(replay_all(pushes, engine, friction, workers).ends, pushes)
            for friction in map(float, scan.split(","))
        }
        poly4 = errors(np.array([push.predicted[0] for push in pushes]), pushes)
        show_scan(found, poly4, len(pushes))
        side_friction = min(found, key=lambda friction: (found[friction].mean(0) / poly4.mean(0)).sum())
    pushes = spread_out({"even": even, "odd": odd, "all": even + odd}[split], names, count)
    replayed = replay_all(pushes, engine, side_friction, workers)
    show(
        title=f"Real pushes, {split} rows, {engine}, side friction {side_friction:g}: mean error, mm / degrees",
        ours=errors(replayed.ends, pushes),
        models=[errors(np.array([push.predicted[k] for push in pushes]), pushes) for k in range(len(MODELS))],
        motion=errors(np.array([push.before for push in pushes]), pushes),
        names=np.array([push.shape_name for push in pushes]),
    )
    back = replayed.moved_back[replayed.moved_back > 0]
    far = f", {1e3 * np.median(back):.2f} mm in the median, at most {1e3 * back.max():.2f} mm" if len(back) else ""
    print(f"{len(back)} of {len(pushes)} probes started inside the object; their start was moved back{far}.")


if __name__ == "__main__":
    typer.run(main)
