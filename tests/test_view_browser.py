"""The viewer in a real browser: what is dragged, clicked and typed there, and what is seen of it."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import browser, opened
from person import Person
from scenes import body

from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.tool import Push, Tool

pytest.importorskip("viser", reason="the extra [viewer] is not installed")

from pushgraph.view.page import Page
from pushgraph.view.panel.files import FileControls
from pushgraph.view.panel.outline import OutlineControls
from pushgraph.view.workbench import PREDICTED, SIMULATED

pytestmark = pytest.mark.slow
VISERS_OWN = "Unable to preventDefault inside passive event listener"
"""What viser's page says of its own while something is dragged."""


def pair() -> Scene:
    """Two bodies and a push of 30 cm that misses both."""
    bodies = (body("box", 0.0, 0.0, Cuboid(size=(0.10, 0.10))), body("cup", -0.2, 0.12))
    return Scene(bodies=bodies, pushes=(Push(start=(-0.2, -0.15), end=(0.1, -0.15)),), tool=Tool.round(0.05))


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    with Page(pair(), folder=tmp_path) as served:
        served.ready()
        yield served


def endless(page: Page) -> None:
    while True:
        page.session.working.tell(0, 1)
        time.sleep(0.02)


def test_push_body_and_goal_are_dragged_and_the_buttons_work(page: Page, tmp_path: Path) -> None:
    bench = page.session.workbench
    with browser() as chromium, opened(chromium, page.url, (1200, 800), drawing=False) as seen:
        person = Person(page, seen)
        before = bench.work.tracks[PREDICTED].poses[-1, 1]
        end = person.knob("push/0/end")
        person.drag_until(end, np.array([0.0, 0.0, end[2]]), lambda: bench.planar.pushes[0].end != (0.1, -0.15))
        person.until(lambda: PREDICTED in bench.work.tracks)
        assert np.hypot(*np.subtract(bench.planar.pushes[0].end, (0.0, 0.0))) < 0.02
        assert np.hypot(*(bench.work.tracks[PREDICTED].poses[-1, 1] - before)[:2]) > 0.01

        seen.page.get_by_text("Simulate", exact=True).click()
        person.until(lambda: SIMULATED in bench.work.tracks)

        grip = np.array([0.03, 0.03, 0.1])
        person.drag_until(grip, grip + [-0.17, 0.1, 0.0], lambda: "they overlap by" in page.session.message)
        seen.page.get_by_text("they overlap by").first.wait_for()
        assert bench.planar.poses_world_from_body[0].tolist() == [0.0, 0.0, 0.0]
        person.drag_until(grip, grip + [0.05, 0.05, 0.0], lambda: bench.planar.poses_world_from_body[0, 0] > 0.02)
        x, y, _ = bench.planar.poses_world_from_body[0]
        edge, turned = np.array([x + 0.04, y, 0.1]), np.array([x, y + 0.04, 0.1])
        person.drag_until(edge, turned, lambda: bench.planar.poses_world_from_body[0, 2] > 1.0, "Shift")

        page.session.do(lambda: bench.set_goal({"body": "cup", "position": (-0.2, 0.12)})).result()
        pin = person.knob("goal")
        person.drag_until(pin, np.array([-0.15, 0.25, pin[2]]), lambda: bench.work.goal.position[1] > 0.18)
        seen.page.get_by_role("tab", name="Plan").click()
        seen.page.get_by_text("Plan", exact=True).last.click()
        person.until(lambda: bench.work.plan is not None, 90.0)

        seen.page.get_by_role("tab", name="Bodies").click()
        seen.page.get_by_text("Draw", exact=True).click()
        outline = page.controls[OutlineControls]
        person.until(lambda: outline.drawing)
        seen.page.wait_for_timeout(500)
        for number, (x, y) in enumerate(((0.15, 0.2), (0.25, 0.2), (0.2, 0.28)), start=1):
            seen.page.mouse.click(*person.pixel(np.array([x, y, 0.0])))
            person.until(lambda number=number: len(outline.corners) == number)
            assert np.hypot(*np.subtract(outline.corners[-1], (x, y))) < 0.01
        seen.page.get_by_text("Close", exact=True).click()
        person.until(lambda: len(bench.planar.bodies) == 3)
        page.session.do(bench.undo).result()

        until_cancelled = page.session.do(lambda: endless(page))
        seen.page.get_by_text("Cancel", exact=True).first.wait_for()
        seen.page.get_by_text("Drag", exact=True).first.click()
        seen.page.keyboard.press("Escape")
        until_cancelled.result(30)
        assert page.session.message.startswith("Cancelled")

        seen.page.get_by_role("tab", name="Files").click()
        seen.page.locator("input.mantine-TextInput-input:visible").fill("from-browser")
        person.until(lambda: page.controls[FileControls].name.value == "from-browser")
        seen.page.get_by_text("Save", exact=True).last.click()
        seen.page.get_by_text("Saved from-browser.json").first.wait_for()
        seen.page.get_by_text("Drag", exact=True).first.click()
        seen.page.keyboard.press("z")
        person.until(lambda: bench.work.plan is None)
        assert [error for error in seen.errors if VISERS_OWN not in error] == []
        assert seen.requests == []
    assert Scene.load(tmp_path / "from-browser.json").names == ("box", "cup")
