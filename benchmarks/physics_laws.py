"""What a prediction must not do: run away, move what is at rest, pull joints apart, depend on where the scene stands.

.venv/bin/python benchmarks/physics_laws.py --count 1000 --out physics_laws
"""

import json
import os
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from pushgraph import pose
from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.track import Track

LONG, DRIFT_FRAMES, MOVED_FRAMES = 300, 100, 50
BLOCK = 25
AT_REST, STAYS = 1e-4, 1e-3
"""Bodies that the simulator moves less than the first (m) in a push should be predicted to move less than the other."""


class Task(NamedTuple):
    model: str
    objects: int
    seed: int
    first: int
    count: int


class Measured(NamedTuple):
    finite: bool
    error: float
    still: float
    rest: np.ndarray
    drift: np.ndarray
    elsewhere: np.ndarray


def measure(task: Task) -> list[Measured]:
    predictor = PhysicsPredictor.load(task.model)
    true = [
        draw_trajectory("multiple-parts", task.objects, task.seed, k).track
        for k in range(task.first, task.first + task.count)
    ]
    scenes = [track.scene for track in true]
    predicted = predictor.predict_many(scenes, LONG)
    rng = np.random.default_rng([task.seed, task.first])
    motions = [np.array([*rng.uniform(-10, 10, 2), rng.uniform(-np.pi, np.pi)]) for _ in scenes]
    large = [scene.replace(table=scene.table.replace(size=(20.0, 20.0))) for scene in scenes]
    moved = predictor.predict_many([s.moved(m) for s, m in zip(large, motions, strict=True)], MOVED_FRAMES)
    found = []
    for track, guess, there, motion in zip(true, predicted, moved, motions, strict=True):
        frames = len(guess.times)
        error = RolloutError(guess, track, frames)
        still = np.hypot(*np.moveaxis(track.poses[:frames, 1:, :2] - track.poses[0, 1:, :2], -1, 0)).mean()
        back = pose.transform(pose.inverse(motion), there.poses[-1, 1:, :2])
        found.append(
            Measured(
                finite=bool(np.isfinite(guess.poses).all()),
                error=error.mean,
                still=float(still),
                rest=rest_in_first_push(track, guess),
                drift=joint_drift(track.scene, guess, min(DRIFT_FRAMES, frames - 1)),
                elsewhere=np.hypot(*(back - guess.poses[len(there.times) - 1, 1:, :2]).T),
            )
        )
    return found


def rest_in_first_push(track: Track, guess: Track) -> np.ndarray:
    """How far bodies that the first push leaves where they are were predicted to move (m)."""
    last = int(np.flatnonzero(track.push == 0)[-1])
    true, predicted = (np.hypot(*(t.poses[last, 1:, :2] - t.poses[0, 1:, :2]).T) for t in (track, guess))
    return predicted[true < AT_REST]


def joint_drift(scene: Scene, track: Track, frame: int) -> np.ndarray:
    """How far the two bodies of each joint have come apart where the joint does not let them (m)."""
    found = []
    for joint in scene.joints:
        anchor, axis, _ = scene.joint_frame(joint)
        ends = [1 + scene.names.index(name) for name in (joint.parent, joint.child)]
        here = [
            pose.transform(track.poses[frame, k], pose.transform(pose.inverse(track.poses[0, k]), anchor)) for k in ends
        ]
        apart = here[1] - here[0]
        if joint.kind == "prismatic":
            axis = pose.rotate(axis, track.poses[frame, ends[0], 2] - track.poses[0, ends[0], 2])
            apart = apart - axis * (apart @ axis)
        found.append(np.hypot(*apart))
    return np.array(found)


def main(
    count: Annotated[int, typer.Option(help="Scenes.")] = 1000,
    objects: Annotated[int, typer.Option()] = 9,
    seed: Annotated[int, typer.Option(help="Of the scenes.")] = 1_000_000,
    model: Annotated[str, typer.Option(help="contact, propnet, or a checkpoint.")] = "contact",
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("physics_laws"),
) -> None:
    tasks = [Task(model, objects, seed, first, min(BLOCK, count - first)) for first in range(0, count, BLOCK)]
    scenes: list[Measured] = []
    for _, found in progress(run_in_processes(measure, tasks, os.cpu_count() or 1), total=len(tasks)):
        scenes += found
    bound = np.array([scene.error / (2 * scene.still + 0.02) for scene in scenes])
    rest = np.concatenate([scene.rest for scene in scenes])
    drift = np.concatenate([scene.drift for scene in scenes])
    elsewhere = np.concatenate([scene.elsewhere for scene in scenes])
    figures = {
        f"rollouts of {LONG} frames that are not finite": int(sum(not scene.finite for scene in scenes)),
        "largest error, as a share of twice still's plus 2 cm": float(bound.max()),
        "objects at rest that are predicted to stay (share)": float((rest < STAYS).mean()),
        "objects at rest": len(rest),
        f"drift of joints after {DRIFT_FRAMES} frames, median (mm)": 1e3 * float(np.median(drift)),
        f"drift of joints after {DRIFT_FRAMES} frames, 95th percentile (mm)": 1e3 * float(np.percentile(drift, 95)),
        f"change of {MOVED_FRAMES} frames when the scene is moved, median (m)": float(np.median(elsewhere)),
        f"change of {MOVED_FRAMES} frames when the scene is moved, 99th percentile (m)": float(
            np.percentile(elsewhere, 99)
        ),
    }
    table = Table(title=f"{model}, {count} scenes of {objects} objects from seed {seed:,}", show_header=False)
    for name, value in figures.items():
        table.add_row(name, f"{value:.3g}")
    Console(width=120).print(table)
    out.mkdir(parents=True, exist_ok=True)
    (out / "physics_laws.json").write_text(json.dumps(figures, indent=1))
    print(f"Written: {out / 'physics_laws.json'}")


if __name__ == "__main__":
    typer.run(main)
