"""The suite `lever-up`: where a board ends that is levered up, against simulation, on drives never seen."""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pushgraph import pose_3d
from pushgraph.errors import SceneError, SimulationError
from pushgraph.evaluation.blocks import Block, measure_blocks
from pushgraph.evaluation.noise_floor import ATTEMPTS, CAMERA, StartNoise
from pushgraph.evaluation.results import Results
from pushgraph.lever_physics import LeverPredictor
from pushgraph.lever_scene import LeverScene, depth
from pushgraph.lever_track import LeverTrack, frame_times
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.lever_setup import LEVER_UP, SIDES, draw_interaction

BASELINES = ("still", "rigid")
NOISE_FLOOR = "noise_floor"
TOUCHES = 1e-4
"""The tool touches the board from this gap (m) on."""
DRIVES_AT_ONCE = 4
INTERACTIONS = 500
"""Label of what has not learnt."""
ALL = "all"


class LeverErrors(NamedTuple):
    """How far off the board is: at the end (m, rad), and on average over the frames (m)."""

    final_position: float
    final_rotation: float
    rollout_position: float

    @classmethod
    def between(cls, predicted: LeverTrack, true: LeverTrack) -> "LeverErrors":
        """Errors of a track that has as many frames as the true one."""
        distance = np.linalg.norm(predicted.board[:, :3] - true.board[:, :3], axis=-1)
        turned = pose_3d.rotation_error(predicted.board[-1], true.board[-1])
        return cls(float(distance[-1]), float(turned), float(distance.mean()))


METRICS = {
    "final_position_error_mm": ("mm", 1e3, "final_position", "median"),
    "final_rotation_error_deg": ("deg", np.degrees(1.0), "final_rotation", "median"),
    "rollout_position_error_mm": ("mm", 1e3, "rollout_position", "mean"),
}
"""Unit, what it is in the units of `LeverErrors`, which of its fields, and what is taken over interactions."""


@dataclass(frozen=True)
class LeverCase:
    """One test interaction: its drive and side, whether a ledge stands there, and the errors of every model."""

    drive: int
    side: str
    ledge: bool
    raised: bool
    errors: Mapping[str, LeverErrors]


def still(scene: LeverScene) -> LeverTrack:
    """The board stays where it is."""
    return _with_board(scene, np.tile(scene.poses_world_from_body[scene.board], (len(frame_times(scene)), 1)))


def rigid(scene: LeverScene) -> LeverTrack:
    """The board moves with the tool, from the frame on in which the tool first touches where it lies."""
    tool, start = scene.tool_poses(frame_times(scene)), scene.poses_world_from_body[scene.board]
    size = scene.bodies[scene.board].size
    deepest = np.max(
        [depth(size, start[None], box.size, pose_3d.compose(tool, box.pose)) for box in scene.tool.boxes], axis=0
    )
    touches = deepest > -TOUCHES
    first = int(touches.argmax()) if touches.any() else len(tool) - 1
    held = pose_3d.compose(tool, pose_3d.relative(tool[first], start))
    return _with_board(scene, np.concatenate((np.tile(start, (first, 1)), held[first:])))


def simulate_lever_again(scene: LeverScene, rng: np.random.Generator, noise: StartNoise = CAMERA) -> LeverTrack | None:
    """Simulate a scene from a noisy start: the board lies elsewhere on what it lies on; None if it is crushed."""
    start = scene.poses_world_from_body[scene.board]
    for _ in range(ATTEMPTS):
        x, y, yaw = rng.normal(size=3) * (noise.position, noise.position, noise.yaw)
        turn = pose_3d.from_rotation_vector(np.array([0.0, 0.0, yaw]))
        elsewhere = np.concatenate((start[:3] + (x, y, 0.0), pose_3d.multiply(turn, start[3:])))
        try:
            return simulate_lever(scene.board_at(elsewhere))
        except SceneError:  # a ledge a millimetre away that the noise pressed the board into
            continue
        except SimulationError:
            return None
    return None


def load_without_range(model: str | os.PathLike) -> LeverPredictor:
    """A predictor that does not warn where a drive of the setup lies a little outside of those that were drawn."""
    loaded = LeverPredictor.load(model)
    return LeverPredictor(loaded.dynamics, hash=loaded.hash)


