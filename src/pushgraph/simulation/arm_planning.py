"""From a scene's pushes to the joints of an arm over time, and what it cannot do, found before anything moves."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from pushgraph.arm import JOINT_LIMITS, NEAREST, Arm
from pushgraph.errors import ArmError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene
from pushgraph.simulation.arm_model import ACCELERATION_LIMIT, SPEED_LIMITS, TOOL_SITE, ArmModel, build_arm
from pushgraph.simulation.arm_path import SAMPLE, SAMPLES_PER_FRAME, ToolPath, along_push, to_start
from pushgraph.simulation.motion import ToolMotion
from pushgraph.tool import Push

EXACT = 1e-7
"""Inverse kinematics ends so near to the tool's pose (m, rad)."""
NEAR_ENOUGH = 1e-4
ITERATIONS = 20
"""Of inverse kinematics at most, for a sample."""
LOWEST_LIFT = 0.02
"""The lifted tool clears the tallest body by so much (m)."""


class JointPath(NamedTuple):
    """Angles of the joints (rad) every SAMPLE from 0 on; between the samples a cubic."""

    positions: Float[np.ndarray, "samples 6"]

    @property
    def frames(self) -> int:
        """Whole frames that it lasts."""
        return (len(self.positions) - 1) // SAMPLES_PER_FRAME

    @property
    def velocities(self) -> Float[np.ndarray, "samples 6"]:
        """rad/s; none at the ends."""
        found = np.zeros_like(self.positions)
        found[1:-1] = (self.positions[2:] - self.positions[:-2]) / (2 * SAMPLE)
        return found

    @property
    def accelerations(self) -> Float[np.ndarray, "samples 6"]:
        """rad/s^2; the arm rests before and after the path."""
        rest = np.vstack((self.positions[:1], self.positions, self.positions[-1:]))
        return np.diff(rest, 2, axis=0) / SAMPLE**2

    def at(
        self, times: Float[np.ndarray, " times"]
    ) -> tuple[Float[np.ndarray, "times 6"], Float[np.ndarray, "times 6"]]:
        """Angles and their rates at any times (s) within the path."""
        before = np.clip((times / SAMPLE).astype(int), 0, len(self.positions) - 2)
        s = (times / SAMPLE - before)[:, None]
        velocities = self.velocities
        p, q = self.positions[before], self.positions[before + 1]
        v, w = velocities[before] * SAMPLE, velocities[before + 1] * SAMPLE
        a, b = 2 * (p - q) + v + w, 3 * (q - p) - 2 * v - w
        return p + s * (v + s * (b + s * a)), (v + s * (2 * b + 3 * s * a)) / SAMPLE


class PlannedPush(NamedTuple):
    """What the arm does for one push: it brings the tool to the start, then moves it down on the table.

    turns: by how much the yaw of the tool is shifted (rad, whole turns), so that the last joint stays within its limits.
    """

    approach: JointPath
    down: JointPath
    turns: float


class ArmPlanner:
    """Plans one push after the other, each from where the last one ended."""

    def __init__(self, arm: Arm, scene: Scene) -> None:
        """Raises ArmError if the extra is not installed or the lifted tool would hit a body."""
        import_mink()
        self.arm, self._scene = arm, scene
        tallest = max(body.shape.height for body in scene.bodies)
        if arm.lift < tallest + LOWEST_LIFT:
            name = max(scene.bodies, key=lambda body: body.shape.height).name
            raise ArmError(
                f"arm.lift: {arm.lift:g} m do not clear body {name!r}, {tallest:g} m high; at least "
                f"{tallest + LOWEST_LIFT:g} m are valid"
            )
        self.model = build_arm(arm, scene)
        self._kinematics = InverseKinematics(self.model, arm)
        self._data = mujoco.MjData(self.model.mujoco)
        self._planned = 0
        self._pose: np.ndarray | None = None
        self._angles: np.ndarray | None = None

    def plan(self, push: Push) -> PlannedPush:
        """The next push; raises ArmError, which names it, says where and why, if the arm cannot do it."""
        where = f"pushes[{self._planned}]"
        if push.force_limit is not None:
            raise ArmError(f"{where}.force_limit: the arm is controlled by position; leave the force_limit out")
        down = along_push(ToolMotion(push, self._scene.tool))
        turns = self._turns(down)
        down.poses[:, 2] += turns
        self._check_reach(down, where)
        approach = to_start(self.arm, self._pose, down.poses[0])
        self._check_reach(approach, f"{where}, on the way to its start")
        above = self.arm.joint_angles(approach.poses[0], float(approach.lift[0]))
        first = above if self._angles is None else self._angles
        on_the_way = self._joints(approach, first, f"{where}, on the way to its start")
        pushing = self._joints(down, on_the_way.positions[-1], where)
        self._planned, self._pose, self._angles = self._planned + 1, down.poses[-1], pushing.positions[-1]
        return PlannedPush(on_the_way, pushing, turns)

    def _turns(self, path: ToolPath) -> float:
        """Whole turns by which the yaw is shifted so that the last joint stays around its middle."""
        angles = self.arm.joint_angles(path.poses)
        last = np.unwrap(angles[:, 0]) - path.poses[:, 2] - math.pi / 2 + self.arm.pose_world_from_base[2]
        if not np.isfinite(last).all():
            return 0.0
        return 2 * math.pi * round((last.min() + last.max()) / 2 / (2 * math.pi))

    def _check_reach(self, path: ToolPath, where: str) -> None:
        distances = self.arm.distances(path.poses)
        reached = np.array(np.isfinite(self.arm.joint_angles(path.poses, self.arm.lift)).all(-1))
        reached &= np.isfinite(self.arm.joint_angles(path.poses)).all(-1)
        for wrong, valid in (
            (~reached & (distances > 1.0), f"at most {self.arm.farthest:.2f} m are in reach"),
            (~reached | (distances < NEAREST), f"at least {NEAREST:g} m are valid"),
        ):
            if wrong.any():
                sample = int(wrong.argmax())
                raise ArmError(
                    f"{_place(where, path, sample)} is out of the arm's reach: {distances[sample]:.2f} m from the axis "
                    f"of its base, {valid}"
                )

    def _joints(self, path: ToolPath, first: Float[np.ndarray, "6"], where: str) -> JointPath:
        positions = np.empty((len(path.poses), 6))
        for sample, (pose, lift) in enumerate(zip(path.poses, path.lift, strict=True)):
            found = self._kinematics.solve(first, pose, float(lift))
            if found is None:
                raise ArmError(f"{_place(where, path, sample)}: no angles within the joint limits lead there")
            positions[sample] = first = found
        joints = JointPath(positions)
        names = self.model.joint_names
        for quantity, values, limits, unit in (
            ("joint limit", joints.positions, JOINT_LIMITS, "rad"),
            ("speed limit", joints.velocities, SPEED_LIMITS, "rad/s"),
            ("acceleration limit", joints.accelerations, np.full(6, ACCELERATION_LIMIT), "rad/s²"),
        ):
            excess = np.abs(values) / limits
            if excess.max() > 1:
                sample, joint = np.unravel_index(int(excess.argmax()), excess.shape)
                raise ArmError(
                    f"{_place(where, path, int(sample))}: {quantity} of {names[joint]}: it had to be at "
                    f"{abs(values[sample, joint]):.2f} {unit}, at most {limits[joint]:.2f} are valid"
                )
        for sample, angles in enumerate(positions):
            if touch := self.model.touch(self._data, angles):
                raise ArmError(f"{_place(where, path, sample)}: {touch}")
        return joints


