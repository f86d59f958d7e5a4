"""What comes of the pushes: predicted, simulated, and which of it is shown."""

from pushgraph.view.panel.controls import NONE, Controls, offer


class TrackControls(Controls):
    """Buttons to compute tracks, and lists to choose which one moves, and which is its ghost."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.button("Simulate", self.workbench.simulate, "MuJoCo's answer beside the prediction, as a ghost")
        self.button("Predict", self._predict, "Also by itself, after every change of the scene")
        self.believed = self.gui.add_checkbox(
            "as believed", False, hint="With the joints of the beliefs, and their doubt"
        )
        self.button("Undo", self.workbench.undo, "The last change (Z)")
        self.main = self.gui.add_dropdown("Moving", (NONE,))
        self.ghost = self.gui.add_dropdown("Ghost", (NONE,))
        for chosen in (self.main, self.ghost):
            self.on_change(chosen, self._choose)

    def refresh(self) -> None:
        """List the tracks there are."""
        there = self.workbench.work.tracks
        main, ghost = self.session.tracks()
        titles = {id(track): title for title, track in there.items()}
        offer(self.main, there, titles.get(id(main)))
        offer(self.ghost, (NONE, *there), titles.get(id(ghost), NONE))

    def _predict(self) -> None:
        self.workbench.predict(bool(self.believed.value))

    def _choose(self) -> None:
        self.session.choose(self.main.value, self.ghost.value)
