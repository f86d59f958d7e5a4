"""The suite `coupled-masses`: predictions that use the masses believed so far, beside true and mean ones."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pushgraph.belief import BeliefModel
from pushgraph.evaluation.blocks import Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.coupled import FRAMES, STARTS, CoupledErrors, rollout_errors
from pushgraph.evaluation.mass_answers import prior_mean
from pushgraph.evaluation.masses import SETUP, masses_of, ratio_observer_over_time, weighed_tracks
from pushgraph.evaluation.recording import ask, record
from pushgraph.evaluation.results import Results
from pushgraph.evaluation.touching import find_touched
from pushgraph.graph.joint_truth import unweighed
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes
from pushgraph.physics import PhysicsPredictor
from pushgraph.track import Track

FIRST_PUSH = "first_push"
"""Stands for the last frame of the first push, the rest after it included."""
TIMES: tuple[int | str, ...] = (*STARTS, FIRST_PUSH)
"""Observed frames before a rollout of FRAMES starts; frame 0 is seen in any case."""
MODELS = ("oracle", "ratio_observer", "belief", "mean_guess")
"""Whose masses: true ones; the medians of who knows the exact ratios inside every group that touched so far, and the
prior; the medians of what is believed; the prior's mean."""


def evaluate_coupled_masses(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[CoupledErrors]]:
    """Measure predictions on `count` test scenes for each number of objects; see `measure_blocks`.

    models: the checkpoints `contact`, which predicts, and `belief`, which watches. Joints are known.
    """
    objects = numbers_of(objects, data, least=2)
    scenes = measure_blocks(predict_block, objects, count, seed, models, workers, progress, SETUP, data=data)
    results = Results("coupled-masses", origin(SETUP, count, seed, data), ("objects", "observed_frames"))
    for number in objects:
        some = [scene for scene in scenes if scene.objects == number]
        for k, observed in enumerate(TIMES):
            for model in MODELS:
                errors = np.array([100 * scene.errors[model][k] for scene in some])
                goes_on = np.flatnonzero(~np.isnan(errors))
                labels: dict[str, Any] = {"objects": number, "observed_frames": observed}
                results.add(model, "error_cm", "cm", errors[goes_on], goes_on, **labels)
    return results, scenes


def predict_block(block: Block) -> list[CoupledErrors]:
    """Simulate the scenes of a block, watch them, and predict them from every start with every model's masses."""
    checkpoints = dict(block.models)
    dynamics = PhysicsPredictor.load(checkpoints["contact"]).dynamics
    belief = BeliefModel.load(checkpoints["belief"])
    tracks = weighed_tracks(block)
    scenes, times = batch_scenes([track.scene for track in tracks]), starts_of(tracks)
    seen = record(tracks, int(times.max()) + FRAMES)
    posterior, _ = ask(belief.masses, belief, unweighed(scenes), seen, times)
    touched = find_touched(scenes, seen).pairs
    ratios = [
        ratio_observer_over_time(masses_of(track), touched[k, times[k]].numpy(), track.scene.classes_of_mass).median
        for k, track in enumerate(tracks)
    ]
    observer = torch.from_numpy(np.stack(ratios))
    mean = torch.full_like(scenes.mass, prior_mean(tracks[0].scene.classes_of_mass))
    assumed = [
        [scenes, *(weighed(scenes, mass) for mass in (observer[:, k], posterior.median[:, k], mean))]
        for k in range(times.shape[1])
    ]
    errors = rollout_errors(dynamics, seen, times.T, assumed).numpy()
    return [
        CoupledErrors(block.objects, dict(zip(MODELS, errors[:, :, k].T, strict=True))) for k in range(len(tracks))
    ]


def starts_of(tracks: Sequence[Track]) -> Int[Tensor, "batch times"]:
    """Frames of every track that TIMES stand for; there are as many beyond its end."""
    first_push = [int(np.flatnonzero(track.push == track.push[track.down][0])[-1]) for track in tracks]
    return torch.tensor([[*STARTS, last] for last in first_push])


def weighed(scenes: SceneBatch, mass: Float[Tensor, "batch bodies"]) -> SceneBatch:
    """The scenes with these masses (kg), taken as known."""
    return scenes._replace(mass=mass.to(scenes.mass), mass_known=torch.ones_like(scenes.mass_known))
