"""The distributions that trajectories are drawn from, by name."""

import contextlib
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from pushgraph.errors import SetupError, SimulationError
from pushgraph.scene import Scene, Table
from pushgraph.simulation.aiming import NoPush, PushStyle, aim
from pushgraph.simulation.anywhere import PUSH_DISTANCE, PUSH_SPEED, draw_paper_shape, joints_anywhere
from pushgraph.simulation.articulation import JOINTS, draw_joints
from pushgraph.simulation.block import Block, arrange
from pushgraph.simulation.glued_cylinders import FEWEST as FEWEST_GLUED
from pushgraph.simulation.glued_cylinders import MOST as MOST_GLUED
from pushgraph.simulation.glued_cylinders import glued_cylinders
from pushgraph.simulation.kinds import KINDS
from pushgraph.simulation.lever_setup import LEVER_UP
from pushgraph.simulation.masses import CONTROLLED_OBJECTS, controlled_masses, different_masses
from pushgraph.simulation.placement import NoRoom
from pushgraph.simulation.plan import DENSITIES, Plan
from pushgraph.simulation.scenery import MASS, place_paper_blocks, table_side
from pushgraph.track import Track

FEWEST = 6
"""Objects in the smallest scenes of a setup of many sizes."""
FIRST_TEST_SEED = 1_000_000
"""Seeds from here on are for tests, smaller ones for training and validation data."""
TOUCHED = 0.005
"""A body that a push moves by this much (m) counts as touched."""
ATTEMPTS = 100

REJECTIONS = {
    "room": "no room for a body",
    "joints": "too few neighbours to join",
    "push": "no push reaches a body",
    "table": "a body left the table",
    "diverged": "the simulation diverged",
}
"""Why a drawn scene comes to nothing."""


class Trajectory(NamedTuple):
    """One draw of a setup; `rejected` counts, by reason, the scenes drawn before it that came to nothing."""

    track: Track
    density: str
    kind: str
    rejected: Counter[str]


