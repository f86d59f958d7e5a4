"""Where a body is to go."""

import numpy as np
import viser

from pushgraph.planning.goal import Goal, index_of
from pushgraph.scene import Scene
from pushgraph.view.drawing.colours import GOAL
from pushgraph.view.drawing.layer import Layer, add_lines, add_solid
from pushgraph.view.drawing.placing import in_space
from pushgraph.view.drawing.solids import circle, outline_of, prism

HEIGHT = 0.004


class DrawnGoal:
    """The outline of a body where it shall be, on the table, and the circle in which it counts as there."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)

    def show(self, scene: Scene, goal: Goal) -> None:
        """Draw it, if it is another than before."""
        body = scene.bodies[index_of(scene, goal.body)]
        self._layer.draw((goal, body), lambda: self._draw(goal, outline_of(body.shape), body.pose_world_from_body[2]))

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()

    def _draw(self, goal: Goal, outline: np.ndarray, yaw: float) -> None:
        api, node = self._layer.api, f"{self._layer.node}/place"
        place = in_space(np.array([*goal.position, yaw if goal.yaw is None else goal.yaw])).tolist()
        api.add_frame(node, show_axes=False, position=place[:3], wxyz=place[3:])
        solid = prism(outline, 0.001, HEIGHT)
        add_solid(api, f"{node}/solid", solid, GOAL, opacity=0.35, cast_shadow=False)
        ring = prism(circle(goal.tolerance), HEIGHT, HEIGHT)
        for name, edges in (("edges", solid.edges), ("tolerance", ring.edges)):
            add_lines(api, f"{node}/{name}", edges, GOAL, 3.0)
