"""Ctrl-C during a training: the step under way is finished, then everything is saved."""

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and what clusters send to jobs whose time is over."""


class Stopping:
    """Within it the first of SIGNALS only asks to stop; a second one has its usual effect, if `twice` says so.

    twice: not for one of several processes, which gets the same Ctrl-C from the terminal and from who started it.
    """

    def __init__(self, twice: bool = True) -> None:
        self.asked = False
        self._twice = twice
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> "Stopping":
        if threading.current_thread() is threading.main_thread():  # others cannot receive signals
            self._before = {one: signal.signal(one, self._ask) for one in SIGNALS}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._restore()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        if self._twice:
            self._restore()

    def _restore(self) -> None:
        for one, handler in self._before.items():
            signal.signal(one, handler)
        self._before = {}
