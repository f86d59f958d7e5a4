"""The forces at every contact and joint, as arrows."""

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.forces import ContactForces
from pushgraph.track import Track
from pushgraph.view.drawing.colours import FORCE
from pushgraph.view.drawing.forces import LONGEST
from pushgraph.view.drawing.layer import DIGITS, Layer
from pushgraph.view.drawing.names import GAP
from pushgraph.view.known_forces import KnownForces

SHAFT, HEAD, HEAD_LENGTH = 0.0018, 0.0055, 0.012


class ContactArrows:
    """Two opposite arrows from each point, each along what one of the two bodies bears.

    So of two that press on each other, each arrow lies over the body that it pushes.
    """

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._arrows: viser.ArrowsHandle | None = None
        self._known: KnownForces | None = None
        self.newtons = 0.0
        """The force whose arrows are 10 cm long; 0 if none are shown."""

    @property
    def source(self) -> str:
        """How the forces are known; empty if none are shown."""
        return "" if self._known is None else self._known.source

    def show(self, track: Track, known: KnownForces, newtons: float) -> None:
        """Draw those of a track; they are placed by `at`. newtons: the scale, if another arrow has one, else 0."""
        self._layer.draw((track, known.source, newtons), lambda: self._draw(track, known, newtons))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()
        self._arrows = self._known = None
        self.newtons = 0.0

    def at(self, frame: int) -> None:
        """Place them as they are in this frame."""
        if self._arrows is None or self._known is None:
            return
        now = self._known.forces.at(frame)
        ends = opposite_arrows(now, self._heights[np.stack((now.first, now.second))].max(0), self.newtons)
        self._arrows.visible = bool(len(ends))
        if len(ends):
            self._arrows.points = np.round(ends, DIGITS)

    def _draw(self, track: Track, known: KnownForces, newtons: float) -> None:
        tool = max(part.shape.height for part in track.scene.tool.parts)
        self._heights = np.array([tool, *(body.shape.height for body in track.scene.bodies)]) + GAP
        largest = float(np.hypot(*known.forces.forces.T).max(initial=0.0))
        self.newtons, self._known = newtons or max(largest, 1e-6) * 0.1 / LONGEST, known
        self._arrows = self._layer.api.add_arrows(
            f"{self._layer.node}/arrows",
            np.zeros((1, 2, 3)),
            FORCE,
            shaft_radius=SHAFT,
            head_radius=HEAD,
            head_length=HEAD_LENGTH,
        )
        self._arrows.visible = False


def opposite_arrows(
    forces: ContactForces, heights: Float[np.ndarray, " points"], newtons: float
) -> Float[np.ndarray, "arrows 2 3"]:
    """From each point at its height (m), along what the second bears and then the first; newtons: 10 cm long.

    Arrows shorter than their heads are left out.
    """
    along = forces.forces * 0.1 / newtons
    kept = np.hypot(*along.T) > HEAD_LENGTH
    feet = np.column_stack((forces.points, heights))[kept]
    along = np.column_stack((along, np.zeros(len(along))))[kept]
    return np.concatenate([np.stack((feet, feet + way), 1) for way in (along, -along)])
