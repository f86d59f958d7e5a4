"""MuJoCo model of a scene whose bodies slide and turn on a table but never tip.

Every body has a frame that slides in x and y and turns about z, and in it a link that slides along z, which
carries mass and contact geometry: it rests on the table with its true weight and cannot tilt. Joints are
kinematic trees of such frames, so they do not drift. A link stands on one small foot whose sliding and
torsional friction are those of its whole patch; its sides are cut at one height, where cylinders are spheres.
"""

import math
from collections import defaultdict
from itertools import combinations
from typing import NamedTuple

import mujoco
import numpy as np

from pushgraph.body import ROBOT, Joint
from pushgraph.errors import SimulationError
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Pose, mean_radius, mean_squared_radius

TIMESTEP = 0.0025
CONTACT_HEIGHT = 0.05
ROBOT_MASS = 1e6
FRAME_MASS = 1e-6
"""Mass of a frame, as a share of its body's."""
TOLERANCE = 1e-16
"""Of the solver, as a share of the mean inertia: the robot's mass is in that, and must not hide the bodies'."""
FOOT_RADIUS = 0.01
LIFT_HEIGHT = 20.0
"""Of the tool where it touches nothing (m); its joints are zero there."""
STIFF = [2 * TIMESTEP, 1.0]
"""Time constant (s) and damping ratio of contacts and limits; the stiffest that a step resolves."""
TABLE, SIDES = 1, 2
"""Collision bits."""


class _Branch(NamedTuple):
    """A body's place in its kinematic tree: joined to `parent` by `joint`; by None if they are one piece."""

    body: int
    parent: int | None
    joint: Joint | None


class _Frame(NamedTuple):
    """A frame that moves in the plane; parallel to the world's at the scene's poses."""

    element: mujoco.MjsBody
    position_world: np.ndarray


def build(scene: Scene) -> mujoco.MjModel:
    """Compile the model of a scene; MuJoCo's name for the link of body k is `link_name(k)`.

    Raises SimulationError if the scene's joints and rigid groups close a cycle, or a mass or friction is unknown.
    """
    _check_known(scene)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.tolerance = TOLERANCE
    world = spec.worldbody
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], contype=TABLE, conaffinity=0)

    pieces = list(range(len(scene.bodies)))
    frames: dict[int, _Frame] = {}
    for body, parent, joint in _spanning_branches(scene):
        if parent is None:
            frames[body] = _add_free_frame(scene, body, world)
        elif joint is None or joint.kind == "fixed":
            frames[body], pieces[body] = frames[parent], pieces[parent]
        else:
            frames[body] = _add_jointed_frame(scene, body, joint, frames[parent])
        _add_link(scene, body, frames[body])
    _exclude_contacts(spec, scene, pieces)
    _add_robot(world, scene)
    try:
        return spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses this scene: {error}") from None


def link_name(body: int) -> str:
    """MuJoCo's name of the link of a body."""
    return f"link {body}"


def _check_known(scene: Scene) -> None:
    unknown = [f"mass of body {body.name!r}" for body in scene.bodies if body.mass is None]
    unknown += ["table.friction"] * (scene.table.friction is None)
    unknown += ["side_friction"] * (scene.side_friction is None)
    if unknown:
        raise SimulationError(
            f"the simulator needs every mass and friction; unknown: {', '.join(unknown)}. Give them, or use "
            "scene.with_nominal_values()"
        )


def _spanning_branches(scene: Scene) -> list[_Branch]:
    """Walk the forest of joints and rigid groups from its roots, parents before children."""
    index = {name: k for k, name in enumerate(scene.names)}
    edges: list[tuple[int, int, Joint | None]] = [
        (index[group[0]], index[name], None) for group in scene.rigid_groups for name in group[1:]
    ] + [(index[joint.parent], index[joint.child], joint) for joint in scene.joints]
    neighbours: dict[int, list[tuple[int, Joint | None]]] = defaultdict(list)
    for first, second, joint in edges:
        neighbours[first].append((second, joint))
        neighbours[second].append((first, joint))
    branches: list[_Branch] = []
    parents: dict[int, int | None] = {}
    for root in range(len(scene.bodies)):
        if root in parents:
            continue
        parents[root] = None
        queue = [_Branch(root, None, None)]
        while queue:
            branch = queue.pop(0)
            branches.append(branch)
            for other, joint in neighbours[branch.body]:
                if other == parents[branch.body]:
                    continue
                if other in parents:
                    raise SimulationError(
                        f"joints: {scene.names[branch.body]!r} and {scene.names[other]!r} close a cycle of joints; "
                        "the simulator needs joints and rigid groups to form trees: remove one of the cycle's joints"
                    )
                parents[other] = branch.body
                queue.append(_Branch(other, branch.body, joint))
    return branches


