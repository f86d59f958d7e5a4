"""Frames of a track: its arrays, without the scene that they belong to."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

FRAME = 0.05
"""Seconds from one frame to the next."""
ON_TIME = 1e-6
"""Times this near to each other (s) are the same."""
LIFTED = -1
"""Stands for the push while the tool is lifted."""


class Frames(NamedTuple):
    """Fields of a track; see `Track`."""

    times: Float[np.ndarray, " frames"]
    poses: Float[np.ndarray, "frames nodes 3"]
    push: Int[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames nodes"]
    wrench: Float[np.ndarray, "frames 3"] | None = None
