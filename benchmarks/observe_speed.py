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
MASSES = ("given", "weighed", "weighed, force")
"""Known masses, all learnt from motion, or from motion and a force sensor."""


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
    for name in ("objects", "masses", "median", "95th percentile", "slowest", "with the tool down, median"):
        table.add_column(name, justify="left" if name == "masses" else "right")
    figures = {}
    for objects in (6, 9, 12):
        tracks = [draw_trajectory("multiple-parts", objects, seed, index).track for index in range(scenes)]
        for masses in MASSES:
            taken, down = [], []
            for track in tracks:
                regulator = BeliefRegulator(track.scene, model, weigh=masses != "given")
                for poses, is_down, wrench in zip(track.poses[:FRAMES], track.down, track.wrench, strict=False):
                    felt = wrench if masses == "weighed, force" else None
                    begun = time.perf_counter()
                    regulator.observe(poses, bool(is_down), felt)
                    if regulator.frames > WARM_UP:
                        taken.append(1e3 * (time.perf_counter() - begun))
                        down.append(bool(is_down))
            times = np.array(taken)
            of_these = {
                "median": float(np.median(times)),
                "p95": float(np.percentile(times, 95)),
                "slowest": float(times.max()),
                "median_down": float(np.median(times[np.array(down)])),
            }
            figures[f"{objects} {masses}"] = of_these
            table.add_row(str(objects), masses, *(f"{value:.2f}" for value in of_these.values()))
    console = Console()
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    (out / "observe_speed.json").write_text(json.dumps(figures, indent=1))
    console.print(f"Written: {out / 'observe_speed.json'}")


if __name__ == "__main__":
    typer.run(main)
