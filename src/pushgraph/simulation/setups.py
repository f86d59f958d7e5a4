"""The distributions that trajectories are drawn from, by name."""

import math
import zlib
from collections import Counter
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from pushgraph import pose
from pushgraph.body import Body
from pushgraph.errors import SetupError, SimulationError
from pushgraph.scene import NOMINAL_TABLE_FRICTION, Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.aiming import NoPush, PushStyle, aim
from pushgraph.simulation.articulation import JOINTS, draw_joints, vary_joint
from pushgraph.simulation.placement import NoRoom, place_cluster, scatter_clusters
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.tool import Part, Tool
from pushgraph.track import Track

PUSHES = 9
FEWEST = 6
"""Objects in the smallest scenes of a setup of many sizes."""
PUSH_DISTANCE = 0.30
FIRST_TEST_SEED = 1_000_000
"""Seeds from here on are for tests, smaller ones for training and validation data."""
PUSH_SPEED = (0.10, 0.30)
SIZE_MEAN, SIZE_SPREAD, SIZE_RANGE = 0.117, 0.023, (0.08, 0.16)
MASS = (0.2, 1.0)
MASS_CLASSES = ((0.2, 0.5), (1.0, 2.0), (8.0, 10.0))
TOUCHED = 0.005
"""A body that a push moves by this much (m) counts as touched."""
SLOW = 0.05
"""Pushes slower than this (m/s) are short."""
SLOW_DISTANCE = 0.05
TABLE_SIDE = 2.0
"""Of the table (m), larger for more than a dozen objects."""
ATTEMPTS = 100

REJECTIONS = {
    "room": "no room for a body",
    "joints": "too few neighbours to join",
    "push": "no push reaches a body",
    "table": "a body left the table",
    "diverged": "the simulation diverged",
}
"""Why a drawn scene comes to nothing."""

Density = Literal["dense", "sparse"]
DENSITIES: tuple[Density, Density] = ("dense", "sparse")


class Plan(NamedTuple):
    """A scene without pushes, and how it shall be pushed."""

    scene: Scene
    density: Density
    style: PushStyle


class Trajectory(NamedTuple):
    """One draw of a setup; `rejected` counts, by reason, the scenes drawn before it that came to nothing."""

    track: Track
    density: Density
    rejected: Counter[str]


