"""The outline of a body that is being drawn, corner by corner."""

from collections.abc import Sequence

import numpy as np
import viser

from pushgraph.view.drawing.colours import GOAL
from pushgraph.view.drawing.layer import Layer, add_lines, add_solid
from pushgraph.view.drawing.solids import circle, prism

HEIGHT = 0.002
"""Above the table (m)."""
DOT = 0.004
"""Radius of a corner (m)."""


class DrawnOutline:
    """Its corners and sides on the table, the last side thin."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)

    def show(self, corners: Sequence[tuple[float, float]]) -> None:
        """Draw corners (m), in order; none: remove it."""
        if corners:
            self._layer.draw(tuple(corners), lambda: self._draw(np.array(corners)))
        else:
            self._layer.clear()

    def _draw(self, corners: np.ndarray) -> None:
        api, node = self._layer.api, self._layer.node
        for index, corner in enumerate(corners):
            add_solid(api, f"{node}/corner_{index}", prism(circle(DOT, 12) + corner, 0.0, 2 * HEIGHT), GOAL)
        points = np.column_stack((corners, np.full(len(corners), HEIGHT)))
        if len(points) > 1:
            add_lines(api, f"{node}/sides", np.stack((points[:-1], points[1:]), 1), GOAL, 4.0)
        if len(points) > 2:
            add_lines(api, f"{node}/last", points[[-1, 0]][None], GOAL)
