"""Goals, and plans that reach them."""

import math

from pushgraph.scene import Scene
from pushgraph.view.panel.controls import NONE, Controls, offer


class GoalControls(Controls):
    """Which body shall be where; the goal can be dragged in the drawing, too."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.body = self.gui.add_dropdown("Body", (NONE,))
        self.position = self.gui.add_vector2("Goal (m)", (0.0, 0.0), step=0.005)
        self.turned = self.gui.add_checkbox("turned so", False, hint="Whether its yaw matters, too")
        self.yaw = self.gui.add_number("Yaw (deg)", 0.0, step=1.0)
        self.pushes = self.gui.add_slider("Pushes", 1, 4, 1, 2, hint="At most")
        self.buttons(
            "Goal",
            {"Set": self._set, "Plan": self._plan},
            "Take over what stands here; choose pushes that bring the body there, in the place of the scene's",
        )
        self.on_change(self.body, self._choose)

    def refresh(self) -> None:
        """Show the goal as it is."""
        scene, goal = self.workbench.scene, self.workbench.work.goal
        names = scene.names if isinstance(scene, Scene) else ()
        offer(self.body, (NONE, *names), NONE if goal is None else goal.body)
        if goal is not None:
            self.position.value = goal.position
            self.turned.value = goal.yaw is not None
            self.yaw.value = math.degrees(goal.yaw or 0.0)

    def _choose(self) -> str | None:
        name = self.body.value
        if name == NONE:
            self.workbench.set_goal(None)
            return None
        scene = self.workbench.planar
        here = scene.poses_world_from_body[scene.names.index(name)] if name in scene.names else (0.0, 0.0, 0.0)
        self.workbench.set_goal({"body": name, "position": (float(here[0]), float(here[1]))})
        return f"Drag the goal of {name!r} where it shall be, then plan."

    def _set(self) -> None:
        if self.body.value == NONE:
            self.workbench.set_goal(None)
            return
        yaw = math.radians(self.yaw.value) if self.turned.value else None
        self.workbench.set_goal({"body": self.body.value, "position": tuple(self.position.value), "yaw": yaw})

    def _plan(self) -> str:
        self.workbench.plan(self.pushes.value, self.session.working.tell)
        plan = self.workbench.work.plan
        return f"{len(plan.pushes)} pushes, expected {100 * plan.cost:.1f} cm from the goal." if plan else ""
