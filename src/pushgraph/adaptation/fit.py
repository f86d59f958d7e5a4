"""Physical unknowns from pushes: the likeliest, by Gauss-Newton through batched rollouts, and how sure they are."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.prediction import predicted_motion
from pushgraph.adaptation.unknowns import COUNT, Estimate, Unknowns
from pushgraph.network.contract import Dynamics
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import RealPushes

SCALE = np.array([2e-3, 2e-3, np.radians(2.5)])
"""What pushes that are repeated alike differ by, about: errors count in these units (m, m, rad)."""
DEGREES = 4.0
"""Of freedom of the errors' Student t: objects that slip off the probe hardly count."""
DIFFERENCE = 0.3
"""Derivatives are taken over so much (prior deviations)."""
ITERATIONS = 5
LONGEST = 2.0
"""An iteration changes no unknown by more (prior deviations)."""
STEEPEST = 4.0
"""No motion changes by more (in SCALE) with an unknown (prior deviation): where objects slip off it jumps instead."""
SHORTEST = 0.03
"""The last iteration changes no unknown by more."""


class Linearized(NamedTuple):
    """Predicted motions (m, m, rad), and their derivatives with respect to the unknowns' standard scores."""

    motion: Float[np.ndarray, "pushes 3"]
    slope: Float[np.ndarray, "pushes 3 9"]


def linearized(dynamics: Dynamics, pushes: RealPushes, scores: Float[np.ndarray, "*pushes 9"]) -> Linearized:
    """Predictions and their finite differences, all in one rollout. scores: of all pushes, or a row for each."""
    count = len(pushes)
    changed = np.concatenate((np.zeros((1, COUNT)), DIFFERENCE * np.eye(COUNT)))
    rows = np.broadcast_to(scores, (count, COUNT)) + changed[:, None]
    everything = pushes.take(np.tile(np.arange(count), len(changed)))
    found = predicted_motion(dynamics, everything, Unknowns.of(rows.reshape(-1, COUNT))).reshape(-1, count, 3)
    change = found[1:] - found[0]
    change[..., 2] = wrap_angle(change[..., 2])
    return Linearized(found[0], np.moveaxis(change, 0, -1) / DIFFERENCE)


def residuals(motion: Float[np.ndarray, "pushes 3"], pushes: RealPushes) -> Float[np.ndarray, "pushes 3"]:
    """What was recorded less what is predicted (m, m, rad)."""
    apart = pushes.motion - motion
    apart[:, 2] = wrap_angle(apart[:, 2])
    return apart


def fit(dynamics: Dynamics, pushes: RealPushes, prior: Estimate, iterations: int = ITERATIONS) -> Estimate:
    """The unknowns that all these pushes have in common, given what was known of them before.

    Maximum a posteriori under errors of a Student t, by iteratively reweighted least squares; the covariance is that of
    the last linearization, for errors as large as they were found.
    """
    information = np.linalg.inv(prior.covariance)
    mean = prior.mean
    for _ in range(iterations):
        at = linearized(dynamics, pushes, mean)
        error, slope = residuals(at.motion, pushes) / SCALE, at.slope / SCALE[:, None]
        slope = slope * np.minimum(1.0, STEEPEST / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9))
        weight = weights(error)
        variance = max(1.0, float(weight @ (error**2).sum(1)) / (3 * len(error)))
        curvature = information + np.einsum("n,nak,nal->kl", weight, slope, slope) / variance
        gradient = np.einsum("n,nak,na->k", weight, slope, error) / variance - information @ (mean - prior.mean)
        step = np.linalg.solve(curvature, gradient)
        longest = np.abs(step).max()
        mean = mean + step * min(1.0, LONGEST / max(longest, 1e-9))
        if longest < SHORTEST:
            break
    return Estimate(mean, np.linalg.inv(curvature))


def weights(error: Float[np.ndarray, "pushes 3"]) -> Float[np.ndarray, " pushes"]:
    """How much each push counts: little, where its error is many times SCALE."""
    return (DEGREES + 3) / (DEGREES + (error**2).sum(1))
