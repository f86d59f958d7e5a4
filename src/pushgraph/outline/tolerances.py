"""How exactly parts follow an outline, and how small and large they are."""

import math

FLAT = 1e-4
"""How far (m) a facet may lie off the outline that it stands for."""
ROUND = 1.5e-4
"""How far (m) a disc may lie off the outline that it stands for."""
TURN = math.radians(3)
"""How far the normal of a facet or of a disc may be turned from that of the outline."""
CORNER = math.radians(25)
"""A vertex that turns by more is a corner; by less, it is a point of a curve."""
DEPTH = 5e-3
"""Parts are at least so deep (m) where the body allows."""
THINNEST = 1e-3
"""Least side or diameter of a part (m)."""
PROTRUSION = 2e-5
"""How far (m) a rectangle along a straight edge may stick out of another edge."""
