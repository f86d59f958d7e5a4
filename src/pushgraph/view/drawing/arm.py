"""The arm that makes the pushes, with the meshes of its links."""

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene
from pushgraph.simulation.arm import held
from pushgraph.simulation.arm_surface import ArmSurface
from pushgraph.view.drawing.colours import ARM
from pushgraph.view.drawing.layer import Layer, Movers


class DrawnArm:
    """A UR10 that holds the tool: as a trajectory of its joints says, or else as the tool's pose demands."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._movers = Movers(())
        self._surface: ArmSurface | None = None
        self._trajectory: JointTrajectory | None = None

    def show(self, scene: Scene, trajectory: JointTrajectory | None = None) -> None:
        """Draw the scene's arm, or one at the default place; raises ArmError without the extra that has its meshes."""
        scene = held(scene)
        heights = max(body.shape.height for body in scene.bodies)
        self._layer.draw((scene.arm, scene.tool, heights), lambda: self._draw(scene))
        self._trajectory = trajectory

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()
        self._movers, self._surface, self._trajectory = Movers(()), None, None

    def at(self, time: float, pose_world_from_tool: Float[np.ndarray, "7"]) -> float | None:
        """Bring it to where it is so long after its start (s); say how high it lifts the tool (m), None without arm.

        pose_world_from_tool: lifted, if its height is not 0. An arm that cannot hold the tool there is hidden.
        """
        if self._surface is None:
            return None
        if self._trajectory is not None:
            angles = angles_at(self._trajectory, time)
        else:
            x, y, z, w, _, _, v = pose_world_from_tool.tolist()
            arm = self._surface.arm
            angles = arm.joint_angles(np.array([x, y, 2 * np.arctan2(v, w)]), arm.lift if z else 0.0)
        if not np.isfinite(angles).all():
            self._movers.move(np.full((len(self._surface.links), 7), np.nan))
            return None
        self._movers.move(self._surface.link_poses(angles))
        return self._surface.lift(angles)

    def _draw(self, scene: Scene) -> None:
        self._surface = ArmSurface(scene)
        handles = []
        for index, triangles in enumerate(self._surface.links):
            vertices, faces = np.unique(triangles.reshape(-1, 3).round(5), axis=0, return_inverse=True)
            node, faces = f"{self._layer.node}/link_{index}", faces.reshape(-1, 3)
            handles.append(self._layer.api.add_mesh_simple(node, vertices, faces, color=ARM, side="double"))
        self._movers = Movers(handles)


def angles_at(trajectory: JointTrajectory, time: float) -> Float[np.ndarray, "6"]:
    """The joints' angles at a time after the start (s), evenly between two points."""
    times = trajectory.times
    return np.array([np.interp(time, times, column) for column in trajectory.positions.T])
