"""The suite `masses`: what beliefs say of every body's mass after so many observed frames, against the truth."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pushgraph.belief import BeliefModel
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.blocks import Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.mass_answers import MassAnswer, MassScores, believed, prior_answer, score
from pushgraph.evaluation.mass_observers import mean_guess, ratio_observer
from pushgraph.evaluation.recording import ask, record
from pushgraph.evaluation.results import Results
from pushgraph.evaluation.sensing import on_table, with_sensor, without_friction
from pushgraph.evaluation.touching import Touched, find_touched, groups_of
from pushgraph.graph.joint_truth import unweighed
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.mass_chains import FRICTION
from pushgraph.mass_prior import MASS_CLASSES, MassClass
from pushgraph.simulation.planar_model import GRAVITY
from pushgraph.track import Track

SETUP = "different-masses"
OBSERVED = (10, 20, 30, *range(40, 201, 20))
"""Observed frames after which beliefs are asked; a shorter trajectory keeps its last answer."""
ENDS = 20
"""A trajectory that has ended rests until the next multiple of so many frames: few frames are asked about then."""
TIMES: tuple[int | str, ...] = (*OBSERVED, "end")
INPUTS = ("motion", "force", "force_friction_unknown")
"""What is observed: poses, or poses and the tool's force sensor; on a table whose friction is known, or may be any of
FRICTION."""
SUBSETS = ("all", "touched", "pushed")
"""Bodies that are scored by themselves: see `pushgraph.evaluation.touching`."""
OBSERVERS = ("ratio_observer", "mean_guess", "median_guess")
"""What is compared with, given motion: the best that it allows, and two constants."""


class SlideAnswer(NamedTuple):
    """What is said of the force that slides each body (N): a median and a 68 % interval."""

    median: Float[np.ndarray, "*bodies"]
    low: Float[np.ndarray, "*bodies"]
    high: Float[np.ndarray, "*bodies"]


class Answers(NamedTuple):
    """What was answered of one scene at TIMES, given one of INPUTS.

    chosen: the bodies of each of SUBSETS. answers: by model. slide: what truly slides each body (N). slides: what
    beliefs say of that, by model.
    """

    chosen: dict[str, Bool[np.ndarray, "times bodies"]]
    answers: dict[str, MassAnswer]
    slide: Float[np.ndarray, " bodies"]
    slides: dict[str, SlideAnswer]


class SceneMasses(NamedTuple):
    """One scene: its masses (kg), and the answers about them by input."""

    objects: int
    masses: Float[np.ndarray, " bodies"]
    beliefs: dict[str, Answers]


def evaluate_masses(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[SceneMasses]]:
    """Measure beliefs on `count` test scenes for each number of objects; see `measure_blocks`.

    Data without readings of a force sensor tells what motion tells, and none is moved to a table of other friction.
    """
    objects = numbers_of(objects, data, least=2)
    scenes = measure_blocks(answer_block, objects, count, seed, models, workers, progress, SETUP, data=data)
    results = Results("masses", origin(SETUP, count, seed, data), ("objects", "observed_frames", "input", "subset"))
    for number in objects:
        for given in INPUTS:
            some = [scene for scene in scenes if scene.objects == number and given in scene.beliefs]
            for model in some[0].beliefs[given].answers if some else ():
                _add_rows(results, model, given, number, some)
            for model in some[0].beliefs[given].slides if some else ():
                _add_slide_rows(results, model, given, number, some)
    return results, scenes


def answer_block(block: Block) -> list[SceneMasses]:
    """Simulate the scenes of a block, and watch them with every model and input."""
    tracks = weighed_tracks(block)
    rngs = [np.random.default_rng([block.seed, block.objects, block.first + k]) for k in range(block.count)]
    models = {name: BeliefModel.load(path) for name, path in block.models}
    if block.data is None:
        elsewhere = [on_table(track, rng.uniform(*FRICTION)) for track, rng in zip(tracks, rngs, strict=True)]
        known = _watch(models, tracks, rngs, ("motion", "force"))
        unknown = _watch(models, elsewhere, rngs, ("force_friction_unknown",))
    else:
        felt = all(track.wrench is not None for track in tracks)
        known, unknown = _watch(models, tracks, None, ("motion", "force")[: 1 + felt]), [{} for _ in tracks]
    return [
        SceneMasses(block.objects, masses_of(track), of_known | of_unknown)
        for track, of_known, of_unknown in zip(tracks, known, unknown, strict=True)
    ]


def weighed_tracks(block: Block) -> list[Track]:
    """The tracks of a block; raises EvaluationError if a true mass is not known, or the classes are others."""
    tracks = [trajectory.track for trajectory in block.draw()]
    for track in tracks:
        for body in track.scene.bodies:
            if body.mass is None:
                raise EvaluationError(f"{block.data}: body {body.name!r}: its true mass is not known, but needed here")
        if track.scene.classes_of_mass != MASS_CLASSES:
            names = ", ".join(one.name for one in track.scene.classes_of_mass)
            raise EvaluationError(f"{block.data}: mass_classes {names}: this suite scores light, normal and heavy only")
    return tracks


def masses_of(track: Track) -> Float[np.ndarray, " bodies"]:
    """True masses (kg)."""
    return np.array([body.mass for body in track.scene.bodies])


def ratio_observer_over_time(
    masses: Float[np.ndarray, " bodies"], pairs: Bool[np.ndarray, "times pairs"], classes: Sequence[MassClass]
) -> MassAnswer:
    """What the ratio observer says once these pairs have touched."""
    at_times: list[MassAnswer] = []
    for time, met in enumerate(pairs):
        same = time > 0 and (met == pairs[time - 1]).all()
        at_times.append(at_times[-1] if same else ratio_observer(masses, groups_of(met, len(masses)), classes))
    return MassAnswer(*map(np.stack, zip(*at_times, strict=True)))


def _watch(
    models: Mapping[str, BeliefModel],
    tracks: Sequence[Track],
    rngs: Sequence[np.random.Generator] | None,
    inputs: Sequence[str],
) -> list[dict[str, Answers]]:
    """Answers about each track, by input. rngs: of the sensor's noise; None if readings have theirs."""
    ends = torch.tensor([-(-len(track.times) // ENDS) * ENDS for track in tracks])
    longest = int(ends.max())
    scenes, seen = batch_scenes([track.scene for track in tracks]), record(tracks, longest)
    times = torch.tensor([*OBSERVED, longest]).minimum(ends[:, None]) - 1
    touched = find_touched(scenes, seen)
    of_tracks: list[dict[str, Answers]] = [{} for _ in tracks]
    for given in inputs:
        watched = seen if given == "motion" else with_sensor(seen, tracks, rngs)
        known = unweighed(scenes) if given != "force_friction_unknown" else without_friction(unweighed(scenes))
        beliefs = {name: ask(model.masses, model, known, watched, times)[0] for name, model in models.items()}
        for k, track in enumerate(tracks):
            slide = masses_of(track) * track.scene.table.friction * GRAVITY
            of_tracks[k][given] = Answers(_subsets(touched, k, times[k]), {}, slide, {})
            for name, belief in beliefs.items():
                of_tracks[k][given].answers[name] = believed(belief).take(k)
                if given == "force_friction_unknown":
                    slides = (getattr(belief, f"slide_{part}")[k].numpy() for part in SlideAnswer._fields)
                    of_tracks[k][given].slides[name] = SlideAnswer(*slides)
            if given == "motion":
                of_tracks[k][given].answers.update(_observed(track, touched.pairs[k, times[k]].numpy()))
    return of_tracks


def _subsets(touched: Touched, scene: int, times: torch.Tensor) -> dict[str, np.ndarray]:
    of_scene = (touched.bodies[scene, times].numpy(), touched.pushed[scene, times].numpy())
    return dict(zip(SUBSETS, (np.ones_like(of_scene[0]), *of_scene), strict=True))


def _observed(track: Track, pairs: Bool[np.ndarray, "times pairs"]) -> dict[str, MassAnswer]:
    """What each of OBSERVERS says."""
    classes, bodies = track.scene.classes_of_mass, len(track.scene.bodies)
    constants = (mean_guess(classes, bodies), prior_answer(classes, bodies))
    always = (MassAnswer(*(np.stack([part] * len(pairs)) for part in answer)) for answer in constants)
    return dict(zip(OBSERVERS, (ratio_observer_over_time(masses_of(track), pairs, classes), *always), strict=True))


def _add_rows(results: Results, model: str, given: str, objects: int, scenes: Sequence[SceneMasses]) -> None:
    beliefs = [scene.beliefs[given] for scene in scenes]
    scores = [_scores(scene.masses, of_scene.answers[model]) for scene, of_scene in zip(scenes, beliefs, strict=True)]
    for time, observed in enumerate(TIMES):
        for subset in SUBSETS:
            chosen = [of_scene.chosen[subset][time] for of_scene in beliefs]
            scene = np.repeat(np.arange(len(scenes)), [some.sum() for some in chosen])
            some = MassScores(
                *(
                    np.concatenate([part[time][which] for part, which in zip(parts, chosen, strict=True)])
                    for parts in zip(*scores, strict=True)
                )
            )
            labels: dict[str, Any] = {"objects": objects, "observed_frames": observed, "input": given, "subset": subset}
            add_mass_rows(results, model, some, scene, labels)


def add_mass_rows(
    results: Results, model: str, scores: MassScores, scene: Int[np.ndarray, " bodies"], labels: Mapping[str, Any]
) -> None:
    """The numbers of some bodies, each of a scene."""
    for metric, unit, values in (
        ("mean_abs_error_kg", "kg", scores.error),
        ("interval_accuracy", "1", scores.right),
        ("coverage_68", "1", scores.held),
        ("log_score", "1", scores.log_score),
    ):
        results.add(model, metric, unit, values.astype(float), scene, **labels)
    results.add_calibration_error(model, scores.top, scores.right, scene, **labels)


def _scores(masses: Float[np.ndarray, " bodies"], answer: MassAnswer) -> MassScores:
    return score(answer, np.broadcast_to(masses, answer.median.shape), MASS_CLASSES)


def _add_slide_rows(results: Results, model: str, given: str, objects: int, scenes: Sequence[SceneMasses]) -> None:
    beliefs = [scene.beliefs[given] for scene in scenes]
    true = np.stack([of_scene.slide for of_scene in beliefs])
    slides = SlideAnswer(*map(np.stack, zip(*(of_scene.slides[model] for of_scene in beliefs), strict=True)))
    for time, observed in enumerate(TIMES):
        for subset in SUBSETS:
            chosen = np.stack([of_scene.chosen[subset][time] for of_scene in beliefs])
            scene = chosen.nonzero()[0]
            labels: dict[str, Any] = {"objects": objects, "observed_frames": observed, "input": given, "subset": subset}
            relative = np.abs(slides.median[:, time] / true - 1)[chosen]
            held = ((slides.low[:, time] <= true) & (true <= slides.high[:, time]))[chosen]
            results.add(model, "slide_error", "1", relative, scene, "median", **labels)
            results.add(model, "slide_coverage_68", "1", held.astype(float), scene, **labels)
