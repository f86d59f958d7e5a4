"""Rectangles and discs that cover an outline."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Parts(NamedTuple):
    """Rectangles and discs: rounded boxes, as in `pushgraph.contact` (m)."""

    centre: Float[np.ndarray, "parts 2"]
    yaw: Float[np.ndarray, " parts"]
    half: Float[np.ndarray, "parts 2"]
    radius: Float[np.ndarray, " parts"]

    def take(self, index: np.ndarray | list[int] | slice) -> "Parts":
        """Those with these indices."""
        return Parts(*(values[index] for values in self))

    def local(self, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "parts points 2"]:
        """The points in the frame of each part."""
        x, y = np.moveaxis(points - self.centre[:, None], -1, 0)
        cos, sin = np.cos(self.yaw)[:, None], np.sin(self.yaw)[:, None]
        return np.stack((cos * x + sin * y, cos * y - sin * x), -1)

    def gap(self, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "parts points"]:
        """Signed distance of each point from each part, negative inside."""
        beyond = np.abs(self.local(points)) - self.half[:, None]
        return np.hypot(*np.moveaxis(beyond.clip(min=0), -1, 0)) + beyond.max(-1).clip(max=0) - self.radius[:, None]

    def contain(self, points: Float[np.ndarray, "points 2"]) -> Bool[np.ndarray, "parts points"]:
        """Whether each point lies inside each part."""
        return np.concatenate([self.take(some).gap(points) <= 1e-6 for some in self.slices()])

    def slices(self) -> list[slice]:
        """So few parts at a time that what is computed for them stays in the cache."""
        return [slice(start, start + 64) for start in range(0, max(len(self.yaw), 1), 64)]

    @property
    def area(self) -> Float[np.ndarray, " parts"]:
        """Of each (m^2)."""
        return 4 * self.half.prod(-1) + np.pi * self.radius**2


def join(*batches: Parts) -> Parts:
    """All of them, in order."""
    return Parts(*(np.concatenate(columns) for columns in zip(*batches, strict=True)))
