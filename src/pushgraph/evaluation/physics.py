"""The suite `physics`: rollouts of the predictors against simulation, beside standing still and the noise floor."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.evaluation.noise_floor import CAMERA, simulate_again
from pushgraph.evaluation.results import Results, Statistic
from pushgraph.physics import PhysicsPredictor
from pushgraph.shape import Cuboid
from pushgraph.track import Track

HORIZONS = (30, 50, 300)
"""Frames of a rollout, its start included; the last may be longer than a trajectory, which then counts whole."""
DENSITIES = ("all", "dense", "sparse")
HISTOGRAM = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
"""The paper's bins of a trajectory's mean error (cm)."""


class SceneErrors(NamedTuple):
    """Errors in one scene by model and horizon; a noise floor that cannot be simulated is left out."""

    objects: int
    density: str
    cuboid: np.ndarray
    errors: dict[tuple[str, int], RolloutError]


def evaluate_physics(
    objects: Sequence[int],
    count: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    setup: str = SETUP,
) -> tuple[Results, list[SceneErrors]]:
    """Measure predictors on `count` test scenes for each number of objects; see `measure_blocks`."""
    scenes = measure_blocks(evaluate_block, objects, count, seed, models, workers, progress, setup)
    results = Results("physics", {"setup": setup, "count": count, "seed": seed}, ("objects", "frames", "density"))
    for number in objects:
        for frames in HORIZONS:
            for density in DENSITIES:
                some = [s for s in scenes if s.objects == number and density in ("all", s.density)]
                for model in ("still", *models, "noise_floor"):
                    _add_rows(results, model, some, objects=number, frames=frames, density=density)
    return results, scenes


def evaluate_block(block: Block) -> list[SceneErrors]:
    """Simulate the scenes of a block, and predict them with every model."""
    trajectories = block.draw()
    tracks = [trajectory.track for trajectory in trajectories]
    longest = min(max(HORIZONS), max(len(track.times) for track in tracks))
    predicted = {"still": [_still(track) for track in tracks]}
    for name, path in block.models:
        predicted[name] = PhysicsPredictor.load(path).predict_many([track.scene for track in tracks], longest)
    found = []
    for k, trajectory in enumerate(trajectories):
        track = trajectory.track
        errors = {
            (name, frames): RolloutError(several[k], track, min(frames, len(track.times)))
            for name, several in predicted.items()
            for frames in HORIZONS
        }
        rng = np.random.default_rng([block.seed, block.first + k])
        for frames in HORIZONS:
            again = simulate_again(track, min(frames, len(track.times)), CAMERA, rng)
            if again is not None:
                errors["noise_floor", frames] = RolloutError(again, track, min(frames, len(track.times)))
        cuboid = np.array([isinstance(body.shape, Cuboid) for body in track.scene.bodies])
        found.append(SceneErrors(block.objects, trajectory.density, cuboid, errors))
    return found


def histogram(scenes: Sequence[SceneErrors], model: str, frames: int) -> np.ndarray:
    """Number of trajectories by mean error, in the bins of HISTOGRAM and one above."""
    errors = [100 * scene.errors[model, frames].mean for scene in scenes if (model, frames) in scene.errors]
    return np.histogram(errors, [0, *HISTOGRAM, np.inf])[0]


def _still(track: Track) -> Track:
    poses = track.poses.copy()
    poses[:, 1:] = poses[0, 1:]
    return Track(track.scene, track.times, poses, track.push, track.seen)


def _add_rows(results: Results, model: str, scenes: Sequence[SceneErrors], frames: int, **labels: Any) -> None:
    there = [scene for scene in scenes if (model, frames) in scene.errors]
    errors = [scene.errors[model, frames] for scene in there]

    def add(metric: str, unit: str, values: list[np.ndarray], statistic: Statistic = "mean") -> None:
        scene = np.repeat(np.arange(len(values)), [len(of_scene) for of_scene in values])
        flat = np.concatenate(values) if values else np.zeros(0)
        results.add(model, metric, unit, flat, scene, statistic, frames=frames, **labels)

    means = [np.array([100 * error.mean]) for error in errors]
    moved = [100 * error.final[error.moved] for error in errors]
    add("mean_error_cm", "cm", means)
    add("final_error_moved_cm", "cm", moved)
    add("median_final_error_moved_cm", "cm", moved, "median")
    add("displacement_moved_cm", "cm", [100 * error.displacement[error.moved] for error in errors])
    for shape, wanted in (("cuboid", True), ("cylinder", False)):
        yaw = [
            error.final_yaw[error.moved & (scene.cuboid == wanted)] * 180 / math.pi
            for error, scene in zip(errors, there, strict=True)
        ]
        add(f"yaw_error_{shape}_deg", "deg", yaw)
    for bound in (0.1, 0.4):
        add(f"share_under_{bound}_cm", "1", [(mean < bound).astype(float) for mean in means])
    add("worst_error_cm", "cm", means, "max")
