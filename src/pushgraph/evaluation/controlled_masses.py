"""The suite `controlled-masses`: scenes of which only the masses change, and the best that can be said of them."""

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int

from pushgraph.belief import BeliefModel
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.belief import add_noise
from pushgraph.evaluation.blocks import Block, measure_blocks
from pushgraph.evaluation.exact_masses import ExactObserver, refined_observer
from pushgraph.evaluation.mass_answers import MassAnswer, MassScores, believed, classes_of, prior_answer, score
from pushgraph.evaluation.masses import add_mass_rows, masses_of
from pushgraph.evaluation.noise_floor import CAMERA
from pushgraph.evaluation.ratio_table import simulated_table
from pushgraph.evaluation.recording import ask, record
from pushgraph.evaluation.results import Results
from pushgraph.evaluation.sensing import with_sensor
from pushgraph.graph.joint_truth import unweighed
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.simulation.masses import CONTROLLED_OBJECTS, controlled_scene

SETUP = "controlled-masses"
INPUTS = ("motion", "force")
"""What is observed: poses with the noise of a camera, or those and the tool's force sensor."""
OBSERVERS = ("exact", "median_guess")
"""What is compared with, given motion."""
HISTOGRAM = (1.0, 2.0, 4.0, 8.0)
"""Edges of the histogram of a scene's mean error (kg); the first bin begins at 0, the last one has no end."""
REFERENCE_HISTOGRAM = tuple(2.0 ** (k - 0.5) for k in range(4))
"""Those of the reference code, in effect, for the root mean square error over all nodes, the robot included."""
MIX_UPS = ("none", "neighbours", "farther")
"""A scene's worst mistake: none, light with normal or normal with heavy, light with heavy."""
UNLIKE = 1.0
"""Masses are different if they differ by this much on average (kg)."""


class ControlledScene(NamedTuple):
    """One scene: its masses (kg), how its bodies truly moved, and what was told by model and input."""

    objects: int
    masses: Float[np.ndarray, " bodies"]
    poses: Float[np.ndarray, "frames bodies 3"]
    answers: dict[tuple[str, str], MassAnswer]

    def scores(self, model: str, given: str) -> MassScores:
        """How an answer compares with the truth."""
        return score(self.answers[model, given], self.masses, MASS_CLASSES)


def evaluate_controlled_masses(
    objects: Sequence[int],
    count: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    table_progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Results, list[ControlledScene]]:
    """Measure beliefs on `count` draws of masses for each number of objects; see `measure_blocks`.

    table_progress: told of the simulations for `exact`, which are made once on a machine. Raises EvaluationError if
    there is no scene of so many objects.
    """
    for number in objects:
        if number not in CONTROLLED_OBJECTS:
            valid = ", ".join(map(str, CONTROLLED_OBJECTS))
            raise EvaluationError(f"no controlled scene of {number} objects; valid: {valid}")
    cells = {
        number: refined_observer(controlled_scene(number), CAMERA, workers, table_progress).cells for number in objects
    }
    work = partial(answer_block, cells=cells)
    scenes = measure_blocks(work, objects, count, seed, models, workers, progress, SETUP)
    protocol = {"setup": SETUP, "count": count, "seed": seed, "noise": CAMERA._asdict(), "cells": cells}
    results = Results("controlled-masses", protocol, ("objects", "input"))
    for number in objects:
        some = [scene for scene in scenes if scene.objects == number]
        for model, given in some[0].answers:
            _add_rows(results, model, given, some)
    return results, scenes


