"""Where bodies press on the table, as tensors: a few feet a body, as the simulator has them.

A body by itself stands on six feet: the middles of its outline's cells, parted in three across its longer extent and
each of these in two across its own (see `pushgraph.simulation.feet`, which does the same for any outline).
"""

import functools
import math
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.body import Body
from pushgraph.contact import RoundedBox
from pushgraph.patch import patch_of
from pushgraph.shape import Cylinder
from pushgraph.simulation.feet import ROUND, SPIN, feet_of

COUNT = 6


class BodyFeet(NamedTuple):
    """Feet of each body in its own frame: where (m), what share of its weight, and friction radius (m): a foot's torque
    in spin over its friction."""

    points: Float[Tensor, "*bodies feet 2"]
    shares: Float[Tensor, "*bodies feet"]
    radii: Float[Tensor, "*bodies feet"]


def feet_of_shapes(shapes: RoundedBox, is_cylinder: Bool[Tensor, "*bodies"]) -> BodyFeet:
    """Feet of cuboids and cylinders that press uniformly on the table."""
    unit = _feet_of_unit_disc()
    disc = BodyFeet(*(values.to(shapes.radius) for values in unit))
    half_x, half_y = shapes.half_extents.unbind(-1)
    # Nearly square ones are parted along x first.
    turned = half_y > half_x * math.sqrt(ROUND)
    longer, shorter = torch.where(turned, half_y, half_x), torch.where(turned, half_x, half_y)
    # Cells of long ones are longer in the same direction, and then all feet stand in a row.
    in_a_row = (longer / 3 > shorter * math.sqrt(ROUND))[..., None]
    thirds, halves = longer.new_tensor([-2 / 3, -2 / 3, 0, 0, 2 / 3, 2 / 3]), longer.new_tensor([-0.5, 0.5] * 3)
    along = longer[..., None] * torch.where(in_a_row, thirds + halves / 3, thirds)
    across = shorter[..., None] * torch.where(in_a_row, 0.0, halves)
    turned = turned[..., None]
    box = torch.stack((torch.where(turned, across, along), torch.where(turned, along, across)), -1)
    long, short = longer.clamp(min=1e-6), shorter.clamp(min=1e-6)
    cell = torch.where(in_a_row[..., 0], _mean_radius(long / 6, short), _mean_radius(long / 3, short / 2))
    cylinder, radius = is_cylinder[..., None], shapes.radius[..., None]
    return BodyFeet(
        points=torch.where(cylinder[..., None], disc.points * radius[..., None], box),
        shares=torch.where(cylinder, disc.shares, 1 / COUNT),
        radii=torch.where(cylinder, disc.radii * radius, SPIN * cell[..., None]),
    )


@functools.cache
@torch.inference_mode(False)
def _feet_of_unit_disc() -> BodyFeet:
    """Of radius 1 m."""
    disc = Body(name="disc", shape=Cylinder(diameter=2.0), pose_world_from_body=(0.0, 0.0, 0.0), mass=1.0)
    feet = feet_of(patch_of([disc]))
    return BodyFeet(*(torch.from_numpy(values).float() for values in feet))


def _mean_radius(half_x: Tensor, half_y: Tensor) -> Tensor:
    """Mean distance of a rectangle's points from its middle."""
    diagonal = torch.hypot(half_x, half_y)
    return (
        diagonal / 3
        + half_x.square() / (6 * half_y) * torch.asinh(half_y / half_x)
        + half_y.square() / (6 * half_x) * torch.asinh(half_x / half_y)
    )
