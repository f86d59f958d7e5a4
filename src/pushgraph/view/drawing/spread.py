"""Ellipses that hold the true positions of bodies with 68 and 95 %."""

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.track import Track
from pushgraph.view.drawing.colours import SPREAD
from pushgraph.view.drawing.layer import DIGITS, Layer
from pushgraph.view.drawing.placing import in_space
from pushgraph.view.drawing.solids import disc

PROBABILITIES = (0.68, 0.95)
OPACITIES = (0.75, 0.4)
LEAST = 0.001
"""A region whose half-axes are smaller is not shown (m)."""
ABOVE = (0.004, 0.003)
"""The smaller region lies on the larger one, over the body (m)."""


class SpreadEllipses:
    """Over every body that may be elsewhere, at a frame of a track that states a spread."""

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)
        self._discs: list[viser.BatchedMeshHandle] = []
        self._last: list[np.ndarray] = []
        self._track: Track | None = None

    def show(self, track: Track) -> None:
        """Draw those of a track; they are placed by `at`."""
        self._layer.draw(track, lambda: self._draw(track))
        self._track = track

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()
        self._discs, self._track = [], None

    @property
    def shown(self) -> bool:
        """Whether there are any."""
        return self._track is not None

    def at(self, frame: int) -> None:
        """Place them as they are in this frame."""
        if self._track is None:
            return
        for index, (handle, (places, scales)) in enumerate(zip(self._discs, regions(self._track, frame), strict=True)):
            now = np.round(np.hstack((places, scales)), DIGITS)
            if not np.array_equal(now, self._last[index]):
                handle.batched_positions, handle.batched_wxyzs, handle.batched_scales = (
                    now[:, :3],
                    now[:, 3:7],
                    now[:, 7:],
                )
                self._last[index] = now

    def _draw(self, track: Track) -> None:
        self._discs, self._last = [], []
        for probability, opacity, (places, scales) in zip(PROBABILITIES, OPACITIES, regions(track, 0), strict=True):
            drawn = disc()
            self._discs.append(
                self._layer.api.add_batched_meshes_simple(
                    f"{self._layer.node}/{probability * 100:.0f}",
                    drawn.vertices,
                    drawn.faces,
                    batched_wxyzs=places[:, 3:],
                    batched_positions=places[:, :3],
                    batched_scales=scales,
                    batched_colors=SPREAD,
                    opacity=opacity,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                    lod="off",
                )
            )
            self._last.append(np.hstack((places, scales)))


def regions(track: Track, frame: int) -> list[tuple[Float[np.ndarray, "bodies 7"], Float[np.ndarray, "bodies 3"]]]:
    """For each probability, where a disc of radius 1 is placed over each body, and its half-axes as scales (m)."""
    assert track.spread is not None
    middles = track.poses[frame, 1:].copy()
    heights = np.array([body.shape.height for body in track.scene.bodies])
    found = []
    for probability, above in zip(PROBABILITIES, ABOVE, strict=True):
        ellipse = track.spread.take(frame).ellipse(probability)
        shown = (np.maximum(ellipse.along, ellipse.across) >= LEAST) & track.seen[frame, 1:]
        middles[:, 2] = ellipse.direction
        scales = np.stack((ellipse.along, ellipse.across, np.ones_like(ellipse.along)), -1)
        found.append(
            (in_space(np.where(shown[:, None], middles, 0.0), heights + above), np.where(shown[:, None], scales, 0.0))
        )
    return found
