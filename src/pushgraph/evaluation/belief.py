"""The suite `belief`: what beliefs say about every pair after so many observed frames, against what is truly joined."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.belief import BeliefModel
from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks, numbers_of, origin
from pushgraph.evaluation.noise_floor import CAMERA, StartNoise
from pushgraph.evaluation.recording import Recording, ask, record
from pushgraph.evaluation.results import Results
from pushgraph.graph.believed import JointPlaces, joint_places
from pushgraph.graph.joint_truth import (
    adjacent_pairs,
    between_pieces,
    closed,
    flush_pairs,
    touched_pairs,
    true_joints,
    unaware,
)
from pushgraph.graph.scene_batch import JOINT_CODES, Relations, SceneBatch, batch_scenes, concatenate

OBSERVED = (10, *range(20, 201, 20))
"""Observed frames after which beliefs are asked; a shorter trajectory keeps its last answer."""
NOISES: dict[str, StartNoise] = {"none": StartNoise(0.0, 0.0), "1mm": CAMERA}
"""Noise on every body's pose in every frame; the robot's is exact."""
PAIRS = ("all", "adjacent", "touched", "touched_anywhere", "touched_flush")
"""Pairs that are scored by themselves. touched_anywhere: touched ones of scenes whose joints sit anywhere.
touched_flush: touched ones of cuboids whose faces were parallel at first."""
ANYWHERE = "joints_anywhere"
"""Kind of the trajectories whose joints sit anywhere."""
INFORMED = "informed"
"""Answers the truth for touched pairs, and none for the rest: what perfect inference could do."""


class Answers(NamedTuple):
    """What was answered about the pairs of a scene after each of OBSERVED.

    likeliest: JOINT_CODES, pair by pair. closed: the likeliest that hold together, with the closure of fixed.
    of_pieces: those as `between_pieces` has them. top: probability of the likeliest; nothing can be asked of `informed`
    there.
    """

    likeliest: Int[np.ndarray, "times pairs"]
    closed: Int[np.ndarray, "times pairs"]
    of_pieces: Int[np.ndarray, "times pairs"]
    top: Float[np.ndarray, "times pairs"] | None

    def of_scene(self, index: int) -> "Answers":
        """Those of one of many scenes."""
        top = None if self.top is None else self.top[index]
        return Answers(self.likeliest[index], self.closed[index], self.of_pieces[index], top)


class PlaceErrors(NamedTuple):
    """How far believed joints sit from the true ones in the end, of every pair that could show it, else NaN.

    anchor: of hinges (m). axis: of sliders (rad).
    """

    anchor: Float[np.ndarray, " pairs"]
    axis: Float[np.ndarray, " pairs"]


class SceneAnswers(NamedTuple):
    """What was answered about one scene, by model and noise, and what is true.

    joint: true JOINT_CODES, closed. listed: the same as the scene lists them. of_pieces: as `between_pieces` has them.
    chosen: the pairs of each of PAIRS.
    """

    objects: int
    joint: Int[np.ndarray, " pairs"]
    listed: Int[np.ndarray, " pairs"]
    of_pieces: Int[np.ndarray, " pairs"]
    chosen: dict[str, Bool[np.ndarray, "times pairs"]]
    answers: dict[tuple[str, str], Answers]
    places: dict[tuple[str, str], PlaceErrors]


def evaluate_belief(
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    setup: str = SETUP,
    data: str | os.PathLike | None = None,
) -> tuple[Results, list[SceneAnswers]]:
    """Measure beliefs on `count` test scenes for each number of objects; see `measure_blocks`.

    From data, what its scenes say is joined counts as true.
    """
    objects = numbers_of(objects, data, least=2)
    scenes = measure_blocks(answer_block, objects, count, seed, models, workers, progress, setup, data=data)
    labels = ("objects", "observed_frames", "pairs", "noise", "joint")
    results = Results("belief", origin(setup, count, seed, data), labels)
    for number in objects:
        some = [scene for scene in scenes if scene.objects == number]
        for model in (*models, INFORMED):
            for noise in NOISES:
                _add_rows(results, model, noise, number, some)
    return results, scenes


def answer_block(block: Block) -> list[SceneAnswers]:
    """Simulate the scenes of a block, and watch them with every model."""
    trajectories = block.draw()
    tracks = [trajectory.track for trajectory in trajectories]
    longest = min(max(OBSERVED), max(len(track.times) for track in tracks))
    scenes, seen = batch_scenes([track.scene for track in tracks]), record(tracks, longest)
    times = torch.tensor(OBSERVED).minimum(seen.lengths[:, None]) - 1
    adjacent = adjacent_pairs(scenes, seen.bodies[:, 0])
    touched = touched_pairs(adjacent, seen.bodies)[torch.arange(len(tracks))[:, None], times]
    anywhere = torch.tensor([trajectory.kind == ANYWHERE for trajectory in trajectories])[:, None, None]
    flush = flush_pairs(scenes, seen.bodies[:, 0])[:, None]
    subsets = (
        *(torch.ones_like(touched), adjacent[:, None].expand(touched.shape), touched),
        *(touched & anywhere, touched & flush),
    )
    chosen = dict(zip(PAIRS, subsets, strict=True))
    joint, listed = true_joints(scenes), scenes.relations.kind
    of_pieces = between_pieces(scenes, listed)

    known = [torch.where(touched, kind[:, None], JOINT_CODES["none"]) for kind in (listed, joint)]
    scored = _arrays(known[0], close(scenes, known[1]), _of_pieces(scenes, known[0]))
    informed = Answers(scored[0], scored[1], scored[2], None)
    answers = {(INFORMED, noise): informed for noise in NOISES}
    places: dict[tuple[str, str], PlaceErrors] = {}
    # All noises are watched side by side.
    noisy = concatenate([add_noise(seen, noise, block) for noise in NOISES.values()])
    watched, all_times = concatenate([scenes] * len(NOISES)), times.repeat(len(NOISES), 1)
    for name, path in block.models:
        model = BeliefModel.load(path)
        (probabilities, kinds), end = ask(model.answers, model, unaware(watched), noisy, all_times)
        top, likeliest = probabilities.max(-1)
        errors = place_errors(watched.relations, joint_places(end.view.state, end.view.fits))
        of_noises = (values.chunk(len(NOISES)) for values in (likeliest, top, kinds, *errors))
        for noise, by_pair, certain, kind, *error in zip(NOISES, *of_noises, strict=True):
            answers[name, noise] = Answers(*_arrays(by_pair, close(scenes, kind), _of_pieces(scenes, kind), certain))
            places[name, noise] = PlaceErrors(*_arrays(*error))
    return [
        SceneAnswers(
            block.objects,
            joint[k].numpy(),
            listed[k].numpy(),
            of_pieces[k].numpy(),
            {pairs: some[k].numpy() for pairs, some in chosen.items()},
            {key: answered.of_scene(k) for key, answered in answers.items()},
            {key: PlaceErrors(error.anchor[k], error.axis[k]) for key, error in places.items()},
        )
        for k in range(len(tracks))
    ]


def place_errors(
    true: Relations, places: JointPlaces
) -> tuple[Float[Tensor, "batch pairs"], Float[Tensor, "batch pairs"]]:
    """See PlaceErrors; only of true hinges and sliders."""
    anchor = (places.anchor_a - true.anchor_a).norm(dim=-1).double()
    cosine = (places.axis * true.axis).sum(-1).abs().clamp(max=1)
    hinge, slider = (true.kind == JOINT_CODES[name] for name in ("revolute", "prismatic"))
    return torch.where(hinge, anchor, torch.nan), torch.where(slider, cosine.acos().double(), torch.nan)


def add_noise(seen: Recording, noise: StartNoise, block: Block) -> Recording:
    """Independent noise on every pose; a scene's own, whatever block it is in."""
    shape = seen.bodies.shape[1:]
    drawn = [
        np.random.default_rng([block.seed, block.objects, index]).normal(size=shape)
        for index in range(block.first, block.first + block.count)
    ]
    spread = seen.bodies.new_tensor([noise.position, noise.position, noise.yaw])
    return seen._replace(bodies=seen.bodies + torch.from_numpy(np.stack(drawn)) * spread)


