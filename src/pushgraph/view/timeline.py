"""The time line: play at true speed, step, and go to any time."""

from collections.abc import Callable
from threading import RLock
from typing import Any

from pushgraph.view.drawing import SceneDrawing


class Timeline:
    """Controls in viser's panel that move a drawing through the frames of its track; all browsers share them."""

    def __init__(self, gui: Any, drawing: SceneDrawing, lock: RLock, on_frame: Callable[[int], None] | None = None):
        """gui: `viser.ViserServer.gui`; made where it stands, e.g. inside a folder. lock: held while it draws.

        on_frame: told each new frame.
        """
        raise NotImplementedError

    def refresh(self) -> None:
        """After the drawing got another track: its length and pushes, from its first frame; hidden if still."""
        raise NotImplementedError

    @property
    def playing(self) -> bool:
        """Whether it moves."""
        raise NotImplementedError

    def play(self) -> None:
        """Move at true speed times the chosen factor, from the first frame if it stands at the last."""
        raise NotImplementedError

    def pause(self) -> None:
        """Stand still."""
        raise NotImplementedError

    def step(self, frames: int) -> None:
        """Pause, and go so many frames on, or back."""
        raise NotImplementedError

    def stop(self) -> None:
        """End for good, as the server stops."""
        raise NotImplementedError
