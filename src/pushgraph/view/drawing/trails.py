"""The ways that bodies and tool went."""

from collections.abc import Sequence

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.lever_track import LeverTrack
from pushgraph.track import Track
from pushgraph.view.drawing.colours import TOOL, Colour, darker
from pushgraph.view.drawing.layer import Layer, add_solid
from pushgraph.view.drawing.solids import Solid

STEP = 0.004
"""A trail has a point so often along its way (m)."""
BREADTH = 0.002
"""Of a trail (m)."""
MOST = 2_000
"""All trails together have so many legs, or a few more; where ways are longer, points are farther apart."""
HEIGHT = 0.003
"""Above the table (m)."""


class Trails:
    """One line for each node of a track that moves; a body that was lost leaves a gap."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)

    def show(self, track: Track | LeverTrack, colours: Sequence[Colour]) -> None:
        """Draw them. colours: of the bodies."""
        self._layer.draw(track, lambda: self._draw(track, [TOOL, *(darker(colour) for colour in colours)]))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()

    def _draw(self, track: Track | LeverTrack, colours: Sequence[Colour]) -> None:
        positions = track.poses[..., :3].copy()
        if isinstance(track, Track):
            positions[..., 2] = HEIGHT
            positions[~track.seen] = np.nan
            positions[~track.down, 0] = np.nan
        gone = np.nansum(np.linalg.norm(np.diff(positions, axis=0), axis=-1))
        step = max(STEP, float(gone) / MOST)
        legs = [thinned(positions[:, index], step) for index in range(len(colours))]
        for index, colour in enumerate(sorted(set(colours))):
            of_colour = np.concatenate([way for way, shade in zip(legs, colours, strict=True) if shade == colour])
            if len(of_colour):
                node, look = f"{self._layer.node}/colour_{index}", {"cast_shadow": False, "receive_shadow": False}
                add_solid(self._layer.api, node, strips(of_colour), colour, **look)


def strips(legs: Float[np.ndarray, "legs 2 3"]) -> Solid:
    """Level strips along straight legs, which are far cheaper to draw than thick lines."""
    way = legs[:, 1] - legs[:, 0]
    aside = np.column_stack((-way[:, 1], way[:, 0], np.zeros(len(way))))
    length = np.linalg.norm(aside, axis=-1, keepdims=True)
    aside = BREADTH / 2 * np.where(length > 1e-9, aside / np.maximum(length, 1e-9), [0.0, 1.0, 0.0])[:, None]
    corners = np.concatenate((legs - aside, legs[:, ::-1] + aside), 1)
    first = 4 * np.arange(len(legs))[:, None]
    return Solid(corners.reshape(-1, 3), np.concatenate((first + [0, 1, 2], first + [0, 2, 3])), np.zeros((0, 2, 3)))


def thinned(positions: Float[np.ndarray, "frames 3"], step: float) -> Float[np.ndarray, "legs 2 3"]:
    """Straight legs of a way, with a point for every step (m); none across frames that are NaN."""
    known = np.isfinite(positions).all(-1)
    legs = []
    for piece in np.split(np.arange(len(positions)), np.flatnonzero(known[1:] != known[:-1]) + 1):
        if not known[piece[0]] or len(piece) < 2:
            continue
        way = positions[piece]
        gone = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=-1))))
        if gone[-1] < step:
            continue
        marks = np.floor(gone / step)
        kept = np.flatnonzero(np.concatenate(([True], marks[1:] > marks[:-1])))
        points = way[np.union1d(kept, [len(way) - 1])]
        legs.append(np.stack((points[:-1], points[1:]), 1))
    return np.concatenate(legs) if legs else np.zeros((0, 2, 3))
