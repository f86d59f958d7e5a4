"""How far off predictions of real pushes may be: from unknowns that are not known better, and from what repeats alike
still differ by."""

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.fit import Linearized
from pushgraph.real_pushes import RealPushes
from pushgraph.spread import Spread

REST, SHARE = 3e-4, 0.08
"""What nothing explains: so much of a body at rest (m), and so much of its way."""
REST_TURN, TURN = np.radians(1.0), 0.13
"""The same of turning: (rad), and in shares of its way over its reach."""
DEGREES = 4.0
"""Of freedom of the errors: objects slip off the probe."""
TO_TAIL = 0.85
"""Scale of a Pareto tail for a normal deviation of yaw."""


def covariance(
    pushes: RealPushes,
    at: Linearized,
    unknowns: Float[np.ndarray, "*pushes 9 9"],
    further: Float[np.ndarray, "pushes 3"] | None = None,
) -> Float[np.ndarray, "pushes 3 3"]:
    """Covariance of the errors of motions (m, m, rad). unknowns: of their standard scores. further: variances of a
    correction."""
    found = at.slope @ unknowns @ np.swapaxes(at.slope, -1, -2)
    way = np.hypot(at.motion[:, 0], at.motion[:, 1])
    reach = np.array([pushes.shapes[name].reach for name in pushes.shape.tolist()])
    noise = np.stack((*[REST**2 + (SHARE * way) ** 2] * 2, REST_TURN**2 + (TURN * way / reach) ** 2), -1)
    noise = noise if further is None else noise + further
    return found + noise[:, :, None] * np.eye(3)


def spread_of(
    pushes: RealPushes,
    covariance: Float[np.ndarray, "pushes 3 3"],
    position: Float[np.ndarray, " pushes"] | float = 1.0,
    yaw: Float[np.ndarray, " pushes"] | float = 1.0,
) -> Spread:
    """The spread of final poses, one each, in the world; position, yaw: factors of its deviations."""
    squares, axes = np.linalg.eigh(covariance[:, :2, :2])
    direction = np.arctan2(axes[:, 1, 1], axes[:, 0, 1]) + pushes.before[:, 2]
    turn = np.sqrt(covariance[:, 2, 2])
    ones = np.ones(len(pushes))
    return Spread(
        direction=direction,
        along=np.sqrt(squares[:, 1]) * position,
        across=np.sqrt(squares[:, 0]) * position,
        degrees=DEGREES * ones,
        farthest=ones,
        yaw=TO_TAIL * turn * yaw,
        yaw_degrees=DEGREES * ones,
    )
