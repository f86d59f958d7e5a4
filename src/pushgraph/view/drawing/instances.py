"""Many solids of one kind, drawn in one call however many they are."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from jaxtyping import Bool, Float, UInt8

from pushgraph.view.drawing.colours import Colour
from pushgraph.view.drawing.layer import DIGITS
from pushgraph.view.drawing.solids import Solid

RESTING = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class Instances:
    """Copies of a solid, each with its size and colour, at any poses.

    sizes: lengths of each along its axes, over those of the solid. They stand at their parent's pose until moved.
    """

    def __init__(
        self,
        api: viser.SceneApi,
        node: str,
        solid: Solid,
        sizes: Float[np.ndarray, "instances 3"],
        colours: Sequence[Colour],
        **look: Any,
    ) -> None:
        self._sizes = sizes
        self._last = np.tile(np.array(RESTING), (len(sizes), 1))
        shown: dict[str, Any] = {"flat_shading": True, "lod": "off"} | look
        self.handle: viser.BatchedMeshHandle = api.add_batched_meshes_simple(
            node,
            solid.vertices,
            solid.faces,
            self._last[:, 3:],
            self._last[:, :3],
            batched_scales=sizes,
            batched_colors=_linear(colours),
            **shown,
        )

    def move(self, poses: Float[np.ndarray, "instances 7"]) -> None:
        """Bring them to poses; those whose pose is not known are shrunk to nothing."""
        rounded = np.round(poses, DIGITS)
        if np.array_equal(rounded, self._last, equal_nan=True):
            return
        seen, was_seen = _known(rounded), _known(self._last)
        self._last = rounded
        if not np.array_equal(seen, was_seen):
            self.handle.batched_scales = np.where(seen, self._sizes, 0.0).astype(np.float32)
        placed = np.where(seen, rounded, RESTING).astype(np.float32)
        self.handle.batched_positions, self.handle.batched_wxyzs = placed[:, :3], placed[:, 3:]


def _known(poses: Float[np.ndarray, "instances 7"]) -> Bool[np.ndarray, "instances 1"]:
    return np.isfinite(poses).all(-1, keepdims=True)


def _linear(colours: Sequence[Colour]) -> UInt8[np.ndarray, "instances 3"]:
    """Intensities of light, which instances are coloured with, from those of a screen (sRGB, IEC 61966-2-1)."""
    screen = np.array(colours) / 255
    light = np.where(screen <= 0.04045, screen / 12.92, ((screen + 0.055) / 1.055) ** 2.4)
    return np.round(255 * light).astype(np.uint8)
