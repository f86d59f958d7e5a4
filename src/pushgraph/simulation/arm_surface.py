"""The surface of an arm at given joint angles, for pictures."""

import numpy as np
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.arm import Arm
from pushgraph.scene import Scene
from pushgraph.simulation.arm_model import ROD_RADIUS, TOOL_SITE, build_arm
from pushgraph.simulation.engine import mujoco

ROD_SIDES = 12


class ArmSurface:
    """Triangles of the links of a scene's arm, and of the rod that joins its flange and the tool."""

    def __init__(self, scene: Scene) -> None:
        self._arm = build_arm(scene)
        self._model = model = self._arm.mujoco
        self._data = mujoco.MjData(model)
        self._meshes: list[tuple[int, np.ndarray]] = []
        for geom in np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)).tolist():
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            faces = model.mesh_face[first : first + count] + int(model.mesh_vertadr[mesh])
            self._meshes.append((geom, model.mesh_vert[faces].astype(float)))
        angles = np.linspace(0, 2 * np.pi, ROD_SIDES + 1)
        circle = ROD_RADIUS * np.column_stack((np.cos(angles), np.sin(angles)))
        length = model.site(TOOL_SITE).pos[2]
        top, end = (np.column_stack((circle, np.full(len(circle), z))) for z in (0.0, length))
        self._rod = np.concatenate(
            (np.stack((top[:-1], top[1:], end[1:]), 1), np.stack((top[:-1], end[1:], end[:-1]), 1))
        )

    @property
    def links(self) -> list[Float[np.ndarray, "triangles 3 3"]]:
        """Corners of the triangles of the rod and of the links, each in its own frame (m)."""
        return [self._rod, *(mesh for _, mesh in self._meshes)]

    def link_poses(self, angles: Float[np.ndarray, "6"]) -> Float[np.ndarray, "links 7"]:
        """Their poses in the world, z up from the table."""
        data = self._data
        data.qpos[:] = angles
        mujoco.mj_kinematics(self._model, data)
        flange = int(self._model.site(TOOL_SITE).bodyid[0])
        geoms = [geom for geom, _ in self._meshes]
        positions = np.vstack((data.xpos[flange], data.geom_xpos[geoms]))
        turns = np.zeros((len(positions), 4))
        for turn, matrix in zip(turns, (data.xmat[flange], *data.geom_xmat[geoms]), strict=True):
            mujoco.mju_mat2Quat(turn, matrix)
        return np.hstack((positions, turns))

    def at(self, angles: Float[np.ndarray, "6"]) -> Float[np.ndarray, "triangles 3 3"]:
        """Corners of all triangles in the world (m), z up from the table."""
        placed = zip(self.link_poses(angles), self.links, strict=True)
        return np.concatenate([pose_3d.transform(link_pose, corners) for link_pose, corners in placed])

    @property
    def arm(self) -> Arm:
        """Whose surface it is."""
        return self._arm.arm

    def lift(self, angles: Float[np.ndarray, "6"]) -> float:
        """How high the tool is lifted at these angles (m)."""
        self._data.qpos[:] = angles
        mujoco.mj_kinematics(self._model, self._data)
        return float(self._data.site(TOOL_SITE).xpos[2]) - self._arm.pushing_height