def multiple_parts(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """The paper's setup: cylinders and cuboids, two to six joints; every other scene dense, the others sparse."""
    density = DENSITIES[index % 2]
    shapes = [_draw_shape(rng) for _ in range(objects)]
    poses = _place(rng, shapes, list(range(objects)), density)
    scene = _scene(shapes, poses, rng.uniform(*MASS, objects))
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


def varied(rng: np.random.Generator, objects: int, index: int) -> Plan:
    """Scenes of other masses, frictions, tools, speeds, pieces and joint geometry than the paper's."""
    density = DENSITIES[index % 2]
    shapes = [_draw_shape(rng) for _ in range(objects)]
    pieces = _draw_pieces(rng, objects)
    poses = _place(rng, shapes, pieces, density)
    tool = _draw_tool(rng)
    groups = [[f"body{k}" for k in np.flatnonzero(np.array(pieces) == piece)] for piece in sorted(set(pieces))]
    scene = _scene(
        shapes,
        poses,
        _draw_masses(rng, objects),
        rigid_groups=tuple(tuple(group) for group in groups if len(group) > 1),
        tool=tool,
        friction=float(rng.uniform(0.2, 0.6)),
        side_friction=float(rng.uniform(0.1, 0.4)),
    )
    joints = draw_joints(rng, scene)
    if rng.random() < 0.5:
        joints = tuple(vary_joint(rng, scene, joint) for joint in joints)
    speed = float(np.exp(rng.uniform(math.log(0.005), math.log(0.3))))
    style = PushStyle(
        distance=SLOW_DISTANCE if speed < SLOW else PUSH_DISTANCE,
        speed=speed,
        turned=not _is_round(tool),
        rotation=0.8 if not _is_round(tool) and rng.random() < 0.5 else 0.0,
    )
    return Plan(scene.replace(joints=joints), density, style)


Setup = Callable[[np.random.Generator, int, int], Plan]
"""Plans the trajectory of a number of objects and an index, which settles what shall be evenly spread."""
SETUPS: dict[str, Setup] = {
    "multiple-parts": multiple_parts,
    "planar": planar,
    "planar-mixed": planar_mixed,
}


def draw_trajectory(setup: str, objects: int, seed: int, index: int) -> Trajectory:
    """Draw and simulate trajectory `index`; the same arguments give the same bits on any machine like this.

    Raises SetupError if the setup is unknown, or a hundred draws in a row come to nothing.
    """
    plan = find_setup(setup)
    rng = np.random.default_rng([zlib.crc32(setup.encode()), objects, seed, index])
    rejected: Counter[str] = Counter()
    while rejected.total() < ATTEMPTS:
        try:
            drawn = plan(rng, objects, index)
            return Trajectory(_push_around(rng, drawn), drawn.density, rejected)
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


def find_setup(name: str) -> Setup:
    """The setup of this name; raises SetupError with the valid names."""
    if name not in SETUPS:
        raise SetupError(f"no setup {name!r}; valid: {', '.join(SETUPS)}")
    return SETUPS[name]


class _TooFewNeighbours(Exception):
    pass


class _LeftTable(Exception):
    pass


def _push_around(rng: np.random.Generator, plan: Plan) -> Track:
    simulation = PlanarSimulation(plan.scene)
    touched = np.zeros(len(plan.scene.bodies), dtype=np.int64)
    for _ in range(PUSHES):
        before = simulation.poses
        simulation.push(aim(rng, plan.scene, before, touched, plan.style))
        after = simulation.poses
        if not plan.scene.table.holds(after[:, :2]).all():
            raise _LeftTable
        touched += np.hypot(*(after - before)[:, :2].T) > TOUCHED
    return simulation.track()


def _draw_length(rng: np.random.Generator) -> float:
    return float(np.clip(rng.normal(SIZE_MEAN, SIZE_SPREAD), *SIZE_RANGE))


def _draw_shape(rng: np.random.Generator) -> Cylinder | Cuboid:
    if rng.random() < 0.5:
        return Cylinder(diameter=_draw_length(rng))
    return Cuboid(size=(_draw_length(rng), _draw_length(rng)))


def _draw_masses(rng: np.random.Generator, objects: int) -> np.ndarray:
    kind = rng.integers(3)
    if kind == 0:
        return rng.uniform(*MASS, objects)
    if kind == 1:
        return np.exp(rng.uniform(math.log(0.2), math.log(10.0), objects))
    low, high = np.array(MASS_CLASSES)[rng.integers(len(MASS_CLASSES), size=objects)].T
    return rng.uniform(low, high)


def _draw_pieces(rng: np.random.Generator, objects: int) -> list[int]:
    """For each body the number of its piece: in three scenes of ten some bodies are parts of one."""
    if rng.random() < 0.7:
        return list(range(objects))
    return np.sort(rng.integers(max(1, round(0.7 * objects)), size=objects)).tolist()


def _draw_tool(rng: np.random.Generator) -> Tool:
    """Half of the tools are round, a quarter cuboids, a quarter composed of several parts."""
    kind = rng.random()
    if kind < 0.5:
        return Tool.round(float(np.exp(rng.uniform(math.log(0.005), math.log(0.12)))))
    count = 1 if kind < 0.75 else int(rng.integers(2, 5))
    place = rng.uniform(-0.15, 0.15, 2) if count > 1 else np.zeros(2)
    parts = []
    for _ in range(count):
        wide = Cuboid(size=(float(rng.uniform(0.02, 0.18)), float(rng.uniform(0.02, 0.10))))
        shape = wide if count == 1 or rng.random() < 0.7 else Cylinder(diameter=float(rng.uniform(0.02, 0.12)))
        parts.append(Part(shape=shape, pose_tool_from_part=(*place.tolist(), float(rng.uniform(-math.pi, math.pi)))))
        place = place + pose.rotate(np.array([rng.uniform(0.04, 0.10), 0.0]), rng.uniform(-math.pi, math.pi))
    return Tool(parts=tuple(parts))


def _is_round(tool: Tool) -> bool:
    return len(tool.parts) == 1 and isinstance(tool.parts[0].shape, Cylinder)


def _place(rng: np.random.Generator, shapes: list, pieces: list[int], density: Density) -> np.ndarray:
    if density == "dense":
        return place_cluster(rng, shapes, pieces)
    clusters, first = [], 0
    while first < len(shapes):
        last = min(first + int(rng.integers(1, 5)), len(shapes))
        while last < len(shapes) and pieces[last] == pieces[last - 1]:
            last += 1
        clusters.append((shapes[first:last], place_cluster(rng, shapes[first:last], pieces[first:last])))
        first = last
    return scatter_clusters(rng, clusters, half_width=0.17 * math.sqrt(len(shapes)))


def _scene(
    shapes: list, poses: np.ndarray, masses: np.ndarray, friction: float = NOMINAL_TABLE_FRICTION, **fields
) -> Scene:
    bodies = tuple(
        Body(name=f"body{k}", shape=shape, pose_world_from_body=tuple(pose), mass=mass)
        for k, (shape, pose, mass) in enumerate(zip(shapes, poses.tolist(), masses.tolist(), strict=True))
    )
    side = max(TABLE_SIDE, 0.55 * math.sqrt(len(bodies)))
    return Scene(bodies=bodies, table=Table(size=(side, side), friction=friction), **fields)
