"""The simulator against exact planar time stepping, on random pushes of one piece (see tests/planar_reference.py).

How chaotic these pushes are stands beside: how far the reference ends from itself, started 0.02 mm and 0.01 degrees
beside.

.venv/bin/python benchmarks/reference_pushes.py --count 100 --out reference_pushes.json
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph.dataset.engines import run_in_processes
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planar_reference import STEP, piece_pose, reference_ends
from random_pushes import KINDS, kind_of, random_pushes

BLOCK = 25
"""Pushes that one process handles at a time."""
START_NOISE = 2e-5, np.radians(0.01)
"""Standard deviations along each axis (m) and of the yaw (rad)."""


class Task(NamedTuple):
    count: int
    seed: int
    first: int
    step: float


class Ends(NamedTuple):
    """Centres of mass and yaws at the end, and the seconds that they took."""

    reference: np.ndarray
    simulated: np.ndarray
    beside: np.ndarray
    reference_seconds: float
    simulated_seconds: float


def measure(task: Task) -> Ends:
    scenes = random_pushes(task.count, task.seed)[task.first : task.first + BLOCK]
    rng = np.random.default_rng([task.seed, task.first])
    reference, reference_seconds = timed(lambda: reference_ends(scenes, task.step))
    beside = reference_ends([start_beside(scene, rng) for scene in scenes], task.step)
    simulated, simulated_seconds = timed(lambda: [simulate(scene).poses[-1, 1:] for scene in scenes])
    ends = (
        np.array([piece_pose(scene, end) for scene, end in zip(scenes, of_all, strict=True)])
        for of_all in (reference, simulated, beside)
    )
    return Ends(*ends, reference_seconds, simulated_seconds)


def timed(work: Callable[[], list[np.ndarray]]) -> tuple[list[np.ndarray], float]:
    start = time.perf_counter()
    return work(), time.perf_counter() - start


def start_beside(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with a little noise on where the push starts, and on how it and its tool are turned."""
    (push,) = scene.pushes
    position, yaw = START_NOISE
    shift, turn = rng.normal(size=2) * position, rng.normal() * yaw
    start = tuple((np.array(push.start) + shift).tolist())
    return scene.replace(pushes=(push.replace(start=start, direction=push.direction + turn, yaw=push.yaw + turn),))


def errors(ends: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Errors of position (mm) and of yaw (degrees), [pushes, 2]."""
    apart = ends - reference
    return np.stack((1e3 * np.hypot(apart[:, 0], apart[:, 1]), np.degrees(np.abs(apart[:, 2]))), -1)


def main(
    count: Annotated[int, typer.Option(help="Pushes.")] = 100,
    seed: Annotated[int, typer.Option(help="Of the pushes.")] = 2_000_000,
    step: Annotated[float, typer.Option(help="How far the tool moves at most in a step of the reference (m).")] = STEP,
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
    worst: Annotated[int, typer.Option(help="Pushes to list, from the largest error on.")] = 0,
    out: Annotated[Path | None, typer.Option(help="File for the errors of each push, JSON.")] = None,
) -> None:
    tasks = [Task(count, seed, first, step) for first in range(0, count, BLOCK)]
    done = dict(progress(run_in_processes(measure, tasks, workers), description="blocks", total=len(tasks)))
    blocks = [done[task] for task in tasks]
    scenes = random_pushes(count, seed)
    kinds = np.array([kind_of(scene) for scene in scenes])
    reference, simulated, beside = (np.concatenate([block[k] for block in blocks]) for k in range(3))
    found = errors(simulated, reference)
    chaos = errors(beside, reference)
    table = Table(title=f"Simulator against reference, {count} pushes of 60 mm, seed {seed:,}: mm / degrees")
    for name in ("piece", "pushes", "mean", "median", "95th percentile", "largest", "0.02 mm beside: median", "95th"):
        table.add_column(name, justify="right")
    for kind in (*KINDS, "all"):
        chosen = np.full(count, True) if kind == "all" else kinds == kind
        if not chosen.any():
            continue
        ours, floor = found[chosen], chaos[chosen]
        columns = (ours.mean(0), *np.percentile(ours, (50, 95, 100), axis=0), *np.percentile(floor, (50, 95), axis=0))
        table.add_row(kind, str(chosen.sum()), *(f"{mm:.2f} / {degrees:.2f}" for mm, degrees in columns))
    Console(width=130).print(table)
    for k in np.argsort(-found[:, 0])[:worst]:
        push, shape = scenes[k].pushes[0], scenes[k].tool.parts[0].shape
        print(
            f"push {k}, {kinds[k]}: {found[k, 0]:.2f} mm, {found[k, 1]:.2f} degrees ({chaos[k, 0]:.2f}, "
            f"{chaos[k, 1]:.2f} beside); {shape.kind}, {1e3 * push.speed:.0f} mm/s, table "
            f"{scenes[k].table.friction:.2f}, side {scenes[k].side_friction:.2f}"
        )
    seconds = [sum(block[k] for block in blocks) for k in (3, 4)]
    print(f"Reference {seconds[0]:.0f} s, simulator {seconds[1]:.0f} s of one core.")
    if out:
        rows = [
            {"kind": kind, "position_error_mm": a[0], "yaw_error_deg": a[1], "beside_mm": b[0], "beside_deg": b[1]}
            for kind, a, b in zip(kinds.tolist(), found.tolist(), chaos.tolist(), strict=True)
        ]
        out.write_text(json.dumps({"count": count, "seed": seed, "step": step, "pushes": rows}, indent=1))
        print(f"Written: {out}")


if __name__ == "__main__":
    typer.run(main)
