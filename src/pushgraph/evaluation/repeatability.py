"""What no model can be better than: how far apart pushes end that were repeated almost exactly."""

import numpy as np
from jaxtyping import Float, Int

from pushgraph.adaptation.prediction import contact_points
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import RealPushes

ALIKE = 1.5e-3
"""Pushes whose first contacts, and ways from there, differ by less than this (m) in the object's frame are repeated."""


def repeated(pushes: RealPushes) -> Int[np.ndarray, "pairs 2"]:
    """Pairs of pushes of one object on one surface that are repeated, perhaps at another speed."""
    touch = contact_points(pushes)
    way = pushes.end_in_body - touch
    found = [np.zeros((0, 2), dtype=int)]
    for surface, shape in pushes.materials:
        chosen = np.flatnonzero(pushes.of(surface, shape))
        apart = np.maximum(_distances(touch[chosen]), _distances(way[chosen]))
        first, second = np.nonzero(np.triu(apart < ALIKE, 1))
        found.append(np.stack((chosen[first], chosen[second]), -1))
    return np.concatenate(found)


def repeatability(pushes: RealPushes, pairs: Int[np.ndarray, "pairs 2"]) -> Float[np.ndarray, "pairs 2"]:
    """Errors (mm, degrees) that the best prediction would have: differences within pairs, over the root of two."""
    apart = pushes.motion[pairs[:, 0]] - pushes.motion[pairs[:, 1]]
    turned = np.degrees(np.abs(wrap_angle(apart[:, 2])))
    return np.stack((1e3 * np.hypot(apart[:, 0], apart[:, 1]), turned), -1) / np.sqrt(2)


def _distances(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points points"]:
    return np.linalg.norm(points[:, None] - points, axis=-1)
