"""What all groups of controls have in common."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pushgraph.view.session import Action, Session

NONE = "(none)"
"""Stands in a list to choose from for nothing."""


class Controls:
    """A group of controls: made once, brought up to date by `refresh` after every change."""

    def __init__(self, session: Session) -> None:
        self.session, self.workbench = session, session.workbench
        self.gui: Any = session.server.gui  # viser's types say that no value can be set
        self.clicks: dict[str, tuple[Any, Action]] = {}
        """The buttons by what stands on them: their row, and what they do."""
        self.make()
        session.refreshers.append(self.refresh)

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        raise NotImplementedError

    def refresh(self) -> None:
        """Show the state of the workbench."""

    def buttons(self, label: str, actions: Mapping[str, Action], hint: str | None = None) -> None:
        """Buttons in a row, each of which does something in its turn."""
        row = self.gui.add_button_group(label, tuple(actions), hint=hint)
        self.clicks |= {option: (row, action) for option, action in actions.items()}

        @row.on_click
        async def _(event: Any) -> None:
            if event.target.value in actions:
                self.session.do(actions[event.target.value], event.client)

    def on_change(self, control: Any, action: Action) -> None:
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


def offer_pair(one: Any, other: Any, names: Sequence[str]) -> None:
    """Give two lists the same names; at first the first two."""
    anew = tuple(other.options) != tuple(names)
    offer(one, names)
    offer(other, names, names[1] if anew and len(names) > 1 and other.value not in names[1:] else None)
