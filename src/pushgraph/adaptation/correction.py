"""A small correction of predicted motions, learnt from what is left of the errors of recorded ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.fit import SCALE, residuals
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.prediction import contact_points
from pushgraph.real_pushes import RealPushes

FARTHEST = 3.0
"""Errors farther than this (in SCALE) count as so far: the object slipped off."""
STRENGTHS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of a correction that are tried."""
FEWEST = 10
"""From fewer pushes no correction is learnt."""
MOST = 500
"""Of more pushes, so many, evenly chosen: the time grows with the third power."""
FEATURES = 11
"""Numbers that a correction sees of a push; see `features`."""
LENGTH, ARM, TURN, TABLE = 0.02, 0.03, 0.3, 0.05
"""Units of the features: of lengths, lever arms (m), turns (rad), and places on the table (m)."""


class Correction(NamedTuple):
    """position, yaw: processes of errors in SCALE, in the frame of the object. strength: share of their means that
    is added."""

    position: GaussianProcess
    yaw: GaussianProcess
    strength: float

    @classmethod
    def fit(cls, pushes: RealPushes, motion: Float[np.ndarray, "pushes 3"]) -> "Correction":
        """Learn what is left of the errors of predicted motions; its strength is what serves pushes left out best."""
        chosen = np.linspace(0, len(pushes) - 1, min(MOST, len(pushes))).round().astype(int)
        some, motion = pushes.take(chosen), motion[chosen]
        error = residuals(motion, some) / SCALE
        length = np.linalg.norm(error, axis=1)
        error = error * np.minimum(1.0, FARTHEST / np.maximum(length, 1e-9))[:, None]
        places = features(some, motion)
        position, yaw = GaussianProcess.fit(places, error[:, :2]), GaussianProcess.fit(places, error[:, 2:])
        expected = error - np.concatenate((position.left_out, yaw.left_out), 1)
        costs = [_cost(error - strength * expected) for strength in STRENGTHS]
        return cls(position, yaw, STRENGTHS[int(np.argmin(costs))])

    def motion(self, pushes: RealPushes, motion: Float[np.ndarray, "pushes 3"]) -> Float[np.ndarray, "pushes 3"]:
        """Corrected motions."""
        places = features(pushes, motion)
        expected = np.concatenate((self.position.mean(places), self.yaw.mean(places)), 1) * SCALE * self.strength
        return motion + expected

    def variance(self, pushes: RealPushes, motion: Float[np.ndarray, "pushes 3"]) -> Float[np.ndarray, "pushes 3"]:
        """Of the correction, per component."""
        places = features(pushes, motion)
        position, yaw = self.position.variance(places), self.yaw.variance(places)
        return np.stack((position, position, yaw), -1) * (SCALE * self.strength) ** 2

    @property
    def left_out(self) -> Float[np.ndarray, "samples 3"]:
        """Errors (m, m, rad) at the pushes that it was learnt from, each left out in turn."""
        processes = self.position, self.yaw
        values = np.concatenate([one.values for one in processes], 1)
        alone = np.concatenate([one.left_out for one in processes], 1)
        return (values - self.strength * (values - alone)) * SCALE


def features(pushes: RealPushes, motion: Float[np.ndarray, "pushes 3"]) -> Float[np.ndarray, "pushes 11"]:
    """Where the probe touches, how it goes on from there, and how the object is predicted to move, in its frame; with
    the heading in the world and the place on the table, since tables and cameras are not alike everywhere."""
    touch = contact_points(pushes)
    way = pushes.end_in_body - touch
    ahead = pushes.probe_end - pushes.probe_start
    ahead = ahead / np.hypot(*ahead.T)[:, None]
    seen = touch / ARM, way / LENGTH, motion[:, :2] / LENGTH, motion[:, 2:] / TURN
    return np.concatenate((*seen, ahead, pushes.before[:, :2] / TABLE), 1)


def _cost(error: Float[np.ndarray, "pushes 3"]) -> float:
    """Mean distance and turn, in SCALE."""
    return float((np.hypot(error[:, 0], error[:, 1]) + np.abs(error[:, 2])).mean())
