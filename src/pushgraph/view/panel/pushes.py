"""Pushes: which there are, where they go, how fast."""

import numpy as np

from pushgraph.scene import Scene
from pushgraph.tool import Push
from pushgraph.view.panel.controls import NONE, Controls, offer


class PushControls(Controls):
    """One push at a time by its number from 1 on; its ends can be dragged in the drawing, too."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.push = self.gui.add_dropdown("Number", (NONE,))
        self.start = self.gui.add_vector2("Start (m)", (0.0, 0.0), step=0.005)
        self.end = self.gui.add_vector2("End (m)", (0.0, 0.0), step=0.005)
        self.speed = self.gui.add_number("Speed (m/s)", 0.2, step=0.01)
        self.buttons(
            "Push",
            {"Change": self._change, "Add": self._add, "Delete": lambda: self.workbench.delete_push(self.index)},
            "Take over start, end and speed; add one towards the first body that can move; delete this one",
        )
        self.on_change(self.push, lambda: None)
        self._shown: Push | None = None

    @property
    def index(self) -> int:
        """Of the push that is chosen; -1 if none is."""
        return int(self.push.value) - 1 if self.push.value.isdecimal() else -1

    def choose(self, push: int) -> None:
        """Show a push, by index."""
        offer(self.push, self._numbers(), str(push + 1))

    def refresh(self) -> None:
        """Show the chosen push as it is."""
        scene = self.workbench.scene
        offer(self.push, self._numbers())
        if isinstance(scene, Scene) and 0 <= self.index < len(scene.pushes):
            push = scene.pushes[self.index]
            if push == self._shown:  # what is being typed stays, whatever else changes meanwhile
                return
            self._shown = push
            self.start.value, self.end.value = push.start, tuple(np.round(push.waypoints[-1, :2], 4).tolist())
            self.speed.value = push.speed

    def _numbers(self) -> list[str]:
        return [str(1 + index) for index in range(len(getattr(self.workbench.scene, "pushes", ())))]

    def _change(self) -> str | None:
        index, workbench = self.index, self.workbench
        push = workbench.planar.pushes[index] if 0 <= index < len(workbench.planar.pushes) else None
        fields = {"start": list(self.start.value), "speed": self.speed.value}
        if push is not None and push.path is not None:
            return self._change_path(fields)
        for absent in ("direction", "distance"):
            fields[absent] = None
        workbench.change_push(index, fields | {"end": list(self.end.value)})
        return None

    def _change_path(self, fields: dict) -> str:
        """Of a path only its start and speed are told by numbers; its last way-point is dragged."""
        self.workbench.change_push(self.index, fields)
        return "The push follows a path: drag its last way-point."

    def _add(self) -> None:
        self.workbench.add_push()
        self.choose(len(self.workbench.planar.pushes) - 1)
