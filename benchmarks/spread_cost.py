"""What stating the spread adds to the time of rollouts: with and without it in turn, on one thread.

.venv/bin/python benchmarks/spread_cost.py --repeats 5
"""

import time
from typing import Annotated

import numpy as np
import torch
import typer
from rich.console import Console
from rich.table import Table

from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import State
from pushgraph.physics import PhysicsPredictor
from pushgraph.simulation.setups import draw_trajectory

FRAMES = 50
BATCHES = (1, 64, 256)


def main(
    objects: Annotated[int, typer.Option()] = 9,
    drawn: Annotated[int, typer.Option(help="Scenes that are drawn; larger batches repeat them.")] = 32,
    repeats: Annotated[int, typer.Option(help="Of each timing; the shortest counts.")] = 5,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
) -> None:
    torch.set_num_threads(1)
    predictor = PhysicsPredictor.load()
    tracks = [draw_trajectory("multiple-parts", objects, seed, index).track for index in range(drawn)]
    table = Table(title=f"Rollouts of {FRAMES} frames, {objects} objects, one thread (ms a scene-frame)")
    for name in ("scenes", "without", "with spread", "times"):
        table.add_column(name, justify="right")
    for batch in BATCHES:
        # A batch of one: every scene by itself.
        groups = [[track] for track in tracks] if batch == 1 else [[tracks[k % drawn] for k in range(batch)]]
        seconds = {spread: 0.0 for spread in (False, True)}
        for group in groups:
            scenes = batch_scenes([track.scene for track in group])
            poses = torch.from_numpy(np.stack([track.poses[:FRAMES] for track in group]))
            down = torch.from_numpy(np.stack([track.down[:FRAMES] for track in group]))
            still = torch.zeros_like(poses[:, 0, 1:])
            state = State(scenes, poses[:, 0, 1:], still, scenes.relations).double()
            taken: dict[bool, list[float]] = {False: [], True: []}
            for _ in range(repeats):
                for spread in taken:
                    begun = time.perf_counter()
                    with torch.no_grad():
                        predictor.rollout(state, poses[:, :, 0], down, spread=spread)
                    taken[spread].append(time.perf_counter() - begun)
            for spread, times in taken.items():
                seconds[spread] += min(times)
        count = sum(map(len, groups)) * (FRAMES - 1)
        each = {spread: 1e3 * total / count for spread, total in seconds.items()}
        table.add_row(str(batch), f"{each[False]:.4f}", f"{each[True]:.4f}", f"{each[True] / each[False]:.2f}")
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
