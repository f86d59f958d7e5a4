"""The posterior of masses, exactly: by enumeration of their ratios through the simulator, given noisy poses."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.evaluation.mass_answers import MassAnswer, weighted_answer
from pushgraph.evaluation.mass_observers import ScalePosterior
from pushgraph.evaluation.noise_floor import CAMERA, StartNoise
from pushgraph.evaluation.ratio_likelihood import RatioLikelihood
from pushgraph.evaluation.ratio_table import RatioTable, simulated_table
from pushgraph.mass_prior import MassClass, draw_masses
from pushgraph.scene import Scene
from pushgraph.simulation.masses import weighing
from pushgraph.simulation.planar import simulate

SAMPLES = 20_000
"""Of an answer, at least."""
FIRST_CELLS = {1: 64, 2: 32}
"""Of the first table, in each dimension, by the number of dimensions."""
MOVES = 0.05
"""A table is fine enough once posterior means move by less than this (kg) when its cells are halved."""
PROBES = 100
"""Observations on which that is tried."""


class ExactObserver:
    """Answers with the posterior, given poses of all frames of a scene that were seen with Gaussian noise."""

    def __init__(self, table: RatioTable, noise: StartNoise, classes: Sequence[MassClass]) -> None:
        self.likelihood, self.classes = RatioLikelihood(table, noise), classes

    @property
    def cells(self) -> int:
        """Of its table, in each dimension."""
        return len(self.likelihood.table.reached)

    def answer(self, poses: Float[np.ndarray, "frames bodies 3"]) -> MassAnswer:
        """What can be said at best."""
        return weighted_answer(*self.samples(poses), self.classes)

    def mean(self, poses: Float[np.ndarray, "frames bodies 3"]) -> Float[np.ndarray, " bodies"]:
        """Posterior means (kg)."""
        masses, weights = self.samples(poses)
        return weights @ masses / weights.sum()

    def samples(
        self, poses: Float[np.ndarray, "frames bodies 3"]
    ) -> tuple[Float[np.ndarray, "samples bodies"], Float[np.ndarray, " samples"]]:
        """Masses (kg) and their weights: likely ratios, each at equally likely scales."""
        likely = self.likelihood.likely(poses)
        ratios = np.exp(np.column_stack((np.zeros(len(likely.log_ratios)), likely.log_ratios)))
        evidence = ScalePosterior(ratios, self.classes).evidence
        weights = evidence * np.exp(likely.log_likelihood - likely.log_likelihood.max())
        there = weights > 1e-6 * weights.max()
        ratios, weights = ratios[there], weights[there]
        levels = max(16, -(-SAMPLES // len(ratios)))
        scales = ScalePosterior(ratios, self.classes).quantiles((np.arange(levels) + 0.5) / levels)
        samples = scales[:, :, None] * ratios[:, None]
        return samples.reshape(-1, ratios.shape[1]), np.repeat(weights, levels)


def refined_observer(
    scene: Scene,
    noise: StartNoise = CAMERA,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ExactObserver:
    """The observer of a scene whose masses alone are unknown, its table refined until that no longer matters.

    See MOVES, and `simulated_table` for the rest.
    """
    classes, cells = scene.classes_of_mass, FIRST_CELLS[len(scene.bodies) - 1]
    rng = np.random.default_rng(0)
    masses = draw_masses(rng, classes, PROBES * len(scene.bodies)).reshape(PROBES, -1)
    seen = np.stack([simulate(weighing(scene, some)).poses[:, 1:] for some in masses])
    seen += rng.normal(size=seen.shape) * [noise.position, noise.position, noise.yaw]
    table, before = None, np.full(masses.shape, np.inf)
    while True:
        table = simulated_table(scene, cells, table, workers, progress)
        observer = ExactObserver(table, noise, classes)
        means = np.stack([observer.mean(poses) for poses in seen])
        if np.abs(means - before).mean() < MOVES:
            return observer
        before, cells = means, 2 * cells
