"""Pushes by an arm: its servos follow the planned joints, and the tool is wherever that brings it."""

import math
from collections.abc import Iterator
from copy import copy
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.arm import Arm
from pushgraph.errors import ArmError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene
from pushgraph.simulation.arm_model import DAMPING, STIFFNESS, TOOL_SITE, ArmModel
from pushgraph.simulation.arm_planning import ArmPlanner, PlannedPush, plan_arm, trajectory_of
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.simulation.planar_model import TIMESTEP
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track

FELT = 0.02
"""The arm feels the contact's wrench as a mean over about so long (s): the tool is driven as if it had infinite mass,
so a single step's force may be an impact."""


class ArmExecution(NamedTuple):
    """What the arm did.

    track: the tool's poses are those of the simulated joints; begins with the tool lifted above the first start.
    trajectory: what the joints were told, from the same moment on. joint_positions: what they did, in every frame of
    the track (rad).
    """

    track: Track
    trajectory: JointTrajectory
    joint_positions: Float[np.ndarray, "frames 6"]


def simulate_with_arm(scene: Scene) -> ArmExecution:
    """Let the scene's arm, or one at the default place, make the scene's pushes.

    Raises ArmError before anything moves if the arm cannot do one of them, SimulationError as `simulate` does.
    """
    if not scene.pushes:
        raise ArmError("pushes: the scene has none, so the arm has nothing to do")
    scene = held(scene)
    planner, planned = plan_arm(scene)
    simulation = ArmSimulation(scene, planner)
    for push, plan in zip(scene.pushes, planned, strict=True):
        simulation.push(push, plan)
    return simulation.execution()


def held(scene: Scene) -> Scene:
    """The scene with an arm: its own, or one at the default place."""
    return scene if scene.arm is not None else scene.replace(arm=Arm())


class ArmSimulation(PlanarSimulation):
    """A scene whose tool is held by an arm. Pushes may be chosen as it goes; each is planned before it begins."""

    def __init__(self, scene: Scene, planner: ArmPlanner | None = None) -> None:
        scene = held(scene)
        super().__init__(scene, force_limits=False)
        self._planner = planner or ArmPlanner(scene)
        self._servos = Servos(self._planner.model)
        self._plans: list[PlannedPush] = []
        self._joint_positions: list[np.ndarray] = []
        self._felt = np.zeros(3)

    def push(self, push: Push, planned: PlannedPush | None = None) -> None:
        """Bring the tool to the start, push and rest; raises ArmError before it moves if the arm cannot do that."""
        self._plans.append(self._planner.plan(push) if planned is None else planned)
        super().push(push)

    def execution(self) -> ArmExecution:
        """What the arm did so far."""
        trajectory = trajectory_of(self._planner.model.joint_names, self._plans)
        return ArmExecution(self.track(), trajectory, np.array(self._joint_positions))

    def _come_down(self, start: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        path = self._plans[-1].approach
        if not self._frames:
            self._servos.place(path.positions[0])
            self._record(self._tool(start), LIFTED)
        steps = round(FRAME / TIMESTEP)
        angles, rates = path.at(np.arange(path.frames * steps) * TIMESTEP)
        here = self._tool_pose
        for frame in range(path.frames):
            self._step_lifted(here)
            for step in range(frame * steps, (frame + 1) * steps):
                self._servos.step(angles[step], rates[step], np.zeros(3), TIMESTEP)
            here = self._tool(start)
            if frame < path.frames - 1:
                self._record(here, LIFTED)
        self._felt = np.zeros(3)
        return here

    def _driven(self, motion: ToolMotion, steps: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        path = self._plans[-1].down
        step = FRAME / steps
        angles, rates = path.at(np.arange(path.frames * steps) * step)
        here = self._tool_pose
        for frame in range(path.frames):
            total = np.zeros(3)
            for index in range(frame * steps, (frame + 1) * steps):
                self._servos.step(angles[index], rates[index], self._frame.wrench_in_world(self._felt), step)
                there = self._tool(here)
                wrench = self._step_down(here, (there - here) / step)
                self._felt += (wrench - self._felt) * min(1.0, step / FELT)
                total += wrench
                here = there
            yield here, total / steps

    def _record(self, pose_of_tool: np.ndarray, push: int, wrench: np.ndarray | None = None) -> None:
        super()._record(pose_of_tool, push, wrench)
        self._joint_positions.append(self._servos.angles)

    def _tool(self, near: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Where the servos hold the tool, in the scene's own frame, with the yaw that is next to that of a pose."""
        found = self._frame.poses_from_world(self._servos.tool)
        found[2] = near[2] + math.remainder(found[2] - near[2], 2 * math.pi)
        return found


class Servos:
    """The arm's joints, each held to its angle by a spring and a damper, with what the tool meets as a load."""

    def __init__(self, model: ArmModel) -> None:
        self._model = copy(model.mujoco)  # whose contacts the planner still needs
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._data = mujoco.MjData(self._model)
        self._site = self._data.site(TOOL_SITE)
        self._flange = int(self._model.site(TOOL_SITE).bodyid[0])

    def place(self, angles: Float[np.ndarray, "6"]) -> None:
        """At rest at these angles."""
        self._data.qpos[:], self._data.qvel[:] = angles, 0.0
        mujoco.mj_forward(self._model, self._data)

    def step(
        self,
        angles: Float[np.ndarray, "6"],
        rates: Float[np.ndarray, "6"],
        wrench: Float[np.ndarray, "3"],
        seconds: float,
    ) -> None:
        """Follow angles and their rates for a moment, against a force (N) and a moment (N m) on the tool."""
        model, data = self._model, self._data
        model.opt.timestep = seconds
        data.ctrl[:] = angles + DAMPING / STIFFNESS * rates
        data.qfrc_applied[:] = 0.0
        force, moment = np.array([*wrench[:2], 0.0]), np.array([0.0, 0.0, wrench[2]])
        mujoco.mj_applyFT(model, data, force, moment, self._site.xpos, self._flange, data.qfrc_applied)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)

    @property
    def angles(self) -> Float[np.ndarray, "6"]:
        """Of the joints now (rad)."""
        return self._data.qpos.copy()

    @property
    def tool(self) -> Float[np.ndarray, "3"]:
        """Pose of the tool in the world, seen from above."""
        x, y, _ = self._site.xpos
        return np.array([x, y, np.arctan2(self._site.xmat[3], self._site.xmat[0])])
