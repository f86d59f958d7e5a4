"""Simulated pushes with the forces at every contact."""

import numpy as np
from jaxtyping import Float

from pushgraph.forces import ContactForces, mean_over_frames
from pushgraph.scene import Scene
from pushgraph.simulation.engine import mujoco
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.simulation.planar_model import SIDES
from pushgraph.track import Track


def simulate_with_forces(scene: Scene) -> tuple[Track, ContactForces]:
    """What `simulate` gives, and the forces where sides touch; those of joints MuJoCo does not tell apart."""
    simulation = _Sensing(scene)
    for push in scene.pushes:
        simulation.push(push)
    return simulation.track(), simulation.forces()


class _Sensing(PlanarSimulation):
    """Reads the forces at contacts after every step."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        model = self._model.mujoco
        nodes = np.zeros(model.nbody, dtype=int)  # what is no body is the tool
        nodes[self._model.links] = 1 + np.arange(len(self._model.links))
        self._node = nodes[model.geom_bodyid]
        self._is_side = model.geom_conaffinity == SIDES
        self._now: list[list[tuple]] = []
        """Of each step since the last frame, its contacts: nodes, point and force, in the own frame."""
        self._rows: list[tuple] = []
        """Of all steps: share of the frame, frame, step, nodes, point, force."""
        self._steps = 0

    def forces(self) -> ContactForces:
        """Of the frames so far."""
        rows = np.array(self._rows or np.zeros((0, 9)))
        share, (frame, step, first, second) = rows[:, 0], rows[:, 1:5].astype(int).T
        zeros = np.zeros((len(rows), 1))
        points = self._frame.poses_in_world(np.hstack((rows[:, 5:7], zeros)))[:, :2]
        forces = self._frame.wrench_in_world(np.hstack((rows[:, 7:], zeros)))[:, :2]
        found = ContactForces(frame, first, second, points, forces, np.zeros(len(rows), dtype=bool))
        return mean_over_frames(share, step, found)

    def _step(self) -> None:
        super()._step()
        contacts, wrench, found = self._data.contact, np.zeros(6), []
        for index, geoms in enumerate(contacts.geom):
            if self._is_side[geoms].all():
                mujoco.mj_contactForce(self._model.mujoco, self._data, index, wrench)
                force = wrench[:3] @ contacts.frame[index].reshape(3, 3)
                if force.any():
                    found.append((*self._node[geoms], *contacts.pos[index, :2], *force[:2]))
        self._now.append(found)

    def _record(self, pose_of_tool: np.ndarray, push: int, wrench: Float[np.ndarray, "3"] | None = None) -> None:
        super()._record(pose_of_tool, push, wrench)
        frame = len(self._frames) - 1
        for number, contacts in enumerate(self._now):
            self._rows += [(1 / len(self._now), frame, self._steps + number, *contact) for contact in contacts]
        self._steps += len(self._now)
        self._now = []
