"""From a scene's pushes to the joints of an arm over time, and what it cannot do, found before anything moves."""

import math
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.arm import NEAREST
from pushgraph.errors import ArmError
from pushgraph.extras import extra
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene
from pushgraph.simulation.arm_model import (
    ACCELERATION_LIMIT,
    ANGLE_LIMITS,
    SPEED_LIMITS,
    TOOL_SITE,
    ArmModel,
    build_arm,
)
from pushgraph.simulation.arm_path import SAMPLE, SAMPLES_PER_FRAME, ToolPath, along_push, to_start
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.motion import ToolMotion
from pushgraph.tool import Push

EXACT = 1e-7
"""Inverse kinematics ends so near to the tool's pose (m, rad)."""
NEAR_ENOUGH = 1e-4
ITERATIONS = 20
"""Of inverse kinematics at most, for a sample."""
NEAR_LIMIT = 0.05
"""A joint so near to its limit (rad) is named where no angles are found."""
SLOWEST = 0.1
"""A push with a speed, or a way between pushes, is slowed to this share of its pace before it is refused."""
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
    """What the arm does for one push: it brings the tool to the start, then moves it down on the table."""

    approach: JointPath
    down: JointPath


class ArmPlanner:
    """Plans one push after the other, each from where the last one ended."""

    def __init__(self, scene: Scene) -> None:
        """Raises ArmError if the scene has no arm, the extra is not installed or the lifted tool would hit a body."""
        self.model = build_arm(scene)
        self.arm = arm = self.model.arm
        self._tool = scene.tool
        tallest = max(body.shape.height for body in scene.bodies)
        if arm.lift < tallest + LOWEST_LIFT:
            name = max(scene.bodies, key=lambda body: body.shape.height).name
            raise ArmError(
                f"arm.lift: {arm.lift:g} m do not clear body {name!r}, {tallest:g} m high; at least "
                f"{tallest + LOWEST_LIFT:g} m are valid"
            )
        self._kinematics = InverseKinematics(self.model)
        self._data = mujoco.MjData(self.model.mujoco)
        self._planned = 0
        self._last: ToolPath | None = None
        self._angles: np.ndarray | None = None

    def plan(self, push: Push) -> PlannedPush:
        """The next push; raises ArmError, which names it, says where and why, if the arm cannot do it."""
        where = f"pushes[{self._planned}]"
        on_the_way = f"{where}, on the way to its start"
        if push.force_limit is not None:
            raise ArmError(f"{where}.force_limit: the arm is controlled by position; leave the force_limit out")
        motion = ToolMotion(push, self._tool)
        down = along_push(motion)
        turns = self._turns(down)

        def pushed(pace: float) -> ToolPath:
            path = along_push(motion, pace)
            return path._replace(poses=path.poses + [0.0, 0.0, turns])

        def approached(pace: float) -> ToolPath:
            return to_start(self.arm, self._last, down.poses[0] + [0.0, 0.0, turns], pace)

        self._check_reach(pushed(1.0), where)
        self._check_reach(approached(1.0), on_the_way)
        first = self._angles
        if first is None:
            above = approached(1.0)
            first = self.arm.joint_angles(above.poses[0], float(above.lift[0]))
        approach = self._in_time(approached, first, on_the_way, SLOWEST)
        pushing = self._in_time(pushed, approach.positions[-1], where, SLOWEST if push.times is None else 1.0)
        self._planned, self._angles = self._planned + 1, pushing.positions[-1]
        self._last = pushed(1.0)
        return PlannedPush(approach, pushing)

    def _turns(self, path: ToolPath) -> float:
        """Whole turns by which the yaw of the tool is shifted (rad), so that the last joint stays around its middle."""
        last = np.unwrap(self.arm.joint_angles(path.poses), axis=0)[:, -1]
        return 2 * math.pi * round((last.min() + last.max()) / 2 / (2 * math.pi)) if np.isfinite(last).all() else 0.0

    def _check_reach(self, path: ToolPath, where: str) -> None:
        reached = self.arm.reaches(path.poses)
        if reached.all():
            return
        sample = int(np.argmin(reached))
        raise ArmError(
            f"{_place(where, path, sample)} is out of the arm's reach: {self.arm.distances(path.poses)[sample]:.2f} m "
            f"from the axis of its base; from {NEAREST:g} to {self.arm.farthest:.2f} m are valid"
        )

    def _in_time(
        self, path_at: Callable[[float], ToolPath], first: Float[np.ndarray, "6"], where: str, slowest: float
    ) -> JointPath:
        """The joints along a path, at the fastest pace of a few that their limits allow."""
        pace = 1.0
        while True:
            path = path_at(pace)
            joints = JointPath(np.unwrap(self.arm.joint_angles(path.poses, path.lift), axis=0))
            excess = max(
                np.abs(joints.velocities / SPEED_LIMITS).max(),
                math.sqrt(np.abs(joints.accelerations / ACCELERATION_LIMIT).max()),
            )
            if excess <= 0.99:  # what inverse kinematics finds may differ by rounding
                break
            pace *= min(0.95 / excess, 0.95)
            if pace < slowest:
                raise ArmError(self._too_fast(path, joints, where))
        joints = self._joints(path, first, where)
        for sample, angles in enumerate(joints.positions):
            if touch := self.model.touch(self._data, angles):
                raise ArmError(f"{_place(where, path, sample)}: {touch}")
        return joints

    def _joints(self, path: ToolPath, first: Float[np.ndarray, "6"], where: str) -> JointPath:
        positions = np.empty((len(path.poses), 6))
        for sample, (pose, lift) in enumerate(zip(path.poses, path.lift, strict=True)):
            found = self._kinematics.solve(first, pose, float(lift))
            if found is None:
                outside = np.abs(first) > ANGLE_LIMITS - NEAR_LIMIT
                which = ", ".join(name for name, far in zip(self.model.joint_names, outside, strict=True) if far)
                reason = f"the joint limit of {which} is reached" if which else "no joint angles lead there"
                raise ArmError(f"{_place(where, path, sample)}: {reason}")
            positions[sample] = first = found
        return JointPath(positions)

    def _too_fast(self, path: ToolPath, joints: JointPath, where: str) -> str:
        """Say which joint is farthest beyond its speed limit, or else its acceleration limit."""
        quantity, values, limits, unit = "speed", joints.velocities, SPEED_LIMITS, "rad/s"
        if (np.abs(values) <= limits).all():
            quantity, values, unit = "acceleration", joints.accelerations, "rad/s²"
            limits = np.full(6, ACCELERATION_LIMIT)
        sample, joint = np.unravel_index(int(np.abs(values / limits).argmax()), values.shape)
        return (
            f"{_place(where, path, int(sample))}: {quantity} limit of {self.model.joint_names[joint]}: "
            f"{abs(values[sample, joint]):.2f} {unit} were needed, at most {limits[joint]:.2f} are valid"
        )


