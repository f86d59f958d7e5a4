"""How the viewer looks in a real browser: no errors, the time line moves, saved pages replay without network.

With PUSHGRAPH_PICTURES=DIR the pictures of docs/images are written there:
`PUSHGRAPH_PICTURES=docs/images pytest -m slow tests/test_view_looks.py`.
"""

import os
import threading
import time
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from browser import browser, opened
from PIL import Image

pytest.importorskip("viser", reason="the extra [viewer] is not installed")

from pushgraph.belief_history import BeliefHistory
from pushgraph.body import Body
from pushgraph.lever_scene import LeverScene
from pushgraph.physics import load
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.arm import simulate_with_arm
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push
from pushgraph.track import Track
from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.page import Page
from pushgraph.view.saved_page import save_page
from pushgraph.view.server import start_server
from pushgraph.view.timeline import PICTURES, Timeline

pytestmark = pytest.mark.slow

SCENES = Path(str(files("pushgraph"))) / "scenes"
COLOURS = 128
"""Of pictures for the docs: they stay small."""
RATE = """async () => {
  const start = performance.now(), drawn = window.drawn || 0;
  let frames = 0;
  await new Promise((done) => {
    const next = () => { frames++; performance.now() - start < 3000 ? requestAnimationFrame(next) : done(); };
    requestAnimationFrame(next);
  });
  return 1000 * frames / (performance.now() - start);
}"""


def demo() -> Scene:
    return Scene.load(SCENES / "demo.json")


