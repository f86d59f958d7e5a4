"""Shapes seen from above, and the units that every record is made of: metres and radians."""

import functools
import math
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from pushgraph import outline
from pushgraph.arrays import Array
from pushgraph.contact import RoundedBox
from pushgraph.record import Record

Coordinate = Annotated[float, Field(ge=-100, le=100)]
Angle = Annotated[float, Field(ge=-100, le=100)]
Length = Annotated[float, Field(ge=0.001, le=20)]
Point = tuple[Coordinate, Coordinate]
Pose = tuple[Coordinate, Coordinate, Angle]


class Cylinder(Record):
    """An upright cylinder."""

    kind: Literal["cylinder"] = "cylinder"
    diameter: Length
    height: Length = 0.10

    @property
    def core(self) -> tuple[float, float, float]:
        """Half extents and radius of the rounded box that this shape is, seen from above (m)."""
        return 0.0, 0.0, self.diameter / 2

    @property
    def reach(self) -> float:
        """Distance from its origin to its farthest point (m)."""
        return math.hypot(*self.core[:2]) + self.core[2]

    @property
    def centroid(self) -> Point:
        """Centroid of its outline in the body's frame (m)."""
        return (0.0, 0.0)

    @property
    def parts(self) -> tuple["PlacedShape", ...]:
        """The rigid parts that it consists of: itself."""
        return (PlacedShape(self),)


class Cuboid(Record):
    """An upright cuboid; `size` is its full extent along its own x and y."""

    kind: Literal["cuboid"] = "cuboid"
    size: tuple[Length, Length]
    height: Length = 0.10

    @property
    def core(self) -> tuple[float, float, float]:
        """Half extents and radius of the rounded box that this shape is, seen from above (m)."""
        return self.size[0] / 2, self.size[1] / 2, 0.0

    @property
    def reach(self) -> float:
        """Distance from its origin to its farthest point (m)."""
        return math.hypot(*self.core[:2]) + self.core[2]

    @property
    def centroid(self) -> Point:
        """Centroid of its outline in the body's frame (m)."""
        return (0.0, 0.0)

    @property
    def parts(self) -> tuple["PlacedShape", ...]:
        """The rigid parts that it consists of: itself."""
        return (PlacedShape(self),)


class Polygon(Record):
    """An upright prism over any simple outline, convex or not, its points in either direction.

    The body's frame is that of the points: its origin need not be the centroid.
    """

    kind: Literal["polygon"] = "polygon"
    points: Annotated[tuple[Point, ...], Field(min_length=3, max_length=1000)]
    """Corners of the outline in the body's frame, in order; the last is joined to the first."""
    height: Length = 0.10

    @field_validator("points")
    @classmethod
    def _simple(cls, points: tuple[Point, ...]) -> tuple[Point, ...]:
        fault = outline.fault_of(points)
        if fault:
            raise ValueError(fault)
        return points

    @property
    def reach(self) -> float:
        """Distance from its origin to its farthest point (m)."""
        return max(math.hypot(*point) for point in self.points)

    @property
    def centroid(self) -> Point:
        """Centroid of its outline in the body's frame (m)."""
        x, y = outline.centroid(np.array(self.points)).tolist()
        return (x, y)

    @property
    def parts(self) -> tuple["PlacedShape", ...]:
        """Cuboids and cylinders that together touch as the outline touches, to within 0.5 mm; cut once, then kept."""
        return _parts_of(self.points, self.height)


class PlacedShape(NamedTuple):
    """A part of a body."""

    shape: Cylinder | Cuboid
    pose_body_from_part: Pose = (0.0, 0.0, 0.0)


@functools.lru_cache(maxsize=1024)
def _parts_of(points: tuple[Point, ...], height: float) -> tuple[PlacedShape, ...]:
    return tuple(
        PlacedShape(
            Cylinder(diameter=2 * piece.radius, height=height)
            if piece.radius
            else Cuboid(size=piece.lengths, height=height),
            piece.pose_outline_from_cut,
        )
        for piece in outline.cut(points)
    )


Shape = Annotated[Cylinder | Cuboid, Field(discriminator="kind")]
"""What one part of a tool may be."""
BodyShape = Annotated[Cylinder | Cuboid | Polygon, Field(discriminator="kind")]
"""What a body may be."""


def simple(shape: Cylinder | Cuboid | Polygon) -> Cylinder | Cuboid:
    """The shape itself; for scenes that hold no polygons, or in which they were taken apart."""
    assert not isinstance(shape, Polygon)
    return shape


def rounded_boxes(shapes: Sequence[Cylinder | Cuboid]) -> RoundedBox:
    """Shapes as one batch for `pushgraph.contact` (float64)."""
    cores = np.array([shape.core for shape in shapes], dtype=float).reshape(-1, 3)
    return RoundedBox(cores[:, :2], cores[:, 2])


def take(boxes: RoundedBox, index: Array) -> RoundedBox:
    """Some rows of a batch of shapes."""
    return RoundedBox(boxes.half_extents[index], boxes.radius[index])