class InverseKinematics:
    """Joint angles for poses of the tool, from those of the pose before."""

    def __init__(self, model: ArmModel) -> None:
        self._mink = import_mink()
        self._configuration = self._mink.Configuration(model.mujoco)
        self._task = self._mink.FrameTask(TOOL_SITE, "site", position_cost=1.0, orientation_cost=1.0)
        self._limits = [self._mink.ConfigurationLimit(model.mujoco)]
        self._height = model.pushing_height

    def solve(
        self, first: Float[np.ndarray, "6"], pose: Float[np.ndarray, "3"], lift: float
    ) -> Float[np.ndarray, "6"] | None:
        """The angles nearest to `first` that bring the tool to a pose, lifted by so much (m); None if none do."""
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
    """All pushes of a scene by its arm; raises ArmError if one cannot be done."""
    planner = ArmPlanner(scene)
    return planner, [planner.plan(push) for push in scene.pushes]


def trajectory_of(joint_names: Sequence[str], planned: Sequence[PlannedPush]) -> JointTrajectory:
    """Everything that the arm does for these pushes, one after the other."""
    paths = [path for one in planned for path in (one.approach, one.down)]

    def whole(name: str) -> np.ndarray:
        return np.vstack([getattr(path, name)[index > 0 :] for index, path in enumerate(paths)] or [np.empty((0, 6))])

    positions = whole("positions")
    times = np.arange(len(positions)) * SAMPLE
    return JointTrajectory.of(joint_names, times, positions, whole("velocities"), whole("accelerations"))


def import_mink() -> ModuleType:
    """The package mink; raises MissingExtraError if it is not installed."""
    with extra("arm", "the arm"):
        import daqp  # noqa: F401, the solver that mink is told to use
        import mink
    return mink


def _place(where: str, path: ToolPath, sample: int) -> str:
    x, y, _ = path.poses[sample]
    return f"{where}: the tool at ({x:.3f}, {y:.3f}), {sample * SAMPLE:.2f} s on"
