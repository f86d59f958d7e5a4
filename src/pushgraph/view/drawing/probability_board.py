"""A board behind the bodies: probabilities of pairs over time, and a line at the moment that is shown."""

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.belief_history import BeliefHistory
from pushgraph.scene import Scene
from pushgraph.view.drawing.beliefs import KINDS, telling_pairs
from pushgraph.view.drawing.colours import EDGE, JOINTS
from pushgraph.view.drawing.layer import Layer, add_lines, add_solid
from pushgraph.view.drawing.names import View, add_label
from pushgraph.view.drawing.solids import Solid
from pushgraph.view.drawing.table import extent

MOST_ROWS = 8
MOST_SAMPLES = 240
ROW, BETWEEN = 1.7, 0.7
"""Heights of a band and of the space above it, over the height of a line of text."""
CURSOR = (190, 0, 0)


class ProbabilityBoard:
    """For each pair that may be joined a band, its colours as wide as the kinds of joints are likely."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._cursor: viser.FrameHandle | None = None
        self._times = np.zeros(1)
        self._width = 0.0

    def show(self, history: BeliefHistory, view: View) -> None:
        """Draw it behind the bodies, facing who first sees them."""
        self._layer.draw((history, view), lambda: self._draw(history, view))

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()
        self._cursor = None

    def at(self, frame: int) -> None:
        """Move the line to this frame."""
        if self._cursor is not None:
            first, last = self._times[0], max(self._times[-1], self._times[0] + 1e-9)
            self._cursor.position = (round(self._width * (self._times[frame] - first) / (last - first), 4), 0.0, 0.0)

    def _draw(self, history: BeliefHistory, view: View) -> None:
        api, node = self._layer.api, f"{self._layer.node}/board"
        rows = telling_pairs(history)[:MOST_ROWS]
        left, width = _lower_rim(history.scene, view)
        self._times, self._width = history.times, width
        if not rows:
            return
        api.add_frame(node, show_axes=False, position=tuple(left.tolist()), wxyz=_facing(view))
        samples = np.unique(np.linspace(0, len(history.times) - 1, MOST_SAMPLES).astype(int))
        x = width * (history.times[samples] - history.times[0]) / max(np.ptp(history.times), 1e-9)
        row_height, line = ROW * view.letters, (ROW + BETWEEN) * view.letters
        for place, pair in enumerate(reversed(rows)):
            low = place * line
            edges = low + row_height * np.cumsum(history.probabilities[samples, pair], -1)
            edges = np.column_stack((np.full(len(samples), low), edges))
            for kind, name in enumerate(KINDS):
                strip = band(x, edges[:, kind], edges[:, kind + 1])
                add_solid(api, f"{node}/{pair}_{name}", strip, JOINTS[name], cast_shadow=False, receive_shadow=False)
            text = " – ".join(history.pairs[pair])
            at = (-0.5 * view.letters, low + row_height / 2, 0.0)
            add_label(api, f"{node}/{pair}_name", text, at, view, 0.8, "center-right")
        self._cursor = api.add_frame(f"{node}/now", show_axes=False)
        now = np.array([[[0.0, -0.4 * line, 0.002], [0.0, len(rows) * line, 0.002]]])
        add_lines(api, f"{node}/now/line", now, CURSOR, 2.5)
        floor = np.array([[[0.0, -0.2 * line, 0.0], [width, -0.2 * line, 0.0]]])
        add_lines(api, f"{node}/floor", floor, EDGE)


def band(
    x: Float[np.ndarray, " samples"], low: Float[np.ndarray, " samples"], high: Float[np.ndarray, " samples"]
) -> Solid:
    """Triangles between two curves over x."""
    flat = np.zeros(len(x))
    vertices = np.concatenate((np.column_stack((x, low, flat)), np.column_stack((x, high, flat))))
    here = np.arange(len(x) - 1)
    after, above, both = here + 1, here + len(x), here + len(x) + 1
    faces = np.concatenate((np.stack((here, after, both), 1), np.stack((here, both, above), 1)))
    return Solid(vertices, faces, np.zeros((0, 2, 3)))


def _lower_rim(scene: Scene, view: View) -> tuple[Float[np.ndarray, "3"], float]:
    """Lower left corner of the board in the world, and its width (m): as broad as the bodies, behind the last one."""
    low, high = extent(scene)
    box = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    across, away = box @ view.right, box @ np.cross([0.0, 0.0, 1.0], view.right)
    back = float(away.max()) + 3 * view.letters
    left = across.min() * view.right + back * np.cross([0.0, 0.0, 1.0], view.right)
    return left + [0.0, 0.0, view.letters], float(np.ptp(across))


def _facing(view: View) -> tuple[float, float, float, float]:
    """Turned about z to the viewer's right, and leaning back so that its face looks at the viewer."""
    turn, tilt = np.arctan2(view.right[1], view.right[0]), np.arccos(np.clip(-view.forward[2], -1.0, 1.0))
    about_z = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    about_x = np.array([np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0])
    w, x, y, z = pose_3d.multiply(about_z, about_x).tolist()
    return w, x, y, z
