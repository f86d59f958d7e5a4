"""A recorded push as a scene, with what was learnt of it written in: to be predicted, simulated, or copied."""

import math
from collections.abc import Mapping

import numpy as np

from pushgraph.adaptation.pressure import support
from pushgraph.adaptation.unknowns import NOMINAL, Estimate, Unknowns
from pushgraph.body import Body
from pushgraph.real_pushes import DEEPEST, RealPushes
from pushgraph.scene import MOST_ANISOTROPY, Scene, Table
from pushgraph.shape import BodyShape, Point
from pushgraph.tool import Push, Tool

LEAST_ANISOTROPY = 1e-3
"""Tables with less have no grain."""
PARTED = 1e-6
"""A probe that is measured to start inside the object moves back until this far from it (m)."""


def scene_of(pushes: RealPushes, index: int, unknowns: Unknowns = NOMINAL) -> Scene:
    """One recorded push as a scene of nominal mass and table friction."""
    name, shape = str(pushes.shape[index]), pushes.shapes[str(pushes.shape[index])]
    body = Body(
        name=name,
        shape=shape,
        pose_world_from_body=_triple(pushes.before[index]),
        support=support_of(shape, unknowns),
    )
    scene = Scene(
        bodies=(body,),
        table=_grained(Table(), float(unknowns.anisotropy_x), float(unknowns.anisotropy_y)),
        tool=Tool.round(2 * pushes.probe_radius),
        side_friction=float(unknowns.side_friction),
    ).with_nominal_values()
    offset = np.array([unknowns.probe_x, unknowns.probe_y], dtype=float)
    start, end = pushes.probe_start[index] + offset, pushes.probe_end[index] + offset
    start = start - _back(scene, start, end) * (end - start) / np.hypot(*(end - start))
    push = Push(start=_pair(start), end=_pair(end), speed=max(float(pushes.speed[index]), 1e-3))
    return scene.replace(pushes=(push,))


def with_unknowns(scene: Scene, estimates: Mapping[str, Estimate]) -> Scene:
    """The scene with what was learnt of some bodies, by name: where they press, and side friction and the grain of the
    table, for which the surest body counts most."""
    if not estimates:
        return scene
    bodies = tuple(
        body.replace(support=support_of(body.shape, estimates[body.name].unknowns)) if body.name in estimates else body
        for body in scene.bodies
    )
    scores = np.stack([estimate.mean for estimate in estimates.values()])
    weights = np.stack([1 / np.diag(estimate.covariance) for estimate in estimates.values()])
    shared = Unknowns.of(np.average(scores, axis=0, weights=weights))
    return scene.replace(
        bodies=bodies,
        side_friction=float(shared.side_friction),
        table=_grained(scene.table, float(shared.anisotropy_x), float(shared.anisotropy_y)),
    )


def support_of(shape: BodyShape, unknowns: Unknowns) -> tuple[Point, ...]:
    """Points on which a body presses as the unknowns say."""
    values = (unknowns.concentration, unknowns.corner_share, unknowns.centre_x, unknowns.centre_y)
    concentration, corner_share, x, y = (float(value) for value in values)
    return support(shape, concentration, corner_share, (x, y))


def _grained(table: Table, anisotropy_x: float, anisotropy_y: float) -> Table:
    """The table with a grain, whose unknowns are told in the world."""
    anisotropy = math.hypot(anisotropy_x, anisotropy_y)
    if anisotropy < LEAST_ANISOTROPY:
        return table
    along = math.atan2(anisotropy_y, anisotropy_x) / 2
    grain = along - table.pose_world_from_table[2]
    return table.replace(anisotropy=min(anisotropy, MOST_ANISOTROPY), grain=grain)


def _back(scene: Scene, start: np.ndarray, end: np.ndarray) -> float:
    """How far back the probe starts so as to start outside the body (m)."""
    ahead, back = (end - start) / np.hypot(*(end - start)), 0.0
    while back < 3 * DEEPEST:
        gap = float(scene.tool_gaps(np.array([[*(start - back * ahead), 0.0]]), scene.poses_world_from_body).min())
        if gap >= 0:
            break
        back += PARTED - gap
    return back


def _pair(values: np.ndarray) -> Point:
    return (float(values[0]), float(values[1]))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
