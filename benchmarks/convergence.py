"""What more iterations and shorter steps gain: rows of boxes whose end is known, and scenes of the paper's setup.

.venv/bin/python benchmarks/convergence.py --data validation.h5 --out convergence
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

from pushgraph.body import Body
from pushgraph.dataset.store import Dataset
from pushgraph.network import newton
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.tool import Part, Push, Tool

SIDE, GAP, DEPTH, STROKE = 0.05, 0.0005, 0.02, 0.1
"""Of the boxes and the gaps between them, of the flat tool, and how far it goes (m)."""
ROWS, ITERATIONS, STEPS = (9, 15, 20), (4, 6, 8, 10, 15, 20, 40, 60), (0.025, 0.015, 0.01, 0.0075, 0.005, 0.0025)
FRAMES = 30
MOVED = 0.01


def row_of(boxes: int) -> Scene:
    """Boxes in a row, a flat tool before it."""
    bodies = tuple(
        Body(name=f"box-{k}", shape=Cuboid(size=(SIDE, SIDE)), pose_world_from_body=(k * (SIDE + GAP), 0, 0), mass=0.5)
        for k in range(boxes)
    )
    start = -(SIDE + DEPTH) / 2 - GAP
    tool = Tool(parts=(Part(shape=Cuboid(size=(DEPTH, SIDE))),))
    return Scene(bodies=bodies, tool=tool, pushes=(Push(start=(start, 0), end=(start + STROKE, 0), rest=0),))


def shown(found: dict[str, float]) -> tuple[str, str]:
    return f"{found['mean_cm']:.3f} / {found['median_cm']:.3f}", f"{found['scene_frames_per_second']:,.0f}"


def main(
    data: Annotated[Path, typer.Option(help="A dataset of multiple-parts.")],
    scenes: Annotated[int, typer.Option()] = 200,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("convergence"),
) -> None:
    torch.set_num_threads(1)
    predictor, console = PhysicsPredictor.load("contact"), Console()
    with Dataset(data) as dataset:
        tracks = [dataset[k] for k in range(min(scenes, len(dataset)))]
    true = np.stack([track.poses[: FRAMES + 1] for track in tracks])
    moved = np.linalg.norm(true[:, -1, 1:, :2] - true[:, 0, 1:, :2], axis=-1) > MOVED
    state, tool = predictor.start([track.scene for track in tracks]), torch.tensor(true[:, :, 0])
    down = torch.tensor(np.stack([track.down[: FRAMES + 1] for track in tracks]))

    def measure(**options: float) -> dict[str, float]:
        begun = time.perf_counter()
        with torch.no_grad():
            poses = predictor.rollout(state, tool, down, **options).poses.numpy()
        seconds = time.perf_counter() - begun
        error = np.linalg.norm(poses[:, -1, : moved.shape[1], :2] - true[:, -1, 1:, :2], axis=-1)[moved]
        found = {"mean_cm": 100 * error.mean(), "median_cm": 100 * float(np.median(error))}
        return found | {"scene_frames_per_second": len(tracks) * FRAMES / seconds}

    measure()
    most = newton.ITERATIONS
    by_iterations: dict[int, dict[str, float]] = {}
    table = Table(title=f"Rows: last box off where it must end (mm). {len(tracks)} scenes, {FRAMES} frames (cm)")
    for column in ("iterations at most", *(f"{row} boxes" for row in ROWS), "mean / median", "scene-frames/s"):
        table.add_column(column, justify="right")
    for newton.ITERATIONS in ITERATIONS:
        rows = [predictor.predict(row_of(row)) for row in ROWS]
        ends = [1e3 * float(track.poses[-1, -1, 0] - track.poses[0, -1, 0]) for track in rows]
        found = {f"row_{row}_mm": abs(end - 1e3 * (STROKE - GAP * row)) for end, row in zip(ends, ROWS, strict=True)}
        found |= measure()
        by_iterations[newton.ITERATIONS] = found
        table.add_row(str(newton.ITERATIONS), *(f"{found[f'row_{row}_mm']:.2f}" for row in ROWS), *shown(found))
    newton.ITERATIONS = most
    console.print(table)

    by_step: dict[float, dict[str, float]] = {}
    table = Table(title=f"{len(tracks)} scenes, {FRAMES} frames: final error of what moved")
    for column in ("step at most (mm)", "mean / median (cm)", "scene-frames/s"):
        table.add_column(column, justify="right")
    for step in STEPS:
        by_step[step] = measure(longest_step=step)
        table.add_row(f"{1e3 * step:g}", *shown(by_step[step]))
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    (out / "convergence.json").write_text(json.dumps({"iterations": by_iterations, "steps": by_step}, indent=1))
    console.print(f"Written: {out / 'convergence.json'}")


if __name__ == "__main__":
    typer.run(main)
