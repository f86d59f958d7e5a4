"""Speed of predicting boards in space beside MuJoCo stepping the same scenes, on one thread in the same run.

.venv/bin/python benchmarks/lever_speed.py --drives 256 --out lever_speed
"""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from jaxtyping import Float
from rich.console import Console
from rich.table import Table

from pushgraph import pose_3d
from pushgraph.graph.lever_batch import start_lever
from pushgraph.lever_physics import LeverPredictor, rollout_lever, tool_knots
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import frame_times
from pushgraph.simulation.lever import STEPS, build, step_board
from pushgraph.simulation.lever_setup import SIDES, draw_interaction

REPEATS = 3
COARSE = (STEPS, STEPS // 4, STEPS // 10)
"""Steps of a frame in which MuJoCo is measured; the first is what truth is made by."""
ALONE = 8
"""So many scenes are predicted one by one."""


def seconds(work: Callable[[], Any], repeats: int = REPEATS) -> tuple[float, Any]:
    """The fastest of some runs, and what the last returned."""
    taken, found = [], None
    for _ in range(repeats):
        begun = time.perf_counter()
        found = work()
        taken.append(time.perf_counter() - begun)
    return min(taken), found


def predicted(
    predictor: LeverPredictor, scenes: Sequence[LeverScene], frames: int
) -> tuple[float, Float[np.ndarray, "scenes 7"]]:
    """Seconds of a rollout of scenes side by side, compiled and laid out before, and where the boards end."""
    state = start_lever(scenes)
    tool = torch.from_numpy(np.stack([tool_knots(scene, frames) for scene in scenes]))
    rollout_lever(predictor.dynamics, state, tool[:, :3])
    taken, poses = seconds(lambda: rollout_lever(predictor.dynamics, state, tool))
    return taken, poses[:, -1].numpy()


def one_by_one(
    predictor: LeverPredictor, scenes: Sequence[LeverScene], frames: int
) -> tuple[float, Float[np.ndarray, "scenes 7"]]:
    """The same, each scene by itself."""
    taken, ends = zip(*(predicted(predictor, [scene], frames) for scene in scenes), strict=True)
    return sum(taken), np.concatenate(ends)


def stepped(scenes: Sequence[LeverScene], steps: int) -> tuple[float, Float[np.ndarray, "scenes 7"]]:
    """Seconds of MuJoCo's steps, models built before, and where the boards end."""
    models = [build(scene, steps) for scene in scenes]
    taken, ends = seconds(
        lambda: [step_board(model, scene)[-1] for model, scene in zip(models, scenes, strict=True)], repeats=1
    )
    return taken, np.array(ends)


def errors(ends: Float[np.ndarray, "scenes 7"], true: Float[np.ndarray, "scenes 7"]) -> tuple[float, float]:
    """Median distance (mm) and angle (degrees)."""
    away = np.linalg.norm((ends - true)[:, :3], axis=-1)
    return 1e3 * float(np.median(away)), float(np.degrees(np.median(pose_3d.rotation_error(ends, true))))


def main(
    drives: Annotated[int, typer.Option(help="Drives side by side, each levered from one side.")] = 256,
    seed: Annotated[int, typer.Option(help="Of the drives.")] = 1_000_000,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("lever_speed"),
) -> None:
    torch.set_num_threads(1)
    console, predictor = Console(), LeverPredictor.load()
    with console.status("Drawing"):
        scenes = [draw_interaction(seed, len(SIDES) * k + k % len(SIDES)).track.scene for k in range(drives)]
    frames = len(frame_times(scenes[0])) - 1
    console.print(f"{drives} drives, {frames} frames each, one thread")
    found = {f"MuJoCo, {steps} steps a frame": stepped(scenes, steps) for steps in COARSE}
    found["lever_up, one by one"] = one_by_one(predictor, scenes[:ALONE], frames)
    found["lever_up, side by side"] = predicted(predictor, scenes, frames)
    base, true = next(iter(found.values()))
    table, rows = Table(title="Off: medians at the end, from MuJoCo in the first row"), []
    for name in ("", "scene-frames/s", "times MuJoCo", "mm off", "degrees off"):
        table.add_column(name, justify="right" if name else "left")
    for name, (taken, ends) in found.items():
        speed, times = len(ends) * frames / taken, base / taken * len(ends) / drives
        away, angle = errors(ends, true[: len(ends)])
        rows.append({"name": name, "scene_frames_per_second": speed, "times": times, "mm": away, "degrees": angle})
        table.add_row(name, f"{speed:,.0f}", f"{times:.1f}", f"{away:.3f}", f"{angle:.3f}")
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    written = {"drives": drives, "frames": frames, "seed": seed, "rows": rows}
    (out / "lever_speed.json").write_text(json.dumps(written, indent=1))
    console.print(f"Written: {out / 'lever_speed.json'}")


if __name__ == "__main__":
    typer.run(main)
