"""The controls beside the drawing, a tab for each thing that can be done."""

from pushgraph.view.panel.panel import add_panel

__all__ = ["add_panel"]
