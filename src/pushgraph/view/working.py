"""Work that takes long: how far it is, and how it is cancelled."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from pushgraph.errors import CancelledError

Progress = Callable[[int, int], None]
"""Told how much of how much is done; raises CancelledError where it shall end."""
PATIENCE = 0.4
"""What takes no longer (s) shows neither bar nor button."""
TELLS = 8
"""The bar moves so often in a second."""


class Working:
    """A bar and a button to cancel, which are seen while something long is done."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._bar = server.gui.add_progress_bar(0.0, visible=False)
        self.button = server.gui.add_button("Cancel", color="red", hint="Escape does so, too", visible=False)
        self.button.on_click(lambda _: self.cancel())
        self._cancelled = threading.Event()
        self._turn = threading.Lock()
        self._busy = False
        self._told = 0.0

    @property
    def seen(self) -> bool:
        """Whether bar and button are."""
        return bool(self.button.visible)

    @contextlib.contextmanager
    def begun(self) -> Iterator[None]:
        """Work, for which `tell` is called every so often."""
        self._cancelled.clear()
        self._busy = True
        later = threading.Timer(PATIENCE, self._show)
        later.daemon = True
        later.start()
        try:
            yield
        finally:
            later.cancel()
            with self._turn:
                self._busy = self._bar.visible = self.button.visible = False
                self.button.label = "Cancel"

    def tell(self, done: int, total: int) -> None:
        """So much of so much is done; raises CancelledError if it was cancelled."""
        if self._cancelled.is_set():
            raise CancelledError("Cancelled; everything is as it was.")
        if time.monotonic() - self._told > 1 / TELLS:
            self._told = time.monotonic()
            self._bar.value = 100.0 * done / max(total, 1)
            self._server.flush()

    def cancel(self) -> None:
        """End what is being done as soon as it asks; nothing, if nothing is."""
        self._cancelled.set()
        with self._turn:
            self.button.label = "Cancelling ..." if self._busy else "Cancel"

    def _show(self) -> None:
        with self._turn:
            self._bar.visible = self.button.visible = self._busy
        self._server.flush()
