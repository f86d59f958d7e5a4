"""How the viewer looks in a real browser: no errors, the time line moves, saved pages replay without network.

The pictures in docs/images are made by `PUSHGRAPH_PICTURES=docs/images pytest -m slow tests/test_view_looks.py`.
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
from pushgraph.view.known_forces import forces_of
from pushgraph.view.page import Page
from pushgraph.view.saved_page import save_page
from pushgraph.view.server import start_server
from pushgraph.view.timeline import PICTURES, Timeline

pytestmark = pytest.mark.slow

SCENES = Path(str(files("pushgraph"))) / "scenes"
COLOURS = 256
"""Of pictures for the docs: they stay small."""
FOR_DOCS = ("page", "ghosts", "beliefs", "arm", "lever", "forces")
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


def pictured(seen, name: str, folder: Path) -> np.ndarray:
    """What is seen once it stands still, as grey values; kept for the docs if asked for."""
    path, before = folder / f"view-{name}.png", np.zeros((1, 1))
    for _ in range(60):
        seen.page.wait_for_timeout(1500)
        seen.page.screenshot(path=path)
        image = Image.open(path).convert("RGB")
        now = np.asarray(image.convert("L"), dtype=float)
        if now.shape == before.shape and difference(now, before, 2.0) < 1e-4 and now[:400, :600].std() > 10:
            break
        before = now
    wanted = os.environ.get("PUSHGRAPH_PICTURES")
    if wanted and name in FOR_DOCS:
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(Path(wanted) / path.name, optimize=True)
    return now


def difference(one: np.ndarray, other: np.ndarray, clearly: float = 24.0) -> float:
    """Share of the pixels that differ clearly."""
    return float((np.abs(one - other) > clearly).mean())


def at(seen, moment: str) -> None:
    """Go to a time of a saved page, which then stands still."""
    field = seen.page.locator("input.mantine-NumberInput-input").first
    field.fill(moment)
    field.press("Enter")


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
            before = pictured(seen, "page", tmp_path)
            slider = seen.page.get_by_role("slider").first
            slider.press("End")
            deadline = time.monotonic() + 60
            while page.session.drawing.frame == 0 and time.monotonic() < deadline:
                seen.page.wait_for_timeout(100)
            assert page.session.drawing.frame > 0
            assert difference(before, pictured(seen, "moved", tmp_path)) > 0.01
            page.session.timeline.step(-10_000)
            seen.page.get_by_role("button", name="Play").click()
            while page.session.drawing.frame == 0 and time.monotonic() < deadline + 60:
                seen.page.wait_for_timeout(100)
            assert page.session.drawing.frame > 0
            seen.page.locator("input[type=checkbox]").last.check()
            dark = pictured(seen, "dark", tmp_path)
            assert dark[400:, 950:].mean() < 0.5 * before[400:, 950:].mean()
            assert seen.errors == []
            assert seen.requests == []


def saved_ghosts(path: Path) -> str:
    """Predicted as if nothing were joined, beside what happens; the time to look at."""
    scene = demo()
    predicted = load().predict(scene.replace(joints=()), spread=True)
    save_page(path, predicted, compare=simulate(scene), title="Predicted without joints, and simulated")
    return "5.7"


def saved_beliefs(path: Path) -> str:
    scene = demo()
    track = simulate(scene)
    history = BeliefHistory.watch(scene.replace(joints=(), unknown_pairs="unlisted"), track)
    save_page(path, track, beliefs=history, title="What is believed of joints")
    return "4.2"


def saved_forces(path: Path) -> str:
    predictor = load()
    track = predictor.predict(demo())
    save_page(path, track, forces=forces_of(track, predictor), title="Forces at all contacts")
    return "2.0"


def saved_arm(path: Path) -> str:
    execution = simulate_with_arm(demo())
    save_page(path, execution.track, trajectory=execution.trajectory, title="A UR10 pushes")
    return "5.0"


def saved_lever(path: Path) -> str:
    lever = LeverScene.load(SCENES / "lever-up.json")
    save_page(path, simulate_lever(lever), title="A board is levered up")
    return "2.0"


@pytest.mark.parametrize("saved", [saved_ghosts, saved_beliefs, saved_forces, saved_arm, saved_lever])
def test_saved_pages_show_what_moves_without_network(saved, tmp_path: Path) -> None:
    path, name = tmp_path / "page.html", saved.__name__.removeprefix("saved_")
    moment = saved(path)
    scheme = "dark" if name == "beliefs" else "light"
    with browser() as chromium, opened(chromium, path, color_scheme=scheme) as seen:
        at(seen, "0.0")
        start = pictured(seen, f"{name}-start", tmp_path)
        at(seen, moment)
        assert difference(start, pictured(seen, name, tmp_path)) > 0.003
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
        seen.page.keyboard.press("ArrowRight")
        seen.page.keyboard.press("ArrowRight")
        seen.page.keyboard.press("ArrowLeft")
        seen.page.wait_for_timeout(1000)
        assert float(field.input_value()) == pytest.approx(float(stands) + 0.1)
        at(seen, "60.0")
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
