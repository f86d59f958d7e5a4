"""Simulate a scene in space in MuJoCo: boxes with six degrees of freedom, and a tool that goes where it is told."""

import numpy as np
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.errors import SimulationError
from pushgraph.lever_scene import Box, LeverScene, ToolBox
from pushgraph.lever_track import LeverTrack, frame_times
from pushgraph.simulation.engine import mujoco
from pushgraph.track_frames import FRAME

STEPS = 100
"""Steps of a frame."""
ONSET, IMPEDANCE, FULL = 0.5, 0.99, 1e-4
"""Contacts begin at this impedance, and are at the other within so much overlap (m)."""
TANGENTIAL_STIFFNESS = 10.0
TOOL_MASS = 1e5
"""kg: next to it nothing else weighs anything."""
THROWN = 3.0
"""m/s: a board whose velocity changes so much within a frame was crushed, and thrown by the solver."""

_REMEDY = "pressed against what cannot give way: let the tool go more slowly, or another way"
CRUSHED = 2e-3
"""Deeper overlap (m) is not from contacts that give way a little, but from a board with nowhere to go."""


def simulate_lever(scene: LeverScene, steps: int = STEPS) -> LeverTrack:
    """Move the tool along its path, in so many steps a frame; the same scene gives the same bits anywhere.

    Raises SimulationError if the board is crushed between what cannot give way.
    """
    times = frame_times(scene)
    poses = np.tile(np.concatenate((np.zeros((1, 7)), scene.poses_world_from_body)), (len(times), 1, 1))
    poses[:, 0], poses[:, 1 + scene.board] = scene.tool_poses(times), step_board(build(scene, steps), scene)
    track = LeverTrack(scene, poses)
    deepest = int(track.penetration.argmax())
    if track.penetration[deepest] > CRUSHED:
        raise SimulationError(
            f"the board is crushed {track.penetration[deepest] * 1e3:.1f} mm deep at {times[deepest]:.2f} s, {_REMEDY}"
        )
    return track


def step_board(model: mujoco.MjModel, scene: LeverScene) -> Float[np.ndarray, "frames 7"]:
    """pose_world_from_board in every frame; model: see `build`. Raises SimulationError if the board is thrown off."""
    data, start = mujoco.MjData(model), scene.poses_world_from_body[scene.board]
    data.qpos[7:] = start
    steps = round(FRAME / model.opt.timestep)
    tool = scene.tool_poses(np.arange((len(frame_times(scene)) - 1) * steps + 1) * (FRAME / steps))
    velocities = _velocities(tool) * (steps / FRAME)
    board = [start]
    for step, velocity in enumerate(velocities):
        data.qpos[:7], data.qvel[:6] = tool[step], velocity
        mujoco.mj_step(model, data)
        if (step + 1) % steps == 0:
            board.append(pose_3d.normalized(data.qpos[7:].copy()))
            _check_thrown(board)
    return np.array(board)


def build(scene: LeverScene, steps: int = STEPS) -> mujoco.MjModel:
    """The model: body 1 is the tool, body 2 the board; they and the fixed boxes touch in explicit pairs only."""
    spec = mujoco.MjSpec()
    spec.option.timestep = FRAME / steps
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.impratio = TANGENTIAL_STIFFNESS
    spec.option.gravity = list(scene.gravity)
    tool = spec.worldbody.add_body(name="tool", explicitinertial=True, mass=TOOL_MASS, inertia=[TOOL_MASS] * 3)
    tool.gravcomp = 1.0
    tool.add_freejoint()
    board = spec.worldbody.add_body(name="board")
    board.add_freejoint()
    touched: dict[str, tuple[Box | ToolBox, mujoco.MjsBody, float]] = {
        f"tool {index}": (box, tool, scene.tool.friction) for index, box in enumerate(scene.tool.boxes)
    }
    touched |= {f"body {body.name}": (body, spec.worldbody, body.friction) for body in scene.bodies if body.fixed}
    own = scene.bodies[scene.board]
    _add_geom(board, "board", own, np.array([0.0, 0, 0, 1, 0, 0, 0]), mass=own.mass)
    for name, (box, parent, friction) in touched.items():
        _add_geom(parent, name, box, box.pose, mass=0.0)
        largest = max(friction, own.friction, 1e-5)
        spec.add_pair(
            geomname1="board",
            geomname2=name,
            condim=3,
            friction=[largest, largest, 0, 0, 0],
            solref=[2 * FRAME / steps, 1.0],
            solimp=[ONSET, IMPEDANCE, FULL, 0.5, 2.0],
        )
    return spec.compile()


def _add_geom(parent: mujoco.MjsBody, name: str, box: Box | ToolBox, pose: Float[np.ndarray, "7"], mass: float) -> None:
    """A geom that touches nothing but what pairs name."""
    parent.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[side / 2 for side in box.size],
        pos=pose[:3].tolist(),
        quat=pose[3:].tolist(),
        mass=mass,
        contype=0,
        conaffinity=0,
    )


def _velocities(poses: Float[np.ndarray, "times 7"]) -> Float[np.ndarray, "steps 6"]:
    """What leads from each pose to the next: displacement in the world, rotation vector in the frame itself."""
    before, after = poses[:-1], poses[1:]
    turn = pose_3d.rotation_vector(pose_3d.multiply(pose_3d.conjugate(before[:, 3:]), after[:, 3:]))
    return np.concatenate((after[:, :3] - before[:, :3], turn), axis=-1)


def _check_thrown(board: list[np.ndarray]) -> None:
    """board: its poses in the frames so far, the last to be checked."""
    places = np.array([board[max(-3, -len(board))], *board[-2:]])[:, :3]
    change = np.linalg.norm(places[2] - 2 * places[1] + places[0]) / FRAME
    if not change <= THROWN:  # NaN, too
        raise SimulationError(
            f"the board is thrown off by {change:.3g} m/s at {(len(board) - 1) * FRAME:.2f} s, {_REMEDY}"
        )
