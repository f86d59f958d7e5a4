"""Scenes that are valid but odd: the simulator moves them to finite poses, or says clearly that it cannot."""

import math

import numpy as np
import pytest

from pushgraph.body import Body, Joint
from pushgraph.errors import SceneError, SimulationError
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Part, Push, Tool

CELL = 0.16
REFUSALS = ("come down on body", "mm outside these points", "against what cannot give way", "is thrown off at")
MOST_CRUSHED = 2
"""Of twenty scenes, so many at most may be refused only once a body is crushed."""
FARTHEST = 20.0
"""No body that the pushes of these scenes meet slides farther (m)."""


def odd_scene(seed: int) -> Scene:
    """Bodies of 1 mm to 14 cm and 1 g to 1,000 kg, some touching, joined at random; tools of many parts."""
    rng = np.random.default_rng(seed)
    for _ in range(1000):
        try:
            return draw_scene(rng)
        except SceneError:
            continue
    raise AssertionError("no valid scene found")


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def draw_shape(rng: np.random.Generator) -> Cuboid | Cylinder | Polygon:
    kind = rng.choice(["cuboid", "cylinder", "tiny", "polygon", "row"])
    if kind == "cuboid":
        return Cuboid(size=(float(rng.uniform(0.003, 0.11)), float(rng.uniform(0.003, 0.11))))
    if kind == "cylinder":
        return Cylinder(diameter=float(rng.uniform(0.005, 0.14)))
    if kind == "tiny":
        return Cuboid(size=(0.001, 0.001)) if rng.random() < 0.5 else Cylinder(diameter=0.001)
    if kind == "row":
        return Cuboid(size=(CELL, 0.05))  # touches its neighbour in the row exactly
    angle = np.sort(rng.uniform(0, 2 * math.pi, int(rng.integers(3, 12))))
    radius = rng.uniform(0.01, 0.07, len(angle))
    return Polygon(points=tuple(zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True)))


def draw_scene(rng: np.random.Generator) -> Scene:
    count = int(rng.integers(1, 10))
    places = rng.permutation(9)[:count]
    bodies = []
    for k, place in enumerate(places.tolist()):
        shape = draw_shape(rng)
        row = isinstance(shape, Cuboid) and shape.size[0] == CELL
        pose = (CELL * (place % 3), CELL * (place // 3), 0.0 if row else float(rng.uniform(-4, 4)))
        fixed = bool(rng.random() < 0.1)
        body = Body(
            name=f"b{k}",
            shape=shape,
            pose_world_from_body=pose,
            mass=None if fixed else log_uniform(rng, 1e-3, 1e3),
            fixed=fixed,
            support=((0.01, 0.0), (-0.01, 0.02), (-0.01, -0.02)) if not row and rng.random() < 0.1 else None,
        )
        bodies.append(body)
    names = [body.name for body in bodies]
    group = rng.choice(names, 2, replace=False).tolist() if count > 2 and rng.random() < 0.3 else None
    joints = {}
    for _ in range(int(rng.integers(0, count + 1)) if count > 1 else 0):
        ends = rng.choice(names, 2, replace=False).tolist()
        joints[frozenset(ends)] = draw_joint(rng, *ends)
    side = float(rng.choice([0.0, 0.25, 2.0, rng.uniform(0, 2)]))
    return Scene(
        bodies=tuple(bodies),
        joints=tuple(joints.values()),
        rigid_groups=(group,) if group else (),
        tool=draw_tool(rng),
        pushes=tuple(draw_push(rng) for _ in range(int(rng.integers(1, 3)))),
        table=Table(size=(6, 6), friction=log_uniform(rng, 1e-3, 2)),
        side_friction=side,
    )


def draw_joint(rng: np.random.Generator, parent: str, child: str) -> Joint:
    kind = str(rng.choice(["fixed", "revolute", "prismatic"]))
    fields = {}
    if kind != "fixed" and rng.random() < 0.5:
        widest = float(rng.uniform(0.01, 0.1 if kind == "prismatic" else 2))
        fields["limits"] = [(-widest, 0.0), (0.0, widest), (-widest, widest), (-100.0, 100.0)][int(rng.integers(4))]
    if kind == "prismatic" and rng.random() < 0.5:
        fields["axis"] = tuple(rng.normal(size=2).tolist())
    if kind == "revolute" and rng.random() < 0.5:
        fields["anchor"] = tuple(rng.uniform(-0.2, 0.5, 2).tolist())
    return Joint(kind=kind, parent=parent, child=child, **fields)


def draw_tool(rng: np.random.Generator) -> Tool:
    parts = [Part(shape=Cylinder(diameter=float(rng.choice([0.001, 0.01, 0.05]))))]
    for _ in range(int(rng.choice([0, 0, 3, 20]))):
        place = (*rng.uniform(-0.04, 0.04, 2).tolist(), float(rng.uniform(-3, 3)))
        parts.append(Part(shape=Cuboid(size=tuple(rng.uniform(0.001, 0.04, 2).tolist())), pose_tool_from_part=place))
    return Tool(parts=tuple(parts))


def draw_push(rng: np.random.Generator) -> Push:
    start, end = (tuple(rng.uniform(-0.3, 0.6, 2).tolist()) for _ in range(2))
    return Push(
        start=start,
        end=end,
        speed=log_uniform(rng, 0.02, 2.0),
        rotation=float(rng.choice([0.0, rng.uniform(-2, 2)])),
        force_limit=log_uniform(rng, 0.01, 1e4) if rng.random() < 0.3 else None,
    )


@pytest.mark.parametrize(("seed", "says"), [(115, "is thrown off at"), (182, "against what cannot give way")])
def test_what_is_crushed_is_refused_in_words(seed: int, says: str) -> None:
    with pytest.raises(SimulationError, match=says):
        simulate(odd_scene(seed))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 200, 20))
def test_odd_scenes_move_to_finite_poses_or_are_refused_in_words(first: int) -> None:
    wrong, crushed = [], 0
    for seed in range(first, first + 20):
        scene = odd_scene(seed)
        try:
            track = simulate(scene)
        except (SimulationError, SceneError) as error:
            if not any(words in str(error) for words in REFUSALS):
                wrong.append(f"{seed}: {error}")
            crushed += any(words in str(error) for words in REFUSALS[2:])
            continue
        farthest = np.abs(track.poses[..., :2]).max()
        if not (np.isfinite(track.poses).all() and np.isfinite(track.wrench).all() and farthest < FARTHEST):
            wrong.append(f"{seed}: a body is {farthest:.3g} m away")
        elif np.ptp(track.poses[:, 1:][:, scene.immovable], axis=0).max(initial=0.0) > 0:
            wrong.append(f"{seed}: a fixed body moves")
    assert not wrong, wrong
    assert crushed <= MOST_CRUSHED
