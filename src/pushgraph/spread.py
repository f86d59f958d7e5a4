"""How far off a prediction may be: the distribution of a body's error in every frame.

Closed forms throughout, so that regions, quantiles and samples are one thing. With q = (a / along)^2 + (c / across)^2
of an error's parts along and across, a position is a bivariate Student t of n degrees of freedom:

    P(q < R^2) = 1 - (1 + R^2 / n)^(-n / 2)

and with z = |error| / yaw a yaw is as likely either way, with a Pareto tail (Lomax) of n degrees:

    P(z < Z) = 1 - (1 + Z / n)^(-n)
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.arrays import is_tensor, namespace

Array = Any  # np.ndarray or Tensor, the same throughout
UNITS = dict(direction="rad", along="m", across="m", degrees="", farthest="m", yaw="rad", yaw_degrees="")


class Ellipse(NamedTuple):
    """A region around a predicted position. direction: of the half-axis `along`, in the world (rad). Both in m."""

    direction: Float[Array, "*batch"]
    along: Float[Array, "*batch"]
    across: Float[Array, "*batch"]


class Spread(NamedTuple):
    """The distribution of the errors of positions and yaws, NumPy or torch; errors are true less predicted.

    direction: of `along`, in the world (rad): the way the body has gone. along, across: scales of the position's
    error (m). degrees: of freedom, few where errors may be far beyond their scale. farthest: no position is farther
    off (m); what the distribution has beyond counts as there. yaw: scale of its error (rad). yaw_degrees: of freedom.

    Errors of different bodies count as independent, which joined ones are not.
    """

    direction: Float[Array, "*batch frames bodies"]
    along: Float[Array, "*batch frames bodies"]
    across: Float[Array, "*batch frames bodies"]
    degrees: Float[Array, "*batch frames bodies"]
    farthest: Float[Array, "*batch frames bodies"]
    yaw: Float[Array, "*batch frames bodies"]
    yaw_degrees: Float[Array, "*batch frames bodies"]

    def ellipse(self, probability: float | Float[Array, "..."]) -> Ellipse:
        """The smallest ellipse of its form that holds the true position with this probability, from 0 to 1."""
        radius = self._radius(1 - probability)
        return Ellipse(self.direction, radius * self.along, radius * self.across)

    def yaw_interval(self, probability: float | Float[Array, "..."]) -> Float[Array, "..."]:
        """Half the width of the interval that holds the true yaw with this probability (rad)."""
        return self._turn(1 - probability)

    def position_level(self, error: Float[Array, "... 2"]) -> Float[Array, "..."]:
        """Probability of the smallest ellipse that holds an error (m, world axes)."""
        along, across = _parts(error, self.direction)
        q = (along / self.along) ** 2 + (across / self.across) ** 2
        return 1 - (1 + q / self.degrees) ** (-self.degrees / 2)

    def yaw_level(self, error: Float[Array, "..."]) -> Float[Array, "..."]:
        """Probability of the narrowest interval that holds an error (rad)."""
        z = abs(pose.wrap_angle(error)) / self.yaw
        return 1 - (1 + z / self.yaw_degrees) ** -self.yaw_degrees

    def errors(self, uniform: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
        """The errors x, y (m, world axes), yaw (rad) that numbers drawn evenly from 0 to 1 stand for.

        The same numbers in every frame make one course of a body's error. Differentiable.
        """
        radius, angle = self._radius(uniform[..., 0]), 2 * math.pi * uniform[..., 1]
        xp = namespace(angle)
        own = xp.stack((radius * xp.cos(angle) * self.along, radius * xp.sin(angle) * self.across), axis=-1)
        signed = 2 * uniform[..., 2] - 1
        turn = xp.sign(signed) * self._turn(1 - abs(signed))
        return xp.concatenate((pose.rotate(own, self.direction), turn[..., None]), axis=-1)

    def sample(self, rng: np.random.Generator, count: int) -> Float[Array, "samples ... 3"]:
        """Draw errors x, y (m, world axes), yaw (rad); in a sample those of a body belong together in all frames."""
        *batch, frames, bodies = self.along.shape
        uniform = np.broadcast_to(rng.random((count, *batch, 1, bodies, 3)), (count, *batch, frames, bodies, 3))
        return self.errors(self.along.new_tensor(uniform) if is_tensor(self.along) else uniform)

    def numpy(self) -> "Spread":
        """The same as NumPy arrays in float64."""
        arrays = (values.detach().cpu() if is_tensor(values) else values for values in self)
        return Spread(*(np.asarray(values, dtype=float) for values in arrays))

    def take(self, index: Any) -> "Spread":
        """Some of it: the arrays indexed."""
        return Spread(*(values[index] for values in self))

    def _radius(self, beyond: float | Float[Array, "..."]) -> Float[Array, "..."]:
        """In scales, of the ellipse beyond which errors are with this probability."""
        radius = (self.degrees * (_inverse(beyond) ** (2 / self.degrees) - 1)) ** 0.5
        return _smaller(radius, self.farthest / _larger(self.along, self.across))

    def _turn(self, beyond: float | Float[Array, "..."]) -> Float[Array, "..."]:
        turn = self.yaw * self.yaw_degrees * (_inverse(beyond) ** (1 / self.yaw_degrees) - 1)
        return _smaller(turn, math.pi + 0 * self.yaw)


def _parts(error: Float[Array, "... 2"], direction: Float[Array, "..."]) -> tuple[Array, Array]:
    own = pose.rotate(error, -direction)
    return own[..., 0], own[..., 1]


def _inverse(probability: float | Array) -> float | Array:
    """1 / probability; what is as good as impossible is still finite."""
    return 1 / (probability + 1e-12)


def _smaller(a: Array, b: Array) -> Array:
    return namespace(a).minimum(a, b)


def _larger(a: Array, b: Array) -> Array:
    return namespace(a).maximum(a, b)