def close(scenes: SceneBatch, kind: Int[Tensor, "batch times pairs"]) -> Int[Tensor, "batch times pairs"]:
    """The closure of fixed, of answers at several times."""
    return torch.stack([closed(scenes, at_one_time) for at_one_time in kind.unbind(1)], 1)


def certainty(
    scenes: Sequence[SceneAnswers], model: str, noise: str, pairs: str, time: int
) -> tuple[Float[np.ndarray, " values"], Bool[np.ndarray, " values"]]:
    """Probabilities of the likeliest answers about some pairs at OBSERVED[time], and whether those are right."""
    answered = [(scene.answers[model, noise], scene.chosen[pairs][time]) for scene in scenes]
    top = [answers.top[time][chosen] for answers, chosen in answered if answers.top is not None]
    assert len(top) == len(answered), f"of {model} it cannot be asked how sure it is"
    right = [(a.likeliest[time] == scene.joint)[chosen] for scene, (a, chosen) in zip(scenes, answered, strict=True)]
    return np.concatenate(top), np.concatenate(right)


def _of_pieces(scenes: SceneBatch, kind: Int[Tensor, "batch times pairs"]) -> Int[Tensor, "batch times pairs"]:
    return torch.stack([between_pieces(scenes, at_one_time) for at_one_time in kind.unbind(1)], 1)


