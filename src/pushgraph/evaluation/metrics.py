"""Errors of a rollout against the truth, and how far probabilities can be trusted."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.pose import wrap_angle
from pushgraph.track import Track

MOVED = 0.01
"""An object whose true position changes by more than this (m) counts as moved."""
CALIBRATION_BINS = 15
"""Equal bins of the likeliest answer's probability, in which it is compared with how often the answer is right."""


class RolloutError:
    """Errors of the first `frames` frames of a rollout, frame 0 its start; the robot is left out.

    Raises ValueError if either track is shorter.
    """

    def __init__(self, predicted: Track, true: Track, frames: int) -> None:
        if min(len(predicted.times), len(true.times)) < frames:
            raise ValueError(f"both tracks need {frames} frames, got {len(predicted.times)} and {len(true.times)}")
        difference = predicted.poses[:frames, 1:] - true.poses[:frames, 1:]
        self.distance: Float[np.ndarray, "frames objects"] = np.hypot(difference[..., 0], difference[..., 1])
        """Position error (m)."""
        self.final_yaw: Float[np.ndarray, " objects"] = np.abs(wrap_angle(difference[-1, :, 2]))
        """Yaw error of each object at the last frame (rad)."""
        displacement = true.poses[frames - 1, 1:, :2] - true.poses[0, 1:, :2]
        self.displacement: Float[np.ndarray, " objects"] = np.hypot(*displacement.T)
        """How far each object truly is from where it started (m)."""

    @property
    def mean(self) -> float:
        """Mean over frames and objects of the position error (m): the paper's error of a trajectory."""
        return float(self.distance.mean())

    @property
    def final(self) -> Float[np.ndarray, " objects"]:
        """Position error of each object at the last frame (m)."""
        return self.distance[-1]

    @property
    def moved(self) -> Bool[np.ndarray, " objects"]:
        """Which objects truly moved by more than 1 cm."""
        return self.displacement > MOVED


def calibration_bin(top: Float[np.ndarray, "*values"]) -> Int[np.ndarray, "*values"]:
    """The bin of each answer, given with probability `top`."""
    return np.minimum((np.asarray(top) * CALIBRATION_BINS).astype(np.int64), CALIBRATION_BINS - 1)


class Reliability(NamedTuple):
    """How sure answers were on average, how often they were right, and what share of all they are, in each bin."""

    sure: Float[np.ndarray, " bins"]
    right: Float[np.ndarray, " bins"]
    share: Float[np.ndarray, " bins"]


def reliability(top: Float[np.ndarray, " values"], right: Bool[np.ndarray, " values"]) -> Reliability:
    """Compare the probabilities of answers with how often they are right; NaN in bins without any."""
    place = calibration_bin(top)
    total = np.bincount(place, minlength=CALIBRATION_BINS)
    there = np.where(total > 0, total, np.nan)
    sure, hits = (np.bincount(place, values, CALIBRATION_BINS) for values in (top, right))
    return Reliability(sure / there, hits / there, total / max(len(top), 1))
