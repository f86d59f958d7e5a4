"""The simulator against itself: how far it ends from where it ended, started with a little noise.

.venv/bin/python benchmarks/noise_floor.py --count 300 --out noise_floor
.venv/bin/python benchmarks/noise_floor.py --setup planar --count 300 --out noise_floor_planar
"""

import functools
import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.evaluation.noise_floor import CAMERA, StartNoise, simulate_again
from pushgraph.evaluation.results import Results
from pushgraph.simulation.setups import draw_trajectory

FRAMES = (30, 50)
NOISES = {
    "1mm": CAMERA,
    "0.2mm": StartNoise(2e-4, math.radians(0.1)),
    "0.02mm": StartNoise(2e-5, math.radians(0.01)),
}
METRICS = {
    "mean_error_cm": ("cm", "mean", lambda error: 100 * error.distance.mean(0)),
    "final_error_moved_cm": ("cm", "mean", lambda error: 100 * error.final[error.moved]),
    "median_final_error_moved_cm": ("cm", "median", lambda error: 100 * error.final[error.moved]),
    "displacement_moved_cm": ("cm", "mean", lambda error: 100 * error.displacement[error.moved]),
    "yaw_error_moved_deg": ("deg", "mean", lambda error: np.degrees(error.final_yaw[error.moved])),
}


def measure(setup: str, objects: int, seed: int, index: int) -> tuple[str, dict[tuple[str, int], RolloutError | None]]:
    """Density of one test scene, and its errors by noise and frames; None where the tool cannot come down."""
    trajectory = draw_trajectory(setup, objects, seed, index)
    errors: dict[tuple[str, int], RolloutError | None] = {}
    for number, (name, noise) in enumerate(NOISES.items()):
        for frames in FRAMES:
            rng = np.random.default_rng([seed, index, number])
            again = simulate_again(trajectory.track, frames, noise, rng)
            errors[name, frames] = again and RolloutError(again, trajectory.track, frames)
    return trajectory.density, errors


def draw(results: Results, path: Path) -> None:
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, frames in zip(figure.subplots(1, 2, sharey=True), FRAMES, strict=True):
        for shift, density in zip((-0.25, 0, 0.25), ("all", "dense", "sparse"), strict=True):
            rows = [
                row
                for row in results.rows
                if (row["metric"], row["frames"], row["density"]) == ("final_error_moved_cm", frames, density)
            ]
            values = [row["value"] for row in rows]
            spread = [[row["value"] - row["low"] for row in rows], [row["high"] - row["value"] for row in rows]]
            axes.bar(np.arange(len(rows)) + shift, values, 0.25, yerr=spread, capsize=3, label=f"{density} scenes")
        axes.set(
            title=f"{frames} frames", xlabel="noise of the start", xticks=range(len(NOISES)), xticklabels=list(NOISES)
        )
    figure.axes[0].set_ylabel("final error of moved objects (cm)")
    figure.axes[0].legend(frameon=False)
    figure.suptitle("Noise floor: the simulator against itself")
    figure.savefig(path, dpi=120)


def main(
    setup: Annotated[str, typer.Option(help="Setup.")] = "multiple-parts",
    count: Annotated[int, typer.Option(help="Scenes.")] = 300,
    objects: Annotated[int, typer.Option(help="Objects in a scene.")] = 9,
    seed: Annotated[int, typer.Option(help="From 1,000,000 on: test scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for results.json and noise_floor.png.")] = Path("noise_floor"),
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
) -> None:
    work = functools.partial(measure, setup, objects, seed)
    done = run_in_processes(work, range(count), workers)
    scenes = dict(progress(done, description="scenes", total=count))
    protocol = {"setup": setup, "objects": objects, "count": count, "seed": seed}
    results = Results("noise-floor", protocol, ("objects", "frames", "density", "noise", "scenes"))
    for noise in NOISES:
        for frames in FRAMES:
            for density in ("all", "dense", "sparse"):
                chosen = [scenes[k] for k in range(count) if density in ("all", scenes[k][0])]
                errors = [found[noise, frames] for _, found in chosen if found[noise, frames] is not None]
                if not any(error.moved.any() for error in errors):
                    continue
                labels = {
                    "objects": objects,
                    "frames": frames,
                    "density": density,
                    "noise": noise,
                    "scenes": len(errors),
                }
                for metric, (unit, statistic, measured) in METRICS.items():
                    values = [measured(error) for error in errors]
                    scene = np.repeat(np.arange(len(values)), [len(of_scene) for of_scene in values])
                    results.add("noise_floor", metric, unit, np.concatenate(values), scene, statistic, **labels)
    results.save(out / "results.json")
    draw(results, out / "noise_floor.png")
    table = Table(title=f"Noise floor, {setup}, {objects} objects, {count} scenes, seed {seed}")
    for name in ("noise", "frames", "scenes", *METRICS):
        table.add_column(name.replace("_", " "), justify="right")
    for noise in NOISES:
        for frames in FRAMES:
            rows = [r for r in results.rows if (r["noise"], r["frames"], r["density"]) == (noise, frames, "all")]
            table.add_row(noise, str(frames), str(rows[0]["scenes"]), *(f"{row['value']:.2f}" for row in rows))
    Console(width=140).print(table)
    print(f"Written: {out / 'results.json'}, {out / 'noise_floor.png'}")


if __name__ == "__main__":
    typer.run(main)
