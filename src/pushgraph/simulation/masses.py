"""Scenes of cylinders that differ in mass: scattered by a few pushes, or pushed always alike."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.body import Body
from pushgraph.errors import SetupError
from pushgraph.mass_prior import MASS_CLASSES, draw_masses
from pushgraph.scene import NOMINAL_MASS, Scene, Table
from pushgraph.shape import Cylinder
from pushgraph.simulation.aiming import PushStyle
from pushgraph.simulation.anywhere import PUSH_DISTANCE, PUSH_SPEED, draw_paper_length
from pushgraph.simulation.block import Block, arrange
from pushgraph.simulation.plan import DENSITIES, Plan
from pushgraph.simulation.scenery import place_paper_blocks, table_side
from pushgraph.tool import Push

SCATTERING_PUSHES = 3
CONTROLLED_PUSH = Push(start=(-0.145, 0.0), end=(0.305, 0.0), speed=0.15, rest=0.5)
"""With the rest, in which all comes to stand still, it takes the paper's 74 frames."""


def different_masses(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """The paper's setup: cylinders, light, normal and heavy, and three pushes that scatter them."""
    density = DENSITIES[index % 2]
    blocks = [Block.of(Cylinder(diameter=draw_paper_length(rng))) for _ in range(objects)]
    poses = place_paper_blocks(rng, blocks, density)
    masses = draw_masses(rng, MASS_CLASSES, objects)
    side = table_side(objects)
    scene = arrange(blocks, poses, masses[:, None].tolist(), table=Table(size=(side, side)))
    speed = float(rng.uniform(*PUSH_SPEED))
    return Plan(scene, density, PushStyle(PUSH_DISTANCE, speed, pushes=SCATTERING_PUSHES, scatters=True))


class Disc(NamedTuple):
    """A cylinder of a controlled scene: where its centre stands in the world frame (m), and its diameter (m)."""

    x: float
    y: float
    diameter: float


CONTROLLED_DISCS = (Disc(0.0, -0.029, 0.15), Disc(0.153, 0.0, 0.15), Disc(0.278, -0.056, 0.11))
"""A row that bends: how it parts before the tool depends on how the masses compare, smoothly, whatever they are."""
CONTROLLED_OBJECTS = (2, 3)
"""The first so many of the discs make a scene."""


def controlled_scene(objects: int) -> Scene:
    """The scene of 2 or 3 cylinders whose masses alone change, with its push, and of nominal masses.

    Raises SetupError if there is none of so many objects.
    """
    if objects not in CONTROLLED_OBJECTS:
        valid = ", ".join(map(str, CONTROLLED_OBJECTS))
        raise SetupError(f"no controlled scene of {objects} objects; valid: {valid}")
    bodies = tuple(
        Body(
            name=f"body{k}",
            shape=Cylinder(diameter=disc.diameter),
            pose_world_from_body=(disc.x, disc.y, 0.0),
            mass=NOMINAL_MASS,
        )
        for k, disc in enumerate(CONTROLLED_DISCS[:objects])
    )
    return Scene(bodies=bodies, pushes=(CONTROLLED_PUSH,))


def weighing(scene: Scene, masses: Sequence[float] | Float[np.ndarray, " bodies"]) -> Scene:
    """The same scene with bodies of these masses (kg)."""
    weighed = zip(scene.bodies, masses, strict=True)
    return scene.replace(bodies=tuple(body.replace(mass=float(mass)) for body, mass in weighed))


def controlled_masses(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """The paper's controlled scenes: all but the masses is always the same, the push too."""
    scene = controlled_scene(objects)
    return Plan(weighing(scene, draw_masses(rng, scene.classes_of_mass, objects)), "dense")
