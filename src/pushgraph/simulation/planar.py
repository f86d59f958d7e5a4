"""Simulate pushes of a planar scene in MuJoCo and record a track."""

import mujoco
import numpy as np
from jaxtyping import Float

from pushgraph.body import ROBOT
from pushgraph.errors import SimulationError
from pushgraph.scene import OVERLAP, Scene
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.planar_model import LIFT_HEIGHT, TIMESTEP, build, link_name
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track

SUBSTEPS = round(FRAME / TIMESTEP)

_DIVERGED = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]


def simulate(scene: Scene) -> Track:
    """Run the scene's pushes one after the other; raises SimulationError if the scene cannot be simulated.

    A scene without pushes gives a track of one frame, with the tool lifted.
    """
    simulation = PlanarSimulation(scene)
    for push in scene.pushes:
        simulation.push(push)
    return simulation.track()


class PlanarSimulation:
    """A scene in motion. Pushes may be chosen as it goes; the same calls give the same bits anywhere."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._pushes: list[Push] = []
        self._model = build(scene)
        self._data = mujoco.MjData(self._model)
        self._links = [self._model.body(link_name(k)).id for k in range(len(scene.bodies))]
        first_joint = self._model.joint(int(self._model.body(ROBOT).jntadr[0]))
        self._robot_position = self._data.qpos[int(first_joint.qposadr[0]) :][:4]
        self._robot_velocity = self._data.qvel[int(first_joint.dofadr[0]) :][:4]
        self._frames: list[np.ndarray] = []
        self._frame_push: list[int] = []

    @property
    def poses(self) -> Float[np.ndarray, "bodies 3"]:
        """Poses of the bodies now, pose_world_from_body."""
        mujoco.mj_kinematics(self._model, self._data)
        rotation = self._data.xmat[self._links]
        yaw = np.arctan2(rotation[:, 3], rotation[:, 0])
        return np.column_stack((self._data.xpos[self._links, :2], yaw))

    def push(self, push: Push) -> None:
        """Let the tool come down, push and rest; after an earlier push it first lifts and moves there.

        Raises SimulationError if the tool would come down on a body, or the simulation diverges.
        """
        motion = ToolMotion(push, self.scene.tool)
        start = motion.pose(0.0)
        if self._frames:
            for above in (self._frames[-1][0], start):
                self._step_lifted(above)
                self._record(above, LIFTED)
            self._step_lifted(start)
        self._check_start(start)
        self._pushes.append(push)
        index = len(self._pushes) - 1
        self._record(start, index)
        here = start
        for frame in range(motion.frames):
            for substep in range(frame * SUBSTEPS, (frame + 1) * SUBSTEPS):
                there = motion.pose((substep + 1) * TIMESTEP)
                self._place_tool(here, there, down=True)
                mujoco.mj_step(self._model, self._data)
                here = there
            self._check_finite()
            self._record(here, index)

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
        )

    def _place_tool(self, now: np.ndarray, after_step: np.ndarray, down: bool) -> None:
        """Set the tool's pose and the velocity that brings it to its next pose in one step."""
        velocity = (after_step - now) / TIMESTEP
        self._robot_position[:] = (now[0], now[1], -LIFT_HEIGHT if down else 0.0, now[2])
        self._robot_velocity[:] = (velocity[0], velocity[1], 0.0, velocity[2])

    def _step_lifted(self, pose_world_from_tool: np.ndarray) -> None:
        for _ in range(SUBSTEPS):
            self._place_tool(pose_world_from_tool, pose_world_from_tool, down=False)
            mujoco.mj_step(self._model, self._data)
        self._check_finite()

    def _record(self, pose_world_from_tool: np.ndarray, push: int) -> None:
        self._frames.append(np.vstack((pose_world_from_tool, self.poses)))
        self._frame_push.append(push)

    def _check_start(self, pose_world_from_tool: np.ndarray) -> None:
        gaps = self.scene.tool_gaps(pose_world_from_tool[None], self.poses)[0]
        if gaps.min() < -OVERLAP:
            raise SimulationError(
                f"pushes[{len(self._pushes)}].start: the tool would come down on body "
                f"{self.scene.names[int(gaps.argmin())]!r}, {-gaps.min() * 1e3:.1f} mm deep, where it lies by then; "
                "start clear of the bodies"
            )

    def _check_finite(self) -> None:
        if any(self._data.warning[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation diverged in pushes[{len(self._pushes) - 1}]; look for bodies pressed into each "
                "other, or masses that differ by many orders of magnitude"
            )
