"""The paper's scenes of a real robot: glued cylinders whose yaw no camera sees, and one push with a hammer."""

import numpy as np

from pushgraph.scene import Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.aiming import PushStyle
from pushgraph.simulation.anywhere import PUSH_SPEED
from pushgraph.simulation.articulation import draw_joints
from pushgraph.simulation.block import Block, arrange
from pushgraph.simulation.placement import NEIGHBOUR_GAP, NoRoom
from pushgraph.simulation.plan import DENSITIES, Plan
from pushgraph.simulation.scenery import MASS, place_paper_blocks
from pushgraph.tool import Part, Tool

FEWEST, MOST = 2, 5
"""Cylinders of a scene."""
DIAMETER = (0.10, 0.14)
"""Of a cylinder (m); 0.12 on average."""
GLUED = (1, 3)
"""Fewest and most fixed joints of a scene."""
DISTANCE = (0.30, 0.60)
"""Of the push (m)."""
HAMMER = Tool(
    parts=(
        Part(shape=Cuboid(size=(0.04, 0.12))),
        Part(shape=Cuboid(size=(0.20, 0.03)), pose_tool_from_part=(-0.12, 0.0, 0.0)),
    )
)
"""Its head stands across the push, its handle behind it."""
REST = 0.5
"""The hammer rests so long (s) after the push, until all has come to rest."""
TABLE = Table(size=(2.5, 2.5))


def glued_cylinders(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """Two cylinders up to as many as given, in turn; one to three fixed joints; one straight push."""
    numbers = objects - FEWEST + 1
    count, density = FEWEST + index % numbers, DENSITIES[index // numbers % 2]
    blocks = [Block.of(Cylinder(diameter=float(rng.uniform(*DIAMETER)))) for _ in range(count)]
    poses = place_paper_blocks(rng, blocks, density)
    scene = arrange(blocks, poses, rng.uniform(*MASS, (count, 1)).tolist(), table=TABLE, tool=HAMMER)
    joints = draw_joints(rng, scene, NEIGHBOUR_GAP[1], ("fixed",), GLUED)
    if not joints:
        raise NoRoom
    bodies = tuple(body.replace(yaw_known=False) for body in scene.bodies)
    distance, speed = float(rng.uniform(*DISTANCE)), float(rng.uniform(*PUSH_SPEED))
    style = PushStyle(distance, speed, pushes=1, rest=REST, square=True)
    return Plan(scene.replace(bodies=bodies, joints=joints), density, style, "glued_cylinders")
