"""MuJoCo model of a scene whose bodies slide and turn on a table but never tip.

A piece (bodies that move as one) slides in x and y and turns about z; nothing in the model moves vertically, so sides
cannot lift or hop. Joints are kinematic trees of pieces, so they do not drift; a joint that would close a loop holds a
light copy of its child, which a constraint ties to the child.

A piece stands on feet that are sunk into the table. Since nothing moves vertically, a foot presses with the same force
at all times, and its friction is Coulomb's with a known bound, independent of the motion; isotropic, but on a table
with a grain, which lies along x here. MuJoCo's contacts couple pressure to slip (a body on a vertical slide hops while
it slides); here the pressure is large and the coefficient small, their product being the friction wanted, so that the
coupling vanishes.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import ROBOT, Body, Joint
from pushgraph.errors import SimulationError
from pushgraph.patch import MassProperties, mass_properties, patch_of
from pushgraph.scene import Scene
from pushgraph.scene_file import TRUSTED
from pushgraph.shape import Cuboid, Cylinder, Pose
from pushgraph.simulation.assembly import Assembly, assemble
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.feet import Feet, feet_of

GRAVITY = 9.81
TIMESTEP = 0.05 / 12
"""Largest step (s), a whole share of a frame; fast pushes take smaller ones."""
CONTACT_HEIGHT = 0.05
"""At which the sides are cut (m); cylinders are spheres there."""
ROBOT_MASS = 1e6
"""As a share of the bodies' mass: scaling all masses then changes nothing but forces."""
LIMITED_MASS = 0.1
"""Of the tool of a pusher with a force limit (kg): light, so that its impact adds little to that force."""
NO_LIMIT = 1e6
"""Force limit (N) of pushes that have none, in scenes where others do."""
COPY_MASS = 0.01
"""Mass of the copy that closes a loop, as a share of its body's; it stands on nothing."""
TOLERANCE = 1e-16
"""Of the solver, as a share of the mean inertia: the robot's mass is in that, and must not hide the bodies'."""
LIFT_HEIGHT = 20.0
"""Of the tool where it touches nothing (m); its joints are zero there."""
SIDE_IMPEDANCE, ONSET_IMPEDANCE, ONSET = 0.99, 0.5, 3e-5
"""Of contacts at this depth (m) and beyond, and at their onset: were they hard from there, slip would part them again
and again."""
TOUCH = 1e-8
"""Sides touch from this gap on (m): at zero, rounding would settle which corners of two faces that just touch do."""
LIMIT_IMPEDANCE = 0.999
LOOP_IMPEDANCE = 0.9999
CLUTCH_IMPEDANCE = 0.9999
TANGENTIAL_STIFFNESS = 100.0
"""How much stiffer contacts are along a surface than across it: what sticks creeps so much less."""
FOOT_RADIUS = 0.01
FOOT_IMPEDANCE = 0.1
"""Low, so that a foot presses hard at a coefficient that MuJoCo still takes."""
FOOT_STIFFNESS = 1e4
"""Of the normal direction (1/s^2): a foot sunk by 1 m would part from the table at this acceleration."""
LEAST_COEFFICIENT = 1.05e-5
"""MuJoCo takes no smaller friction coefficient than 1e-5."""
HARDEST = 1000.0
"""Acceleration with which a foot presses at most (m/s^2): more would drown its friction in rounding."""
COUPLING, COUPLING_SPEED = 0.01, 0.5
"""Slip adds at most this share to the pressure of a foot at this speed (m/s), in proportion to the speed."""
TABLE, SIDES = 1, 2
"""Collision bits."""


class PlanarModel(NamedTuple):
    """A compiled scene.

    links: MuJoCo's body of each body of the scene. robot_position, robot_velocity: where the robot's joints stand in
    qpos and qvel. clutch: whether they have a clutch between heading and yaw.
    """

    mujoco: mujoco.MjModel
    links: list[int]
    robot_position: slice
    robot_velocity: slice
    clutch: bool

    def set_timestep(self, seconds: float) -> None:
        """Step by so much, with contacts and limits as stiff as a step of that length resolves."""
        model = self.mujoco
        model.opt.timestep = seconds
        sides = model.geom_contype == SIDES
        model.geom_solref[sides, 0] = 2 * seconds
        model.geom_solref[model.geom_conaffinity == TABLE, 1] = -FOOT_IMPEDANCE / seconds
        model.pair_solref[:, 1] = -FOOT_IMPEDANCE / seconds
        model.jnt_solref[:, 0] = 2 * seconds
        model.eq_solref[:, 0] = 2 * seconds


class _Frame(NamedTuple):
    """A piece's frame: its centre of mass, parallel to the world's at the scene's poses."""

    element: mujoco.MjsBody
    position_world: Float[np.ndarray, "2"]


