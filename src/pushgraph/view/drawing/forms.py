"""Shapes of bodies as a few unit solids and sizes, so that bodies of one kind are drawn together."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.polygon import orient

from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.view.drawing.solids import Solid, circle, outline_of, prism

RIM, THIN_RIM = 0.0012, 0.0004
"""So much larger than a body, on each side, is the solid whose far side is seen as its rim; of boxes in space (m)."""
_SQUARE = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])
STANDING_BOX, CENTRED_BOX, CYLINDER = prism(_SQUARE, 0.0, 1.0), prism(_SQUARE, -0.5, 0.5), prism(circle(0.5), 0.0, 1.0)
"""Of lengths 1; the first and the last stand on z = 0."""

Size = tuple[float, float, float]


class Form(NamedTuple):
    """A solid in a body's frame, and a slightly larger one; each of a size over that of the unit solid."""

    solid: Solid
    size: Size
    rim: Solid
    rim_size: Size


def form_of(shape: Cylinder | Cuboid | Polygon) -> Form:
    """Of a body that stands on the table."""
    if isinstance(shape, Polygon):
        return _form_of_polygon(shape)
    half_x, half_y, radius = shape.core
    unit = CYLINDER if radius else STANDING_BOX
    x, y, z = 2 * (half_x + radius), 2 * (half_y + radius), shape.height
    return Form(unit, (x, y, z), unit, (x + 2 * RIM, y + 2 * RIM, z + RIM))


def form_of_box(size: Size) -> Form:
    """Of a box around its centre; full lengths (m)."""
    x, y, z = size
    return Form(CENTRED_BOX, size, CENTRED_BOX, (x + 2 * THIN_RIM, y + 2 * THIN_RIM, z + 2 * THIN_RIM))


@lru_cache(maxsize=256)
def _form_of_polygon(shape: Polygon) -> Form:
    outline = outline_of(shape)
    solid = prism(outline, 0.0, shape.height)
    rim = prism(_grown(outline), 0.0, shape.height + RIM)
    return Form(solid, (1.0, 1.0, 1.0), rim, (1.0, 1.0, 1.0))


def _grown(outline: Float[np.ndarray, "corners 2"]) -> Float[np.ndarray, "other_corners 2"]:
    grown = orient(shapely.Polygon(outline).buffer(RIM, join_style="mitre"))
    return shapely.get_coordinates(grown.exterior)[:-1]
