"""Where the probe truly is, from where pushes start: no push needs to be carried out to the end for it.

Recordings of pushes begin as the probe touches, or as it seems to. A probe that is nearer to the object than it is said
to be touches while there seems to be a gap; one that is farther away is cut off where outlines meet. So the gap at the
start is max(0, offset along the normal into the object), give or take what poses are measured to.
"""

import numpy as np
import shapely
from jaxtyping import Float

from pushgraph import pose
from pushgraph.adaptation.unknowns import DEVIATION, PROBE, Estimate
from pushgraph.real_pushes import RealPushes, depths, outline_of

FARTHEST = 3e-3
"""Pushes that start farther away than this (m) do not start as the probe touches."""
TOUCHING, SHARE = 3e-4, 0.2
"""Unless at least this share of the pushes seems to start within so much (m) of touching, starts say nothing."""
NOISE = 4e-4
"""Of the gap at the start (m): scale of a Student t of four degrees of freedom."""
LARGEST, STEP = 4e-3, 1e-4
"""Offsets are tried on a grid: up to this in x and y, in such steps (m)."""
SUREST = 2e-4
"""No offset is known better (m): starts are cut where outlines meet only nearly."""
MOST = 600
"""Of more pushes, so many, evenly chosen."""


def from_starts(pushes: RealPushes, known: Estimate) -> Estimate:
    """What is known of the probe once the starts of pushes on one surface are seen; all else stays."""
    gap, normal = _starts(pushes)
    if np.mean(np.abs(gap) < TOUCHING) < SHARE:
        return known
    near = np.flatnonzero(np.abs(gap) < FARTHEST)
    near = near[np.linspace(0, len(near) - 1, min(len(near), MOST)).round().astype(int)]
    line = np.arange(-LARGEST, LARGEST + STEP / 2, STEP)
    tried = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    expected = np.maximum(tried @ normal[near].T, 0.0)
    log = -2.5 * np.log1p(((gap[near] - expected) / NOISE) ** 2 / 4).sum(1)
    inverse = np.linalg.inv(known.covariance[PROBE, PROBE])
    away = tried / DEVIATION[PROBE] - known.mean[PROBE]
    log -= np.einsum("ni,ij,nj->n", away, inverse, away) / 2
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ tried
    spread = (tried - mean).T @ ((tried - mean) * weight[:, None]) + SUREST**2 * np.eye(2)
    found, covariance = known.mean.copy(), known.covariance.copy()
    covariance[PROBE], covariance[:, PROBE] = 0.0, 0.0
    found[PROBE] = mean / DEVIATION[PROBE]
    covariance[PROBE, PROBE] = spread / np.outer(DEVIATION[PROBE], DEVIATION[PROBE])
    return Estimate(found, covariance)


def _starts(pushes: RealPushes) -> tuple[Float[np.ndarray, " pushes"], Float[np.ndarray, "pushes 2"]]:
    """Gap between probe and outline at the start (m), and the normal there, from probe to object, in the world."""
    start = pushes.start_in_body
    gap, normal = np.zeros(len(pushes)), np.zeros((len(pushes), 2))
    for name in dict.fromkeys(pushes.shape.tolist()):
        chosen = np.flatnonzero(pushes.of(shape=name))
        polygon = shapely.Polygon(outline_of(pushes.shapes[name]))
        places = shapely.points(start[chosen])
        along = shapely.line_locate_point(polygon.exterior, places)
        nearest = shapely.get_coordinates(shapely.line_interpolate_point(polygon.exterior, along))
        outside = -depths(pushes.shapes[name], start[chosen])
        away = (nearest - start[chosen]) / np.where(np.abs(outside) < 1e-9, 1e-9, outside)[:, None]
        gap[chosen] = outside - pushes.probe_radius
        normal[chosen] = pose.rotate(away, pushes.before[chosen, 2])
    return gap, normal
