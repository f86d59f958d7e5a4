"""Draw a scene around blocks: their places, the frictions and masses, joints between neighbours, and a table."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.patch import area_shares
from pushgraph.scene import Scene, Table
from pushgraph.simulation.articulation import draw_joints, place_anywhere
from pushgraph.simulation.block import Block, area_of, arrange
from pushgraph.simulation.outlines import log_uniform
from pushgraph.simulation.placement import NEIGHBOUR_GAP, place_cluster, place_clusters
from pushgraph.simulation.plan import Density
from pushgraph.simulation.pushers import draw_tool
from pushgraph.tool import Tool

PAPER_SIZE = 0.117
"""Mean size of the paper's bodies (m)."""
TABLE_FRICTION = (0.05, 1.5)
SIDE_FRICTION = (0.0, 1.0)
MASS = (0.2, 1.0)
MASS_PER_AREA = (20.0, 500.0)
"""kg/m^2, of bodies of one material."""
TABLE_SIDE = 2.0
"""Of the table (m), larger for more than a dozen objects, or larger ones."""


def table_side(objects: int) -> float:
    """Of a table (m) for so many objects of the paper's size."""
    return max(TABLE_SIDE, 0.55 * math.sqrt(objects))


def place_paper_blocks(
    rng: np.random.Generator, blocks: Sequence[Block], density: Density
) -> Float[np.ndarray, "blocks 3"]:
    """Poses of blocks of the paper's size: in one cluster, or in several."""
    if density == "dense":
        return place_cluster(rng, blocks)
    return place_clusters(rng, blocks, half_width=0.17 * math.sqrt(len(blocks)))


def draw_scene(
    rng: np.random.Generator,
    blocks: Sequence[Block],
    density: Density,
    size: float,
    tool: Tool | None = None,
    frictions: tuple[float, float] | None = None,
    anywhere: float = 0.25,
    even: bool = False,
    margin: float = 0.0,
) -> Scene:
    """A scene of blocks of about this size (m), with all that a kind does not settle.

    anywhere: share of scenes whose joints sit anywhere. even: whether all masses go with area. margin: how much wider
    the table is on each side (m).
    """
    scale = size / PAPER_SIZE
    gap = (NEIGHBOUR_GAP[0], min(NEIGHBOUR_GAP[1], max(0.004, NEIGHBOUR_GAP[1] * scale)))
    if density == "dense":
        poses = place_cluster(rng, blocks, gap)
    else:
        poses = place_clusters(rng, blocks, _half_width(blocks), gap)
    extent = float(max(np.abs(poses[:, :2]).max(1) + [block.reach for block in blocks]))
    tool = tool or draw_tool(rng, min(scale, 2.0))
    side = max(TABLE_SIDE, 2 * (extent + 3.5 * size + 2 * tool.reach + 0.4 + margin))
    table = log_uniform(rng, *TABLE_FRICTION), float(rng.uniform(*SIDE_FRICTION))
    table_friction, side_friction = frictions or table
    scene = arrange(
        blocks,
        poses,
        _draw_masses(rng, blocks, scale, even),
        table=Table(size=(side, side), friction=table_friction),
        side_friction=side_friction,
        tool=tool,
    )
    joined = draw_joints(rng, scene, gap[1])
    if rng.random() < anywhere:
        joined = tuple(place_anywhere(rng, scene, joint) for joint in joined)
    return scene.replace(joints=scene.joints + joined)


def _half_width(blocks: Sequence[Block]) -> float:
    """Of a square that has room for clusters of some blocks (m)."""
    return 1.3 * math.sqrt(sum((block.reach + 0.03) ** 2 for block in blocks))


def _draw_masses(rng: np.random.Generator, blocks: Sequence[Block], scale: float, even: bool) -> list[list[float]]:
    """Masses of the parts of each block (kg), those of bodies of the paper's size times the scale's square.

    Pieces come with their mass evenly spread, or unevenly over their parts. even: whether all masses go with area.
    """
    kind = 3 if even else rng.integers(4)
    uneven = not even and rng.random() < 0.5
    mass_per_area = log_uniform(rng, *MASS_PER_AREA)
    masses = []
    for block in blocks:
        own = np.zeros(len(block.parts))
        for piece in sorted(set(block.pieces)):
            members = np.flatnonzero(np.array(block.pieces) == piece)
            shapes = [block.parts[k] for k in members]
            area = sum(area_of(part.shape) for part in shapes)
            mass = mass_per_area * area if kind == 3 else scale**2 * _draw_mass(rng, int(kind))
            shares = area_shares(tuple(shapes)) if len(shapes) > 1 else np.ones(1)
            if uneven:
                shares = shares * np.exp(rng.normal(0.0, 1.0, len(shares)))
            own[members] = mass * shares / shares.sum()
        masses.append(own.tolist())
    return masses


def _draw_mass(rng: np.random.Generator, kind: int) -> float:
    if kind == 0:
        return float(rng.uniform(*MASS))
    if kind == 1:
        return log_uniform(rng, 0.2, 10.0)
    one = MASS_CLASSES[rng.integers(len(MASS_CLASSES))]
    return float(rng.uniform(one.lowest, one.highest))
