"""Keys of the page; viser lists them in its palette of commands, too (Ctrl-K)."""

from collections.abc import Callable
from typing import Any

from pushgraph.view.session import Session

SECOND = 20
"""Frames."""


def add_keys(session: Session) -> None:
    """Play, step, cancel and undo."""
    timeline = session.timeline

    def play() -> None:
        timeline.pause() if timeline.playing else timeline.play()

    keys: list[tuple[str, str, str | None, Callable[[], None]]] = [
        ("Play or pause", "space", None, play),
        ("One frame on", "arrowright", None, lambda: timeline.step(1)),
        ("One frame back", "arrowleft", None, lambda: timeline.step(-1)),
        ("A second on", "arrowright", "shift", lambda: timeline.step(SECOND)),
        ("A second back", "arrowleft", "shift", lambda: timeline.step(-SECOND)),
        ("Cancel what is being done", "escape", None, session.working.cancel),
    ]
    for label, key, modifier, act in keys:
        command = session.server.gui.add_command(label, hotkey=key, modifier=modifier)  # type: ignore[arg-type]
        command.on_trigger(_directly(act))
    for label, modifier in (("Undo the last change", None), ("Undo", "cmd/ctrl")):
        command = session.server.gui.add_command(label, hotkey="Z", modifier=modifier)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(event: Any) -> None:
            session.do(session.workbench.undo, event.client)


def _directly(act: Callable[[], None]) -> Callable[[Any], None]:
    return lambda event: act()
