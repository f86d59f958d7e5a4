"""What is answered about masses, and how it is scored."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.mass_prior import MassClass, class_of, prior_quantiles, shares_of

MEDIAN, LOW, HIGH = 0.5, 0.16, 0.84
"""Probabilities below a stated median, and below the ends of its interval, which holds 68 %."""
LEAST_PROBABILITY = 1e-4
"""A class that was called less likely scores as if it had been called this likely, so that no score is infinite."""


class MassAnswer(NamedTuple):
    """What is said of bodies: a median and a 68 % interval (kg), and the probabilities of the classes."""

    median: Float[np.ndarray, "*bodies"]
    low: Float[np.ndarray, "*bodies"]
    high: Float[np.ndarray, "*bodies"]
    probabilities: Float[np.ndarray, "*bodies classes"]

    def take(self, index: int | tuple | np.ndarray) -> "MassAnswer":
        """The same values of all parts."""
        return MassAnswer(*(values[index] for values in self))

    @property
    def likeliest(self) -> Int[np.ndarray, "*bodies"]:
        """Index of the likeliest class."""
        return self.probabilities.argmax(-1)


class MassScores(NamedTuple):
    """How an answer compares with the truth, body by body.

    error: of the median (kg). right: whether the likeliest class is the true one. held: whether the interval holds the
    true mass. log_score: logarithm of the probability of the true class. top: probability of the likeliest.
    """

    error: Float[np.ndarray, "*bodies"]
    right: Bool[np.ndarray, "*bodies"]
    held: Bool[np.ndarray, "*bodies"]
    log_score: Float[np.ndarray, "*bodies"]
    top: Float[np.ndarray, "*bodies"]


def score(answer: MassAnswer, masses: Float[np.ndarray, "*bodies"], classes: Sequence[MassClass]) -> MassScores:
    """Compare with the true masses (kg)."""
    true = classes_of(classes, masses)
    of_true = np.take_along_axis(answer.probabilities, true[..., None], -1)[..., 0]
    return MassScores(
        np.abs(answer.median - masses),
        answer.likeliest == true,
        (answer.low <= masses) & (masses <= answer.high),
        np.log(np.maximum(of_true, LEAST_PROBABILITY)),
        answer.probabilities.max(-1),
    )


def classes_of(classes: Sequence[MassClass], masses: Float[np.ndarray, "*bodies"]) -> Int[np.ndarray, "*bodies"]:
    """Indices of the classes that masses (kg) belong to."""
    different, place = np.unique(masses, return_inverse=True)
    return np.array([class_of(classes, float(mass)) for mass in different], dtype=np.int64)[place]


def believed(posterior: tuple) -> MassAnswer:
    """The answer that `BeliefModel.masses` gives, as arrays."""
    return MassAnswer(*(getattr(posterior, name).numpy().astype(np.float64) for name in MassAnswer._fields))


def prior_answer(classes: Sequence[MassClass], bodies: int) -> MassAnswer:
    """What can be said of bodies of which nothing was seen."""
    quantiles = prior_quantiles(classes, np.array([MEDIAN, LOW, HIGH]))
    median, low, high = np.tile(quantiles[:, None], bodies)
    return MassAnswer(median, low, high, np.tile(shares_of(classes), (bodies, 1)))


def prior_mean(classes: Sequence[MassClass]) -> float:
    """The mean mass (kg) before anything is seen."""
    return float(shares_of(classes) @ [(one.lowest + one.highest) / 2 for one in classes])


def weighted_answer(
    samples: Float[np.ndarray, "samples bodies"], weights: Float[np.ndarray, " samples"], classes: Sequence[MassClass]
) -> MassAnswer:
    """The answer of a distribution that is given by weighted samples of masses (kg) within the classes.

    A quantile is where half the weight of its own sample, and all of smaller ones, make up its probability; between
    samples it is interpolated.
    """
    shares = weights / weights.sum()
    bounds = np.array([(one.lowest, one.highest) for one in classes])
    within = (samples[..., None] >= bounds[:, 0]) & (samples[..., None] <= bounds[:, 1])
    probabilities = np.einsum("s,sbc->bc", shares, within)
    order = samples.argsort(0)
    ordered = np.take_along_axis(samples, order, 0)
    upto = shares[order].cumsum(0) - shares[order] / 2
    wanted = np.array([MEDIAN, LOW, HIGH])
    quantiles = [np.interp(wanted, *columns) for columns in zip(upto.T, ordered.T, strict=True)]
    median, low, high = np.transpose(quantiles)
    return MassAnswer(median, low, high, probabilities / probabilities.sum(-1, keepdims=True))
