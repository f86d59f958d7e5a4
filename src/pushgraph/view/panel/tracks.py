"""Which tracks are shown, and with which joints they are predicted."""

import math

import numpy as np

from pushgraph.track import Track
from pushgraph.view.panel.controls import NONE, Controls, offer


class DeedControls(Controls):
    """What is done to the scene as it is; always at hand."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.buttons(
            "Do",
            {"Predict": self._predict, "Simulate": self._simulate, "Undo": self.workbench.undo},
            "Predictions are made anew after every change; MuJoCo's simulation is shown beside it, as a ghost",
        )

    def _predict(self) -> str:
        self.workbench.predict(self.session.believed)
        return self._apart()

    def _simulate(self) -> str:
        self.workbench.simulate(self.session.working.tell)
        return self._apart()

    def _apart(self) -> str:
        """Go to the end, where the moving track and its ghost differ most, and say by how much."""
        self.session.show_next = math.inf
        main, ghost = self.session.tracks()
        if not isinstance(main, Track) or not isinstance(ghost, Track):
            return ""
        off = 100 * np.hypot(*(main.poses[-1, 1:, :2] - ghost.poses[-1, 1:, :2]).T)
        if not np.isfinite(off).any():
            return ""
        farthest = int(np.nanargmax(off))
        return (
            f"In the end the ghosts (see Pushes, Ghost) are {np.nanmean(off):.2f} cm away on average; the farthest is "
            f"{main.scene.names[farthest]!r}, {off[farthest]:.2f} cm. Play to see how they come there."
        )


class TrackControls(Controls):
    """Lists to choose which track moves, and which is its ghost."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.main = self.gui.add_dropdown("Moving", (NONE,))
        self.ghost = self.gui.add_dropdown("Ghost", (NONE,))
        for chosen in (self.main, self.ghost):
            self.on_change(chosen, self._choose)
        self.forces = self.gui.add_checkbox(
            "contact forces", self.session.forces, hint="At every contact and joint, of the moving track"
        )
        self.on_change(self.forces, self._show_forces)
        self.gui.add_divider()

    def refresh(self) -> None:
        """List the tracks there are."""
        there = self.workbench.work.tracks
        main, ghost = self.session.tracks()
        titles = {id(track): title for title, track in there.items()}
        offer(self.main, there, titles.get(id(main)))
        offer(self.ghost, (NONE, *there), titles.get(id(ghost), NONE))

    def _show_forces(self) -> None:
        self.session.forces = bool(self.forces.value)
        self._choose()

    def _choose(self) -> None:
        self.session.choose(self.main.value, self.ghost.value)