def answer_block(block: Block, cells: Mapping[int, int]) -> list[ControlledScene]:
    """Simulate the scenes of a block, and ask every model about what is seen of them.

    cells: of the table of `exact` in each dimension, by number of objects.
    """
    tracks = [trajectory.track for trajectory in block.draw()]
    scene, frames = tracks[0].scene, len(tracks[0].times)
    classes = scene.classes_of_mass
    clean = record(tracks, frames)
    seen = add_noise(clean, CAMERA, block)
    rngs = [np.random.default_rng([block.seed, block.objects, block.first + k]) for k in range(block.count)]
    unknown, end = unweighed(batch_scenes([track.scene for track in tracks])), torch.full((block.count, 1), frames - 1)
    answers: dict[tuple[str, str], MassAnswer] = {}
    for given, watched in (("motion", seen), ("force", with_sensor(seen, tracks, rngs))):
        for name, path in block.models:
            model = BeliefModel.load(path)
            answers[name, given] = believed(ask(model.masses, model, unknown, watched, end)[0]).take((slice(None), 0))
    exact = ExactObserver(simulated_table(controlled_scene(block.objects), cells[block.objects]), CAMERA, classes)
    at_best = [exact.answer(poses) for poses in seen.bodies.numpy()]
    answers["exact", "motion"] = MassAnswer(*map(np.stack, zip(*at_best, strict=True)))
    always = [prior_answer(classes, block.objects)] * block.count
    answers["median_guess", "motion"] = MassAnswer(*map(np.stack, zip(*always, strict=True)))
    return [
        ControlledScene(
            block.objects,
            masses_of(track),
            clean.bodies[k].numpy(),
            {key: answer.take(k) for key, answer in answers.items()},
        )
        for k, track in enumerate(tracks)
    ]


def histogram(scenes: Sequence[ControlledScene], model: str, given: str) -> Int[np.ndarray, " bins"]:
    """Number of scenes by mean error."""
    errors = [scene.scores(model, given).error.mean() for scene in scenes]
    return np.histogram(errors, [0, *HISTOGRAM, np.inf])[0]


def reference_histogram(scenes: Sequence[ControlledScene], model: str, given: str) -> Int[np.ndarray, " bins"]:
    """Number of scenes by root mean square error, the robot counting as a node without error."""
    squares = [np.square(scene.scores(model, given).error).sum() / (scene.objects + 1) for scene in scenes]
    return np.histogram(np.sqrt(squares), [0, *REFERENCE_HISTOGRAM, np.inf])[0]


def mix_ups(scenes: Sequence[ControlledScene], model: str, given: str) -> Int[np.ndarray, " kinds"]:
    """Number of scenes by their worst mistake, in the order of MIX_UPS."""
    farthest = [
        np.abs(scene.answers[model, given].likeliest - classes_of(MASS_CLASSES, scene.masses)).max() for scene in scenes
    ]
    return np.bincount(farthest, minlength=len(MIX_UPS))


def confusion(scenes: Sequence[ControlledScene], model: str, given: str) -> Int[np.ndarray, "classes classes"]:
    """Number of bodies by true and by likeliest class."""
    counts = np.zeros((len(MASS_CLASSES), len(MASS_CLASSES)), dtype=np.int64)
    for scene in scenes:
        np.add.at(counts, (classes_of(MASS_CLASSES, scene.masses), scene.answers[model, given].likeliest), 1)
    return counts


def hardly_different(scenes: Sequence[ControlledScene]) -> tuple[int, int, float] | None:
    """The two scenes that look most alike although their masses differ (see UNLIKE), and how far bodies are apart in
    them on average (m); None if there are no such two."""
    nearest = None
    for first, second in itertools.combinations(range(len(scenes)), 2):
        one, other = scenes[first], scenes[second]
        if one.objects != other.objects or np.abs(one.masses - other.masses).mean() < UNLIKE:
            continue
        apart = float(np.linalg.norm((one.poses - other.poses)[..., :2], axis=-1).mean())
        if nearest is None or apart < nearest[2]:
            nearest = first, second, apart
    return nearest


def _add_rows(results: Results, model: str, given: str, scenes: Sequence[ControlledScene]) -> None:
    labels: dict[str, Any] = {"objects": scenes[0].objects, "input": given}
    scores = [scene.scores(model, given) for scene in scenes]
    bodies = np.repeat(np.arange(len(scenes)), scenes[0].objects)
    add_mass_rows(results, model, MassScores(*map(np.concatenate, zip(*scores, strict=True))), bodies, labels)
    mean = np.array([some.error.mean() for some in scores])
    results.add(model, "share_under_1_kg", "1", (mean < 1).astype(float), np.arange(len(scenes)), **labels)
