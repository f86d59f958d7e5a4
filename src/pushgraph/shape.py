"""Shapes seen from above, and the units that every record is made of: metres and radians."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import torch
from pydantic import Field

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


class Cuboid(Record):
    """An upright cuboid; `size` is its full extent along its own x and y."""

    kind: Literal["cuboid"] = "cuboid"
    size: tuple[Length, Length]
    height: Length = 0.10

    @property
    def core(self) -> tuple[float, float, float]:
        """Half extents and radius of the rounded box that this shape is, seen from above (m)."""
        return self.size[0] / 2, self.size[1] / 2, 0.0


Shape = Annotated[Cylinder | Cuboid, Field(discriminator="kind")]


def rounded_boxes(shapes: Sequence[Cylinder | Cuboid]) -> RoundedBox:
    """Shapes as one batch for `pushgraph.contact` (float64)."""
    cores = torch.tensor([shape.core for shape in shapes], dtype=torch.float64).reshape(-1, 3)
    return RoundedBox(cores[:, :2], cores[:, 2])


def take(boxes: RoundedBox, index: torch.Tensor) -> RoundedBox:
    """Some rows of a batch of shapes."""
    return RoundedBox(boxes.half_extents[index], boxes.radius[index])


def mean_radius(shape: Cylinder | Cuboid) -> float:
    """Mean distance (m) of a shape's points from its centre: friction torque in spin is mu m g times this."""
    half_x, half_y, radius = shape.core
    if radius:
        return 2 * radius / 3
    diagonal = math.hypot(half_x, half_y)
    return (
        diagonal / 3
        + half_x**2 / (6 * half_y) * math.asinh(half_y / half_x)
        + half_y**2 / (6 * half_x) * math.asinh(half_x / half_y)
    )


def mean_squared_radius(shape: Cylinder | Cuboid) -> float:
    """Mean squared distance (m^2) of a shape's points from its centre: its moment of inertia per kilogram."""
    half_x, half_y, radius = shape.core
    return radius**2 / 2 if radius else (half_x**2 + half_y**2) / 3
