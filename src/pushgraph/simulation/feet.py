"""Feet: a few points that stand for what a body or piece presses on the table with.

The patch is parted across its longer extent into cells of equal weight, and each of these again. A foot stands at the
middle of each cell, bears its weight, and resists spin nearly as the cell does. There are as few feet as keep friction
within 3 % of the patch's on average over centres of rotation: six under a box or a disc, nine under a T.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.patch import Patch

PARTINGS = ((3, 2), (3, 3))
"""Into how many cells the patch is parted, and then each of them; the first that serves is taken, or the last."""
FEW = 9
"""A patch of no more points stands on these."""
LARGEST_ERROR = 0.028
"""Of friction, as `friction_error` has it."""
SPIN = 0.75
"""Friction radius of a foot, as a share of the mean distance of its cell's points from its middle. Most feet slide more
than they spin, and then a cell's spin takes less from its friction than a foot's does; this serves best on average."""
ROUND = 1.1
"""Cells whose second moments differ by less than this factor have no longer axis: that of their frame serves."""
SAME = 1e-9
"""Points whose coordinates differ by less than this (m) are parted alike."""


class Feet(NamedTuple):
    """Points (m), shares of the weight (sum 1) and friction radii (m): a foot's torque in spin over its friction."""

    points: Float[np.ndarray, "feet 2"]
    weights: Float[np.ndarray, " feet"]
    radii: Float[np.ndarray, " feet"]


def feet_of(patch: Patch) -> Feet:
    """The feet of a patch: its own points, if they are few. Those of its mirror image are their mirror images."""
    if len(patch.points) <= FEW:
        return Feet(patch.points, patch.weights, np.zeros(len(patch.points)))
    for partings in PARTINGS:
        feet = _feet(patch, partings)
        if friction_error(feet, patch) <= LARGEST_ERROR:
            break
    return feet


def friction_error(feet: Feet, patch: Patch) -> float:
    """How far the friction of feet is from that of the patch, over the friction in a slide: the mean over centres of
    rotation in eight directions from the centre of pressure, at a quarter to four mean radii. Torque counts about that
    centre, over the mean radius.
    """
    centre, mean_radius = patch.centre, patch.mean_radius
    angle = np.arange(8) * math.pi / 4
    distance = mean_radius * np.array([0.25, 0.5, 1.0, 2.0, 4.0])
    around = np.stack((np.cos(angle), np.sin(angle)), -1)
    rotation_centres = centre + (distance[:, None, None] * around).reshape(-1, 2)
    whole = Feet(patch.points, patch.weights, np.zeros(len(patch.weights)))
    force, torque = (
        of_feet - of_patch
        for of_feet, of_patch in zip(
            _friction(feet, rotation_centres, centre), _friction(whole, rotation_centres, centre), strict=True
        )
    )
    return float(np.hypot(np.linalg.norm(force, axis=-1), torque / mean_radius).mean())


def _friction(
    feet: Feet, rotation_centres: Float[np.ndarray, "centres 2"], about: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "centres 2"], Float[np.ndarray, " centres"]]:
    """Force on feet that turn about each centre, and torque about a point; their weight and the coefficient are 1."""
    x, y = np.moveaxis(feet.points - rotation_centres[:, None], -1, 0)
    # No foot that is itself the centre slides.
    strength = feet.weights / np.maximum(np.sqrt(x**2 + y**2 + feet.radii**2), SAME)
    force_x, force_y = y * strength, -x * strength
    arm_x, arm_y = (feet.points - about).T
    torque = arm_x * force_y - arm_y * force_x - feet.radii**2 * strength
    return np.stack((force_x.sum(-1), force_y.sum(-1)), -1), torque.sum(-1)


def _feet(patch: Patch, partings: tuple[int, ...]) -> Feet:
    parts = [patch.weights]
    for count in partings:
        parts = [part for cell in parts for part in _parted(patch.points, cell, count)]
    cells = np.array(parts)
    weights = cells.sum(-1)
    points = cells @ patch.points / weights[:, None]
    distances = np.linalg.norm(patch.points - points[:, None], axis=-1)
    return Feet(points, weights, SPIN * (cells * distances).sum(-1) / weights)


def _parted(
    points: Float[np.ndarray, "points 2"], weights: Float[np.ndarray, " points"], count: int
) -> Float[np.ndarray, "{count} points"]:
    """Part weighted points across their longer extent into cells of equal weight, as the weights that each has there.

    Points that lie alike are parted alike, in shares: so a symmetric patch has symmetric cells.
    """
    centred = points - weights @ points / weights.sum()
    moments, axes = np.linalg.eigh((centred * weights[:, None]).T @ centred)
    along = centred[:, 0] if moments[1] < ROUND * moments[0] else centred @ axes[:, 1]
    _, level = np.unique(np.round(along / SAME), return_inverse=True)
    of_level = np.bincount(level, weights)
    upper = np.cumsum(of_level)
    lower = upper - of_level
    bounds = np.linspace(0.0, upper[-1], count + 1)[:, None]
    inside = np.minimum(upper, bounds[1:]) - np.maximum(lower, bounds[:-1])
    shares = inside.clip(min=0.0) / np.where(of_level > 0, of_level, 1.0)
    return shares[:, level] * weights
