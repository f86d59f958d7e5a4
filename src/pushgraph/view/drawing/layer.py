"""One part of a picture: nodes under a frame of their own, drawn anew only if what they show has changed."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser
from jaxtyping import Float, UInt8

from pushgraph.view.drawing.colours import Colour
from pushgraph.view.drawing.solids import Solid

DIGITS = 4
"""Decimal places of positions (m) and quaternions: what cannot be seen is neither sent nor saved."""


class Layer:
    """Nodes that come and go together. `node` is the name of their frame."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self.api, self.node = api, node
        self._frame: viser.FrameHandle | None = None
        self._shows: Any = None

    def draw(self, what: Any, drawn: Callable[[], None]) -> bool:
        """Call `drawn` on an empty frame, unless `what` equals what was shown; say whether it was called."""
        if self._frame is not None and self._shows == what:
            return False
        self.clear()
        self._frame, self._shows = self.api.add_frame(self.node, show_axes=False), what
        drawn()
        return True

    def clear(self) -> None:
        """Remove all of it."""
        if self._frame is not None:
            self._frame.remove()
        self._frame = self._shows = None


def add_solid(api: viser.SceneApi, node: str, solid: Solid, colour: Colour, **look: Any) -> viser.MeshHandle:
    """A surface in one colour, seen from both sides."""
    shown: dict[str, Any] = {"color": colour, "flat_shading": True, "side": "double"} | look
    return api.add_mesh_simple(node, solid.vertices, solid.faces, **shown)


def add_lines(
    api: viser.SceneApi,
    node: str,
    lines: Float[np.ndarray, "lines 2 3"],
    colours: Colour | UInt8[np.ndarray, "lines 2 3"],
    pixels: float = 1.3,
    **at: Any,
) -> viser.LineSegmentsHandle:
    """Straight lines (m), so many pixels thick from near and far."""
    return api.add_line_segments(node, lines, colours, thickness=pixels, thickness_units="screen", **at)


def add_arrow(
    api: viser.SceneApi,
    node: str,
    ends: Float[np.ndarray, "2 3"],
    colour: Colour,
    shaft: float,
    head: float,
    length: float,
) -> viser.ArrowsHandle:
    """From point to point. shaft, head: radii; length: of the head (m)."""
    return api.add_arrows(node, ends[None], colour, shaft_radius=shaft, head_radius=head, head_length=length)


class Movers:
    """Nodes that follow poses; what stays where it is costs nothing."""

    def __init__(self, nodes: Sequence[viser.SceneNodeHandle]) -> None:
        self._nodes = nodes
        self._last = np.full((len(nodes), 7), np.inf)

    def move(self, poses: Float[np.ndarray, "nodes 7"]) -> None:
        """Bring the nodes to poses; those whose pose is not known are hidden."""
        rounded = np.round(poses, DIGITS)
        changed = ~np.isclose(rounded, self._last, rtol=0, atol=1e-9, equal_nan=True).all(-1)
        for index in np.flatnonzero(changed).tolist():
            node, row = self._nodes[index], rounded[index].tolist()
            node.visible = seen = bool(np.isfinite(row).all())
            if seen:
                node.position, node.wxyz = row[:3], row[3:]
        self._last = rounded
