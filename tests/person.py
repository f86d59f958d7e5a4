"""Somebody at a browser that shows the viewer: drags what stands in the scene, and waits for what comes of it."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pushgraph import pose_3d

if TYPE_CHECKING:
    from pushgraph.view.page import Page


class Person:
    """Somebody at a browser: finds things of the scene on the screen."""

    def __init__(self, page: "Page", seen: Any) -> None:
        self.page, self.seen = page, seen.page
        self.seen.get_by_role("tab", name="Pushes").wait_for()
        self.seen.wait_for_function("() => document.querySelector('canvas').clientWidth > 0")
        self.seen.wait_for_timeout(1500)  # until the first picture is drawn

    def pixel(self, point: np.ndarray) -> tuple[float, float]:
        """Where a point of the world is on the screen."""
        (client,) = self.page.session.server.get_clients().values()
        camera, box = client.camera, self.seen.locator("canvas").first.bounding_box()
        inverse = pose_3d.conjugate(np.asarray(camera.wxyz))
        x, y, z = pose_3d.rotate(np.asarray(point) - camera.position, inverse)
        scale = box["height"] / 2 / math.tan(camera.fov / 2) / z
        return box["x"] + box["width"] / 2 + scale * x, box["y"] + box["height"] / 2 + scale * y

    def drag(self, start: np.ndarray, end: np.ndarray, modifier: str | None = None) -> None:
        """From one point of the world to another, with the left button."""
        mouse = self.seen.mouse
        (x, y), (u, v) = self.pixel(start), self.pixel(end)
        if modifier:
            self.seen.keyboard.down(modifier)
        mouse.move(x, y)
        self.seen.wait_for_timeout(300)
        mouse.down()
        for share in np.linspace(0.2, 1.0, 5):
            self.seen.wait_for_timeout(60)
            mouse.move(x + share * (u - x), y + share * (v - y))
        mouse.up()
        if modifier:
            self.seen.keyboard.up(modifier)

    def drag_until(self, start: np.ndarray, end: np.ndarray, holds: Any, modifier: str | None = None) -> None:
        """Drag until it has come about: on a busy machine what shall be dragged may not be on the screen yet."""
        for _ in range(4):
            self.drag(start, end, modifier)
            for _ in range(80):
                if holds():
                    return
                self.seen.wait_for_timeout(50)
        raise AssertionError(f"it did not come about; the page says {self.page.session.message!r}")

    def until(self, holds: Any, seconds: float = 30.0) -> None:
        """Wait for what the page shall have brought about."""
        for _ in range(int(seconds * 20)):
            if holds():
                return
            self.seen.wait_for_timeout(50)
        raise AssertionError(f"it did not come about; the page says {self.page.session.message!r}")

    def knob(self, name: str) -> np.ndarray:
        """Where something is held to drag it."""
        return np.asarray(self.page.handles.knobs[name].position)
