"""Prediction of the mixture, by kind of scene: error over motion, and whether anything went where it cannot.

.venv/bin/pushgraph generate planar --objects 9 --count 400 --seed 2000000 --out mixture.h5
.venv/bin/python benchmarks/mixture.py mixture.h5 --out mixture
"""

import json
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import torch
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph.dataset.store import Dataset
from pushgraph.physics import PhysicsPredictor
from pushgraph.track import LIFTED

MOVED = 0.005
"""Bodies that move farther than this (m) in the first push count."""
FARTHEST = 3.0
"""No body goes farther than this many times what the tool does, or what any body truly does."""
BATCH = 16


class Kind(NamedTuple):
    errors: list[float]
    motions: list[float]


def main(
    data: Annotated[Path, typer.Argument(help="A dataset of planar.")],
    frames: Annotated[int, typer.Option(help="Frames of the first push at most.")] = 50,
    frames_per_step: Annotated[int, typer.Option()] = 1,
    count: Annotated[int, typer.Option(help="Trajectories; 0: all.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("mixture"),
) -> None:
    torch.set_num_threads(1)
    predictor = PhysicsPredictor.load("contact")
    kinds: dict[str, Kind] = {}
    broken, too_far, done = 0, 0, 0
    with Dataset(data) as dataset:
        total = min(count or len(dataset), len(dataset))
        for first in progress(range(0, total, BATCH)):
            last = min(first + BATCH, total)
            tracks = [dataset[k] for k in range(first, last)]
            names = [name.decode() for name in dataset.columns(first, last).kind.tolist()]
            lengths = [min(frames, int(np.argmax(np.append(track.push, LIFTED) != 0))) for track in tracks]
            scenes = [track.scene.replace(pushes=track.scene.pushes[:1]) for track in tracks]
            predicted = predictor.predict_many(scenes, frames, frames_per_step)
            for track, one, length, name in zip(tracks, predicted, lengths, names, strict=True):
                true = track.poses[:length, 1:, :2]
                poses = one.poses[:length, 1:, :2]
                broken += int(not np.isfinite(poses).all())
                motion = np.linalg.norm(true[-1] - true[0], axis=-1)
                way = np.linalg.norm(track.poses[length - 1, 0, :2] - track.poses[0, 0, :2])
                gone = np.linalg.norm(poses - poses[0], axis=-1).max()
                too_far += int(gone > FARTHEST * max(way, float(motion.max()), 0.01))
                error = np.linalg.norm(poses[-1] - true[-1], axis=-1)
                moved = motion > MOVED
                kind = kinds.setdefault(name, Kind([], []))
                kind.errors.extend(error[moved].tolist())
                kind.motions.extend(motion[moved].tolist())
                done += 1
    table = Table(title=f"{done} rollouts of up to {frames} frames, steps of up to {frames_per_step}")
    for column in ("kind", "bodies that moved", "motion (cm)", "error, mean / median (cm)", "error over motion"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    rows = {}
    for name in sorted(kinds):
        errors, motions = (100 * np.array(values) for values in kinds[name])
        if not len(errors):
            continue
        rows[name] = {
            "bodies": len(errors),
            "motion_cm": float(motions.mean()),
            "mean_cm": float(errors.mean()),
            "median_cm": float(np.median(errors)),
            "error_over_motion": float(errors.sum() / motions.sum()),
        }
        row = rows[name]
        table.add_row(
            name,
            f"{row['bodies']}",
            f"{row['motion_cm']:.1f}",
            f"{row['mean_cm']:.2f} / {row['median_cm']:.2f}",
            f"{100 * row['error_over_motion']:.1f} %",
        )
    console = Console()
    console.print(table)
    console.print(f"not finite: {broken}; farther than could be: {too_far}")
    out.mkdir(parents=True, exist_ok=True)
    (out / "mixture.json").write_text(json.dumps({"kinds": rows, "broken": broken, "too_far": too_far}, indent=1))
    console.print(f"Written: {out / 'mixture.json'}")


if __name__ == "__main__":
    typer.run(main)