def measure_drives(block: Block) -> list[list[LeverCase]]:
    """The four interactions of each drive of a block; its models are checkpoints of predictors."""
    predictors = {name: load_without_range(path) for name, path in block.models}
    numbers = [(drive, side) for drive in range(block.first, block.first + block.count) for side in range(len(SIDES))]
    interactions = [draw_interaction(block.seed, drive * len(SIDES) + side) for drive, side in numbers]
    scenes = [interaction.track.scene for interaction in interactions]
    tracks: dict[str, Sequence[LeverTrack | None]] = {
        "still": [still(scene) for scene in scenes],
        "rigid": [rigid(scene) for scene in scenes],
        **{name: predictor.predict_many(scenes) for name, predictor in predictors.items()},
        NOISE_FLOOR: [
            simulate_lever_again(scene, np.random.default_rng([block.seed, *number]))
            for number, scene in zip(numbers, scenes, strict=True)
        ],
    }
    cases = [
        LeverCase(
            drive,
            interaction.side,
            interaction.ledge,
            interaction.track.raised,
            {
                name: LeverErrors.between(track, interaction.track)
                for name, some in tracks.items()
                if (track := some[k]) is not None
            },
        )
        for k, ((drive, _), interaction) in enumerate(zip(numbers, interactions, strict=True))
    ]
    return [cases[k : k + len(SIDES)] for k in range(0, len(cases), len(SIDES))]


def evaluate_lever_up(
    drives: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Results, list[LeverCase]]:
    """Measure `models`, checkpoints by name, beside the baselines and the noise floor, on the sides of test drives.

    progress: is told how many drives are done. Raises EvaluationError if the drives of this seed are for training.
    """
    trained_on = {name: LeverPredictor.load(path).record["data"]["interactions"] for name, path in models.items()}
    measured = measure_blocks(measure_drives, [1], drives, seed, models, workers, progress, LEVER_UP, DRIVES_AT_ONCE)
    cases = [case for drive in measured for case in drive]
    protocol = {"count": drives, "seed": seed, "raised": sum(case.raised for case in cases), "of": len(cases)}
    results = Results(LEVER_UP, protocol, ("subset", "interactions", "side", "ledge"))
    for model in (*BASELINES, *models, NOISE_FLOOR):
        interactions = trained_on.get(model, INTERACTIONS)
        for add, chosen in _selections(cases, functools.partial(results.add, model, interactions=interactions)):
            _add_metrics(add, model, [case for case, take in zip(cases, chosen, strict=True) if take])
    return results, cases


def _selections(
    cases: Sequence[LeverCase], add: Callable[..., None]
) -> list[tuple[Callable[..., None], Bool[np.ndarray, " cases"]]]:
    """All cases and the raised ones; of each all, every side, and with and without a ledge."""
    every = np.ones(len(cases), dtype=bool)
    sides, ledge = np.array([case.side for case in cases]), np.array([case.ledge for case in cases])
    groups = {(ALL, ALL): every, (ALL, "with"): ledge, (ALL, "without"): ~ledge}
    groups |= {(side, ALL): sides == side for side in SIDES}
    raised = np.array([case.raised for case in cases])
    return [
        (functools.partial(add, subset=subset, side=side, ledge=has_ledge), group & some)
        for subset, some in ((ALL, every), ("raised", raised))
        for (side, has_ledge), group in groups.items()
    ]


def _add_metrics(add: Callable[..., None], model: str, cases: Sequence[LeverCase]) -> None:
    known = [case for case in cases if model in case.errors]
    drives = np.array([case.drive for case in known], dtype=int)
    for metric, (unit, scale, field, statistic) in METRICS.items():
        values = scale * np.array([getattr(case.errors[model], field) for case in known])
        add(metric=metric, unit=unit, values=values, scene=drives, statistic=statistic)


def _with_board(scene: LeverScene, board: Float[np.ndarray, "frames 7"]) -> LeverTrack:
    poses = np.tile(np.concatenate((np.zeros((1, 7)), scene.poses_world_from_body)), (len(board), 1, 1))
    poses[:, 0], poses[:, 1 + scene.board] = scene.tool_poses(frame_times(scene)), board
    return LeverTrack(scene, poses)
