"""Links between bodies that are believed to be joined, in the colours of their likeliest joints."""

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.belief_history import BeliefHistory
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.view.drawing.colours import JOINTS
from pushgraph.view.drawing.layer import DIGITS, Layer
from pushgraph.view.drawing.names import GAP
from pushgraph.view.drawing.solids import circle, prism

KINDS = tuple(JOINT_CODES)
THICKEST = 0.009
"""Radius of the link of a pair that is surely joined (m)."""
LEAST = 0.1
"""A link is shown where a pair is joined with this probability."""
CERTAIN = 0.98
"""A pair that was never less sure of not being joined than this has no link."""


def telling_pairs(history: BeliefHistory) -> list[int]:
    """Pairs that ever may have been joined, the likeliest in the end first."""
    joined = 1 - history.probabilities[..., JOINT_CODES["none"]]
    telling = np.flatnonzero(joined.max(0) > 1 - CERTAIN)
    return telling[np.argsort(-joined[-1, telling], kind="stable")].tolist()


class BeliefLinks:
    """A rod from body to body for every pair: the surer that it is joined, the thicker."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._rods: viser.BatchedMeshHandle | None = None
        self._last = self._kinds = np.zeros(0)

    def show(self, history: BeliefHistory) -> None:
        """Draw those of a history; they are placed by `at`."""
        self._layer.draw(history, lambda: self._draw(history))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()
        self._rods = None

    def at(self, frame: int, places: Float[np.ndarray, "bodies 3"]) -> None:
        """Show what was believed in this frame. places: of the middles of the bodies' upper sides (m)."""
        if self._rods is None:
            return
        first, second = places[self._ends].swapaxes(0, 1)
        shares = self._history.probabilities[frame, self._pairs]
        positions, turns, scales = rods(first + [0, 0, GAP / 2], second + [0, 0, GAP / 2], joined(shares))
        now = np.round(np.hstack((positions, turns, scales)), DIGITS)
        kinds = shares.argmax(-1)
        if not np.array_equal(now, self._last):
            rods_now = self._rods
            rods_now.batched_positions, rods_now.batched_wxyzs, rods_now.batched_scales = np.split(now, [3, 7], 1)
            self._last = now
        if not np.array_equal(kinds, self._kinds):
            self._rods.batched_colors = _colours(kinds)
            self._kinds = kinds

    def _draw(self, history: BeliefHistory) -> None:
        self._history, self._pairs = history, telling_pairs(history)
        names = history.scene.names
        self._ends = np.array([[names.index(name) for name in history.pairs[pair]] for pair in self._pairs])
        if not self._pairs:
            return
        self._kinds = history.probabilities[0, self._pairs].argmax(-1)
        rod, count = prism(circle(1.0, 12), 0.0, 1.0), len(self._pairs)
        self._rods = self._layer.api.add_batched_meshes_simple(
            f"{self._layer.node}/rods",
            rod.vertices,
            rod.faces,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            batched_positions=np.zeros((count, 3)),
            batched_scales=np.zeros((count, 3)),
            batched_colors=_colours(self._kinds),
            cast_shadow=False,
            side="double",
            lod="off",
        )


def joined(probabilities: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows"]:
    """Probability of any joint."""
    return 1 - probabilities[..., JOINT_CODES["none"]]


def rods(
    first: Float[np.ndarray, "pairs 3"], second: Float[np.ndarray, "pairs 3"], shares: Float[np.ndarray, " pairs"]
) -> tuple[Float[np.ndarray, "pairs 3"], Float[np.ndarray, "pairs 4"], Float[np.ndarray, "pairs 3"]]:
    """Position, quaternion and scales that bring an upright rod of length and radius 1 from point to point (m).

    Rods of pairs that are joined with less than `LEAST`, or of which one was not seen, have no size.
    """
    between = second - first
    length = np.linalg.norm(between, axis=-1)
    shown = np.isfinite(length) & (length > 1e-6) & (shares >= LEAST)
    direction = np.where(shown[:, None], between / np.where(shown, length, 1.0)[:, None], [0.0, 0.0, 1.0])
    # The half-way turn from z to the direction: 1 + cosine and z x direction, normalized.
    turn = np.column_stack((1 + direction[:, 2], -direction[:, 1], direction[:, 0], np.zeros(len(direction))))
    turn[turn[:, 0] < 1e-9] = [0.0, 1.0, 0.0, 0.0]
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    radius = THICKEST * shares
    scales = np.where(shown[:, None], np.column_stack((radius, radius, length)), 0.0)
    return np.where(shown[:, None], first, 0.0), turn, scales


def _colours(kinds: np.ndarray) -> np.ndarray:
    """Of the likeliest kinds; where that is `none`, though a joint may be, the colour of none."""
    return np.array([JOINTS[KINDS[kind]] for kind in kinds], dtype=np.uint8)
