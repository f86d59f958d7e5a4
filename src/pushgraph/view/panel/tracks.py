"""Which tracks are shown, and with which joints they are predicted."""

from pushgraph.view.panel.controls import NONE, Controls, offer


class DeedControls(Controls):
    """What is done to the scene as it is; always at hand."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.buttons(
            "Do",
            {"Predict": self._predict, "Simulate": self.workbench.simulate, "Undo": self.workbench.undo},
            "Predictions are made anew after every change; MuJoCo's simulation is shown beside it, as a ghost",
        )

    def _predict(self) -> None:
        self.workbench.predict(self.session.believed)


class TrackControls(Controls):
    """Lists to choose which track moves, and which is its ghost."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.main = self.gui.add_dropdown("Moving", (NONE,))
        self.ghost = self.gui.add_dropdown("Ghost", (NONE,))
        for chosen in (self.main, self.ghost):
            self.on_change(chosen, self._choose)
        self.gui.add_divider()

    def refresh(self) -> None:
        """List the tracks there are."""
        there = self.workbench.work.tracks
        main, ghost = self.session.tracks()
        titles = {id(track): title for title, track in there.items()}
        offer(self.main, there, titles.get(id(main)))
        offer(self.ghost, (NONE, *there), titles.get(id(ghost), NONE))

    def _choose(self) -> None:
        self.session.choose(self.main.value, self.ghost.value)
