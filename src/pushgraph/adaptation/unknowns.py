"""What nobody told the robot about its pushes: a few numbers, each with a nominal value and how sure that is."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

COUNT = 9


class Unknowns(NamedTuple):
    """Physical unknowns of an object on a surface, and of the probe that pushes it; or as many rows of them as pushes.

    side_friction: between probe and object. concentration: where the weight presses that is not on corners: what a
    uniform pressure has at a share s of the way from the centre to the outline stands at s ** concentration; 1:
    uniform, less: farther out. corner_share: share of the weight on the corners of the outline, if it has any.
    centre_x, centre_y: of pressure, from the outline's centroid, in the body's frame (m). probe_x, probe_y: how far the
    probe is from where it is said to be, in the world (m). anisotropy_x, anisotropy_y: of the table's friction, times
    cosine and sine of twice the direction of its grain in the world.
    """

    side_friction: float | np.ndarray = 0.2
    concentration: float | np.ndarray = 1.4
    corner_share: float | np.ndarray = 0.35
    centre_x: float | np.ndarray = 0.0
    centre_y: float | np.ndarray = 0.0
    probe_x: float | np.ndarray = 0.0
    probe_y: float | np.ndarray = 0.0
    anisotropy_x: float | np.ndarray = 0.0
    anisotropy_y: float | np.ndarray = 0.0

    @classmethod
    def of(cls, scores: Float[np.ndarray, "*pushes 9"]) -> "Unknowns":
        """From standard scores: how far each is from its nominal value, over its prior deviation."""
        away = np.moveaxis(np.clip(scores, -FARTHEST, FARTHEST) * DEVIATION, -1, 0)
        return cls(*(scale.back(scale.of(n) + a) for scale, n, a in zip(SCALES, NOMINAL, away, strict=True)))

    @property
    def scores(self) -> Float[np.ndarray, "*pushes 9"]:
        """The standard scores; see `of`."""
        values = zip(SCALES, map(np.asarray, self), NOMINAL, strict=True)
        return np.stack([scale.of(v) - scale.of(n) for scale, v, n in values], -1) / DEVIATION


class Scale(NamedTuple):
    """A scale on which an unknown is Gaussian: from a value to it, back, and how fast values change along it."""

    of: Callable[[Any], Any]
    back: Callable[[Any], Any]
    slope: Callable[[float], float]


LINEAR = Scale(lambda value: value, lambda at: at, lambda value: 1.0)
FACTOR = Scale(np.log, np.exp, lambda value: value)
SHARE = Scale(
    lambda value: np.log(value / (1 - value)), lambda at: 1 / (1 + np.exp(-at)), lambda value: value * (1 - value)
)
SCALES = (FACTOR, FACTOR, SHARE, *6 * (LINEAR,))
NOMINAL = Unknowns()
DEVIATION = np.array([0.3, 0.7, 1.0, 3e-3, 3e-3, 1e-3, 1e-3, 0.1, 0.1])
"""Of the priors, each on its scale: nobody who puts a probe to a part on a table knows these better without measuring
them."""
FARTHEST = 4.0
"""No unknown is farther from its nominal value (prior deviations)."""
UNITS = ("", "", "", "mm", "mm", "mm", "mm", "", "")
PROBE, GRAIN = slice(5, 7), slice(7, 9)
"""The unknowns of the probe, and of the table's grain, among all."""
EVEN = 1e-3
"""Deviation of the grain's scores where tables are taken to have none; one that is learnt of them makes up for other
errors, and serves pushes left out no better."""


class Estimate(NamedTuple):
    """Standard scores of the unknowns, Gaussian: mean and covariance."""

    mean: Float[np.ndarray, "9"]
    covariance: Float[np.ndarray, "9 9"]

    @classmethod
    def prior(cls) -> "Estimate":
        """What is known of unknowns before any push, on a table without grain."""
        covariance = np.eye(COUNT)
        covariance[GRAIN, GRAIN] *= EVEN**2
        return cls(np.zeros(COUNT), covariance)

    def with_grain(self) -> "Estimate":
        """The same, but that the table may have a grain."""
        covariance = self.covariance.copy()
        covariance[GRAIN], covariance[:, GRAIN] = 0.0, 0.0
        covariance[GRAIN, GRAIN] = np.eye(2)
        return Estimate(self.mean, covariance)

    @property
    def unknowns(self) -> Unknowns:
        """The likeliest values."""
        return Unknowns(*(float(value) for value in Unknowns.of(self.mean)))

    @property
    def deviations(self) -> Unknowns:
        """Standard deviation of each, in its own unit."""
        share = np.sqrt(np.diag(self.covariance)) * DEVIATION
        values = zip(SCALES, self.unknowns, share, strict=True)
        return Unknowns(*(float(scale.slope(float(v)) * s) for scale, v, s in values))

    def lines(self) -> list[str]:
        """In words: `side friction 0.17 +- 0.02` and so on; of the grain only if it was learnt."""
        values = list(zip(Unknowns._fields, self.unknowns, self.deviations, UNITS, strict=True))
        if np.diag(self.covariance)[GRAIN].max() < (2 * EVEN) ** 2:
            values = values[: GRAIN.start]
        return [
            f"{name.replace('_', ' ')} {value * _factor(unit):.2f} +- {deviation * _factor(unit):.2f} {unit}".rstrip()
            for name, value, deviation, unit in values
        ]


def _factor(unit: str) -> float:
    return 1e3 if unit == "mm" else 1.0
