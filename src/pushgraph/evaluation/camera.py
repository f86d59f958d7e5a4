"""The suite `camera`: the paper's scenes of a real robot, predicted with what is believed after a few camera frames."""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float

from pushgraph.belief import BeliefModel
from pushgraph.dataset.engines import single_threaded
from pushgraph.errors import EvaluationError, TrackError
from pushgraph.evaluation.blocks import Block, measure_blocks
from pushgraph.evaluation.results import Results
from pushgraph.physics import PhysicsPredictor
from pushgraph.recording.files import read_sightings
from pushgraph.recording.recording import recording_of
from pushgraph.recording.sightings import NOTHING_DECLARED, Sightings
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.simulation.camera import film
from pushgraph.simulation.glued_cylinders import MOST
from pushgraph.track import Track

SETUP = "camera"
CONTACT_GAP = 0.01
"""First contact is when the tool is this near to a body (m): the rule of the published curves."""
AFTER_CONTACT = tuple(f"contact+{k}" if k else "contact" for k in range(5))
OBSERVED = tuple(range(0, 81, 10))
STARTS: tuple[int | str, ...] = (*AFTER_CONTACT, *OBSERVED)
"""First frame that is predicted from; a recording that is shorter keeps its last answer."""
MODELS = ("true_joints", "believed_joints")
PRIOR = {"none": 1.0, "fixed": 1.0}
"""Neighbours are glued or not, beforehand as likely."""


class Filmed(NamedTuple):
    """A scene with its true joints, what a camera saw of a push, and where its bodies truly ended (m)."""

    scene: Scene
    track: Track
    final: Float[np.ndarray, "bodies 2"]


class CameraErrors(NamedTuple):
    """Of one recording, means over its bodies (m): how far they moved, and by model how far off their predicted final
    positions are, from each of STARTS on."""

    motion: float
    errors: dict[str, Float[np.ndarray, " starts"]]


def evaluate_camera(
    count: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    prior: Mapping[str, float] = PRIOR,
) -> tuple[Results, list[CameraErrors]]:
    """Measure predictions of `count` test scenes that a simulated camera films; see `measure_blocks`.

    models: the checkpoints `contact`, which predicts, and `belief`, which watches. prior: see `BeliefRegulator`.
    """
    work = partial(measure_block, prior=prior)
    scenes = measure_blocks(work, (MOST,), count, seed, models, workers, progress, SETUP)
    return results_of(scenes, {"setup": SETUP, "count": count, "seed": seed, "prior": dict(prior)}), scenes


def evaluate_recordings(
    paths: Sequence[Path],
    models: Mapping[str, str | os.PathLike],
    progress: Callable[[int], None] = lambda done: None,
    prior: Mapping[str, float] = PRIOR,
) -> tuple[Results, list[CameraErrors]]:
    """The same of recordings that hold their scene with its true joints; where bodies were last seen is where they end.

    A folder stands for all files in it. Raises TrackError if one cannot be read or believed, EvaluationError if it
    holds no scene.
    """
    files = [file for path in paths for file in (_files_in(path) if path.is_dir() else [path])]
    scenes = []
    for file in files:
        scenes += errors_of([recorded(file)], models, prior)
        progress(len(scenes))
    protocol = {"data": [str(path) for path in paths], "count": len(files), "prior": dict(prior)}
    return results_of(scenes, protocol), scenes


def results_of(scenes: Sequence[CameraErrors], protocol: Mapping[str, object]) -> Results:
    """Rows of all scenes."""
    results = Results("camera", protocol, ("start",))
    of_scene = np.arange(len(scenes))
    for model in MODELS:
        motion = np.array([100 * scene.motion for scene in scenes])
        results.add(model, "motion_cm", "cm", motion, of_scene, start="all")
        for k, start in enumerate(STARTS):
            errors = np.array([100 * scene.errors[model][k] for scene in scenes])
            results.add(model, "final_error_cm", "cm", errors, of_scene, start=start)
    return results


def measure_block(block: Block, prior: Mapping[str, float]) -> list[CameraErrors]:
    """Simulate and film the scenes of a block, and predict them."""
    filmed = []
    for index, trajectory in enumerate(block.draw(), start=block.first):
        track = trajectory.track
        sightings = film(track, np.random.default_rng([block.seed, index]))
        filmed.append(Filmed(track.scene, _seen(sightings, track.scene), track.poses[-1, 1:, :2]))
    return errors_of(filmed, dict(block.models), prior)


