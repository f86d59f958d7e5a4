"""What the colours mean, what is known of masses and frictions, and whether the page is light or dark."""

from pushgraph.view.legend import facts, legend
from pushgraph.view.panel.controls import Controls
from pushgraph.view.server import set_dark


class LegendControls(Controls):
    """Explains what is seen; what is believed of masses follows the time line."""

    def make(self) -> None:
        """Two folders and a switch."""
        with self.gui.add_folder("What you see"):
            self._legend = self.gui.add_html("")
            self._dark = self.gui.add_checkbox("Dark", False)
        with self.gui.add_folder("Masses and frictions", expand_by_default=False):
            self._facts = self.gui.add_html("")
        self._dark.on_update(lambda event: set_dark(self.session.server, event.target.value))
        self.session.timeline.on_frame = lambda frame: self._show_facts()

    def refresh(self) -> None:
        """After every change."""
        text = f'<div style="padding:0 0.75em;font-size:0.875em">{legend(self.session.drawing)}</div>'
        if self._legend.content != text:
            self._legend.content = text
        self._show_facts()

    def _show_facts(self) -> None:
        drawing = self.session.drawing
        if drawing.scene is None:
            return
        known = facts(drawing.scene, drawing.history, float(drawing.times[drawing.frame]))
        text = f'<div style="padding:0 0.75em">{known}</div>'
        if self._facts.content != text:
            self._facts.content = text