def _arrays(*tensors: Tensor) -> list[np.ndarray]:
    return [tensor.numpy() for tensor in tensors]


def _add_rows(results: Results, model: str, noise: str, objects: int, scenes: Sequence[SceneAnswers]) -> None:
    answers = [scene.answers[model, noise] for scene in scenes]
    joint, listed, of_pieces = (
        np.stack([getattr(scene, name) for scene in scenes]) for name in ("joint", "listed", "of_pieces")
    )
    likeliest, answered, between = (
        np.stack([getattr(answer, name) for answer in answers]) for name in ("likeliest", "closed", "of_pieces")
    )
    for time, observed in enumerate(OBSERVED):
        for pairs in PAIRS:
            chosen = np.stack([scene.chosen[pairs][time] for scene in scenes])
            scene, truth, said = chosen.nonzero()[0], joint[chosen], answered[:, time][chosen]
            labels = {"objects": objects, "observed_frames": observed, "pairs": pairs, "noise": noise}

            def add(
                metric: str,
                right: np.ndarray,
                of: np.ndarray,
                joint: str = "all",
                scene: np.ndarray = scene,
                labels: dict[str, Any] = labels,
            ) -> None:
                results.add(model, metric, "1", right[of].astype(float), scene[of], **labels, joint=joint)

            everything = np.ones_like(truth, dtype=bool)
            add("accuracy", said == truth, everything)
            add("accuracy_raw", likeliest[:, time][chosen] == listed[chosen], everything)
            add("accuracy_pieces", between[:, time][chosen] == of_pieces[chosen], everything)
            for name, code in JOINT_CODES.items():
                add("precision", said == truth, said == code, name)
                add("recall", said == truth, truth == code, name)
            if model != INFORMED:
                top, right = certainty(scenes, model, noise, pairs, time)
                results.add_calibration_error(model, top, right, scene, **labels, joint="all")
            if model != INFORMED and pairs.startswith("touched") and observed == max(OBSERVED):
                _add_place_rows(results, model, noise, scenes, pairs, labels)


def _add_place_rows(
    results: Results, model: str, noise: str, scenes: Sequence[SceneAnswers], pairs: str, labels: dict[str, Any]
) -> None:
    """How far joints that were told right sit from the true ones, in the median."""
    chosen = np.stack([scene.chosen[pairs][-1] for scene in scenes])
    right = np.stack([scene.answers[model, noise].likeliest[-1] == scene.listed for scene in scenes])
    for metric, unit, scale, name in (
        ("anchor_error_mm", "mm", 1e3, "anchor"),
        ("axis_error_deg", "degree", math.degrees(1), "axis"),
    ):
        errors = np.stack([getattr(scene.places[model, noise], name) for scene in scenes])
        scene, pair = (chosen & right & np.isfinite(errors)).nonzero()
        joint = {"anchor": "revolute", "axis": "prismatic"}[name]
        results.add(model, metric, unit, scale * errors[scene, pair], scene, "median", **labels, joint=joint)
