"""Bodies: their shapes, masses and places."""

import math
from typing import Any

import numpy as np

from pushgraph.body import Body
from pushgraph.scene import Scene
from pushgraph.shape import Polygon
from pushgraph.view.panel.controls import NONE, Controls, offer

SHAPES = ("cuboid", "cylinder")
AS_IT_IS = "as it is"
"""Of a shape that is not told by numbers: a polygon."""


class BodyControls(Controls):
    """One body at a time; it can be dragged in the drawing, too."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.body = self.gui.add_dropdown("Chosen", (NONE,))
        self.name = self.gui.add_text("Name", "")
        self.shape = self.gui.add_dropdown("Shape", (*SHAPES, AS_IT_IS))
        self.size = self.gui.add_vector2(
            "Size (m)", (0.1, 0.1), step=0.005, hint="Of a cylinder the first: its diameter"
        )
        self.height = self.gui.add_number("Height (m)", 0.1, step=0.005)
        self.mass = self.gui.add_number("Mass (kg)", 0.5, step=0.05, hint="0: not known")
        self.fixed = self.gui.add_checkbox("fixed", False, hint="Nothing moves it")
        self.position = self.gui.add_vector2("Place (m)", (0.0, 0.0), step=0.005)
        self.yaw = self.gui.add_number("Yaw (deg)", 0.0, step=1.0)
        self.buttons(
            "Body",
            {"Change": self._change, "Add": self._add, "Delete": lambda: self.workbench.delete(self.body.value)},
            "Take over what stands here; add one as stands here; delete this one with its joints",
        )
        self.on_change(self.body, lambda: None)
        self._shown: Body | None = None

    def choose(self, name: str) -> None:
        """Show a body."""
        offer(self.body, self.workbench.scene.names, name)

    def refresh(self) -> None:
        """Show the chosen body as it is."""
        scene = self.workbench.scene
        names = scene.names if isinstance(scene, Scene) else ()
        offer(self.body, names)
        if self.body.value not in names or not isinstance(scene, Scene):
            return
        body = scene.bodies[names.index(self.body.value)]
        if body == self._shown:  # what is being typed stays, whatever else changes meanwhile
            return
        self._shown = body
        self.name.value, self.fixed.value, self.mass.value = body.name, body.fixed, body.mass or 0.0
        self.height.value = body.shape.height
        self.shape.value = AS_IT_IS if isinstance(body.shape, Polygon) else body.shape.kind
        if body.shape.kind == "cylinder":
            self.size.value = (body.shape.diameter, body.shape.diameter)
        elif body.shape.kind == "cuboid":
            self.size.value = body.shape.size
        x, y, yaw = body.pose_world_from_body
        self.position.value, self.yaw.value = (x, y), math.degrees(yaw)

    def _fields(self) -> dict[str, Any]:
        fields: dict[str, Any] = {"name": self.name.value, "fixed": self.fixed.value}
        fields["mass"] = self.mass.value if self.mass.value != 0 else None
        if self.shape.value == "cylinder":
            fields["shape"] = {"kind": "cylinder", "diameter": self.size.value[0], "height": self.height.value}
        elif self.shape.value == "cuboid":
            fields["shape"] = {"kind": "cuboid", "size": list(self.size.value), "height": self.height.value}
        return fields

    @property
    def _place(self) -> list[float]:
        return [*self.position.value, math.radians(self.yaw.value)]

    def _change(self) -> None:
        old = None if self._shown is None else self._shown.pose_world_from_body
        moved = old is None or not np.allclose(self._place, old, rtol=0, atol=1e-9)
        self.workbench.change_body(self.body.value, self._fields(), self._place if moved else None)
        self.choose(self.name.value)

    def _add(self) -> None:
        fields = self._fields() | {"pose_world_from_body": self._place}
        if self._shown is not None:
            fields.setdefault("shape", self._shown.shape.model_dump(mode="json"))
        self.workbench.add_body(fields)
        self.choose(self.name.value)
