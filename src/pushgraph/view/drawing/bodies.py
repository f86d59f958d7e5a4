"""Bodies with their heights, names and joints."""

from typing import Any, NamedTuple

import numpy as np
import viser
from jaxtyping import Float

from pushgraph.lever_scene import LeverScene
from pushgraph.scene import Scene
from pushgraph.view.drawing import joints, names
from pushgraph.view.drawing.colours import EDGE, Colour, body_colours, darker
from pushgraph.view.drawing.layer import Layer, Movers, add_lines, add_solid
from pushgraph.view.drawing.solids import Solid, box, outline_of, prism

GHOST_OPACITY = 0.3
GHOST_SIZE = 0.996
"""Ghosts are so much smaller that they vanish in bodies that are where they are."""
MOST_SHADOWS = 20
"""More bodies cast none: every shadow is drawn several times over."""


class DrawnBody(NamedTuple):
    """A body in its own frame. middle: of its upper side (m). front: how far it reaches along its x (m), if shown."""

    name: str
    solid: Solid
    colour: Colour
    middle: tuple[float, float, float]
    front: float = 0.0


def drawn_bodies(scene: Scene | LeverScene) -> list[DrawnBody]:
    """The bodies of a scene, in order."""
    fixed = [body.fixed for body in scene.bodies] if isinstance(scene, LeverScene) else scene.immovable.tolist()
    groups = () if isinstance(scene, LeverScene) else scene.rigid_groups
    colours = body_colours(scene.names, groups, tuple(fixed))
    if isinstance(scene, LeverScene):
        return [
            DrawnBody(body.name, box(body.size), colour, (0.0, 0.0, body.size[2] / 2))
            for body, colour in zip(scene.bodies, colours, strict=True)
        ]
    return [
        DrawnBody(
            body.name,
            prism(outline_of(body.shape), 0.0, body.shape.height),
            colour,
            (*body.shape.centroid, body.shape.height),
            float(max(0.0, outline_of(body.shape)[:, 0].max())),
        )
        for body, colour in zip(scene.bodies, colours, strict=True)
    ]


class Bodies:
    """The bodies of a scene at any poses. ghost: translucent, without names and joints."""

    def __init__(self, api: viser.SceneApi, node: str, ghost: bool = False) -> None:
        self._layer, self._ghost = Layer(api, node), ghost
        self._movers = Movers(())
        self._names: names.Names | None = None
        self.drawn: list[DrawnBody] = []
        self.solids: dict[str, viser.MeshHandle] = {}

    def show(self, scene: Scene | LeverScene, view: names.View) -> None:
        """Draw them, if they are others than before; they stand where they stood until they are moved."""
        self._layer.draw((_looks(scene), view), lambda: self._draw(scene, view))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()
        self._movers, self._names, self.drawn, self.solids = Movers(()), None, [], {}

    def move(self, poses_world_from_body: Float[np.ndarray, "bodies 7"]) -> None:
        """Bring them to poses; those not seen are hidden."""
        self._movers.move(poses_world_from_body)

    def place_names(self, poses_world_from_body: Float[np.ndarray, "bodies 7"], view: names.View) -> None:
        """Place the names of bodies at these poses so that none hides another from there."""
        if self._names is not None:
            self._names.place(poses_world_from_body, view)

    def frame_of(self, name: str) -> str:
        """The node that a body carries along."""
        return f"{self._layer.node}/{name}"

    def _draw(self, scene: Scene | LeverScene, view: names.View) -> None:
        api, bodies = self._layer.api, drawn_bodies(scene)
        self.drawn = bodies
        self._movers = Movers([api.add_frame(self.frame_of(body.name), show_axes=False) for body in bodies])
        if self._ghost:
            self.solids = {body.name: self._add_ghost(body) for body in bodies}
            return
        shadow = len(bodies) <= MOST_SHADOWS
        self.solids = {body.name: self._add(body, shadow) for body in bodies}
        self._names = names.Names(api, self.frame_of, scene, bodies, view)
        if isinstance(scene, Scene):
            for index, joint in enumerate(scene.joints):
                joints.add_joint(api, self.frame_of, scene, joint, index)

    def _add(self, body: DrawnBody, shadow: bool) -> viser.MeshHandle:
        top = body.middle[2] + 1e-3
        front = [[share * body.front, 0.0, top] for share in (0.65, 0.95)]
        lines = np.concatenate((body.solid.edges, np.array([front])))
        return self._solid(body, 1.0, lines, EDGE, cast_shadow=shadow)

    def _add_ghost(self, body: DrawnBody) -> viser.MeshHandle:
        edges, colour = body.solid.edges * GHOST_SIZE, darker(body.colour, 0.75)
        return self._solid(body, GHOST_SIZE, edges, colour, opacity=GHOST_OPACITY, cast_shadow=False)

    def _solid(
        self, body: DrawnBody, size: float, lines: Float[np.ndarray, "lines 2 3"], colour: Colour, **look: Any
    ) -> viser.MeshHandle:
        api, node = self._layer.api, self.frame_of(body.name)
        add_lines(api, f"{node}/lines", lines, colour)
        solid = body.solid._replace(vertices=body.solid.vertices * size)
        return add_solid(api, f"{node}/solid", solid, body.colour, **look)


def _looks(scene: Scene | LeverScene) -> tuple:
    """All of a scene's bodies that must be drawn anew where it changes; bodies that no joint marks are just moved."""
    if isinstance(scene, LeverScene):
        return tuple((body.name, body.size, body.fixed) for body in scene.bodies)
    shapes = tuple((body.name, body.shape, body.fixed) for body in scene.bodies)
    poses = tuple(body.pose_world_from_body for body in scene.bodies) if scene.joints else ()
    return shapes, scene.rigid_groups, scene.joints, poses
