"""Scenes of the paper's bodies whose joints sit anywhere: off the line of centres, on flush faces, in closed rings."""

import math

import numpy as np

from pushgraph.scene import Table
from pushgraph.shape import Cuboid, Cylinder, PlacedShape
from pushgraph.simulation.aiming import PushStyle
from pushgraph.simulation.articulation import draw_joints, place_anywhere
from pushgraph.simulation.block import Block, arrange, centred
from pushgraph.simulation.linkages import draw_ring
from pushgraph.simulation.placement import place_cluster, place_clusters
from pushgraph.simulation.plan import Density, Plan
from pushgraph.simulation.scenery import MASS, table_side

SIZE_MEAN, SIZE_SPREAD, SIZE_RANGE = 0.117, 0.023, (0.08, 0.16)
"""Of the paper's bodies (m)."""
PUSH_DISTANCE = 0.30
PUSH_SPEED = (0.10, 0.30)
"""Of the paper's pushes (m, m/s)."""
ANYWHERE = 0.75
"""Share of joints that sit anywhere; the others sit where a scene puts those that say no more."""
RING, RING_SIZE, RING_BARS = 0.2, (0.25, 0.4), 4
"""Share of scenes with a ring of hinged bars, how wide it is (m), and of how many bars."""
FLUSH, FLUSH_GAP = 0.3, 0.004
"""Share of places taken by two cuboids whose faces lie flush, and how far apart they are at most (m)."""


def draw_paper_length(rng: np.random.Generator) -> float:
    """Diameter or edge of a body of the paper (m)."""
    return float(np.clip(rng.normal(SIZE_MEAN, SIZE_SPREAD), *SIZE_RANGE))


def draw_paper_shape(rng: np.random.Generator) -> Cylinder | Cuboid:
    """A body of the paper."""
    if rng.random() < 0.5:
        return Cylinder(diameter=draw_paper_length(rng))
    return Cuboid(size=(draw_paper_length(rng), draw_paper_length(rng)))


def joints_anywhere(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Bodies, masses and pushes of the paper; joints anywhere, some on flush faces, some in rings."""
    blocks: list[Block] = []
    left = objects
    if left > RING_BARS and rng.random() < RING:
        blocks.append(draw_ring(rng, float(rng.uniform(*RING_SIZE)), RING_BARS))
        left -= RING_BARS
    while left:
        if left > 1 and rng.random() < FLUSH:
            blocks.append(_flush_pair(rng))
        else:
            blocks.append(Block.of(draw_paper_shape(rng)))
        left -= len(blocks[-1].parts)
    if density == "dense":
        poses = place_cluster(rng, blocks)
    else:
        poses = place_clusters(rng, blocks, half_width=0.17 * math.sqrt(objects) + 0.1)
    side = table_side(objects) + 0.5
    masses = [rng.uniform(*MASS, len(block.parts)).tolist() for block in blocks]
    scene = arrange(blocks, poses, masses, table=Table(size=(side, side)))
    joints = (
        place_anywhere(rng, scene, joint) if rng.random() < ANYWHERE else joint for joint in draw_joints(rng, scene)
    )
    scene = scene.replace(joints=(*scene.joints, *joints))
    return Plan(scene, density, PushStyle(PUSH_DISTANCE, float(rng.uniform(*PUSH_SPEED))), "joints_anywhere")


def _flush_pair(rng: np.random.Generator) -> Block:
    """Two cuboids side by side, their faces parallel, one shifted along the other."""
    first, second = (Cuboid(size=(draw_paper_length(rng), draw_paper_length(rng))) for _ in range(2))
    apart = (first.size[0] + second.size[0]) / 2 + float(rng.uniform(0.0, FLUSH_GAP))
    shift = float(rng.uniform(-0.3, 0.3)) * (first.size[1] + second.size[1])
    return Block.loose(centred((PlacedShape(first), PlacedShape(second, (apart, shift, 0.0)))))
