"""Simulate pushes of a planar scene in MuJoCo and record a track."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from pushgraph.errors import SimulationError
from pushgraph.plausibility import start_fault
from pushgraph.scene import Scene
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.own_frame import OwnFrame
from pushgraph.simulation.planar_model import LIFT_HEIGHT, NO_LIMIT, TIMESTEP, build
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track

TRAVEL = 0.9e-3
"""No point of the tool moves farther in a step (m): it comes to lie so deep in what it meets, until that yields."""
STALL = 1e-3
"""A pusher that lags so far behind (m), its force at its limit, waits until it is let on."""
CATCH_UP = 0.02
"""In about this time (s) a pusher that lags catches up, if its force suffices."""

THROWN, THROWN_RATIO = 5.0, 25.0
"""A body both so fast (m/s) and so much faster than the tool was not pushed: crushed, it was thrown by the solver."""

_CLUTCH = 4
"""Place of the clutch among the robot's joints: x, y, height, heading, clutch, yaw."""
_LESS_FORCE = "Let the push end earlier, go more slowly, or give it a force_limit"
_DIVERGED = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]


def simulate(scene: Scene, progress: Callable[[int], None] = lambda frame: None) -> Track:
    """Run the scene's pushes one after the other; raises SimulationError if the scene cannot be simulated.

    A scene without pushes gives a track of one frame, with the tool lifted. progress: told every frame.
    """
    simulation = PlanarSimulation(scene, progress=progress)
    for push in scene.pushes:
        simulation.push(push)
    return simulation.track()


