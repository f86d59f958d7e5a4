"""What all groups of controls have in common."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pushgraph.view.session import Session

NONE = "(none)"
"""Stands in a list to choose from for nothing."""


class Controls:
    """A group of controls: made once, brought up to date by `refresh` after every change."""

    def __init__(self, session: Session) -> None:
        self.session, self.gui, self.workbench = session, session.server.gui, session.workbench
        self.buttons: dict[str, Any] = {}
        self.make()
        session.refreshers.append(self.refresh)

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        raise NotImplementedError

    def refresh(self) -> None:
        """Show the state of the workbench."""

    def button(self, label: str, action: Callable[[], str | None], hint: str | None = None) -> Any:
        """A button that does something in its turn."""
        made = self.buttons[label] = self.gui.add_button(label, hint=hint)

        @made.on_click
        async def _(event: Any) -> None:
            self.session.do(action, event.client)

        return made

    def on_change(self, control: Any, action: Callable[[], str | None]) -> None:
        """Do something in its turn when a person changes a control, not when the program does."""

        @control.on_update
        async def _(event: Any) -> None:
            if event.client_id is not None:
                self.session.do(action, event.client)


def offer(dropdown: Any, options: Iterable[str], chosen: str | None = None) -> None:
    """Give a list other options; the choice stays if it can, unless another is given."""
    there: Sequence[str] = tuple(options) or (NONE,)
    if tuple(dropdown.options) != there:
        dropdown.options = there
    if chosen in there and dropdown.value != chosen:
        dropdown.value = chosen
