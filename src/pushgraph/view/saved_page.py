"""One self-contained page that replays without Python and without network."""

import html
import os

import numpy as np
import viser

from pushgraph.belief_history import BeliefHistory
from pushgraph.errors import ViewerError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.scene import Scene
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.known_forces import KnownForces
from pushgraph.view.legend import facts, legend
from pushgraph.view.server import start_server

REST = 1.5
"""So long the last frame is seen before it begins anew (s)."""
LONGEST = 3600.0
"""A track that takes longer (s) is refused: the page would be too large to send."""
_RULES = "default-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' data: blob:"
"""What the page may load: only what is in it."""
_STYLE = """
#pushgraph{position:fixed;bottom:4em;left:0.75em;z-index:5;max-width:17em;padding:0.5em 0.8em;border-radius:0.4em;
font:12px/1.4 system-ui,sans-serif;background:#ffffffe6;color:#222;box-shadow:0 0 1em #0003}
#pushgraph summary{cursor:pointer;font-weight:600}#pushgraph details{max-height:14em;overflow:auto}
@media (prefers-color-scheme:dark){#pushgraph{background:#222222e6;color:#eee}}
"""
_KEYS = """
addEventListener("keydown", (event) => {
  const by = { ArrowLeft: -0.1, ArrowRight: 0.1 }[event.code];
  const time = document.querySelector("input.mantine-NumberInput-input");
  if (!by || !time || event.target.matches("input")) return;
  event.stopImmediatePropagation();
  const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  value.set.call(time, Math.max(0, parseFloat(time.value) + by).toFixed(1));
  time.dispatchEvent(new Event("input", { bubbles: true }));
}, true);
"""
"""The arrow keys write another time (s) into the field of the time, as a person would."""
_HINT = "Space plays and rests, ← and → step. Drag turns the view, right-drag moves it, the wheel zooms."
_MODE = "window.__VISER_EMBED_CONFIG__={darkMode:matchMedia('(prefers-color-scheme: dark)').matches}"


def save_page(
    path: str | os.PathLike,
    shown: Scene | LeverScene | Track | LeverTrack | BeliefHistory,
    *,
    compare: Track | LeverTrack | None = None,
    beliefs: BeliefHistory | None = None,
    trajectory: JointTrajectory | None = None,
    forces: KnownForces | None = None,
    title: str = "pushgraph",
) -> None:
    """Write `shown` as a page with a time line, light or dark as who reads it has set.

    compare: a second track, as ghosts. beliefs: links and board beside a track. trajectory: of the scene's arm.
    forces: at the contacts of `shown`; see `pushgraph.view.known_forces`.
    """
    history = shown if isinstance(shown, BeliefHistory) else beliefs
    server = start_server()
    try:
        drawing = SceneDrawing(server)
        if isinstance(shown, Track | LeverTrack):
            drawing.show_track(shown)
            drawing.show_forces(forces)
        elif isinstance(shown, Scene | LeverScene):
            drawing.show_scene(shown)
        drawing.show_ghost(compare)
        drawing.show_belief(history)
        drawing.show_arm(trajectory)
        page = recorded(server, drawing)
        text = legend(drawing) + _known(drawing)
    finally:
        server.stop()
    with replacing(path) as temporary:
        temporary.write_text(_explained(page, title, text), encoding="utf-8")


def recorded(server: viser.ViserServer, drawing: SceneDrawing) -> str:
    """The page of all frames at true speed, as viser writes it; raises ViewerError if that takes too long."""
    times = drawing.times
    if times[-1] - times[0] > LONGEST:
        raise ViewerError(f"a page holds at most {LONGEST:g} s, this takes {times[-1] - times[0]:.0f} s")
    drawing.set_frame(0)
    recording = server.get_scene_serializer()
    for frame, pause in enumerate(np.diff(times).tolist(), start=1):
        recording.insert_sleep(pause)
        drawing.set_frame(frame)
    if len(times) > 1:
        recording.insert_sleep(REST)
    return recording.as_html()


def _known(drawing: SceneDrawing) -> str:
    if drawing.scene is None:
        return ""
    return f"<details><summary>Masses and frictions</summary>{facts(drawing.scene, drawing.history)}</details>"


def _explained(page: str, title: str, text: str) -> str:
    """With a title, what the colours mean, the rule that it loads nothing, and light or dark as the reader has set."""
    name = html.escape(title)
    head = f'<meta http-equiv="Content-Security-Policy" content="{_RULES}"><title>{name}</title><style>{_STYLE}</style>'
    box = f'<details id="pushgraph" open><summary>{name}</summary>{text}<small>{_HINT}</small></details>'
    page = page.replace("<head>", f"<head>{head}", 1).replace("<title>Viser</title>", "", 1)
    page = page.replace("</head>", f"<script>{_MODE};{_KEYS}</script></head>", 1)
    start, end = page.rsplit("</body>", 1)
    return f"{start}{box}</body>{end}"