class PlanarSimulation:
    """A scene in motion. Pushes may be chosen as it goes; the same calls give the same bits anywhere.

    force_limits: whether pushes may have force limits; by default, if one of the scene's has. progress: told every
    frame.
    """

    def __init__(
        self,
        scene: Scene,
        force_limits: bool | None = None,
        progress: Callable[[int], None] = lambda frame: None,
    ) -> None:
        self.scene, self._progress = scene, progress
        if force_limits is None:
            force_limits = any(push.force_limit is not None for push in scene.pushes)
        self._pushes: list[Push] = []
        self._frame = OwnFrame(scene)
        self._model = build(self._frame.scene(scene), clutch=force_limits)
        self._data = mujoco.MjData(self._model.mujoco)
        self._robot_position = self._data.qpos[self._model.robot_position]
        self._robot_velocity = self._data.qvel[self._model.robot_velocity]
        self._robot_force = self._data.qfrc_constraint[self._model.robot_velocity]
        self._tool_pose = np.zeros(3)
        self._frames: list[np.ndarray] = []
        self._frame_push: list[int] = []
        self._wrenches: list[np.ndarray] = []

    @property
    def poses(self) -> Float[np.ndarray, "bodies 3"]:
        """Poses of the bodies now, pose_world_from_body."""
        mujoco.mj_kinematics(self._model.mujoco, self._data)
        rotation = self._data.xmat[self._model.links]
        yaw = np.arctan2(rotation[:, 3], rotation[:, 0])
        return self._frame.poses_in_world(np.column_stack((self._data.xpos[self._model.links, :2], yaw)))

    def push(self, push: Push) -> None:
        """Let the tool come down, push and rest; after an earlier push it first lifts and moves there.

        Raises SimulationError if the tool would come down on a body, or the simulation diverges.
        """
        if push.force_limit is not None and not self._model.clutch:
            raise SimulationError(
                f"pushes[{len(self._pushes)}].force_limit: this simulation was begun without force limits; begin it "
                "with PlanarSimulation(scene, force_limits=True)"
            )
        motion = ToolMotion(self._frame.push(push), self.scene.tool)
        start = self._come_down(motion.pose(0.0))
        index = len(self._pushes)
        if fault := start_fault(self.scene, index, self._frame.poses_in_world(start), self.poses):
            raise SimulationError(fault)
        self._pushes.append(push)
        self._record(start, index)
        steps = math.ceil(FRAME / min(TIMESTEP, TRAVEL / max(motion.speed, 1e-9)) - 1e-9)
        self._model.set_timestep(FRAME / steps)
        if self._model.clutch:
            limit = NO_LIMIT if push.force_limit is None else push.force_limit
            self._model.mujoco.dof_frictionloss[self._model.robot_velocity][_CLUTCH] = limit
        for here, wrench in (self._driven if push.force_limit is None else self._driven_with_limit)(motion, steps):
            self._record(here, index, wrench)
            self._check_thrown(index, motion.speed)
        self._check_finite()

    def track(self) -> Track:
        """The track so far; its scene holds the pushes made so far."""
        frames = self._frames or [np.vstack((np.zeros(3), self.poses))]
        poses = np.array(frames)
        yaw = np.vstack((self.scene.poses_world_from_body[:, 2], poses[:, 1:, 2]))
        poses[:, 1:, 2] = np.unwrap(yaw, axis=0)[1:]
        return Track(
            scene=self.scene.replace(pushes=tuple(self._pushes)),
            times=np.arange(len(poses)) * FRAME,
            poses=poses,
            push=np.array(self._frame_push or [LIFTED]),
            seen=np.ones(poses.shape[:2], dtype=bool),
            wrench=np.array(self._wrenches or [np.zeros(3)]),
        )

    def _step(self) -> None:
        mujoco.mj_step(self._model.mujoco, self._data)

    def _come_down(self, start: np.ndarray) -> np.ndarray:
        """Lift the tool and bring it to the start of a push; where it then comes down, in the own frame."""
        if self._frames:
            for above in (self._tool_pose, start):
                self._step_lifted(above)
                self._record(above, LIFTED)
            self._step_lifted(start)
        return start

    def _driven(self, motion: ToolMotion, steps: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Drive the tool along its motion, so many steps a frame: its pose after each frame, and the wrench on it."""
        poses = motion.poses(np.arange(motion.frames * steps + 1) * (FRAME / steps))
        positions = self._robot_joints(poses, -LIFT_HEIGHT)
        velocities = self._robot_joints(np.diff(poses, axis=0) * (steps / FRAME), 0.0)
        for frame in range(motion.frames):
            force = np.zeros(len(self._robot_force))
            for step in range(frame * steps, (frame + 1) * steps):
                self._robot_position[:] = positions[step]
                self._robot_velocity[:] = velocities[step]
                self._step()
                force += self._robot_force
            yield poses[(frame + 1) * steps], force[[0, 1, -1]] / steps

    def _driven_with_limit(self, motion: ToolMotion, steps: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same for a tool that slips along its way where its force would pass the limit.

        What drives it goes faster while it lags, and is set back after each step; if it lags by more than STALL, to
        where it was before the step.
        """
        step = FRAME / steps
        pose, heading, time, slip, drive = motion.pose(0.0), 0.0, 0.0, 0.0, 0.0
        for _ in range(motion.frames):
            force = np.zeros(len(self._robot_force))
            for _ in range(steps):
                goes_on = abs(slip) <= STALL
                velocity = (motion.pose(time + step) - pose) / step
                speed = float(np.hypot(*velocity[:2]))
                if speed:
                    heading = math.atan2(velocity[1], velocity[0])
                along = np.array([math.cos(heading), math.sin(heading), 0.0])
                catch_up = -slip / CATCH_UP
                tool_speed = drive + self._robot_velocity[_CLUTCH]
                drive = speed + catch_up
                x, y, _ = drive * along
                turning = velocity[2] * goes_on
                self._robot_position[:] = (pose[0], pose[1], -LIFT_HEIGHT, heading, slip, pose[2] - heading)
                self._robot_velocity[:] = (x, y, 0.0, 0.0, tool_speed - drive, turning)
                self._step()
                force += self._robot_force
                time += step * goes_on
                pose = motion.pose(time)
                slip = self._robot_position[_CLUTCH] + step * (catch_up if goes_on else drive)
            yield pose + slip * along, force[[0, 1, -1]] / steps

    def _step_down(self, pose_of_tool: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Step with the tool down at a pose and moving; the wrench on it, all in the own frame."""
        self._robot_position[:] = self._robot_joints(pose_of_tool[None], -LIFT_HEIGHT)[0]
        self._robot_velocity[:] = self._robot_joints(velocity[None], 0.0)[0]
        self._step()
        return self._robot_force[[0, 1, -1]]

    def _robot_joints(self, poses: Float[np.ndarray, "times 3"], height: float) -> Float[np.ndarray, "times joints"]:
        """Positions of the robot's joints for poses of the tool, or their velocities; a clutch holds."""
        joints = np.zeros((len(poses), len(self._robot_position)))
        joints[:, [0, 1, -1]], joints[:, 2] = poses, height
        return joints

    def _step_lifted(self, pose_of_tool: np.ndarray) -> None:
        self._model.set_timestep(TIMESTEP)
        joints = self._robot_joints(pose_of_tool[None], 0.0)[0]
        for _ in range(round(FRAME / TIMESTEP)):
            self._robot_position[:] = joints
            self._robot_velocity[:] = 0.0
            self._step()

    def _record(self, pose_of_tool: np.ndarray, push: int, wrench: np.ndarray | None = None) -> None:
        self._tool_pose = pose_of_tool
        self._frames.append(np.vstack((self._frame.poses_in_world(pose_of_tool), self.poses)))
        self._frame_push.append(push)
        self._wrenches.append(np.zeros(3) if wrench is None else self._frame.wrench_in_world(wrench))
        self._progress(len(self._frames) - 1)

    def _check_thrown(self, push: int, tool_speed: float) -> None:
        """tool_speed: of its fastest point (m/s)."""
        motion = (self._frames[-1] - self._frames[-2])[1:, :2]
        speeds = np.hypot(*motion.T) / FRAME
        fastest = int(speeds.argmax())
        if speeds[fastest] > max(THROWN, THROWN_RATIO * tool_speed):
            raise SimulationError(
                f"pushes[{push}]: body {self.scene.names[fastest]!r} is thrown off at {speeds[fastest]:.3g} m/s by a "
                f"tool of {tool_speed:.3g} m/s: it is crushed between what cannot give way. {_LESS_FORCE}"
            )

    def _check_finite(self) -> None:
        if any(self._data.warning[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation diverged in pushes[{len(self._pushes) - 1}]; look for bodies pressed into each "
                "other or against what cannot give way, or masses that differ by many orders of magnitude. "
                f"{_LESS_FORCE}"
            )
