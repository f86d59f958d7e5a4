"""The force on the tool, as an arrow."""

import numpy as np
import viser

from pushgraph.track import Track
from pushgraph.view.drawing.colours import FORCE
from pushgraph.view.drawing.layer import Layer, add_arrow
from pushgraph.view.drawing.names import GAP

LONGEST = 0.15
"""The arrow of the largest force of a track (m)."""
SHAFT, HEAD = 0.005, 0.012


class ForceArrow:
    """What the bodies exert on the tool, in the frames of a track that was recorded with a force sensor."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._arrow: viser.ArrowsHandle | None = None
        self._track: Track | None = None
        self.newtons = 0.0
        """The force whose arrow is 10 cm long."""

    def show(self, track: Track) -> None:
        """Draw that of a track; it is placed by `at`."""
        self._layer.draw(track, lambda: self._draw(track))

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()
        self._arrow = self._track = None
        self.newtons = 0.0

    def at(self, frame: int) -> None:
        """Place it as it is in this frame."""
        if self._arrow is None or self._track is None or self._track.wrench is None:
            return
        force, place = np.nan_to_num(self._track.wrench[frame, :2]), self._track.poses[frame, 0, :2]
        length = float(np.hypot(*force)) * 0.1 / self.newtons
        self._arrow.visible = length > HEAD
        if length > HEAD:
            height = max(part.shape.height for part in self._track.scene.tool.parts) + 2 * GAP
            tip = place + force * 0.1 / self.newtons
            self._arrow.points = np.round([[[*place, height], [*tip, height]]], 4)

    def _draw(self, track: Track) -> None:
        assert track.wrench is not None
        largest = float(np.nanmax(np.hypot(*track.wrench[:, :2].T), initial=0.0))
        self.newtons, self._track = max(largest, 1e-6) * 0.1 / LONGEST, track
        ends = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
        self._arrow = add_arrow(self._layer.api, f"{self._layer.node}/arrow", ends, FORCE, SHAFT, HEAD, 2 * HEAD)
        self._arrow.visible = False