def _add_frame_body(parent: mujoco.MjsBody, offset: np.ndarray, body_mass: float) -> mujoco.MjsBody:
    mass = FRAME_MASS * body_mass
    return parent.add_body(pos=[*offset, 0], explicitinertial=True, mass=mass, inertia=[mass * FOOT_RADIUS**2] * 3)


def _add_free_frame(scene: Scene, body: int, world: mujoco.MjsBody) -> _Frame:
    position_world = scene.poses_world_from_body[body, :2]
    element = _add_frame_body(world, position_world, scene.bodies[body].mass)
    element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])
    element.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    return _Frame(element, position_world)


def _add_jointed_frame(scene: Scene, body: int, joint: Joint, parent: _Frame) -> _Frame:
    position_world = scene.poses_world_from_body[body, :2]
    element = _add_frame_body(parent.element, position_world - parent.position_world, scene.bodies[body].mass)
    anchor, axis, limits = scene.joint_frame(joint)
    # A tree that reaches the joint's parent through its child moves it the other way.
    sign = 1.0 if scene.names[body] == joint.child else -1.0
    common = {"range": limits, "limited": 1, "solref_limit": STIFF}
    if joint.kind == "revolute":
        offset = anchor - position_world
        element.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, sign], pos=[*offset, 0], **common)
    else:
        element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[*(sign * axis), 0], **common)
    return _Frame(element, position_world)


def _add_link(scene: Scene, body: int, frame: _Frame) -> None:
    """The link of a body: its weight on one foot, and its sides."""
    shape, mass = scene.bodies[body].shape, scene.bodies[body].mass
    x, y, yaw = scene.poses_world_from_body[body]
    link = frame.element.add_body(
        name=link_name(body),
        pos=[x - frame.position_world[0], y - frame.position_world[1], 0],
        quat=_about_z(yaw),
        explicitinertial=True,
        mass=mass,
        inertia=[mass * mean_squared_radius(shape)] * 3,
    )
    link.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    link.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[FOOT_RADIUS, 0, 0],
        pos=[0, 0, FOOT_RADIUS],
        contype=0,
        conaffinity=TABLE,
        condim=4,
        priority=1,
        friction=[scene.table.friction, scene.table.friction * mean_radius(shape), 0],
        solref=STIFF,
    )
    _add_sides(link, shape, (0.0, 0.0, 0.0), scene.side_friction)


def _add_sides(element: mujoco.MjsBody, shape: Cylinder | Cuboid, pose: Pose, friction: float) -> None:
    half_x, half_y, radius = shape.core
    element.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE if radius else mujoco.mjtGeom.mjGEOM_BOX,
        size=[radius, 0, 0] if radius else [half_x, half_y, CONTACT_HEIGHT / 2],
        pos=[pose[0], pose[1], CONTACT_HEIGHT],
        quat=_about_z(pose[2]),
        contype=SIDES,
        conaffinity=SIDES,
        condim=3,
        friction=[friction, 0, 0],
        solref=STIFF,
    )


def _exclude_contacts(spec: mujoco.MjSpec, scene: Scene, pieces: list[int]) -> None:
    """No contact within one piece, nor between the two bodies of a prismatic joint, which slide on each other."""
    sliding = {frozenset((joint.parent, joint.child)) for joint in scene.joints if joint.kind == "prismatic"}
    for (k, first), (m, second) in combinations(enumerate(scene.names), 2):
        if pieces[k] == pieces[m] or frozenset((first, second)) in sliding:
            spec.add_exclude(bodyname1=link_name(k), bodyname2=link_name(m))


def _add_robot(world: mujoco.MjsBody, scene: Scene) -> None:
    """The end-effector with its tool, lifted: so heavy that no contact slows it, and never asleep."""
    robot = world.add_body(
        name=ROBOT,
        pos=[0, 0, LIFT_HEIGHT],
        explicitinertial=True,
        mass=ROBOT_MASS,
        inertia=[ROBOT_MASS] * 3,
        gravcomp=1,
        sleep=mujoco.mjtSleepPolicy.mjSLEEP_NEVER,
    )
    for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1]):
        robot.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    robot.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    for part in scene.tool.parts:
        _add_sides(robot, part.shape, part.pose_tool_from_part, scene.side_friction)


def _about_z(angle: float) -> list[float]:
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]
