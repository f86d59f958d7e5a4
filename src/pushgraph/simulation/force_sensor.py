"""A force sensor between arm and tool: what it reads of the simulated wrench."""

import numpy as np
from jaxtyping import Float

FORCE_NOISE, MOMENT_NOISE = 0.3, 0.01
"""Standard deviation of a frame's reading, of each component of the force (N) and of the moment (N m)."""


def measured_wrench(
    wrench: Float[np.ndarray, "frames 3"],
    rng: np.random.Generator,
    force: float = FORCE_NOISE,
    moment: float = MOMENT_NOISE,
) -> Float[np.ndarray, "frames 3"]:
    """Readings of force (N) and moment (N m) with normal noise of these standard deviations, each by itself."""
    return wrench + rng.normal(size=wrench.shape) * [force, force, moment]
