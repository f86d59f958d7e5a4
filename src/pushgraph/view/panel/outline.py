"""A new body whose outline is drawn by clicks on the table."""

from typing import Any

import numpy as np

from pushgraph.errors import SceneError
from pushgraph.view.drawing.outline import DrawnOutline
from pushgraph.view.handles import where_on_table
from pushgraph.view.panel.bodies import BodyControls
from pushgraph.view.panel.controls import Controls
from pushgraph.view.session import Session


class OutlineControls(Controls):
    """Corners are clicked one after the other; closed, they are a polygon, with what else stands in `bodies`."""

    def __init__(self, session: Session, bodies: BodyControls) -> None:
        self.bodies = bodies
        self.corners: list[tuple[float, float]] = []
        """Of the outline so far (m)."""
        self.drawing = False
        """Whether clicks on the table add corners."""
        self._scene: Any = session.server.scene  # viser's types know no coroutine that is told of clicks
        self._drawn = DrawnOutline(session.server.scene, "/outline")
        super().__init__(session)

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.buttons(
            "Outline",
            {"Draw": self._draw, "Back": self._back, "Close": self._close},
            "Click the corners of a polygon on the table; take the last back; make it a body, with name, height and "
            "mass as they stand above",
        )

    def refresh(self) -> None:
        """Show the corners there are."""
        self._drawn.show(self.corners)

    def _draw(self) -> str:
        self.corners = []
        if not self.drawing:
            self.drawing = True
            self._scene.on_click()(self._clicked)
        return "Click the corners one after the other, then Close; Back takes the last back, and ends it."

    async def _clicked(self, event: Any) -> None:
        point = where_on_table(np.array(event.ray_origin), np.array(event.ray_direction), 0.0)
        if point is not None:
            corner = (round(float(point[0]), 3), round(float(point[1]), 3))
            self.session.do(lambda: self._add(corner), event.client)

    def _add(self, corner: tuple[float, float]) -> str:
        if not self.drawing:
            return ""
        self.corners = [*self.corners, corner]
        return f"{len(self.corners)} corners; Close makes them a body."

    def _back(self) -> str:
        if self.corners:
            self.corners = self.corners[:-1]
            return f"{len(self.corners)} corners."
        self._end()
        return ""

    def _close(self) -> str:
        if not self.drawing:
            raise SceneError("outline: none was begun: Draw, and click its corners")
        corners = np.array(self.corners).reshape(-1, 2)
        middle = corners.mean(0).round(3) if len(corners) else np.zeros(2)
        names = self.workbench.planar.names
        wanted = self.bodies.name.value
        free = next(name for name in (wanted, *(f"outline_{k}" for k in range(len(names) + 1))) if name not in names)
        points = np.round(corners - middle, 3).tolist()
        shape = {"kind": "polygon", "points": points, "height": self.bodies.height.value}
        body = {"name": free, "shape": shape, "mass": self.bodies.mass.value or None, "fixed": self.bodies.fixed.value}
        self.workbench.add_body(body | {"pose_world_from_body": [*middle.tolist(), 0.0]})
        self._end()
        self.bodies.choose(free)
        return f"{free!r} was added."

    def _end(self) -> None:
        self.corners, self.drawing = [], False
        self._scene.remove_click_callback(self._clicked)
