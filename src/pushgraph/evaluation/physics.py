"""The suite `physics`: rollouts of the predictors against simulation, beside standing still and the noise floor."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from pushgraph.dataset.engines import single_threaded
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.metrics import RolloutError
from pushgraph.evaluation.noise_floor import CAMERA, simulate_again
from pushgraph.evaluation.results import Results, Statistic
from pushgraph.physics import PhysicsPredictor
from pushgraph.shape import Cuboid
from pushgraph.simulation.motion import plan_tool
from pushgraph.track import Track

HORIZONS = (30, 50, 300)
"""Frames of a rollout, its start included; the last may be longer than a trajectory, which then counts whole."""
DENSITIES = ("all", "dense", "sparse")
HISTOGRAM = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
"""The paper's bins of a trajectory's mean error (cm)."""


AS_PLANNED = 1e-3
"""A tool that is never farther from its plan than this (m, rad) goes as planned."""


class SceneErrors(NamedTuple):
    """Errors in one scene by model and horizon; a noise floor that cannot be simulated is left out."""

    objects: int
    density: str
    cuboid: np.ndarray
    errors: dict[tuple[str, int], RolloutError]


def evaluate_physics(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    setup: str = SETUP,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[SceneErrors]]:
    """Measure predictors on `count` test scenes for each number of objects; see `measure_blocks`.

    From data, the tool goes as it went there.
    """
    objects = numbers_of(objects, data)
    scenes = measure_blocks(evaluate_block, objects, count, seed, models, workers, progress, setup, data=data)
    results = Results("physics", origin(setup, count, seed, data), ("objects", "frames", "density"))
    densities = DENSITIES if data is None else ("all", *sorted({s.density for s in scenes} & {*DENSITIES}))
    for number in objects:
        for frames in HORIZONS:
            for density in densities:
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
        predictor = PhysicsPredictor.load(path)
        if block.data is None:
            predicted[name] = predictor.predict_many([track.scene for track in tracks], longest)
        else:
            predicted[name] = predict_along(predictor, tracks, longest, name)
    found = []
    for k, trajectory in enumerate(trajectories):
        track = trajectory.track
        errors = {
            (name, frames): RolloutError(several[k], track, min(frames, len(track.times)))
            for name, several in predicted.items()
            for frames in HORIZONS
        }
        rng = np.random.default_rng([block.seed, block.first + k])
        for frames in HORIZONS if block.data is None or _as_planned(track) else ():
            again = simulate_again(track, min(frames, len(track.times)), CAMERA, rng)
            if again is not None:
                errors["noise_floor", frames] = RolloutError(again, track, min(frames, len(track.times)))
        cuboid = np.array([isinstance(body.shape, Cuboid) for body in track.scene.bodies])
        found.append(SceneErrors(block.objects, trajectory.density, cuboid, errors))
    return found


def predict_along(
    predictor: PhysicsPredictor, tracks: Sequence[Track], frames: int, name: str = "the network"
) -> list[Track]:
    """Predict the first frames of tracks from where their bodies stand at first, the tool going as it went.

    Raises EvaluationError, which tells the name, if a pose is not finite.
    """
    lengths = [min(frames, len(track.times)) for track in tracks]
    beyond = [max(lengths) - length for length in lengths]
    some = list(zip(tracks, lengths, beyond, strict=True))
    tool = np.stack([np.pad(track.poses[:n, 0], ((0, rest), (0, 0)), "edge") for track, n, rest in some])
    down = np.stack([np.pad(track.down[:n], (0, rest)) for track, n, rest in some])
    with torch.no_grad(), single_threaded():
        predicted, _ = predictor.rollout(predictor.start([track.scene for track in tracks]), tool, down).numpy()
    if not np.isfinite(predicted).all():
        raise EvaluationError(f"{name}: predicts poses that are not finite")
    found = []
    for (track, length, _), bodies in zip(some, predicted, strict=True):
        poses = np.concatenate((track.poses[:length, :1], bodies[:length, : len(track.scene.bodies)]), 1)
        found.append(Track(track.scene, track.times[:length], poses, track.push[:length], track.seen[:length]))
    return found


def _as_planned(track: Track) -> bool:
    """Whether the tool went as the pushes of the scene say: then the simulator can be asked, too."""
    if not track.scene.pushes:
        return False
    planned, push = plan_tool(track.scene.pushes, track.scene.tool, len(track.times))
    return len(push) == len(track.push) and bool((np.abs(planned - track.poses[:, 0]) < AS_PLANNED).all())


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
