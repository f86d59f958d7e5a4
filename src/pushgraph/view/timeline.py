"""The time line: play at true speed, step, and go to any time."""

import math
import threading
import time
from collections.abc import Callable
from threading import RLock
from typing import Any

import viser

from pushgraph.view.drawing import SceneDrawing

PICTURES = 30
"""Shown in a second while it plays."""
SLIDES = 6
"""The slider follows so often in a second: what it sends is only for it."""
SPEEDS = {"¼ ×": 0.25, "½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "4 ×": 4.0}
MOST_MARKS = 12


class Timeline:
    """Controls in viser's panel that move a drawing through the frames of its track; all browsers share them."""

    def __init__(
        self,
        gui: viser.GuiApi,
        drawing: SceneDrawing,
        lock: RLock,
    ) -> None:
        """gui: `viser.ViserServer.gui`; it gets a folder for the controls. lock: held while it draws."""
        self._gui, self._drawing, self._lock = gui, drawing, lock
        self.on_frame: Callable[[int], None] = lambda frame: None
        """Told each new frame."""
        self._time = 0.0
        self._moving, self._ended = threading.Event(), threading.Event()
        self._folder = gui.add_folder("Time")
        self._slider: Any = None  # viser's types say that no value can be set
        with self._folder:
            self._button = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY_FILLED)
            self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 ×")
        self._button.on_click(lambda _: self.pause() if self.playing else self.play())
        self.refresh()
        self._thread = threading.Thread(target=self._run, name="pushgraph-timeline", daemon=True)
        self._thread.start()

    def refresh(self) -> None:
        """After the drawing got another track: its length and pushes, from its first frame; hidden if still."""
        self.pause()
        with self._lock:
            times = self._drawing.times
            self._time = first = float(times[0])
            last = float(times[-1])
            if self._slider is not None:
                self._slider.remove()
                self._slider = None
            self._folder.visible = last > first
            if not self._folder.visible:
                return
            marks = tuple((begun, str(push)) for push, begun in list(self._drawing.push_times.items())[:MOST_MARKS])
            with self._folder:
                self._slider = self._gui.add_slider(
                    "time (s)", first, last, step=_step(last - first), initial_value=first, marks=marks or None
                )
            self._slider.on_update(self._slid)

    @property
    def playing(self) -> bool:
        """Whether it moves."""
        return self._moving.is_set()

    def play(self) -> None:
        """Move at true speed times the chosen factor, from the first frame if it stands at the last."""
        with self._lock:
            times = self._drawing.times
            if self._time >= times[-1]:
                self._time = float(times[0])
            self._button.label, self._button.icon = "Pause", viser.Icon.PLAYER_PAUSE_FILLED
        self._moving.set()

    def pause(self) -> None:
        """Stand still."""
        self._moving.clear()
        self._button.label, self._button.icon = "Play", viser.Icon.PLAYER_PLAY_FILLED
        with self._lock:
            self._drawing.place_names()

    def step(self, frames: int) -> None:
        """Pause, and go so many frames on, or back."""
        self.pause()
        with self._lock:
            times = self._drawing.times
            self._go(float(times[min(max(self._drawing.frame + frames, 0), len(times) - 1)]))
            self._follow()
            self._drawing.place_names()

    def stop(self) -> None:
        """End for good, as the server stops."""
        self._ended.set()
        self._moving.set()

    def _slid(self, event: viser.GuiEvent) -> None:
        if event.client is not None:  # it was dragged, not moved by playing
            self.pause()
            with self._lock:
                self._go(float(event.target.value))

    def _run(self) -> None:
        while True:
            self._moving.wait()
            if self._ended.is_set():
                return
            self._play()

    def _play(self) -> None:
        """Until it is paused or over; pictures that come too late are left out, so that the speed stays true."""
        last_shown = last_slid = time.monotonic()
        while self.playing and not self._ended.is_set():
            time.sleep(max(0.0, last_shown + 1 / PICTURES - time.monotonic()))
            now = time.monotonic()
            with self._lock:
                if not self.playing:
                    return
                self._go(self._time + (now - last_shown) * SPEEDS[self._speed.value])
                over = self._time >= self._drawing.times[-1]
                if over or now - last_slid > 1 / SLIDES:
                    last_slid = now
                    self._follow()
            last_shown = now
            if over:
                self.pause()

    def _go(self, moment: float) -> None:
        times = self._drawing.times
        self._time = min(max(moment, float(times[0])), float(times[-1]))
        before = self._drawing.frame
        self._drawing.set_time(self._time)
        if self._drawing.frame != before:
            self.on_frame(self._drawing.frame)

    def _follow(self) -> None:
        if self._slider is not None:
            self._slider.value = self._time


def _step(duration: float) -> float:
    """Of the slider: at most a thousandth of it, and at least a hundredth of a second, in round numbers."""
    return max(0.01, 10.0 ** math.floor(math.log10(duration / 100)))
