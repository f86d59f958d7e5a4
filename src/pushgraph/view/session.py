"""One page for any number of browsers: what they ask for is done one after the other, and shown to all."""

import contextlib
import html
import sys
import threading
import traceback
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from pushgraph.errors import CancelledError, PushGraphError
from pushgraph.track import Track
from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.timeline import Timeline
from pushgraph.view.work import AnyTrack, Work
from pushgraph.view.workbench import PREDICTED, SIMULATED, Workbench
from pushgraph.view.working import Working

if TYPE_CHECKING:
    import viser

Action = Callable[[], str | None]
"""Changes the workbench; may say what came of it."""
LONGEST_MESSAGE = 2000
MOST_NOTES = 30
NOTES_AFTER = 0.3
"""Notes follow so much later (s): they are slower to find than a prediction, and may wait."""
HELP = (
    "**Drag** the ends of a push, a body, or the pin of a goal. Shift-drag turns a body.<br/>"
    "**Space** plays, **←** and **→** step, **Z** undoes the last change."
)


class Session:
    """The workbench and what the page shows of it. lock: held by whoever draws, or changes the workbench."""

    def __init__(self, server: "viser.ViserServer", workbench: Workbench) -> None:
        self.server, self.workbench = server, workbench
        self.lock = threading.RLock()
        self.drawing = SceneDrawing(server)
        self.refreshers: list[Callable[[], None]] = []
        """Called after every change, to bring controls up to date."""
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="pushgraph-view")
        self._latest: dict[Hashable, Callable[[], None]] = {}
        self._shown: Work | None = None
        self._unpredictable: object = None
        self._noted: Work | None = None
        self._shown_tracks: tuple[AnyTrack | None, AnyTrack | None] = (None, None)
        self.show_next: float | None = None
        """The time (s) that shall be shown next; None: that which is shown, or the start of what is new."""
        self.believed = False
        """Whether predictions take the joints that are believed, while there are beliefs."""
        self.forces = False
        """Whether the forces at contacts are shown."""
        self.chosen: tuple[str, str] = ("", "")
        """Titles of the track that moves and of its ghost; empty: chosen by what there is."""
        server.gui.add_markdown(HELP)
        self.message = ""
        """What was said last."""
        self._message = server.gui.add_html("")
        self.working = Working(server)
        self.timeline = Timeline(server.gui, self.drawing, self.lock)
        with server.gui.add_folder("Notes", expand_by_default=False, order=1e9):
            self._notes = server.gui.add_html("")

    def do(self, action: Action, client: "viser.ClientHandle | None" = None) -> Future:
        """Do it after what was asked for before; whoever asked is told if it is refused."""
        return self._worker.submit(self._do, action, client)

    def do_latest(self, key: Hashable, action: Callable[[], None]) -> None:
        """Do it soon, unless another of the same key comes first: for what a drag shows on its way."""
        waiting = key in self._latest
        self._latest[key] = action
        if not waiting:
            with contextlib.suppress(RuntimeError):  # the page was stopped meanwhile
                self._worker.submit(self._do_latest, key)

    def say(self, text: str, refused: bool = False) -> None:
        """Show a message to everyone."""
        shown = text if len(text) <= LONGEST_MESSAGE else text[:LONGEST_MESSAGE] + " ..."
        colour = "#d55e00" if refused else "inherit"
        title = "<b>Refused.</b> " if refused else ""
        self.message = shown
        self._message.content = block(f"{title}{html.escape(shown)}", colour) if shown else ""

    def show(self) -> None:
        """Bring drawing and controls up to date."""
        work = self.workbench.work
        if work is not self._shown:
            self._show_work(work)
            self._shown = work
        for refresh in self.refreshers:
            refresh()
        self.server.flush()
        if self._noted is not work:
            self._noted = work
            later = threading.Timer(NOTES_AFTER, self.do_latest, ("notes", self._show_notes))
            later.daemon = True
            later.start()

    def tracks(self) -> tuple[AnyTrack | None, AnyTrack | None]:
        """The track that moves, and its ghost."""
        there = self.workbench.work.tracks
        opened = [title for title in there if title not in (PREDICTED, SIMULATED)]
        order = [*opened, *(title for title in (PREDICTED, SIMULATED) if title in there)]
        main = self.chosen[0] if self.chosen[0] in there else next(iter(order), "")
        others = [title for title in order if title != main]
        ghost = self.chosen[1] if self.chosen[1] in (*there, "none") else next(iter(others), "")
        return there.get(main), there.get(ghost)

    def stop(self) -> None:
        """End for good."""
        self.timeline.stop()
        self._worker.shutdown(wait=True, cancel_futures=True)
        self.server.stop()

    def _do(self, action: Action, client: "viser.ClientHandle | None") -> None:
        with self.lock:
            try:
                with self.working.begun():
                    said = action() or ""
                self.say("\n".join(filter(None, (said, self._predict()))))
            except CancelledError as cancelled:
                self.say(str(cancelled))
            except PushGraphError as error:
                self._shown = None  # whatever a drag has shown on its way is drawn as it is
                self._refuse(str(error), client)
            except Exception as error:
                self._shown = None
                traceback.print_exc(file=sys.stderr)
                self._refuse(f"pushgraph failed at this, which it should not: {error!r}", client)
            try:
                self.show()
            except Exception:
                traceback.print_exc(file=sys.stderr)
                self._refuse("pushgraph failed to draw this, which it should not; undo it", client)

    def forget_latest(self, key: Hashable) -> None:
        """What waits to be done under this key is of no matter any more."""
        if key in self._latest:
            self._latest[key] = lambda: None

    def _do_latest(self, key: Hashable) -> None:
        action = self._latest.pop(key)
        with self.lock:
            try:
                action()
            except PushGraphError as error:
                self.say(str(error), refused=True)
            except Exception:
                traceback.print_exc(file=sys.stderr)
            self.server.flush()

    def _predict(self) -> str:
        """Of a changed scene, what its pushes do, unless it came with tracks; says why if that cannot be."""
        work = self.workbench.work
        if not work.tracks and getattr(work.scene, "pushes", True) and work.scene is not self._unpredictable:
            try:
                self.workbench.predict(self.believed and work.history is not None)
            except PushGraphError as error:
                self._unpredictable = work.scene
                return f"Not predicted: {error}"
        return ""

    def _show_notes(self) -> None:
        notes = [f"• {html.escape(note)}" for note in self.workbench.remarks()[:MOST_NOTES]]
        self._notes.content = block("\n".join(notes) or "Nothing is assumed, and nothing doubtful.")

    def _refuse(self, text: str, client: Any) -> None:
        self.say(text, refused=True)
        if client is not None:
            client.add_notification("Refused", text[:LONGEST_MESSAGE], color="red", auto_close_seconds=8.0)

    def _show_work(self, work: Work) -> None:
        main, ghost = self.tracks()
        before = self._shown_tracks
        self.drawing.show_scene(work.scene)
        self.drawing.show_track(main)
        self._show_forces(main)
        self.drawing.show_ghost(ghost)
        self.drawing.show_belief(work.history)
        self.drawing.show_goal(work.goal)
        self.show_outcome(main)
        if before != (main, ghost) or self._shown is None:
            self.timeline.refresh()
        if self.show_next is not None:
            frame = int(np.searchsorted(self.drawing.times, self.show_next, side="right")) - 1
            self.timeline.step(frame - self.drawing.frame)
            self.show_next = None
        self._shown_tracks = (main, ghost)

    def _show_forces(self, track: AnyTrack | None) -> None:
        if self.forces and isinstance(track, Track):
            try:
                self.drawing.show_forces(self.workbench.forces(track))
            except PushGraphError as error:
                self.say(str(error), refused=True)

    def show_outcome(self, track: AnyTrack | None) -> None:
        """Where a track of a scene on a table ends, with its spread."""
        self.drawing.show_outcome(track if isinstance(track, Track) else None)

    def choose(self, main: str, ghost: str) -> None:
        """Show these tracks, by their titles."""
        self.chosen = (main, ghost)
        self._show_work(self.workbench.work)


def block(written: str, colour: str = "inherit") -> str:
    """Text as HTML, which was escaped, in the look of the panel."""
    style = f"padding:0.25em 0.75em;overflow-wrap:anywhere;white-space:pre-wrap;font-size:0.875em;color:{colour}"
    return f'<div style="{style}">{written}</div>'