def recorded(path: Path) -> Filmed:
    """A recording that holds its scene."""
    sightings = read_sightings(path)
    if not sightings.scene:
        raise EvaluationError(
            f"{path}: holds no scene, so its true joints are not known; tracks (.h5) and the paper's JSON do: "
            "pushgraph track FILE --scene SCENE --out track.h5 makes one"
        )
    scene = Scene.from_json(sightings.scene, f"{path}: scene")
    moving = [joint for joint in scene.joints if joint.kind != "fixed"]
    if moving:
        raise EvaluationError(f"{path}: scene: joints of kind {moving[0].kind}; this suite is of fixed joints only")
    track = _seen(sightings, scene, f"{path}: ")
    unseen = [name for k, name in enumerate(track.nodes) if not track.seen[:, k].any()]
    if unseen:
        raise EvaluationError(f"{path}: {', '.join(unseen)}: never seen, so where it ends is not known")
    last = len(track.times) - 1 - track.seen[::-1].argmax(0)
    return Filmed(scene, track, track.poses[last, np.arange(len(last)), :2][1:])


def _files_in(folder: Path) -> list[Path]:
    files = sorted(file for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))
    if not files:
        raise EvaluationError(f"{folder}: holds no files")
    return files


def _seen(sightings: Sightings, scene: Scene, source: str = "") -> Track:
    try:
        return recording_of(sightings, scene, {}, NOTHING_DECLARED, None, False).believed().at_frames()
    except TrackError as error:
        raise TrackError(f"{source}{error}") from None


def contact_of(filmed: Filmed) -> int:
    """The first frame in which the tool is at a body; raises EvaluationError if there is none."""
    track = filmed.track
    gaps = filmed.scene.tool_gaps(track.poses[:, 0], np.nan_to_num(track.poses[:, 1:]))
    touches = track.down & np.where(track.seen[:, 1:], gaps < CONTACT_GAP, False).any(1)
    if not touches.any():
        raise EvaluationError(f"the tool never comes within {CONTACT_GAP * 100:g} cm of a body")
    return int(touches.argmax())


def errors_of(
    filmed: Sequence[Filmed], models: Mapping[str, str | os.PathLike], prior: Mapping[str, float]
) -> list[CameraErrors]:
    """Watch recordings, and predict how each ends from every start with either model's joints."""
    predictor = PhysicsPredictor.load(models["contact"])
    belief = BeliefModel.load(models["belief"]).expecting(prior)
    taken, rest = [], []
    for one in filmed:
        last, contact = len(one.track.times) - 1, contact_of(one)
        starts = [min(start, last) for start in (*range(contact, contact + len(AFTER_CONTACT)), *OBSERVED)]
        believed = believed_at(one, starts, belief)
        joints = tuple(joint.replace(anchor=None) for joint in one.scene.joints)
        taken += [scene.replace(joints=joints) for scene in believed] + believed
        rest += 2 * [(one.track.poses[start:, 0], one.track.down[start:]) for start in starts]
    ends = predicted_ends(predictor, taken, rest)
    measured = []
    for one, of_one in zip(filmed, np.split(np.arange(len(ends)), len(filmed)), strict=True):
        bodies = len(one.scene.bodies)
        off = [np.hypot(*(ends[k][:bodies] - one.final).T).mean() for k in of_one]
        first = one.track.poses[one.track.seen.argmax(0), np.arange(bodies + 1), :2][1:]
        moved = float(np.hypot(*(one.final - first).T).mean())
        measured.append(CameraErrors(moved, dict(zip(MODELS, np.reshape(off, (2, -1)), strict=True))))
    return measured


def believed_at(filmed: Filmed, starts: Sequence[int], belief: BeliefModel) -> list[Scene]:
    """The scene as it is believed to be in each of some frames."""
    regulator = BeliefRegulator(filmed.scene, belief)
    believed = {}
    for frame, (poses, down) in enumerate(filmed.track.frames()):
        regulator.observe(poses, down)
        if frame in starts:
            believed[frame] = regulator.scene()
        if frame == max(starts):
            break
    return [believed[start] for start in starts]


def predicted_ends(
    predictor: PhysicsPredictor,
    scenes: Sequence[Scene],
    tools: Sequence[tuple[Float[np.ndarray, "_ 3"], Bool[np.ndarray, " _"]]],
) -> Float[np.ndarray, "scenes bodies 2"]:
    """Where bodies are predicted to end while the tool goes as it went from then on: its poses, and whether down."""
    longest = max(len(poses) for poses, _ in tools)
    poses = np.stack([np.pad(path, ((0, longest - len(path)), (0, 0)), "edge") for path, _ in tools])
    down = np.stack([np.pad(down, (0, longest - len(down))) for _, down in tools])
    with torch.no_grad(), single_threaded():
        states = predictor.start(scenes)
        return predictor.rollout(states, torch.from_numpy(poses), torch.from_numpy(down)).poses[:, -1, :, :2].numpy()
