"""Exact integrals over shapes, to compare with."""

import math

from pushgraph.shape import Cuboid, Cylinder


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
