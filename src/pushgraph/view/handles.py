"""What can be dragged in the drawing: the ends of pushes, bodies, and the goal."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.scene import Scene
from pushgraph.view import scene_edits
from pushgraph.view.drawing.bodies import Grip
from pushgraph.view.drawing.tool import arrow_height
from pushgraph.view.session import Session

RADIUS = 0.013
"""Of the knobs at which things are dragged (m)."""
COLOURS = {"start": (0, 114, 178), "end": (213, 94, 0), "goal": (0, 158, 115)}
"""Told apart by colour-blind people, too (Okabe and Ito)."""


class Handles:
    """Follow the pointer across the table; what a drag would bring about is shown on its way, and done at its end."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.knobs: dict[str, Any] = {}
        self._grips: list[Grip] = []
        session.refreshers.append(self.refresh)

    def refresh(self) -> None:
        """Put every handle where what it stands for is."""
        work = self.session.workbench.work
        wanted: dict[str, tuple[float, float]] = {}
        height = 0.0
        if isinstance(work.scene, Scene):
            height = arrow_height(work.scene)
            for index, push in enumerate(work.scene.pushes):
                wanted[f"push/{index}/start"] = push.start
                x, y = push.waypoints[-1, :2].tolist()
                wanted[f"push/{index}/end"] = (x, y)
            if work.goal is not None:
                wanted["goal"] = work.goal.position
        for name in [name for name in self.knobs if name not in wanted]:
            self.knobs.pop(name).remove()
        for name, (x, y) in wanted.items():
            if name not in self.knobs:
                self.knobs[name] = self._new_knob(name)
            self.knobs[name].position = (x, y, height)
        self._hold_bodies(isinstance(work.scene, Scene))

    def _new_knob(self, name: str) -> Any:
        kind = name.rsplit("/", 1)[-1]
        knob = self.session.server.scene.add_icosphere(f"/handles/{name}", RADIUS, color=COLOURS[kind])
        if name == "goal":
            pole = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]])
            self.session.server.scene.add_line_segments(f"/handles/{name}/pole", pole, COLOURS[kind], thickness=0.003)
        preview, done = self._of_goal() if name == "goal" else self._of_push(int(name.split("/")[1]), kind)

        @knob.on_drag
        async def _(event: Any) -> None:
            point = on_table(event, float(knob.position[2]))
            if point is None:
                return
            point = np.round(point, 4)
            if event.phase == "end":
                self.session.forget_latest(name)
                self.session.do(lambda: done(point), event.client)
            elif event.phase == "update":
                self.session.do_latest(name, lambda: self._move(name, point, preview))

        return knob

    def _move(self, name: str, point: Float[np.ndarray, "2"], preview: Callable[[np.ndarray], None]) -> None:
        if name in self.knobs:  # it may have been deleted by another browser meanwhile
            self.knobs[name].position = (*point.tolist(), float(self.knobs[name].position[2]))
            self.session.server.flush()
            preview(point)

    def _of_push(self, push: int, end: str) -> tuple[Callable[[np.ndarray], None], Callable[[np.ndarray], None]]:
        def preview(point: np.ndarray) -> None:
            self._foresee(
                lambda scene: scene_edits.move_push_end(scene, push, end, point.tolist()),
                self.session.drawing.show_scene,
            )

        def done(point: np.ndarray) -> None:
            self.session.workbench.move_push_end(push, end, point.tolist())

        return preview, done

    def _of_goal(self) -> tuple[Callable[[np.ndarray], None], Callable[[np.ndarray], None]]:
        def preview(point: np.ndarray) -> None:
            goal = self.session.workbench.work.goal
            if goal is not None:
                self.session.drawing.show_goal(goal.replace(position=tuple(point.tolist())))

        def done(point: np.ndarray) -> None:
            goal = self.session.workbench.work.goal
            if goal is not None:
                self.session.workbench.set_goal(goal.model_dump() | {"position": tuple(point.tolist())})

        return preview, done

    def _foresee(self, edit: Callable[[Scene], Scene], show: Callable[[Scene], None]) -> None:
        """Show what an edit would bring about."""
        scene = edit(self.session.workbench.planar)
        self.session.timeline.pause()
        show(scene)
        self.session.show_outcome(self.session.workbench.foreseen(scene) if scene.pushes else None)
        self.session.say("")

    def _foresee_body(self, name: str, there: list[float]) -> None:
        self._foresee(lambda scene: scene_edits.place_body(scene, name, there), self.session.drawing.move_bodies)

    def _hold_bodies(self, planar: bool) -> None:
        """Make the solids of the bodies draggable, those that are not yet."""
        grips = list(self.session.drawing.grips) if planar else []
        held = [grip.handle for grip in self._grips]
        for grip in grips:
            if not any(grip.handle is handle for handle in held):
                self._hold(grip)
        self._grips = grips

    def _hold(self, grip: Grip) -> None:
        grabbed: dict[int, tuple[np.ndarray, np.ndarray, float]] = {}
        """Of each browser that drags: where the pointer was on the table, the body's pose, and at which height."""

        def place(event: Any, name: str, turning: bool) -> list[float] | None:
            """Where the body would be; None if the pointer is off the table's plane."""
            if event.phase == "start":
                scene = self.session.workbench.scene
                height = float(event.start_position[2])
                point = on_table(event, height)
                if point is not None and name in scene.names:
                    grabbed[event.client_id] = (point, scene.poses_world_from_body[scene.names.index(name)], height)
                return None
            if event.client_id not in grabbed:
                return None
            first, pose, height = grabbed[event.client_id]
            point = on_table(event, height)
            if point is None:
                return None
            if turning:
                before, now = first - pose[:2], point - pose[:2]
                return [
                    *pose[:2].tolist(),
                    float(pose[2] + math.atan2(now[1], now[0]) - math.atan2(before[1], before[0])),
                ]
            return [*np.round(pose[:2] + point - first, 4).tolist(), float(pose[2])]

        def drag(event: Any, turning: bool) -> None:
            name = grip.names[event.instance_index]
            there = place(event, name, turning)
            if event.phase == "end":
                grabbed.pop(event.client_id, None)
            if there is None:
                return
            if event.phase == "end":
                self.session.forget_latest(("body", name))
                self.session.do(lambda: self.session.workbench.place_body(name, there), event.client)
            else:
                self.session.do_latest(("body", name), lambda: self._foresee_body(name, there))

        @grip.handle.on_drag
        async def _(event: Any) -> None:
            drag(event, False)

        @grip.handle.on_drag("left", modifier="shift")
        async def _(event: Any) -> None:
            drag(event, True)


def on_table(event: Any, height: float) -> Float[np.ndarray, "2"] | None:
    """Where the pointer of a drag is at this height above the table (m), as the browser's camera sees it."""
    camera = np.asarray(event.client.camera.position, dtype=float)
    return where_on_table(camera, np.asarray(event.end_position, dtype=float) - camera, height)


def where_on_table(
    camera: Float[np.ndarray, "3"], ray: Float[np.ndarray, "3"], height: float
) -> Float[np.ndarray, "2"] | None:
    """Where a ray from a camera meets a height above the table (m); None if it passes it, or far away."""
    if not ray[2] < -1e-3 * np.linalg.norm(ray):  # it looks past the table
        return None
    point = camera + ray * ((height - camera[2]) / ray[2])
    return point[:2] if np.isfinite(point).all() and np.abs(point).max() < 50 else None
