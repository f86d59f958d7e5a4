"""How far simulated ends depend on accidents: the order of bodies in the file, and where the scene stands.

Neither is physics, so ends should differ by less than those of starts that differ by less than any camera sees.

.venv/bin/python benchmarks/accidents.py --count 16 --draws 4 --out accidents.json
"""

import functools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph import pose
from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import SimulationError
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.evaluation.noise_floor import StartNoise, simulate_again
from pushgraph.simulation.motion import LIFTED_FRAMES
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import FIRST_TEST_SEED, draw_trajectory
from pushgraph.track import Track

SHIFT = 1.0
"""How far scenes are shifted at most along each axis (m)."""
START_NOISE = StartNoise(2e-5, math.radians(0.01))

Accident = Callable[[Track, int, np.random.Generator], Track | None]
"""The begun track of a scene simulated again, in the scene's own frame and order; None if that comes to nothing."""


def shuffled(track: Track, frames: int, rng: np.random.Generator) -> Track | None:
    """Bodies stand in another order in the file."""
    order = rng.permutation(len(track.scene.bodies))
    again = simulate(track.scene.replace(bodies=tuple(track.scene.bodies[k] for k in order)))
    poses = np.empty_like(again.poses)
    poses[:, [0, *(1 + order)]] = again.poses
    return Track(track.scene, again.times, poses, again.push, again.seen)


def moved(track: Track, frames: int, rng: np.random.Generator) -> Track | None:
    """The scene is shifted and turned, table and all."""
    motion = np.array([*rng.uniform(-SHIFT, SHIFT, 2), rng.uniform(-math.pi, math.pi)])
    again = simulate(track.scene.moved(motion))
    return Track(track.scene, again.times, pose.relative(motion, again.poses), again.push, again.seen)


def started_beside(track: Track, frames: int, rng: np.random.Generator) -> Track | None:
    """Bodies start 0.02 mm and 0.01 degrees beside."""
    return simulate_again(track, frames, START_NOISE, rng)


ACCIDENTS: dict[str, Accident] = {
    "bodies shuffled": shuffled,
    "scene shifted and turned": moved,
    "started 0.02 mm beside": started_beside,
}


def measure(objects: int, seed: int, frames: int, draws: int, index: int) -> dict[str, list[np.ndarray | None]]:
    """How far moved bodies of a scene end from where they ended (mm), for each accident and draw."""
    whole = draw_trajectory("multiple-parts", objects, seed, index).track
    # Frames of the lifted tool exist only before a push, so a stretch that ends in them needs the next push.
    begun = int(whole.push[: frames + LIFTED_FRAMES].max()) + 1
    track = simulate(whole.scene.replace(pushes=whole.scene.pushes[:begun]))
    found: dict[str, list[np.ndarray | None]] = {}
    for number, (name, accident) in enumerate(ACCIDENTS.items()):
        rng = np.random.default_rng([seed, index, number])
        found[name] = [differences(accident, track, frames, rng) for _ in range(draws)]
    return found


def differences(accident: Accident, track: Track, frames: int, rng: np.random.Generator) -> np.ndarray | None:
    try:
        again = accident(track, frames, rng)
    except SimulationError:  # the tool comes down on a body that ends elsewhere
        return None
    if again is None:
        return None
    error = RolloutError(again, track, frames)
    return 1e3 * error.final[error.moved]


def main(
    count: Annotated[int, typer.Option(help="Scenes.")] = 16,
    draws: Annotated[int, typer.Option(help="Of every accident in every scene.")] = 4,
    objects: Annotated[int, typer.Option(help="Objects in a scene.")] = 9,
    frames: Annotated[int, typer.Option(help="After so many frames bodies are compared.")] = 50,
    seed: Annotated[int, typer.Option(help="From 1,000,000 on: test scenes.")] = FIRST_TEST_SEED,
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
    out: Annotated[Path | None, typer.Option(help="File for the figures, JSON.")] = None,
) -> None:
    work = functools.partial(measure, objects, seed, frames, draws)
    scenes = dict(progress(run_in_processes(work, range(count), workers), description="scenes", total=count))
    table = Table(title=f"Ends of moved bodies, {count} scenes of {objects} objects, {frames} frames: apart (mm)")
    for name in ("accident", "ends", "median", "95th percentile", "largest", "came to nothing"):
        table.add_column(name, justify="left" if name == "accident" else "right")
    figures = {}
    for name in ACCIDENTS:
        draws_of_all = [apart for index in range(count) for apart in scenes[index][name]]
        apart = np.concatenate([np.zeros(0), *(ends for ends in draws_of_all if ends is not None)])
        nothing = sum(ends is None for ends in draws_of_all)
        if not len(apart):
            continue
        median, high, largest = np.percentile(apart, (50, 95, 100)).tolist()
        table.add_row(name, str(len(apart)), f"{median:.3f}", f"{high:.3f}", f"{largest:.2f}", str(nothing))
        figures[name] = {
            "ends": len(apart),
            "median_mm": median,
            "percentile_95_mm": high,
            "largest_mm": largest,
            "came_to_nothing": nothing,
        }
    Console(width=120).print(table)
    if out:
        protocol = {"count": count, "draws": draws, "objects": objects, "frames": frames, "seed": seed}
        out.write_text(json.dumps({"protocol": protocol, "accidents": figures}, indent=1))
        print(f"Written: {out}")


if __name__ == "__main__":
    typer.run(main)
