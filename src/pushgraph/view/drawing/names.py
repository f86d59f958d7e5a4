"""Names above bodies, each so high that none hides another."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.lever_scene import LeverScene
from pushgraph.scene import Scene
from pushgraph.view.drawing.colours import EDGE
from pushgraph.view.drawing.layer import DIGITS, add_lines
from pushgraph.view.drawing.placing import start_of

if TYPE_CHECKING:
    from pushgraph.view.drawing.bodies import DrawnBody

WIDTH = 0.56
"""Of a letter, over the height of its line."""
PADDING = 0.35
"""Of the ground of a label on either side, over the height of its line."""
GAP = 0.012
"""Between a body and its name (m)."""
MOST_STEPS = 12


class View(NamedTuple):
    """From where a scene is seen. target, position: m. letters: height of a line of text (m)."""

    target: tuple[float, float, float]
    position: tuple[float, float, float]
    letters: float

    @property
    def forward(self) -> Float[np.ndarray, "3"]:
        """Unit vector of the line of sight."""
        along = np.subtract(self.target, self.position)
        return along / np.linalg.norm(along)

    @property
    def right(self) -> Float[np.ndarray, "3"]:
        """Unit vector that points to the right, level."""
        across = np.cross(self.forward, [0.0, 0.0, 1.0])
        return across / np.linalg.norm(across)


class Names:
    """The names of bodies, which the bodies carry along; a raised one stands on a pole."""

    def __init__(
        self,
        api: viser.SceneApi,
        frame_of: Callable[[str], str],
        scene: Scene | LeverScene,
        bodies: Sequence["DrawnBody"],
        view: View,
    ) -> None:
        """frame_of: the node of each body's frame."""
        self._feet = np.array([body.middle for body in bodies])
        if isinstance(scene, LeverScene):
            self._feet = _on_rims(scene, self._feet, start_of(scene)[1:], view)
        self._lengths = [len(body.name) for body in bodies]
        self._heights = np.zeros(len(bodies))
        self._labels, self._poles = [], []
        for body, foot in zip(bodies, self._feet.tolist(), strict=True):
            node, top = frame_of(body.name), (*foot[:2], foot[2] + GAP)
            self._labels.append(add_label(api, f"{node}/name", body.name, top, view))
            self._poles.append(add_lines(api, f"{node}/pole", np.array([[foot, top]]), EDGE, visible=False))
        self.place(start_of(scene)[1:], view)

    def place(self, poses: Float[np.ndarray, "bodies 7"], view: View) -> None:
        """So high that none hides another, seen from there; bodies that are not seen hide nothing."""
        heights = heights_of(pose_3d.transform(poses, self._feet + [0, 0, GAP]), self._lengths, view).round(DIGITS)
        for index in np.flatnonzero(heights != self._heights).tolist():
            foot, height = self._feet[index], float(heights[index])
            top = foot + [0, 0, GAP + height]
            self._labels[index].position = tuple(top.tolist())
            self._poles[index].visible = height > 0
            if height > 0:
                self._poles[index].points = np.array([[foot, top]])
        self._heights = heights


def add_label(
    api: viser.SceneApi,
    node: str,
    text: str,
    place: tuple[float, float, float],
    view: View,
    size: float = 1.0,
    anchor: Literal["bottom-center", "center-right"] = "bottom-center",
) -> viser.LabelHandle:
    """A label with its anchor on a point of its parent's frame (m), so many lines of the view's text high."""
    return api.add_label(
        node,
        text,
        position=place,
        anchor=anchor,
        font_size_mode="scene",
        font_scene_height=size * view.letters,
    )


def _on_rims(
    scene: LeverScene, middles: Float[np.ndarray, "bodies 3"], poses: Float[np.ndarray, "bodies 7"], view: View
) -> Float[np.ndarray, "bodies 3"]:
    """Names of fixed boxes stand at the rim that is nearest to the viewer: the board lies on their middles."""
    towards = pose_3d.transform(pose_3d.inverse(poses), np.array(view.position)) - middles
    side = np.abs(towards[:, :2]).argmax(-1)
    fixed = np.flatnonzero([body.fixed for body in scene.bodies])
    moved, side = middles.copy(), side[fixed]
    half = np.array([body.size for body in scene.bodies])[fixed, side] / 2
    moved[fixed, side] += np.sign(towards[fixed, side]) * half
    return moved


def heights_of(places: Float[np.ndarray, "names 3"], lengths: Sequence[int], view: View) -> Float[np.ndarray, " names"]:
    """How much higher than its place each name must stand, so that none hides another as it is seen (m).

    lengths: letters. The nearest stand lowest; a name that finds no room in twelve steps stays at the twelfth.
    """
    forward, right = view.forward, view.right
    up = np.cross(right, forward)
    line = view.letters * (1 + PADDING)
    half = np.array([(WIDTH * length + 2 * PADDING) * view.letters / 2 for length in lengths])
    across, along = places @ right, places @ up
    rise = line / max(float(up[2]), 0.2)
    heights = np.zeros(len(places))
    taken: list[tuple[float, float, float]] = []
    for index in np.argsort(places @ forward, kind="stable").tolist():
        for step in range(MOST_STEPS + 1):
            heights[index] = step * rise
            at = along[index] + heights[index] * up[2]
            if not any(abs(at - y) < line and abs(across[index] - x) < half[index] + w for x, y, w in taken):
                break
        taken.append((float(across[index]), float(at), float(half[index])))
    return heights
