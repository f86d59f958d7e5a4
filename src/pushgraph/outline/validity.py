"""What an outline must be."""

import functools
import re

import numpy as np
import shapely

from pushgraph.outline.tolerances import THINNEST

LARGEST = 20.0
"""Longest outline (m)."""


@functools.lru_cache(maxsize=1024)
def fault_of(points: tuple[tuple[float, float], ...]) -> str | None:
    """What keeps these points from being an outline: what is wrong, where, and what is valid; None if nothing does."""
    array = np.array(points)
    same = np.flatnonzero((array == np.roll(array, -1, 0)).all(-1))
    if len(same):
        k, following = int(same[0]), (int(same[0]) + 1) % len(points)
        closing = "; an outline closes itself, so leave the last one out" if following == 0 else ""
        return f"points {k} and {following} are the same, {list(points[k])}; each must differ from the next{closing}"
    extent = np.ptp(array, axis=0)
    if extent.max() > LARGEST:
        return f"the outline is {extent.max():.3g} m long; at most {LARGEST:g} m is valid"
    polygon = shapely.Polygon(array)
    if shapely.minimum_rotated_rectangle(polygon).area < 1e-3 * THINNEST * extent.max():
        return "the points lie on one line; an outline must enclose an area"
    if not polygon.is_valid:
        x, y = (float(number) for number in re.findall(r"[^\s\[\]]+", shapely.is_valid_reason(polygon))[-2:])
        return f"the outline crosses or touches itself at [{x:.6g}, {y:.6g}] m; it must be simple"
    if polygon.area < THINNEST**2:
        return f"the outline encloses {polygon.area * 1e6:.3g} mm^2; at least {THINNEST**2 * 1e6:g} mm^2 is valid"
    return None
