"""What nobody told the robot about its pushes: a few numbers, each with a nominal value and how sure that is."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

COUNT = 6


class Unknowns(NamedTuple):
    """Physical unknowns of an object on a surface, and of the probe that pushes it; or as many rows of them as pushes.

    side_friction: between probe and object. concentration: where the weight presses: what a uniform pressure has at a
    share s of the way from the centre to the outline stands at s ** concentration; 1: uniform, less: farther out.
    centre_x, centre_y: of pressure, from the outline's centroid, in the body's frame (m). probe_x, probe_y: how far the
    probe is from where it is said to be, in the world (m).
    """

    side_friction: float | np.ndarray = 0.2
    concentration: float | np.ndarray = 1.0
    centre_x: float | np.ndarray = 0.0
    centre_y: float | np.ndarray = 0.0
    probe_x: float | np.ndarray = 0.0
    probe_y: float | np.ndarray = 0.0

    @classmethod
    def of(cls, scores: Float[np.ndarray, "*pushes 6"]) -> "Unknowns":
        """From standard scores: how far each is from its nominal value, over its prior deviation."""
        bounded = np.clip(scores, -FARTHEST, FARTHEST) * DEVIATION
        columns = zip(np.moveaxis(bounded, -1, 0), NOMINAL, LOG, strict=True)
        return cls(*(np.exp(part) * nominal if log else nominal + part for part, nominal, log in columns))

    @property
    def scores(self) -> Float[np.ndarray, "*pushes 6"]:
        """The standard scores; see `of`."""
        values = zip(map(np.asarray, self), NOMINAL, LOG, strict=True)
        return np.stack([np.log(v / n) if log else v - n for v, n, log in values], -1) / DEVIATION


NOMINAL = Unknowns()
LOG = (True, True, False, False, False, False)
"""Whether an unknown is a factor: then its deviation is that of its logarithm."""
DEVIATION = np.array([0.3, 0.7, 3e-3, 3e-3, 1e-3, 1e-3])
"""Of the priors: nobody who puts a probe to a part on a table knows these better without measuring them."""
FARTHEST = 4.0
"""No unknown is farther from its nominal value (prior deviations)."""
UNITS = ("", "", "mm", "mm", "mm", "mm")


class Estimate(NamedTuple):
    """Standard scores of the unknowns, Gaussian: mean and covariance."""

    mean: Float[np.ndarray, "6"]
    covariance: Float[np.ndarray, "6 6"]

    @classmethod
    def prior(cls) -> "Estimate":
        """What is known of unknowns before any push."""
        return cls(np.zeros(COUNT), np.eye(COUNT))

    @property
    def unknowns(self) -> Unknowns:
        """The likeliest values."""
        return Unknowns(*(float(value) for value in Unknowns.of(self.mean)))

    @property
    def deviations(self) -> Unknowns:
        """Standard deviation of each, in its own unit."""
        share = np.sqrt(np.diag(self.covariance)) * DEVIATION
        values = zip(self.unknowns, share, LOG, strict=True)
        return Unknowns(*(float(v * s) if log else float(s) for v, s, log in values))

    def lines(self) -> list[str]:
        """In words: `side friction 0.17 +- 0.02` and so on."""
        values = zip(Unknowns._fields, self.unknowns, self.deviations, UNITS, strict=True)
        return [
            f"{name.replace('_', ' ')} {value * _factor(unit):.2f} +- {deviation * _factor(unit):.2f} {unit}".rstrip()
            for name, value, deviation, unit in values
        ]


def _factor(unit: str) -> float:
    return 1e3 if unit == "mm" else 1.0
