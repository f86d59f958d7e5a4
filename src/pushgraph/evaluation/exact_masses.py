"""The posterior of masses, exactly: by enumeration of their ratios through the simulator, given noisy poses."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.evaluation.mass_answers import MassAnswer, weighted_answer
from pushgraph.evaluation.mass_observers import ScalePosterior
from pushgraph.evaluation.noise_floor import CAMERA, StartNoise
from pushgraph.evaluation.ratio_table import RatioTable, simulated_table, with_masses
from pushgraph.mass_prior import MassClass, draw_masses
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate

FINEST = 0.003
"""Cells are halved until they are this wide in log ratio."""
MOST_CELLS = 8192
"""Halving ends where so many cells are likely: then none of them matters alone."""
UNLIKELY = 25.0
"""Cells of the finest width are dropped where they are less likely than the best by this logarithm; wider ones, whose
middle may miss where their likelihood peaks, by so much more as they are wider."""
SAMPLES = 20_000
"""Of an answer, at least."""
FIRST_CELLS = {1: 64, 2: 32}
"""Of the first table, in each dimension, by the number of dimensions."""
MOVES = 0.05
"""A table is fine enough once posterior means move by less than this (kg) when its cells are halved."""
PROBES = 24
"""Observations on which that is tried."""


def exact_answer(
    table: RatioTable, poses: Float[np.ndarray, "frames bodies 3"], noise: StartNoise, classes: Sequence[MassClass]
) -> MassAnswer:
    """The answer to poses of all frames that were seen with independent Gaussian noise."""
    return weighted_answer(*posterior_samples(table, poses, noise, classes), classes)


def posterior_samples(
    table: RatioTable, poses: Float[np.ndarray, "frames bodies 3"], noise: StartNoise, classes: Sequence[MassClass]
) -> tuple[Float[np.ndarray, "samples bodies"], Float[np.ndarray, " samples"]]:
    """Masses (kg) and their weights: likely ratios, each at equally likely scales."""
    log_ratios, log_likelihood = likely_ratios(table, poses, noise)
    ratios = np.exp(np.column_stack((np.zeros(len(log_ratios)), log_ratios)))
    posterior = ScalePosterior(ratios, classes)
    weights = posterior.evidence * np.exp(log_likelihood - log_likelihood.max())
    there = weights > 1e-9 * weights.max()
    ratios, weights = ratios[there], weights[there]
    levels = max(16, -(-SAMPLES // len(ratios)))
    scales = ScalePosterior(ratios, classes).quantiles((np.arange(levels) + 0.5) / levels)
    samples = scales[:, :, None] * ratios[:, None]
    return samples.reshape(-1, ratios.shape[1]), np.repeat(weights, levels)


def likely_ratios(
    table: RatioTable, poses: Float[np.ndarray, "frames bodies 3"], noise: StartNoise
) -> tuple[Float[np.ndarray, "points dimensions"], Float[np.ndarray, " points"]]:
    """Middles of equal cells that hold nearly all of the likelihood, and its logarithms there.

    Cells of the table are halved in every dimension, and unlikely ones dropped, until they are fine.
    """
    precision = np.tile(1 / np.array([noise.position, noise.position, noise.yaw]), poses.size // 3).astype(np.float32)
    seen = (poses.reshape(-1) * precision).astype(np.float32)

    def log_likelihood(points: np.ndarray) -> np.ndarray:
        some = np.array_split(points, len(points) // 1024 + 1)
        return -0.5 * np.concatenate([np.square(table.at(part) * precision - seen).sum(-1) for part in some])

    width = table.spacing
    halves = np.stack(np.meshgrid(*[(-0.25, 0.25)] * table.dimensions, indexing="ij"), -1).reshape(-1, table.dimensions)
    points = table.lowest + width * (np.argwhere(table.reached) + 0.5)
    while True:
        likelihood = log_likelihood(points)
        likely = likelihood > likelihood.max() - UNLIKELY * max(1.0, width / FINEST)
        points, likelihood = points[likely], likelihood[likely]
        if width <= FINEST or len(points) * len(halves) > MOST_CELLS:
            return points, likelihood.astype(np.float64)
        points = (points[:, None] + width * halves).reshape(-1, table.dimensions)
        width /= 2


def refined_table(
    scene: Scene,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
    noise: StartNoise = CAMERA,
) -> RatioTable:
    """The table of a scene, refined until it no longer matters; see MOVES."""
    classes, cells = scene.classes_of_mass, FIRST_CELLS[len(scene.bodies) - 1]
    rng = np.random.default_rng(0)
    masses = draw_masses(rng, classes, PROBES * len(scene.bodies)).reshape(PROBES, -1)
    seen = np.stack([simulate(with_masses(scene, some)).poses[:, 1:] for some in masses])
    seen += rng.normal(size=seen.shape) * [noise.position, noise.position, noise.yaw]

    def means(table: RatioTable) -> np.ndarray:
        told = [posterior_samples(table, poses, noise, classes) for poses in seen]
        return np.stack([weights @ samples / weights.sum() for samples, weights in told])

    table = simulated_table(scene, cells, None, workers, progress)
    before = means(table)
    while True:
        cells *= 2
        table = simulated_table(scene, cells, table, workers, progress)
        now = means(table)
        if np.abs(now - before).mean() < MOVES:
            return table
        before = now