def multiple_parts(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """The paper's setup: cylinders and cuboids, two to six joints; every other scene dense, the others sparse."""
    density = DENSITIES[index % 2]
    shapes = [draw_paper_shape(rng) for _ in range(objects)]
    blocks = [Block.of(shape) for shape in shapes]
    poses = place_paper_blocks(rng, blocks, density)
    masses = rng.uniform(*MASS, objects)
    side = table_side(objects)
    scene = arrange(blocks, poses, masses[:, None].tolist(), table=Table(size=(side, side)))
    joints = draw_joints(rng, scene)
    if len(joints) < min(JOINTS[0], objects - 1):
        raise _TooFewNeighbours
    return Plan(scene.replace(joints=joints), density, PushStyle(PUSH_DISTANCE, float(rng.uniform(*PUSH_SPEED))))


def planar(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """The training mixture: half `multiple-parts`, half everything that a planar task may ask for."""
    return (multiple_parts, varied)[index // 2 % 2](rng, objects, index)


def planar_mixed(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """`planar` with six objects, up to as many as given."""
    return planar(rng, int(rng.integers(min(FEWEST, objects), objects + 1)), index)


def different_masses_mixed(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """`different-masses` with two objects, up to as many as given."""
    return different_masses(rng, int(rng.integers(min(2, objects), objects + 1)), index)


def varied(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """Everything that a scene may say, kind by kind: see `pushgraph.simulation.kinds`."""
    kind = list(KINDS)[index // 4 % len(KINDS)]
    return KINDS[kind](rng, objects, DENSITIES[index % 2])._replace(kind=kind)


def jointed(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """What belief learns from: half `multiple-parts`, half the same with joints anywhere."""
    if index // 2 % 2 == 0:
        return multiple_parts(rng, objects, index)
    return joints_anywhere(rng, objects, DENSITIES[index % 2])


Setup = Callable[[np.random.Generator, int, int], Plan]
"""Plans the trajectory of a number of objects and an index, which settles what shall be evenly spread."""
SETUPS: dict[str, Setup] = {
    "multiple-parts": multiple_parts,
    "jointed": jointed,
    "planar": planar,
    "planar-mixed": planar_mixed,
    "different-masses": different_masses,
    "different-masses-mixed": different_masses_mixed,
    "controlled-masses": controlled_masses,
    "camera": glued_cylinders,
}
OBJECTS: dict[str, tuple[int, ...]] = {
    "controlled-masses": CONTROLLED_OBJECTS,
    "camera": tuple(range(FEWEST_GLUED, MOST_GLUED + 1)),
}
"""Numbers of objects of the setups that are not of any."""
EPISODIC = {"multiple-parts", "jointed", "different-masses"}
"""Setups whose scenes all hold as many bodies as asked for, and a round tool: what episodes can begin with."""


def register_setup(
    name: str, plan: Setup, objects: Sequence[int] | None = None, episodic: bool = False
) -> None:
    """Make a setup known by name, in this process: to generation, evaluation and environments.

    plan: plans a trajectory, the same from the same generator, and raises NoRoom where a draw comes to nothing.
    objects: the numbers of objects that it knows, if it does not know any. episodic: see EPISODIC. Processes that are
    started have to import the module that calls this, too; scripts do so with what stands outside of
    `if __name__ == "__main__"`. Raises SetupError if the name is taken.
    """
    if SETUPS.get(name, plan) is not plan or name == LEVER_UP:
        raise SetupError(f"{name!r}: there is a setup of this name already")
    SETUPS[name] = plan
    if objects is not None:
        OBJECTS[name] = tuple(objects)
    if episodic:
        EPISODIC.add(name)


def draw_trajectory(setup: str, objects: int, seed: int, index: int) -> Trajectory:
    """Draw and simulate trajectory `index`; the same arguments give the same bits on any machine like this.

    Raises SetupError if the setup is unknown or not of so many objects, or a hundred draws in a row come to nothing.
    """
    from pushgraph.simulation.planar import simulate  # here, so that datasets are read without MuJoCo

    plan = find_setup(setup, objects)
    rng = np.random.default_rng([zlib.crc32(setup.encode()), objects, seed, index])
    rejected: Counter[str] = Counter()
    while rejected.total() < ATTEMPTS:
        try:
            drawn = plan(rng, objects, index)
            style = drawn.style
            track = simulate(drawn.scene) if style is None else _push_around(rng, drawn.scene, style)
            return Trajectory(track, drawn.density, drawn.kind, rejected)
        except NoRoom:
            rejected[REJECTIONS["room"]] += 1
        except _TooFewNeighbours:
            rejected[REJECTIONS["joints"]] += 1
        except NoPush:
            rejected[REJECTIONS["push"]] += 1
        except _LeftTable:
            rejected[REJECTIONS["table"]] += 1
        except SimulationError:
            rejected[REJECTIONS["diverged"]] += 1
    raise SetupError(
        f"setup {setup!r} with {objects} objects: {ATTEMPTS} scenes in a row came to nothing "
        f"({', '.join(f'{reason}: {count}' for reason, count in rejected.items())}); use fewer objects"
    )


def draw_setup(setup: str, objects: int, rng: np.random.Generator) -> Scene:
    """A scene of a setup, without pushes.

    Raises SetupError if the setup is unknown or not of so many objects, or a hundred draws in a row come to nothing.
    """
    plan = find_setup(setup, objects)
    for _ in range(ATTEMPTS):
        with contextlib.suppress(NoRoom, _TooFewNeighbours):
            return plan(rng, objects, int(rng.integers(len(KINDS) * 4))).scene.replace(pushes=())
    raise SetupError(f"setup {setup!r} with {objects} objects: no room in {ATTEMPTS} scenes; use fewer objects")


def find_setup(name: str, objects: int) -> Setup:
    """The setup of this name; raises SetupError with the valid names, or the valid numbers of objects."""
    if name not in SETUPS:
        raise SetupError(f"no setup {name!r}; valid: {', '.join(SETUPS)}; import what registers your own")
    if name in OBJECTS and objects not in OBJECTS[name]:
        raise SetupError(f"setup {name!r}: no scene of {objects} objects; valid: {', '.join(map(str, OBJECTS[name]))}")
    return SETUPS[name]


class _TooFewNeighbours(Exception):
    pass


class _LeftTable(Exception):
    pass


def _push_around(rng: np.random.Generator, scene: Scene, style: PushStyle) -> Track:
    from pushgraph.simulation.planar import PlanarSimulation

    simulation = PlanarSimulation(scene, force_limits=style.force_limit is not None)
    touched = np.zeros(len(scene.bodies), dtype=np.int64)
    for _ in range(style.pushes):
        before = simulation.poses
        simulation.push(aim(rng, scene, before, touched, style))
        after = simulation.poses
        if not (scene.table.holds(after[:, :2]) | scene.immovable).all():
            raise _LeftTable
        touched += np.hypot(*(after - before)[:, :2].T) > TOUCHED
    return simulation.track()
