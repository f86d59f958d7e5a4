"""Time of one `observe`, on one thread, against the 50 ms of a frame.

.venv/bin/python benchmarks/observe_speed.py --out observe_speed
"""

import json
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from rich.console import Console
from rich.table import Table

from pushgraph.belief import BeliefModel
from pushgraph.regulator import BeliefRegulator
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.track import FRAME

WARM_UP, FRAMES = 20, 200


def main(
    scenes: Annotated[int, typer.Option(help="Scenes of each number of objects.")] = 4,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("observe_speed"),
) -> None:
    torch.set_num_threads(1)
    model = BeliefModel.load("belief")
    table = Table(
        title=f"One observe, one thread, after {WARM_UP} frames of warm-up (ms); a frame lasts {FRAME * 1e3:g}"
    )
    for name in ("objects", "median", "95th percentile", "slowest", "with the tool down, median"):
        table.add_column(name, justify="right")
    figures = {}
    for objects in (6, 9, 12):
        taken, down = [], []
        for index in range(scenes):
            track = draw_trajectory("multiple-parts", objects, seed, index).track
            regulator = BeliefRegulator(track.scene, model)
            for poses, is_down in zip(track.poses[:FRAMES], track.down[:FRAMES].tolist(), strict=True):
                begun = time.perf_counter()
                regulator.observe(poses, is_down)
                if regulator.frames > WARM_UP:
                    taken.append(1e3 * (time.perf_counter() - begun))
                    down.append(is_down)
        times = np.array(taken)
        figures[objects] = {
            "median": float(np.median(times)),
            "p95": float(np.percentile(times, 95)),
            "slowest": float(times.max()),
            "median_down": float(np.median(times[np.array(down)])),
        }
        table.add_row(str(objects), *(f"{value:.2f}" for value in figures[objects].values()))
    console = Console()
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    (out / "observe_speed.json").write_text(json.dumps(figures, indent=1))
    console.print(f"Written: {out / 'observe_speed.json'}")


if __name__ == "__main__":
    typer.run(main)
