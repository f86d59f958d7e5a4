"""Edits of what is tried out, one after the other, and how they are undone."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from pushgraph.errors import SceneError
from pushgraph.lever_scene import LeverScene
from pushgraph.planning.goal import Goal
from pushgraph.scene import Scene
from pushgraph.view import scene_edits
from pushgraph.view.scene_edits import Content
from pushgraph.view.work import Work

MOST_UNDONE = 100


class Editing:
    """What there is now, and what there was before. What is refused leaves everything as it was."""

    def __init__(self, work: Work) -> None:
        self.work = work
        self._past: list[Work] = []

    @property
    def scene(self) -> Scene | LeverScene:
        """The scene as it is now."""
        return self.work.scene

    @property
    def planar(self) -> Scene:
        """The scene; raises SceneError if it is one in space, which is watched but not edited here."""
        if isinstance(self.work.scene, LeverScene):
            raise SceneError("scenes in space are shown, predicted and simulated here, but not edited")
        return self.work.scene

    # Edits of the scene. What was computed for the scene before is gone; beliefs and goal stay while bodies do.

    def add_body(self, body: Content) -> None:
        """A body as it stands in a scene file."""
        self._edit(scene_edits.add_body(self.planar, body))

    def change_body(self, name: str, fields: Content, place: Sequence[float] | None = None) -> None:
        """Other fields of a body, and another pose."""
        self._edit(scene_edits.change_body(self.planar, name, fields, place))

    def move_body(self, name: str, point: Sequence[float]) -> None:
        """Its frame to another place (m), turned as it is."""
        yaw = 0.0 if name not in self.planar.names else self._pose(name)[2]
        self._edit(scene_edits.place_body(self.planar, name, [*point, yaw]))

    def turn_body(self, name: str, yaw: float) -> None:
        """About its origin, to this yaw (rad)."""
        here = (0.0, 0.0) if name not in self.planar.names else self._pose(name)[:2]
        self._edit(scene_edits.place_body(self.planar, name, [*here, yaw]))

    def place_body(self, name: str, place: Sequence[float]) -> None:
        """To a pose x, y (m), yaw (rad)."""
        self._edit(scene_edits.place_body(self.planar, name, place))

    def delete(self, name: str) -> None:
        """A body, with its joints."""
        self._edit(scene_edits.delete_body(self.planar, name))

    def join(self, joint: Content) -> None:
        """A joint as it stands in a scene file."""
        self._edit(scene_edits.join(self.planar, joint))

    def part(self, one: str, other: str) -> None:
        """Take the joint of two bodies away."""
        self._edit(scene_edits.part(self.planar, one, other))

    def add_push(self, push: Content | None = None) -> None:
        """A push as it stands in a scene file; by default one towards the first body that can move."""
        self._edit(scene_edits.add_push(self.planar, push))

    def change_push(self, push: int, fields: Content) -> None:
        """Other fields of a push, by index."""
        self._edit(scene_edits.change_push(self.planar, push, fields))

    def move_push_end(self, push: int, end: str, point: Sequence[float]) -> None:
        """The "start" or the "end" of a push, by index, to another place (m)."""
        self._edit(scene_edits.move_push_end(self.planar, push, end, point))

    def delete_push(self, push: int) -> None:
        """A push, by index."""
        self._edit(scene_edits.delete_push(self.planar, push))

    def set_goal(self, goal: Content | None) -> None:
        """Where a body shall be, with the fields of a `Goal`; None: nowhere."""
        wanted = None if goal is None else Goal(**goal)
        if wanted is not None:
            wanted.check(self.planar)
        self._become(goal=wanted, plan=None)

    def undo(self) -> None:
        """The last change."""
        if not self._past:
            raise SceneError("there is nothing to undo")
        self.work = self._past.pop()

    def _pose(self, name: str) -> list[float]:
        return self.planar.poses_world_from_body[self.planar.names.index(name)].tolist()

    def _become(self, **changes: Any) -> None:
        self._past = [*self._past[1 - MOST_UNDONE :], self.work]
        self.work = dataclasses.replace(self.work, **changes)

    def _edit(self, scene: Scene) -> None:
        old = self.work
        same = scene.names == old.scene.names
        goal = old.goal if old.goal is not None and old.goal.body in scene.names else None
        self._become(scene=scene, tracks={}, plan=None, goal=goal, watching=None, history=old.history if same else None)
