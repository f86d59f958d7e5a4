"""The discs inside an outline that touch along its curves."""

import numpy as np
import shapely

from pushgraph.outline.parts import Parts
from pushgraph.outline.ring import Ring, Samples
from pushgraph.outline.tolerances import FLAT, THINNEST


def discs_within(ring: Ring, samples: Samples) -> Parts:
    """The largest disc inside that touches at each of some samples of curves.

    A disc of radius r that touches at p, with normal n, holds q not deeper than t if |p + r n - q| >= r - t, which is
    r <= (|q - p|^2 - t^2) / (2 (n (q - p) - t)).
    """
    at = np.flatnonzero(samples.curved)
    at = at[:: max(1, len(at) // 300)]
    point, normal = samples.point[at], samples.normal[at]
    boundary = np.concatenate((samples.point, ring.vertex))
    away = boundary - point[:, None]
    height = (away * normal[:, None]).sum(-1) - FLAT / 2
    limit = ((away**2).sum(-1) - (FLAT / 2) ** 2) / np.where(height > 0, 2 * height, 1)
    radius = np.where(height > 0, limit, np.inf).min(1, initial=10.0)
    keep = radius >= THINNEST / 2
    radius, centre = radius[keep], (point + radius[:, None] * normal)[keep]
    inside = shapely.contains_xy(ring.polygon, *centre.T) if len(centre) else np.zeros(0, bool)
    radius, centre = radius[inside], centre[inside]
    return Parts(centre, np.zeros(len(radius)), np.zeros((len(radius), 2)), radius)