class InverseKinematics:
    """Joint angles for poses of the tool, from those of the pose before."""

    def __init__(self, model: ArmModel, arm: Arm) -> None:
        self._mink = import_mink()
        self._arm = arm
        self._configuration = self._mink.Configuration(model.mujoco)
        self._task = self._mink.FrameTask(TOOL_SITE, "site", position_cost=1.0, orientation_cost=1.0)
        self._limits = [self._mink.ConfigurationLimit(model.mujoco)]
        self._height = float(_site_height(model, arm))

    def solve(
        self, first: Float[np.ndarray, "6"], pose: Float[np.ndarray, "3"], lift: float
    ) -> Float[np.ndarray, "6"] | None:
        """The angles nearest to `first` that bring the tool to a pose, lifted by so much (m); None if there are none."""
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        rotation = self._mink.SO3.from_matrix(np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]]))
        position = np.array([x, y, self._height + lift])
        self._task.set_target(self._mink.SE3.from_rotation_and_translation(rotation, position))
        self._configuration.update(first)
        for _ in range(ITERATIONS):
            velocity = self._mink.solve_ik(
                self._configuration, [self._task], dt=1.0, solver="daqp", damping=1e-12, limits=self._limits
            )
            self._configuration.integrate_inplace(velocity, 1.0)
            if np.abs(self._task.compute_error(self._configuration)).max() < EXACT:
                break
        if np.abs(self._task.compute_error(self._configuration)).max() > NEAR_ENOUGH:
            return None
        return self._configuration.q.copy()


def plan_arm(scene: Scene) -> tuple[ArmPlanner, list[PlannedPush]]:
    """All pushes of a scene, by its arm or one at the default place; raises ArmError if one cannot be done."""
    planner = ArmPlanner(scene.arm or Arm(), scene)
    return planner, [planner.plan(push) for push in scene.pushes]


def trajectory_of(model: ArmModel, planned: Sequence[PlannedPush]) -> JointTrajectory:
    """Everything that the arm does for these pushes, one after the other."""
    paths = [path for one in planned for path in (one.approach, one.down)]

    def whole(name: str) -> np.ndarray:
        return np.vstack([getattr(path, name)[index > 0 :] for index, path in enumerate(paths)] or [np.empty((0, 6))])

    positions = whole("positions")
    times = np.arange(len(positions)) * SAMPLE
    return JointTrajectory.of(model.joint_names, times, positions, whole("velocities"), whole("accelerations"))


def import_mink():
    """The package mink; raises ArmError if it is not installed."""
    try:
        import mink
    except ModuleNotFoundError:
        raise ArmError("the arm needs the extra `arm`: pip install 'pushgraph[arm]'") from None
    return mink


def _site_height(model: ArmModel, arm: Arm) -> float:
    """Of the tool's site above the table while it pushes (m)."""
    return arm.flange_height - model.mujoco.site(TOOL_SITE).pos[2]


def _place(where: str, path: ToolPath, sample: int) -> str:
    x, y, _ = path.poses[sample]
    return f"{where}: the tool at ({x:.3f}, {y:.3f}), {sample * SAMPLE:.2f} s on"
