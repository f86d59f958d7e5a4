"""Outlines of bodies from above: which are valid, and how one is cut into rectangles and discs."""

import numpy as np
import shapely
from jaxtyping import Float

from pushgraph.outline.cutting import Cut, cut
from pushgraph.outline.tolerances import CORNER
from pushgraph.outline.validity import fault_of

__all__ = ["CORNER", "Cut", "centroid", "cut", "fault_of"]


def centroid(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """Centre of the area within an outline (m)."""
    return np.array(shapely.Polygon(points).centroid.coords[0])
