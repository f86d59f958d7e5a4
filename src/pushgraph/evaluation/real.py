"""The suite `real`: recorded pushes of a real robot against predictions of where they end."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from pushgraph.adaptation.adapted import Adaptation, Prediction, zero_shot
from pushgraph.adaptation.scenes import scene_of
from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.repeatability import repeatability, repeated
from pushgraph.evaluation.results import Results
from pushgraph.physics import PhysicsPredictor
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import RealPushes, read_pushes
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate

ALL = "all"
LABELS = ("shape", "surface", "speed", "split", "pushes")
METRICS = (("position_error_mm", "mm"), ("rotation_error_deg", "deg"))
SIMULATED = 20
"""Pushes of each material that are simulated, too, unless told otherwise: a fifth of a second each."""
BLOCK = 10
"""Pushes that a process simulates at a time."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Errors of a model on some pushes.

    errors: (mm, degrees). index: of the pushes among all, or of the first of pairs. held: whether its 68 % regions of
    position and yaw hold what was recorded; None if it states none. split, adapted_with: how it was adapted, if it was.
    """

    model: str
    errors: Float[np.ndarray, "some 2"]
    index: Int[np.ndarray, " some"]
    held: np.ndarray | None = None
    split: str = ALL
    adapted_with: int = 0


@dataclass(eq=False)
class RealMeasures:
    """The pushes, and what was measured."""

    pushes: RealPushes
    measured: list[Measured] = field(default_factory=list)

    def add(self, model: str, ends: Float[np.ndarray, "some 3"], index: np.ndarray) -> None:
        """Add a model that states final poses alone."""
        self.measured.append(Measured(model, errors_of(ends, self.pushes.after[index]), index))


def errors_of(ends: Float[np.ndarray, "some 3"], after: Float[np.ndarray, "some 3"]) -> Float[np.ndarray, "some 2"]:
    """Distances (mm) and turns (degrees) between final poses."""
    apart = ends - after
    return np.stack((1e3 * np.hypot(apart[:, 0], apart[:, 1]), np.degrees(np.abs(wrap_angle(apart[:, 2])))), -1)


def measured(
    model: str, predicted: Prediction, pushes: RealPushes, index: np.ndarray, split: str = ALL, adapted_with: int = 0
) -> Measured:
    """Errors of predictions of some of the pushes, and whether their spreads hold."""
    after = pushes.after[index]
    apart = after - predicted.ends
    held = np.stack((predicted.spread.position_level(apart[:, :2]), predicted.spread.yaw_level(apart[:, 2])), -1) < 0.68
    return Measured(model, errors_of(predicted.ends, after), index, held, split, adapted_with)


def evaluate_real(
    data: str | os.PathLike,
    outlines: str | os.PathLike,
    count: int | None = None,
    contact: str | os.PathLike = "contact",
    adaptation: Adaptation | None = None,
    simulated: int | None = None,
    workers: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> tuple[Results, RealMeasures]:
    """Measure predictions of `count` pushes, spread evenly over each material, or of all of them.

    contact: the checkpoint that predicts. adaptation: one that was learnt on other pushes than these, measured, too.
    simulated: how many pushes of each material are simulated.
    """
    pushes = read_pushes(data, outlines)
    if count is not None:
        pushes = pushes.take(spread_out(pushes, -(-count // len(pushes.materials)))[:count])
    everything = np.arange(len(pushes))
    measures = RealMeasures(pushes)
    measures.add("still", pushes.before, everything)
    for model, ends in pushes.stated.items():
        measures.add(model, ends, everything)
    chosen = spread_out(pushes, SIMULATED if simulated is None else simulated)
    known = zero_shot(pushes)
    scenes = [scene_of(pushes, k, known.of(*pushes.material(k)).estimate.unknowns) for k in chosen.tolist()]
    measures.add("mujoco", simulated_ends(scenes, workers, lambda done, n: progress("simulated", done, n)), chosen)
    dynamics = PhysicsPredictor.load(contact).dynamics
    progress("predicted", 0, len(pushes))
    measures.measured.append(measured("zero_shot", known.predict(dynamics, pushes), pushes, everything))
    if adaptation is not None:
        measures.measured.append(measured("adapted", adaptation.predict(dynamics, pushes), pushes, everything))
    progress("predicted", len(pushes), len(pushes))
    pairs = repeated(pushes)
    measures.measured.append(Measured("floor", repeatability(pushes, pairs), pairs[:, 0]))
    protocol = {"data": Path(data).name, "count": len(pushes), "seed": 0, "simulated": len(chosen), "pairs": len(pairs)}
    return results_of(measures, protocol), measures


def results_of(measures: RealMeasures, protocol: Mapping[str, object]) -> Results:
    """A row for each number, of all pushes, and of each shape, surface, speed and material."""
    results = Results("real", protocol, LABELS)
    pushes = measures.pushes
    speeds = [round(1e3 * speed, 3) for speed in pushes.speed.tolist()]
    columns = {"shape": pushes.shape, "surface": pushes.surface, "speed": np.array(speeds)}
    for one in measures.measured:
        for labels in _selections(columns):
            own = np.ones(len(one.index), dtype=bool)
            for name, value in labels.items():
                own &= columns[name][one.index] == value
            every: dict[str, Any] = (
                {name: ALL for name in LABELS} | labels | {"split": one.split, "pushes": one.adapted_with}
            )
            for (metric, unit), values in zip(METRICS, one.errors[own].T, strict=True):
                results.add(one.model, metric, unit, values, one.index[own], **every)
            if one.held is not None:
                held = one.held[own].T.astype(float)
                for metric, values in zip(("coverage_68", "yaw_coverage_68"), held, strict=True):
                    results.add(one.model, metric, "1", values, one.index[own], **every)
    return results


def _selections(columns: Mapping[str, np.ndarray]) -> list[dict[str, object]]:
    each = {name: list(dict.fromkeys(values.tolist())) for name, values in columns.items()}
    found: list[dict[str, object]] = [{}]
    found += [{name: value} for name, values in each.items() for value in values]
    found += [{"shape": shape, "surface": surface} for shape in each["shape"] for surface in each["surface"]]
    return found


def spread_out(pushes: RealPushes, count: int) -> Int[np.ndarray, " some"]:
    """Up to `count` pushes of each material, spread evenly over the file."""
    found: Iterable[np.ndarray] = (np.flatnonzero(pushes.of(*names)) for names in pushes.materials)
    return np.sort(
        np.concatenate([own[np.linspace(0, len(own) - 1, min(count, len(own))).round().astype(int)] for own in found])
    )


def simulated_ends(
    scenes: Sequence[Scene], workers: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> Float[np.ndarray, "scenes 3"]:
    """Final poses of the one body of each scene."""
    blocks = [tuple(scenes[k : k + BLOCK]) for k in range(0, len(scenes), BLOCK)]
    jobs = list(enumerate(blocks))
    found: dict[int, np.ndarray] = {}
    for done, ((number, _), ends) in enumerate(run_in_processes(_simulated, jobs, workers), start=1):
        found[number] = ends
        progress(min(done * BLOCK, len(scenes)), len(scenes))
    return np.concatenate([found[number] for number in range(len(blocks))])


def _simulated(job: tuple[int, tuple[Scene, ...]]) -> np.ndarray:
    return np.array([simulate(scene).poses[-1, 1] for scene in job[1]])