class _Foot(NamedTuple):
    """A foot's MuJoCo name, the friction it bears (N) and its radius in spin (m)."""

    name: str
    friction: float
    radius: float


def build(scene: Scene, clutch: bool = False) -> PlanarModel:
    """Compile the model of a scene; with a clutch, the robot's force along its heading can be limited.

    Raises SimulationError if a mass or a friction is unknown.
    """
    frictions = _known_frictions(scene)
    original, scene = scene, _in_order_of_names(scene)
    spec = _empty_spec()
    world = spec.worldbody
    world.add_geom(name=_TABLE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], contype=TABLE, conaffinity=0)
    assembly = assemble(scene)
    frames: dict[int, _Frame] = {}
    feet: list[_Foot] = []
    for piece, parent, joint in assembly.branches:
        members = [scene.bodies[body] for body in assembly.pieces[piece].bodies]
        if assembly.pieces[piece].immovable:
            frames[piece] = _Frame(world.add_body(name=_piece_name(piece)), np.zeros(2))
        else:
            upper = _Frame(world, np.zeros(2)) if parent is None else frames[parent]
            inertia = mass_properties(members)
            frames[piece] = _add_frame(upper, inertia, _piece_name(piece))
            _add_joints(scene, assembly, piece, joint, frames[piece])
            borne = frictions.table * inertia.mass * GRAVITY
            own = _add_feet(piece, feet_of_piece(members), frames[piece], borne)
            if scene.table.anisotropy:
                _pair_with_table(spec, own)
            feet += own
        for body in assembly.pieces[piece].bodies:
            _add_link(scene, body, frames[piece], frictions.sides)
    for joint in assembly.loops:
        _close_loop(spec, scene, assembly, joint, frames)
    _exclude_contacts(spec, scene)
    heavy = ROBOT_MASS * sum(body.mass or 0.0 for body in scene.bodies)
    _add_robot(world, scene, heavy or ROBOT_MASS, clutch, frictions.sides)
    try:
        model = spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses this scene: {error}") from None
    links = [model.body(link_name(body)).id for body in range(len(scene.bodies))]
    # Links have no mass of their own; what a contact weighs is their piece.
    model.body_invweight0[links] = model.body_invweight0[model.body_parentid[links]]
    _press_feet(model, feet, scene.table.anisotropy)
    robot_joint = model.joint(int(model.body(_CARRIAGE).jntadr[0]))
    count = 6 if clutch else 4
    first_position, first_velocity = int(robot_joint.qposadr[0]), int(robot_joint.dofadr[0])
    return PlanarModel(
        mujoco=model,
        links=[links[scene.names.index(name)] for name in original.names],
        robot_position=slice(first_position, first_position + count),
        robot_velocity=slice(first_velocity, first_velocity + count),
        clutch=clutch,
    )


def link_name(body: int) -> str:
    """MuJoCo's name of a body of the scene."""
    return f"link {body}"


_CARRIAGE, _TABLE = "carriage", "table"
_AT_ONE_PLACE = [0.0] * 6 + [1.0, 0.0, 0.0, 0.0] + [1.0, 0.0]
"""MuJoCo's data of a weld of bodies whose frames coincide: anchor, relative position and quaternion, torque scale."""


def _piece_name(piece: int) -> str:
    return f"piece {piece}"


def _in_order_of_names(scene: Scene) -> Scene:
    """The same scene, however its bodies and joints were ordered: rounding must not depend on that."""
    fields = {name: getattr(scene, name) for name in Scene.model_fields} | {
        "bodies": sorted(scene.bodies, key=lambda body: body.name),
        "joints": sorted(scene.joints, key=lambda joint: (joint.parent, joint.child)),
        "rigid_groups": sorted(sorted(group) for group in scene.rigid_groups),
    }
    return Scene.model_validate(fields, context=TRUSTED)


def _empty_spec() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.impratio = TANGENTIAL_STIFFNESS
    spec.option.gravity = [0, 0, 0]
    spec.option.tolerance = TOLERANCE
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    # Bodies that a hinge joins still touch.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    return spec


class _Frictions(NamedTuple):
    table: float
    sides: float


def _known_frictions(scene: Scene) -> _Frictions:
    """The frictions of a scene that says all that is needed."""
    table, sides = scene.table.friction, scene.side_friction
    immovable = {body for piece in assemble(scene).pieces if piece.immovable for body in piece.bodies}
    unknown = [
        f"mass of body {body.name!r}"
        for index, body in enumerate(scene.bodies)
        if body.mass is None and index not in immovable
    ]
    unknown += ["table.friction"] * (table is None) + ["side_friction"] * (sides is None)
    if unknown or table is None or sides is None:
        raise SimulationError(
            f"the simulator needs every mass and friction; unknown: {', '.join(unknown)}. Give them, or use "
            "scene.with_nominal_values()"
        )
    return _Frictions(table, sides)


