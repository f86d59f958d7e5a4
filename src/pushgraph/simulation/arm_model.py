"""MuJoCo model of a UR10 that holds a tool over a table, from the maker's description in a wheel."""

from importlib.metadata import distribution
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from pushgraph.arm import Arm
from pushgraph.errors import ArmError
from pushgraph.extras import extra
from pushgraph.scene import Scene
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.planar_model import CONTACT_HEIGHT

TOOL_SITE = "tool"
"""Where the tool touches what it pushes: the site's x is the tool's, its z points down."""
FULL_TURN = 2 * np.pi
ANGLE_LIMITS = np.array([FULL_TURN, FULL_TURN, np.pi, FULL_TURN, FULL_TURN, FULL_TURN])
"""Largest angle of each joint to either side (rad), from the description."""
BASE_SPEED, WRIST_SPEED = np.radians(120.0), np.radians(180.0)
"""Fastest turn of the first two joints and of the others (rad/s), from the UR10's data sheet."""
SPEED_LIMITS = np.array([BASE_SPEED] * 2 + [WRIST_SPEED] * 4)
ACCELERATION_LIMIT = 5.0
"""Of every joint (rad/s^2): the maker states none; this is the conservative one of its ur_moveit_config (ROS 2
driver)."""
TORQUE_LIMITS = np.array([330.0, 330.0, 150.0, 54.0, 54.0, 54.0])
"""N m, from the description."""
STIFFNESS = np.array([4e4, 4e4, 2e4, 8e3, 8e3, 8e3])
"""Of the servos (N m/rad): chosen, so that 40 N on a stretched arm bend it by about 1 mm."""
TYPICAL_INERTIA = np.array([10.0, 10.0, 3.0, 0.5, 0.5, 0.5])
"""For which the servos are critically damped (kg m^2)."""
DAMPING = 2 * np.sqrt(STIFFNESS * TYPICAL_INERTIA)
ROTOR_INERTIA = np.array([2.0, 2.0, 1.0, 0.2, 0.2, 0.2])
"""Of the motors behind their gears (kg m^2): of the usual size for motors of this power and gears of 1 : 101."""
ROD_RADIUS, ROD_MASS = 0.03, 1.0
"""Of what joins flange and tool (m, kg)."""
GROUND_CLEARANCE = 0.005
"""Of the tool's lower side above the table (m)."""
_TABLE, _LINKS, _BODIES = 1, 2, 4
"""Collision bits: the table, the arm with its tool, and the height of the tallest body."""
_ROBOT = Path("cmeel.prefix/share/example-robot-data/robots/ur_description")


class ArmModel(NamedTuple):
    """A compiled arm; `joint_names` in the order of qpos."""

    arm: Arm
    mujoco: mujoco.MjModel
    joint_names: tuple[str, ...]

    @property
    def pushing_height(self) -> float:
        """Of the tool's site above the table while it pushes (m)."""
        return float(self.arm.flange_height - self.mujoco.site(TOOL_SITE).pos[2])

    def touch(self, data: mujoco.MjData, angles: Float[np.ndarray, "6"]) -> str | None:
        """Say what touches what at these angles, if anything."""
        data.qpos[:] = angles
        mujoco.mj_kinematics(self.mujoco, data)
        mujoco.mj_collision(self.mujoco, data)
        if not data.ncon:
            return None
        geoms = data.contact.geom[0]
        one, other = (self.mujoco.body(int(self.mujoco.geom_bodyid[geom])).name for geom in geoms)
        if "world" in (one, other):
            return f"its {_words(other if one == 'world' else one)} would touch the table or what stands on it"
        return f"its {_words(one)} would touch its {_words(other)}"


def build_arm(scene: Scene) -> ArmModel:
    """Compile the model of the scene's arm, which holds its tool.

    Its forearm and wrist may not come lower than the tallest body, wherever that is. Gravity is balanced, as its
    controller does.
    Raises ArmError if the scene has no arm, and MissingExtraError if the extra is not installed.
    """
    arm = scene.arm
    if arm is None:
        raise ArmError("arm: the scene has none; add one, or use pushgraph.simulate")
    spec = mujoco.MjSpec.from_string(_description())
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = [0, 0, 0]
    x, y, yaw = arm.pose_world_from_base
    base = spec.body("base_link")
    base.pos, base.quat = [x, y, arm.base_height], [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = _LINKS, _LINKS | _TABLE | _BODIES
    # What carries them may stand on the table, and the upper arm is as low as they are.
    for name, may_touch in (("base_link", _LINKS), ("shoulder_link", _LINKS), ("upper_arm_link", _LINKS | _TABLE)):
        for geom in spec.body(name).geoms:
            geom.conaffinity = may_touch
    spec.add_exclude(bodyname1="base_link", bodyname2="shoulder_link")
    tallest = max(body.shape.height for body in scene.bodies)
    for height, bit in ((0.0, _TABLE), (tallest, _BODIES)):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], pos=[0, 0, height], contype=bit, conaffinity=0
        )
    _add_tool(spec.body("tool0"), arm, scene)
    joints = list(spec.joints)
    for joint, inertia, stiffness, damping, torque in zip(
        joints, ROTOR_INERTIA, STIFFNESS, DAMPING, TORQUE_LIMITS, strict=True
    ):
        joint.armature = inertia
        spec.add_actuator(
            target=joint.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            gainprm=[stiffness] + [0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0, -stiffness, -damping] + [0] * 7,
            forcelimited=True,
            forcerange=[-torque, torque],
        )
    return ArmModel(arm, spec.compile(), tuple(joint.name for joint in joints))


def _description() -> str:
    """The wheel's URDF, with where its collision meshes are."""
    with extra("arm", "the arm"):
        folder = Path(str(distribution("example-robot-data").locate_file(_ROBOT)))
    robot = ElementTree.parse(folder / "urdf" / "ur10_robot.urdf").getroot()
    meshes = {"meshdir": str(folder / "meshes" / "ur10" / "collision"), "strippath": "true", "discardvisual": "true"}
    ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler", meshes, fusestatic="false")
    return ElementTree.tostring(robot, encoding="unicode")


def _add_tool(flange: mujoco.MjsBody, arm: Arm, scene: Scene) -> None:
    """A rod from the flange down, the tool at its end, and the site where it pushes."""
    down_to_table = arm.flange_height
    flange.add_site(name=TOOL_SITE, pos=[0, 0, down_to_table - CONTACT_HEIGHT])
    shapes = [part.shape for part in scene.tool.parts]
    top = down_to_table - GROUND_CLEARANCE - max(shape.height for shape in shapes)
    tool = flange.add_body(name="tool")
    common = {"contype": _LINKS, "conaffinity": _LINKS}
    rod = max(top, 0.02)
    tool.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[ROD_RADIUS, rod / 2, 0], pos=[0, 0, rod / 2], mass=ROD_MASS, **common
    )
    for part, shape in zip(scene.tool.parts, shapes, strict=True):
        half_x, half_y, radius = shape.core
        x, y, yaw = part.pose_tool_from_part
        tool.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER if radius else mujoco.mjtGeom.mjGEOM_BOX,
            size=[radius, shape.height / 2, 0] if radius else [half_x, half_y, shape.height / 2],
            # The site's z points down, so what turns left in the world turns right here.
            pos=[x, -y, down_to_table - GROUND_CLEARANCE - shape.height / 2],
            quat=[np.cos(yaw / 2), 0, 0, -np.sin(yaw / 2)],
            mass=0,
            **common,
        )


def _words(name: str) -> str:
    return name.replace("_", " ").removesuffix(" link")
