"""How likely noisy poses are for every ratio of masses, by a table of what the simulator does.

The simulator is chaotic on a small scale: ratios that differ by a thousandth end up to a millimetre apart. So between
the nodes of a table, however fine, poses are known only up to this roughness, which counts as noise beside the
camera's. It is found from how nodes stray from the straight line between their neighbours, and goes on from frame to
frame, so that it has few directions in the space of all poses.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.evaluation.noise_floor import StartNoise
from pushgraph.evaluation.ratio_table import RatioTable

DIRECTIONS = 32
"""Principal directions of the roughness that are kept."""
NEIGHBOURHOOD = 2
"""Nodes this near (in each dimension) are as rough as each other."""
FINEST = 0.004
"""Cells are halved until they are this wide in log ratio."""
MOST_CELLS = 8192
"""Halving ends where so many cells are likely: then none of them matters alone."""
UNLIKELY = 20.0
"""Cells of the finest width are dropped where they are less likely than the best by this logarithm; wider ones, whose
middle may miss where their likelihood peaks, by so much more as they are wider."""


class LikelyRatios(NamedTuple):
    """Middles of equal cells that hold nearly all of the likelihood, and its logarithms there."""

    log_ratios: Float[np.ndarray, "points dimensions"]
    log_likelihood: Float[np.ndarray, " points"]


class RatioLikelihood:
    """The likelihood of log ratios, given poses of all frames that were seen with Gaussian noise."""

    def __init__(self, table: RatioTable, noise: StartNoise) -> None:
        self.table = table
        frames_and_bodies = table.poses.shape[-1] // 3
        scale = np.tile([1 / noise.position, 1 / noise.position, 1 / noise.yaw], frames_and_bodies)
        self._scale = scale.astype(np.float32)
        self._directions, self._variance = _roughness(table.poses * self._scale, table.dimensions)

    def likely(self, poses: Float[np.ndarray, "frames bodies 3"]) -> LikelyRatios:
        """Cells of the table are halved in every dimension, and unlikely ones dropped, until they are fine."""
        table, width = self.table, self.table.spacing
        seen = (poses.reshape(-1) * self._scale).astype(np.float32)
        steps = np.meshgrid(*[(-0.25, 0.25)] * table.dimensions, indexing="ij")
        halves = np.stack(steps, -1).reshape(-1, table.dimensions)
        points = table.lowest + width * (np.argwhere(table.reached) + 0.5)
        while True:
            likelihood = self._log_likelihood(points, seen)
            likely = likelihood > likelihood.max() - UNLIKELY * max(1.0, width / FINEST)
            points, likelihood = points[likely], likelihood[likely]
            if width <= FINEST or len(points) * len(halves) > MOST_CELLS:
                return LikelyRatios(points, likelihood)
            points = (points[:, None] + width * halves).reshape(-1, table.dimensions)
            width /= 2

    def _log_likelihood(
        self, points: Float[np.ndarray, "points dimensions"], seen: Float[np.ndarray, " values"]
    ) -> Float[np.ndarray, " points"]:
        """Of a Gaussian with covariance 1 + U V U', in units of the noise: directions U, and variances V along them."""
        log_likelihoods = []
        for some in np.array_split(points, len(points) // 1024 + 1):
            away = self.table.at(some) * self._scale - seen
            along = away @ self._directions
            variance = self._variance[self.table.cells_of(some)]
            explained = np.square(along) * variance / (1 + variance) - np.log1p(variance)
            log_likelihoods.append(0.5 * (explained.sum(-1) - np.square(away).sum(-1)))
        return np.concatenate(log_likelihoods).astype(np.float64)


def _roughness(
    poses: Float[np.ndarray, "*nodes values"], dimensions: int
) -> tuple[Float[np.ndarray, "values directions"], Float[np.ndarray, "*nodes directions"]]:
    """Principal directions of the roughness, and its variance along each near every node.

    If every node is off by the variance v, then off the line between its neighbours, twice over, by 6 v. A pose that is
    seen is off by v itself, and what is interpolated by 2/3 v in the mean for every dimension.
    """
    strays = []
    for axis in range(dimensions):
        before, node, after = (np.roll(poses, -shift, axis) for shift in (-1, 0, 1))
        bend = before - 2 * node + after
        np.moveaxis(bend, axis, 0)[[0, -1]] = np.nan
        strays.append(bend)
    rows = np.concatenate([stray.reshape(-1, poses.shape[-1]) for stray in strays])
    rows = rows[~np.isnan(rows[:, 0])]
    directions = np.linalg.eigh(rows.T @ rows)[1][:, -DIRECTIONS:]
    squares = np.stack([np.square(stray @ directions) for stray in strays])
    there = ~np.isnan(squares)
    total = _around(np.where(there, squares, 0.0).sum(0), dimensions)
    count = _around(there.sum(0).astype(float), dimensions)
    return directions, (1 + (2 / 3) ** dimensions) / 6 * total / np.maximum(count, 1)


def _around(values: Float[np.ndarray, "*nodes directions"], dimensions: int) -> Float[np.ndarray, "*nodes directions"]:
    """Sums over the neighbourhood of every node."""
    for axis in range(dimensions):
        widths = [(NEIGHBOURHOOD * (k == axis),) * 2 for k in range(values.ndim)]
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, widths), 2 * NEIGHBOURHOOD + 1, axis)
        values = windows.sum(-1)
    return values