def wandering(bodies: int, frames: int) -> Track:
    """Bodies on a grid, all of which move a little in every frame."""
    rng = np.random.default_rng(0)
    side = int(np.ceil(np.sqrt(bodies)))
    shapes = (Cylinder(diameter=0.05), Cuboid(size=(0.06, 0.04)))
    places = [((k % side - side / 2) * 0.11, (k // side - side / 2) * 0.11, 0.1 * k) for k in range(bodies)]
    standing = [
        Body(name=f"body_{k}", shape=shapes[k % 2], pose_world_from_body=place) for k, place in enumerate(places)
    ]
    scene = Scene(bodies=tuple(standing), pushes=(Push(start=(0.7, 0.0), end=(0.6, 0.0)),))
    start = np.vstack(([0.7, 0.0, 0.0], scene.poses_world_from_body))
    poses = start + np.cumsum(rng.normal(size=(frames, bodies + 1, 3)) * [8e-4, 8e-4, 1e-2], axis=0)
    return Track(
        scene, np.arange(frames) * 0.05, poses, np.zeros(frames, dtype=int), np.ones((frames, bodies + 1), dtype=bool)
    )


def pictured(seen, name: str, folder: Path, settle: float = 4.0) -> np.ndarray:
    """What is seen once it has settled, as grey values; kept for the docs if asked for."""
    seen.page.wait_for_timeout(settle * 1000)
    path = folder / f"view-{name}.png"
    seen.page.screenshot(path=path)
    image = Image.open(path).convert("RGB")
    wanted = os.environ.get("PUSHGRAPH_PICTURES")
    if wanted:
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(Path(wanted) / path.name, optimize=True)
    return np.asarray(image.convert("L"), dtype=float)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Share of the pixels that differ clearly."""
    return float((np.abs(one - other) > 24).mean())


@pytest.fixture
def drawn():
    server = start_server()
    yield server, SceneDrawing(server)
    server.stop()


def test_the_page_of_the_demo_opens_without_an_error_and_its_time_line_moves(tmp_path: Path) -> None:
    with Page(demo(), folder=tmp_path) as page:
        page.ready()
        with browser() as chromium, opened(chromium, page.url, (1200, 760)) as seen:
            seen.page.get_by_text("What you see").wait_for()
            before = pictured(seen, "page", tmp_path, 6.0)
            slider = seen.page.get_by_role("slider").first
            slider.press("End")
            deadline = time.monotonic() + 60
            while page.session.drawing.frame == 0 and time.monotonic() < deadline:
                seen.page.wait_for_timeout(100)
            assert page.session.drawing.frame > 0
            assert difference(before, pictured(seen, "moved", tmp_path)) > 0.01
            page.session.timeline.step(-10_000)
            began = time.monotonic()
            seen.page.get_by_role("button", name="Play").click()
            while not page.session.timeline.playing and time.monotonic() < deadline + 60:
                seen.page.wait_for_timeout(20)
            began = time.monotonic()
            seen.page.wait_for_timeout(2000)
            moment = page.session.drawing.times[page.session.drawing.frame]
            assert moment == pytest.approx(time.monotonic() - began, abs=0.8)
            seen.page.locator("input[type=checkbox]").last.check()
            dark = pictured(seen, "dark", tmp_path)
            assert dark[400:, 950:].mean() < 0.5 * before[400:, 950:].mean()
            assert seen.errors == []
            assert seen.requests == []


def test_two_tracks_beliefs_arm_and_lever_are_drawn(drawn, tmp_path: Path) -> None:
    server, drawing = drawn
    scene = demo()
    track = simulate(scene)
    predicted = load().predict(scene.replace(joints=()), spread=True)
    unknown = scene.replace(joints=(), unknown_pairs="unlisted")
    drawing.show_track(predicted)
    drawing.show_ghost(track)
    drawing.set_frame(len(predicted.times) - 1)
    server.gui.main_panel.collapsed = True
    with browser() as chromium:
        with opened(chromium, f"http://127.0.0.1:{server.get_port()}") as seen:
            both = pictured(seen, "ghosts", tmp_path)
            drawing.show_ghost(None)
            assert difference(both, pictured(seen, "one", tmp_path)) > 0.005
            assert seen.errors == []
        save_page(
            tmp_path / "beliefs.html", track, beliefs=BeliefHistory.watch(unknown, track), title="What is believed"
        )
        with opened(chromium, tmp_path / "beliefs.html", color_scheme="dark") as seen:
            field = seen.page.locator("input.mantine-NumberInput-input").first
            field.fill("4.2")
            field.press("Enter")
            pictured(seen, "beliefs", tmp_path)
            assert (seen.errors, seen.requests) == ([], [])
        execution = simulate_with_arm(scene)
        save_page(tmp_path / "arm.html", execution.track, trajectory=execution.trajectory, title="A UR10 pushes")
        lever = LeverScene.load(SCENES / "lever-up.json")
        save_page(tmp_path / "lever.html", simulate_lever(lever), title="A board is levered up")
        for name, moment in (("arm", "5.0"), ("lever", "2.0")):
            with opened(chromium, tmp_path / f"{name}.html") as seen:
                field = seen.page.locator("input.mantine-NumberInput-input").first
                before = pictured(seen, f"{name}-before", tmp_path)
                field.fill(moment)
                field.press("Enter")
                assert difference(before, pictured(seen, name, tmp_path)) > 0.003
                assert (seen.errors, seen.requests) == ([], [])


def test_a_minute_of_twenty_bodies_is_a_small_page_that_replays_without_network(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    save_page(path, wandering(20, 1201))
    assert path.stat().st_size < 10e6
    with browser() as chromium, opened(chromium, path, (640, 480)) as seen:
        field = seen.page.locator("input.mantine-NumberInput-input").first
        field.wait_for()
        before = float(field.input_value())
        seen.page.wait_for_timeout(3000)
        assert float(field.input_value()) > before
        seen.page.keyboard.press("Space")
        seen.page.wait_for_timeout(1000)
        stands = field.input_value()
        start = pictured(seen, "start", tmp_path)
        assert field.input_value() == stands
        field.fill("60.0")
        field.press("Enter")
        assert difference(start, pictured(seen, "end", tmp_path)) > 0.01
        assert (seen.errors, seen.requests) == ([], [])


def test_sixty_bodies_play_at_thirty_frames_a_second(drawn) -> None:
    """The page's own work, that is all but what a graphics card does, and this program's."""
    server, drawing = drawn
    track = wandering(60, 400)
    drawing.show_track(track)
    began = time.process_time()
    for frame in range(100):
        drawing.set_frame(frame)
    assert (time.process_time() - began) / 100 < 0.5 / PICTURES
    timeline = Timeline(server.gui, drawing, threading.RLock())
    drawn_at: list[float] = []
    timeline.on_frame = lambda frame: drawn_at.append(time.monotonic())
    with (
        browser() as chromium,
        opened(chromium, f"http://127.0.0.1:{server.get_port()}", (640, 480), drawing=False) as seen,
    ):
        seen.page.wait_for_timeout(5000)
        timeline.play()
        seen.page.wait_for_timeout(500)
        assert seen.page.evaluate(RATE) >= 30
        timeline.stop()
        assert seen.page.evaluate("() => window.drawn") > 1000


def test_ten_thousand_frames_open_within_three_seconds(drawn, tmp_path: Path) -> None:
    wandering(9, 10_000).save(tmp_path / "long.h5")
    _, drawing = drawn
    began = time.monotonic()
    drawing.show_track(Track.load(tmp_path / "long.h5"))
    drawing.set_frame(9_999)
    assert time.monotonic() - began < 3.0
