"""The suite `coupled`: predictions that use what is believed so far, beside other ways to settle what is joined."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.belief import BeliefModel
from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.recording import Recording, record, watch
from pushgraph.evaluation.results import Results
from pushgraph.graph.believed import believe
from pushgraph.graph.joint_fit import JointFits
from pushgraph.graph.joint_truth import adjacent_pairs, rigid_pairs, touched_pairs, unaware
from pushgraph.graph.scene_batch import (
    JOINT_CODES,
    Relations,
    SceneBatch,
    batch_scenes,
    concatenate,
    hide_relations,
    remember,
)
from pushgraph.graph.state import ADJACENT, State
from pushgraph.network.contract import Dynamics
from pushgraph.physics import PhysicsPredictor
from pushgraph.rollout import rollout

STARTS = tuple(range(0, 101, 10))
"""Observed frames before a rollout starts; frame 0 is seen in any case."""
FRAMES = 50
"""Of a rollout, its start included; a shorter trajectory is compared as far as it goes."""
WIDE = 0.05
"""Gap (m) of the reference code's rule for contacting pairs."""
MODELS = ("oracle", "informed_oracle", "belief", "no_joint", "all_fixed", "all_fixed_5cm")


class CoupledErrors(NamedTuple):
    """Mean position errors (m) in one scene by model, from each start on; NaN from where it has ended."""

    objects: int
    errors: dict[str, Float[np.ndarray, " starts"]]


def evaluate_coupled(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[CoupledErrors]]:
    """Measure predictions on `count` test scenes for each number of objects; see `measure_blocks`.

    models: the checkpoints `contact`, which predicts, and `belief`, which watches.
    """
    objects = numbers_of(objects, data, least=2)
    scenes = measure_blocks(predict_block, objects, count, seed, models, workers, progress, data=data)
    results = Results("coupled", origin(SETUP, count, seed, data), ("objects", "observed_frames"))
    for number in objects:
        some = [scene for scene in scenes if scene.objects == number]
        for k, observed in enumerate(STARTS):
            for model in MODELS:
                errors = np.array([100 * scene.errors[model][k] for scene in some])
                goes_on = np.flatnonzero(~np.isnan(errors))
                labels: dict[str, Any] = {"objects": number, "observed_frames": observed}
                results.add(model, "error_cm", "cm", errors[goes_on], goes_on, **labels)
    return results, scenes


def mean_and_standard_error(
    scenes: Sequence[CoupledErrors], objects: int, model: str
) -> tuple[Float[np.ndarray, " starts"], Float[np.ndarray, " starts"]]:
    """Mean over the scenes that go on of a model's errors (cm), and its standard error, which one alone has not."""
    errors = 100 * np.stack([scene.errors[model] for scene in scenes if scene.objects == objects])
    count = (~np.isnan(errors)).sum(0)
    mean = np.nansum(errors, 0) / np.where(count > 0, count, np.nan)
    squares = np.nansum(np.square(errors - mean), 0)
    return mean, np.sqrt(squares / np.where(count > 1, count * (count - 1.0), np.nan))


def predict_block(block: Block) -> list[CoupledErrors]:
    """Simulate the scenes of a block, watch them, and predict them from every start with every model's relations."""
    checkpoints = dict(block.models)
    dynamics = PhysicsPredictor.load(checkpoints["contact"]).dynamics
    belief = BeliefModel.load(checkpoints["belief"])
    tracks = [trajectory.track for trajectory in block.draw()]
    scenes, seen = batch_scenes([track.scene for track in tracks]), record(tracks, max(STARTS) + FRAMES)
    assumed: list[list[SceneBatch]] = []
    for frame, watched in zip(range(max(STARTS) + 1), watch(belief, unaware(scenes), seen), strict=False):
        if frame in STARTS:
            kind, view = belief.joints(watched), watched.view
            believed = believe(view.state, kind, view.fits).relations
            relations = {"belief": believed} | assumptions(scenes, seen.bodies[:, : frame + 1])
            assumed.append([scenes._replace(relations=relations[model]) for model in MODELS])
    starts = torch.tensor(STARTS)[:, None].expand(-1, len(tracks))
    errors = rollout_errors(dynamics, seen, starts, assumed).numpy()
    return [CoupledErrors(block.objects, dict(zip(MODELS, errors[:, :, k].T, strict=True))) for k in range(len(tracks))]


def assumptions(scenes: SceneBatch, bodies: Float[Tensor, "batch frames bodies 3"]) -> dict[str, Relations]:
    """Relations that are assumed without any belief, after the frames in which bodies were at `bodies`."""
    touched = touched_pairs(adjacent_pairs(scenes, bodies[:, 0]), bodies)[:, -1]
    return {
        "oracle": scenes.relations,
        "informed_oracle": only(scenes.relations, touched),
        "no_joint": only(scenes.relations, torch.zeros_like(touched)),
        "all_fixed": all_fixed(scenes, bodies[:, -1], ADJACENT),
        "all_fixed_5cm": all_fixed(scenes, bodies[:, -1], WIDE),
    }


def only(relations: Relations, chosen: Bool[Tensor, "batch pairs"]) -> Relations:
    """The joints of some pairs, and no others."""
    return relations._replace(
        kind=torch.where(chosen, relations.kind, JOINT_CODES["none"]),
        known=torch.ones_like(relations.known),
        remembered=relations.remembered & chosen,
    )


def all_fixed(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"], gap: float) -> Relations:
    """All pairs whose surfaces are nearer than `gap` (m) fixed as they stand, and no others."""
    blank = hide_relations(scenes, ~rigid_pairs(scenes.group))
    near = remember(blank, blank.relations, poses, gap)
    fixed = torch.full_like(near.kind, JOINT_CODES["fixed"])
    unmoved = JointFits.begin(near.known)
    return believe(State(blank, poses, torch.zeros_like(poses), near), fixed, unmoved).relations


@torch.no_grad()
def rollout_errors(
    dynamics: Dynamics,
    seen: Recording,
    starts: Int[Tensor, "starts batch"],
    assumed: Sequence[Sequence[SceneBatch]],
) -> Float[Tensor, "starts assumed batch"]:
    """Mean position error (m), over frames and bodies, of rollouts from the true state in the frames `starts`.

    assumed: what the scenes are taken for at each start. All are predicted side by side. How bodies moved in the frame
    before is known. NaN where a scene had ended by then.
    """
    shape = len(starts), len(assumed[0]), starts.shape[1]
    states = []
    for start, several in zip(starts, assumed, strict=True):
        (before,), (now,) = (_at(seen.bodies, frame[None]) for frame in ((start - 1).clamp(min=0), start))
        states += [State(scenes, now, now - before, scenes.relations) for scenes in several]

    def from_starts(values: Tensor) -> Tensor:
        """Frames of every start, alike for all that is assumed."""
        chosen = torch.stack([_at(values, starts + k) for k in range(FRAMES)], 2)[:, None]
        return chosen.expand(*shape, *chosen.shape[3:]).flatten(0, 2)

    predicted = rollout(dynamics, concatenate(states), from_starts(seen.tool), from_starts(seen.down)).poses
    distance = (predicted - from_starts(seen.bodies))[..., :2].norm(dim=-1).mean(-1).unflatten(0, shape)
    there = (starts[..., None] + torch.arange(FRAMES) < seen.lengths[:, None])[:, None]
    return (distance * there).sum(-1) / there.sum(-1)


def _at(values: Tensor, frames: Int[Tensor, "starts batch"]) -> Tensor:
    """[starts batch ...]: values, [batch frames ...], of each scene in its own frames."""
    return values[torch.arange(len(values)), frames]
