"""The suite `spread`: how often the truth lies within what predictions state, and whether doubt goes with error."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.belief import BeliefModel
from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.metrics import MOVED
from pushgraph.evaluation.recording import Recording, record, watch
from pushgraph.evaluation.results import Results
from pushgraph.graph.believed import believe
from pushgraph.graph.joint_truth import unaware
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes
from pushgraph.graph.state import State
from pushgraph.graph.track_features import default_doubt, doubt_of
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import NOMINAL_MASS

HORIZONS = (30, 50)
"""Frames of a rollout, its start included."""
OBSERVED = (0, 20, 40, 100)
"""Observed frames after which joints are believed and a rollout starts."""
DENSITIES = ("all", "dense", "sparse")
STATED = (0.68, 0.95)


class Condition(NamedTuple):
    """What a rollout knows. joints: given or believed, then after so many observed frames. masses: known or unknown."""

    joints: str
    observed_frames: int
    masses: str


CONDITIONS = (
    Condition("given", 0, "known"),
    Condition("given", 0, "unknown"),
    *(Condition("believed", observed, "known") for observed in OBSERVED),
)


class Stated(NamedTuple):
    """What was stated of the bodies of a scene in one frame, and what came true.

    level, yaw_level: probabilities of the smallest regions that hold the truth. size: of the 68 % ellipse, the mean
    of its half-axes (m). yaw_size: half the width of the 68 % interval (rad). error, yaw_error: m and rad. moved: by
    more than 1 cm, truly or as predicted.
    """

    level: Float[np.ndarray, " bodies"]
    yaw_level: Float[np.ndarray, " bodies"]
    size: Float[np.ndarray, " bodies"]
    yaw_size: Float[np.ndarray, " bodies"]
    error: Float[np.ndarray, " bodies"]
    yaw_error: Float[np.ndarray, " bodies"]
    moved: Bool[np.ndarray, " bodies"]


class SceneSpread(NamedTuple):
    """What was stated in one scene; a condition is left out where the trajectory is too short for it."""

    objects: int
    density: str
    stated: dict[tuple[Condition, int], Stated]


def evaluate_spread(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[SceneSpread]]:
    """Measure spreads on `count` test scenes for each number of objects; see `measure_blocks`.

    models: the checkpoints `contact`, which predicts, `spread`, which says how surely, and `belief`, which watches.
    """
    objects = numbers_of(objects, data, least=2)
    scenes = measure_blocks(state_block, objects, count, seed, models, workers, progress, data=data)
    names = ("objects", "frames", "density", "joints", "observed_frames", "masses", "bodies")
    results = Results("spread", origin(SETUP, count, seed, data), names)
    for number in objects:
        for density in DENSITIES if data is None else ("all", *sorted({s.density for s in scenes} & {*DENSITIES})):
            chosen = [s for s in scenes if s.objects == number and density in ("all", s.density)]
            for frames in HORIZONS:
                labels = {"objects": number, "density": density, "frames": frames}
                for condition in CONDITIONS:
                    stated = [s.stated[condition, frames] for s in chosen if (condition, frames) in s.stated]
                    _add_rows(results, stated, "moved", labels | condition._asdict())
                    _add_rows(results, stated, "all", labels | condition._asdict())
                known = [[s.stated[one, frames] for one in CONDITIONS if (one, frames) in s.stated] for s in chosen]
                together = [_together(of_scene) for of_scene in known if of_scene]
                _add_rows(results, together, "moved", labels | dict.fromkeys(Condition._fields, "all"))
    return results, scenes


def _together(stated: Sequence[Stated]) -> Stated:
    """What was stated of one scene under several conditions."""
    return Stated(*(np.concatenate(columns) for columns in zip(*stated, strict=True)))


def state_block(block: Block) -> list[SceneSpread]:
    """Simulate the scenes of a block, predict them under every condition, and see what came true."""
    checkpoints = dict(block.models)
    predictor = PhysicsPredictor.load(checkpoints["contact"], spread=checkpoints["spread"])
    belief = BeliefModel.load(checkpoints["belief"])
    trajectories = block.draw()
    tracks = [trajectory.track for trajectory in trajectories]
    scenes, seen = batch_scenes([track.scene for track in tracks]), record(tracks, max(OBSERVED) + max(HORIZONS))
    found: list[dict[tuple[Condition, int], Stated]] = [{} for _ in tracks]
    for condition, state, doubt in _starts(scenes, seen, belief):
        first, last = condition.observed_frames, condition.observed_frames + max(HORIZONS)
        with torch.no_grad():
            predicted = predictor.rollout(
                state.double(), seen.tool[:, first:last], seen.down[:, first:last], spread=True, doubt=doubt
            )
        assert predicted.spread is not None
        spread, poses, true = predicted.spread.numpy(), predicted.poses.numpy(), seen.bodies[:, first:last].numpy()
        error = true - poses
        level, yaw_level = spread.position_level(error[..., :2]), spread.yaw_level(error[..., 2])
        ellipse, yaw_size = spread.ellipse(STATED[0]), spread.yaw_interval(STATED[0])
        gone = [np.hypot(*np.moveaxis((some - some[:, :1])[..., :2], -1, 0)) > MOVED for some in (poses, true)]
        columns = (
            *(level, yaw_level, (ellipse.along + ellipse.across) / 2, yaw_size),
            *(np.hypot(error[..., 0], error[..., 1]), np.abs(error[..., 2]), gone[0] | gone[1]),
        )
        arrays = [np.asarray(column) for column in columns]
        for k in range(len(tracks)):
            for frames in HORIZONS:
                if first + frames <= int(seen.lengths[k]):
                    found[k][condition, frames] = Stated(*(array[k, frames - 1] for array in arrays))
    return [SceneSpread(block.objects, t.density, of) for t, of in zip(trajectories, found, strict=True)]


def _starts(scenes: SceneBatch, seen: Recording, belief: BeliefModel) -> Iterator[tuple[Condition, State, Tensor]]:
    """Where rollouts start under each condition, and how doubtful the joints of every pair are there."""
    unweighed = scenes._replace(
        mass=torch.where(scenes.immovable, scenes.mass, NOMINAL_MASS), mass_known=scenes.immovable.clone()
    )
    at_rest = torch.zeros_like(seen.bodies[:, 0])
    for masses, known in (("known", scenes), ("unknown", unweighed)):
        state = State(known, seen.bodies[:, 0], at_rest, scenes.relations)
        yield Condition("given", 0, masses), state, default_doubt(state.relations)
    for frame, watched in zip(range(max(OBSERVED) + 1), watch(belief, unaware(scenes), seen), strict=False):
        if frame in OBSERVED:
            probabilities = belief.probabilities(watched)
            relations = believe(watched.view.state, belief.joints(watched), watched.view.fits).relations
            motions = seen.bodies[:, frame] - seen.bodies[:, max(frame - 1, 0)]
            state = State(scenes, seen.bodies[:, frame], motions, relations)
            yield Condition("believed", frame, "known"), state, doubt_of(scenes, relations, probabilities)


def _add_rows(results: Results, stated: Sequence[Stated], bodies: str, labels: Mapping[str, Any]) -> None:
    chosen = [one.moved if bodies == "moved" else np.ones_like(one.moved) for one in stated]
    scene = np.repeat(np.arange(len(stated)), [int(some.sum()) for some in chosen])

    def column(name: str) -> np.ndarray:
        values = [getattr(one, name)[some] for one, some in zip(stated, chosen, strict=True)]
        return np.concatenate(values) if values else np.zeros(0)

    labels = {**labels, "bodies": bodies}
    for prefix, unit, scale in (("", "cm", 100), ("yaw_", "deg", 180 / np.pi)):
        level, size, error = column(f"{prefix}level"), column(f"{prefix}size"), column(f"{prefix}error")
        for probability in STATED:
            metric = f"{prefix}coverage_{round(100 * probability)}"
            results.add("contact", metric, "1", (level < probability).astype(float), scene, **labels)
        results.add_rank_correlation("contact", f"{prefix}spread_correlation", size, error, scene, **labels)
        results.add("contact", f"{prefix}median_size_68_{unit}", unit, scale * size, scene, "median", **labels)
        results.add("contact", f"{prefix}median_error_{unit}", unit, scale * error, scene, "median", **labels)


def levels(scenes: Sequence[SceneSpread], condition: Condition, frames: int, name: str) -> Float[np.ndarray, " bodies"]:
    """`level` or `yaw_level` of all bodies that moved."""
    stated = [scene.stated[condition, frames] for scene in scenes if (condition, frames) in scene.stated]
    return np.concatenate([getattr(one, name)[one.moved] for one in stated] or [np.zeros(0)])
