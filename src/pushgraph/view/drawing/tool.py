"""The tool, and the pushes that it will make."""

from collections.abc import Sequence

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.lever_scene import LeverScene
from pushgraph.scene import Scene
from pushgraph.tool import Push
from pushgraph.view.drawing.colours import EDGE, PUSH, TOOL
from pushgraph.view.drawing.layer import Layer, Movers, add_arrow, add_lines, add_solid
from pushgraph.view.drawing.names import GAP, View, add_label
from pushgraph.view.drawing.solids import box, outline_of, prism

SHAFT, HEAD = 0.004, 0.011
"""Radii of the arrow of a push (m)."""
SAME = 0.03
"""Pushes that begin so near each other share a number (m)."""


class DrawnTool:
    """The tool at any pose."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._movers = Movers(())

    def show(self, scene: Scene | LeverScene) -> None:
        """Draw it, if it is another than before."""
        self._layer.draw(scene.tool, lambda: self._draw(scene))

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()
        self._movers = Movers(())

    def move(self, pose_world_from_tool: Float[np.ndarray, "7"]) -> None:
        """Bring it to a pose; hide it if that is not known."""
        self._movers.move(pose_world_from_tool[None])

    def _draw(self, scene: Scene | LeverScene) -> None:
        api, frame = self._layer.api, f"{self._layer.node}/frame"
        self._movers = Movers([api.add_frame(frame, show_axes=False)])
        if isinstance(scene, LeverScene):
            solids = [box(part.size) for part in scene.tool.boxes]
            places = [part.pose.tolist() for part in scene.tool.boxes]
        else:
            shapes = [part.shape for part in scene.tool.parts]
            solids = [prism(outline_of(shape), 0.0, shape.height) for shape in shapes]
            poses = [part.pose_tool_from_part for part in scene.tool.parts]
            places = [[x, y, 0.0, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)] for x, y, yaw in poses]
        for index, (solid, place) in enumerate(zip(solids, places, strict=True)):
            at = {"position": place[:3], "wxyz": place[3:]}
            add_solid(api, f"{frame}/part_{index}", solid, TOOL, opacity=0.85, **at)
            add_lines(api, f"{frame}/edges_{index}", solid.edges, EDGE, **at)


def arrow_height(scene: Scene) -> float:
    """At which pushes are drawn (m): over whatever there is."""
    heights = [body.shape.height for body in scene.bodies] + [part.shape.height for part in scene.tool.parts]
    return max(heights) + GAP


class DrawnPushes:
    """Arrows over the bodies along which the tool will go, and their numbers from 1 on."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)

    def show(self, scene: Scene, view: View) -> None:
        """Draw them, if they are others than before."""
        height = arrow_height(scene)
        self._layer.draw((scene.pushes, height, view), lambda: self._draw(scene.pushes, height, view))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()

    def _draw(self, pushes: Sequence[Push], height: float, view: View) -> None:
        api, node = self._layer.api, self._layer.node
        numbers: dict[tuple[float, float, float], list[int]] = {}
        for index, push in enumerate(pushes):
            points = np.column_stack((push.waypoints[:, :2], np.full(len(push.waypoints), height)))
            legs = np.stack((points[:-1], points[1:]), 1)
            if len(legs) > 1:
                api.add_line_segments(f"{node}/path_{index}", legs[:-1], PUSH, thickness=2 * SHAFT)
            head = min(3 * HEAD, 0.5 * float(np.linalg.norm(legs[-1, 1] - legs[-1, 0])))
            add_arrow(api, f"{node}/arrow_{index}", legs[-1], PUSH, SHAFT, HEAD, max(head, 1e-3))
            start = points[0]
            foot = np.array([[[*start[:2], 0.002], start]])
            add_lines(api, f"{node}/foot_{index}", foot, PUSH)
            place = next((at for at in numbers if np.hypot(*np.subtract(at, start)[:2]) < SAME), tuple(start.tolist()))
            numbers.setdefault(place, []).append(index + 1)
        for index, (place, those) in enumerate(numbers.items()):
            add_label(api, f"{node}/number_{index}", ", ".join(map(str, those)), place, view)