def _add_frame(parent: _Frame, inertia: MassProperties, name: str) -> _Frame:
    position = inertia.centre_of_mass
    element = parent.element.add_body(name=name, pos=[*(position - parent.position_world), 0])
    _set_inertia(element, inertia.mass, inertia.moment_of_inertia)
    return _Frame(element, position)


def _set_inertia(element: mujoco.MjsBody, mass: float, moment_of_inertia: float) -> None:
    """Mass at the origin of the element; MuJoCo would put it elsewhere if not told where."""
    element.explicitinertial = True
    element.mass, element.inertia = mass, [moment_of_inertia] * 3
    element.ipos, element.iquat = [0, 0, 0], [1, 0, 0, 0]


def _add_joints(scene: Scene, assembly: Assembly, piece: int, joint: Joint | None, frame: _Frame) -> None:
    if joint is None:
        _add_slides(frame.element)
        frame.element.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        return
    child = assembly.piece_of[scene.names.index(joint.child)]
    _add_joint(scene, joint, frame, forward=child == piece)


def _add_slides(element: mujoco.MjsBody) -> None:
    element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])


def _add_joint(scene: Scene, joint: Joint, frame: _Frame, forward: bool) -> None:
    """A joint of the scene, through which the frame moves relative to the one that it is in.

    forward: whether the frame is that of the joint's child; that of its parent moves the other way.
    """
    anchor, axis, limits = scene.joint_frame(joint)
    sign = 1.0 if forward else -1.0
    common = {
        "range": limits,
        "limited": 1,
        "solref_limit": [2 * TIMESTEP, 1.0],
        "solimp_limit": _constant_impedance(LIMIT_IMPEDANCE),
    }
    if joint.kind == "revolute":
        offset = anchor - frame.position_world
        frame.element.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, sign], pos=[*offset, 0], **common)
    else:
        frame.element.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[*(sign * axis), 0], **common)


def _add_link(scene: Scene, body: int, frame: _Frame, friction: float) -> None:
    """The sides of one body of a piece."""
    x, y, yaw = scene.poses_world_from_body[body]
    position = np.array([x, y]) - frame.position_world
    link = frame.element.add_body(name=link_name(body), pos=[*position, 0], quat=_about_z(yaw))
    for part in scene.bodies[body].shape.parts:
        _add_side(link, part.shape, part.pose_body_from_part, friction)


def _add_side(element: mujoco.MjsBody, shape: Cylinder | Cuboid, pose_in_element: Pose, friction: float) -> None:
    half_x, half_y, radius = shape.core
    x, y, yaw = pose_in_element
    element.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE if radius else mujoco.mjtGeom.mjGEOM_BOX,
        size=[radius, 0, 0] if radius else [half_x, half_y, CONTACT_HEIGHT / 2],
        pos=[x, y, CONTACT_HEIGHT],
        quat=_about_z(yaw),
        mass=0,
        contype=SIDES,
        conaffinity=SIDES,
        condim=3,
        margin=TOUCH,
        friction=[friction, 0, 0],
        solref=[2 * TIMESTEP, 1.0],
        solimp=[ONSET_IMPEDANCE, SIDE_IMPEDANCE, ONSET, 0.5, 2.0],
    )


def _add_feet(piece: int, feet: Feet, frame: _Frame, friction: float) -> list[_Foot]:
    """Feet that bear a friction (N) together; they press once the model is compiled."""
    added = []
    for index, (point, share, radius) in enumerate(zip(feet.points, feet.weights, feet.radii, strict=True)):
        name = f"foot {piece} {index}"
        frame.element.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[FOOT_RADIUS, 0, 0],
            pos=[*(point - frame.position_world), -FOOT_RADIUS],
            mass=0,
            contype=0,
            conaffinity=TABLE,
            condim=4,
            priority=1,
            solref=[-FOOT_STIFFNESS * FOOT_IMPEDANCE, -FOOT_IMPEDANCE / TIMESTEP],
            solimp=_constant_impedance(FOOT_IMPEDANCE),
        )
        added.append(_Foot(name, friction * float(share), float(radius)))
    return added


def _pair_with_table(spec: mujoco.MjSpec, feet: list[_Foot]) -> None:
    """Only in pairs that are named can a contact have two frictions."""
    for foot in feet:
        spec.add_pair(
            name=foot.name,
            geomname1=_TABLE,
            geomname2=foot.name,
            condim=4,
            solref=[-FOOT_STIFFNESS * FOOT_IMPEDANCE, -FOOT_IMPEDANCE / TIMESTEP],
            solimp=_constant_impedance(FOOT_IMPEDANCE),
        )


