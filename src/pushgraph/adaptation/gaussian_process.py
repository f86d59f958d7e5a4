"""Gaussian process regression of several values at a time, by exact inference, with its length scales learnt.

Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006: algorithm 2.1, equations 5.8 and 5.12.
"""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

ITERATIONS = 30
LENGTH, LENGTH_DEVIATION = 2.0, 1.0
"""Prior of the length scales: median, and deviation of the logarithm."""
SIGNAL, NOISE, DEVIATION = 0.75, 0.75, 1.0
"""The same of the deviations of signal and noise: medians, and deviation of their logarithms."""
FARTHEST = 3.0
"""No logarithm is farther from its median (prior deviations)."""


class GaussianProcess(NamedTuple):
    """A regression from places to values, zero where nothing is near. logs: of length scales, signal and noise.

    answers: inverse covariance times the values; inverse: of the places' covariance.
    """

    places: Float[Tensor, "samples features"]
    logs: Float[Tensor, " parameters"]
    answers: Float[Tensor, "samples values"]
    inverse: Float[Tensor, "samples samples"]

    @classmethod
    def fit(
        cls, places: Float[np.ndarray, "samples features"], values: Float[np.ndarray, "samples values"]
    ) -> "GaussianProcess":
        """Learn the scales by the largest posterior probability, then condition on all samples."""
        x, y = torch.from_numpy(places).double(), torch.from_numpy(values).double()
        features = x.shape[1]
        middle = torch.full((features + 2,), math.log(LENGTH), dtype=torch.float64)
        middle[features:] = torch.tensor([SIGNAL, NOISE], dtype=torch.float64).log()
        width = torch.tensor([LENGTH_DEVIATION] * features + [DEVIATION] * 2, dtype=torch.float64)
        free = torch.zeros_like(middle).requires_grad_(True)
        optimizer = torch.optim.LBFGS([free], max_iter=ITERATIONS, line_search_fn="strong_wolfe")

        def bounded() -> Tensor:  # a line search that goes too far stays where the covariance is regular
            return middle + FARTHEST * width * torch.tanh(free / FARTHEST)

        def loss() -> Tensor:
            optimizer.zero_grad()
            logs = bounded()
            lower = torch.linalg.cholesky(_covariance(x, x, logs) + _noise(x, logs))
            solved = torch.cholesky_solve(y, lower)
            evidence = (y * solved).sum() / 2 + y.shape[1] * lower.diagonal().log().sum()
            value = evidence + ((logs - middle) / width).square().sum() / 2
            value.backward()
            return value

        with torch.enable_grad():
            optimizer.step(loss)
        return cls.conditioned(x, y, bounded().detach())

    @classmethod
    def conditioned(cls, places: Tensor, values: Tensor, logs: Tensor) -> "GaussianProcess":
        """With given scales."""
        lower = torch.linalg.cholesky(_covariance(places, places, logs) + _noise(places, logs))
        inverse = torch.cholesky_inverse(lower)
        return cls(places, logs, inverse @ values, inverse)

    def mean(self, places: Float[np.ndarray, "some features"]) -> Float[np.ndarray, "some values"]:
        """Expected values."""
        return (_covariance(torch.from_numpy(places).double(), self.places, self.logs) @ self.answers).numpy()

    def variance(self, places: Float[np.ndarray, "some features"]) -> Float[np.ndarray, " some"]:
        """Of the expected values, the same for all of them; without noise."""
        across = _covariance(torch.from_numpy(places).double(), self.places, self.logs)
        known = ((across @ self.inverse) * across).sum(1)
        return (self.logs[-2].exp().square() - known).clamp(min=0).numpy()

    @property
    def values(self) -> Float[np.ndarray, "samples values"]:
        """What it was learnt from."""
        covariance = _covariance(self.places, self.places, self.logs) + _noise(self.places, self.logs)
        return (covariance @ self.answers).numpy()

    @property
    def left_out(self) -> Float[np.ndarray, "samples values"]:
        """Errors at each sample of the process that is conditioned on all others: value less mean."""
        return (self.answers / self.inverse.diagonal()[:, None]).numpy()


def _covariance(a: Tensor, b: Tensor, logs: Tensor) -> Tensor:
    """Matern's, of smoothness 3/2 (equation 4.17)."""
    lengths = logs[:-2].exp()
    away = (3 * torch.cdist(a / lengths, b / lengths).square() + 1e-12).sqrt()
    return logs[-2].exp().square() * (1 + away) * torch.exp(-away)


def _noise(places: Tensor, logs: Tensor) -> Tensor:
    return (logs[-1].exp().square() + 1e-6) * torch.eye(len(places), dtype=places.dtype)