def feet_of_piece(members: list[Body]) -> Feet:
    """The feet of a piece, in the world. They are found in the frame of its first body, so that they stand alike in
    every scene that holds it."""
    pose_world_from_first = np.array(members[0].pose_world_from_body)
    seen_from_first = [
        body.replace(
            pose_world_from_body=tuple(pose.relative(pose_world_from_first, np.array(body.pose_world_from_body)))
        )
        for body in members
    ]
    feet = feet_of(patch_of(seen_from_first))
    return feet._replace(points=pose.transform(pose_world_from_first, feet.points))


def _press_feet(model: mujoco.MjModel, feet: list[_Foot], anisotropy: float) -> None:
    """Sink each foot so deep that it presses as hard as its coefficient is small: their product is its friction.

    With impedance d, a contact that is sunk by z where nothing moves vertically presses with inertia * acceleration:
    inertia = d / (1 - d) / invweight, acceleration = FOOT_STIFFNESS * z. Slip at speed v adds coefficient * v / step to
    the acceleration (MuJoCo documentation, Computation, Constraint model).
    """
    for name, friction, radius in feet:
        foot = model.geom(name).id
        inertia = FOOT_IMPEDANCE / (1 - FOOT_IMPEDANCE) / model.body_invweight0[model.geom_bodyid[foot], 0]
        # Soft enough that the coefficient in spin is one that MuJoCo takes, hard enough that slip hardly adds.
        soft = friction * radius / (LEAST_COEFFICIENT * inertia)
        hard = math.sqrt(friction * COUPLING_SPEED / (inertia * TIMESTEP * COUPLING))
        acceleration = min(max(soft, hard), HARDEST)
        coefficient = friction / (inertia * acceleration)
        model.geom_friction[foot] = [coefficient, coefficient * radius, 0]
        model.geom_pos[foot, 2] = FOOT_RADIUS - acceleration / FOOT_STIFFNESS
        if anisotropy:
            # The first tangent of such a contact is the table's y, the second its x.
            two = [coefficient * (1 - anisotropy), coefficient * (1 + anisotropy)]
            model.pair_friction[model.pair(name).id] = [*two, coefficient * radius, 0, 0]


def _close_loop(spec: mujoco.MjSpec, scene: Scene, assembly: Assembly, joint: Joint, frames: dict[int, _Frame]) -> None:
    """Join a light copy of the joint's child to its parent, and weld the copy to the child."""
    parent, child = (assembly.piece_of[scene.names.index(name)] for name in (joint.parent, joint.child))
    forward = not assembly.pieces[child].immovable
    if not forward:
        parent, child = child, parent
    members = [scene.bodies[body] for body in assembly.pieces[child].bodies]
    whole = mass_properties(members)
    copied = MassProperties(COPY_MASS * whole.mass, whole.centre_of_mass, COPY_MASS * whole.moment_of_inertia)
    name = f"copy for {joint.parent} - {joint.child}"
    copy = _add_frame(frames[parent], copied, name)
    _add_joint(scene, joint, copy, forward)
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=_piece_name(child),
        name2=name,
        data=_AT_ONE_PLACE,
        solref=[2 * TIMESTEP, 1.0],
        solimp=_constant_impedance(LOOP_IMPEDANCE),
    )


def _exclude_contacts(spec: mujoco.MjSpec, scene: Scene) -> None:
    """No contact between the two bodies of a prismatic joint, which slide on each other."""
    for joint in scene.joints:
        if joint.kind == "prismatic":
            ends = [link_name(scene.names.index(name)) for name in (joint.parent, joint.child)]
            spec.add_exclude(bodyname1=ends[0], bodyname2=ends[1])


def _add_robot(world: mujoco.MjsBody, scene: Scene, mass: float, clutch: bool, friction: float) -> None:
    """The end-effector with its tool, lifted, never asleep: so heavy that no contact slows it.

    With a clutch, a carriage of that mass turns to where it is heading, and the tool slips against it along that.
    """
    carriage = world.add_body(name=_CARRIAGE, pos=[0, 0, LIFT_HEIGHT], sleep=mujoco.mjtSleepPolicy.mjSLEEP_NEVER)
    _set_inertia(carriage, mass, mass)
    _add_slides(carriage)
    carriage.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    robot = carriage
    if clutch:
        carriage.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        robot = carriage.add_body(name=ROBOT)
        _set_inertia(robot, LIMITED_MASS, mass)
        robot.add_joint(
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[1, 0, 0],
            frictionloss=NO_LIMIT,
            solref_friction=[2 * TIMESTEP, 1.0],
            solimp_friction=_constant_impedance(CLUTCH_IMPEDANCE),
        )
    robot.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    for part in scene.tool.parts:
        _add_side(robot, part.shape, part.pose_tool_from_part, friction)


def _constant_impedance(impedance: float) -> list[float]:
    return [impedance, impedance, 0.001, 0.5, 2.0]


def _about_z(angle: float) -> list[float]:
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]
