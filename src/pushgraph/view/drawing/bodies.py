"""Bodies with their heights, names and joints."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.lever_scene import LeverScene
from pushgraph.scene import Scene
from pushgraph.view.drawing import joints, names
from pushgraph.view.drawing.colours import EDGE, Colour, body_colours, darker
from pushgraph.view.drawing.forms import CENTRED_BOX, Form, form_of, form_of_box
from pushgraph.view.drawing.instances import Instances
from pushgraph.view.drawing.layer import Layer, Movers
from pushgraph.view.drawing.solids import Solid, outline_of

GHOST_OPACITY = 0.3
GHOST_SIZE = 0.996
"""Ghosts are so much smaller that they vanish in bodies that are where they are."""
LINE = 0.0016
"""Breadth of the line on a body that shows where its x axis points (m)."""


class DrawnBody(NamedTuple):
    """A body in its own frame. middle: of its upper side (m). front: how far it reaches along its x (m), if shown."""

    name: str
    form: Form
    colour: Colour
    middle: tuple[float, float, float]
    front: float = 0.0


class Grip(NamedTuple):
    """What can be clicked and dragged: the solids of these bodies, one an instance."""

    handle: viser.BatchedMeshHandle
    names: tuple[str, ...]


class _Part(NamedTuple):
    """One solid of many bodies. body: their places in the scene. places: of the solid in each body's frame (m)."""

    instances: Instances
    body: list[int]
    places: Float[np.ndarray, "bodies 3"]


def drawn_bodies(scene: Scene | LeverScene) -> list[DrawnBody]:
    """The bodies of a scene, in order."""
    fixed = [body.fixed for body in scene.bodies] if isinstance(scene, LeverScene) else scene.immovable.tolist()
    groups = () if isinstance(scene, LeverScene) else scene.rigid_groups
    colours = body_colours(scene.names, groups, tuple(fixed))
    if isinstance(scene, LeverScene):
        return [
            DrawnBody(body.name, form_of_box(body.size), colour, (0.0, 0.0, body.size[2] / 2))
            for body, colour in zip(scene.bodies, colours, strict=True)
        ]
    return [
        DrawnBody(
            body.name,
            form_of(body.shape),
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
        self._forget()

    def _forget(self) -> None:
        self._parts: list[_Part] = []
        self._movers = Movers(())
        self._names: names.Names | None = None
        self.drawn: list[DrawnBody] = []
        self.grips: list[Grip] = []

    def show(self, scene: Scene | LeverScene, view: names.View, shadows: bool = False) -> None:
        """Draw them, if they are others than before; they stand where they stood until they are moved."""
        self._layer.draw((_looks(scene), view, shadows), lambda: self._draw(scene, view, shadows))

    def clear(self) -> None:
        """Remove them."""
        self._layer.clear()
        self._forget()

    def move(self, poses_world_from_body: Float[np.ndarray, "bodies 7"]) -> None:
        """Bring them to poses; those not seen are hidden."""
        for instances, body, places in self._parts:
            poses = poses_world_from_body[body]
            instances.move(np.column_stack((pose_3d.transform(poses, places), poses[:, 3:])))
        if not self._ghost:
            self._movers.move(poses_world_from_body)

    def place_names(self, poses_world_from_body: Float[np.ndarray, "bodies 7"], view: names.View) -> None:
        """Place the names of bodies at these poses so that none hides another from there."""
        if self._names is not None:
            self._names.place(poses_world_from_body, view)

    def frame_of(self, name: str) -> str:
        """The node that carries a body's name and joints."""
        return f"{self._layer.node}/{name}"

    def _draw(self, scene: Scene | LeverScene, view: names.View, shadows: bool) -> None:
        self._forget()
        api, self.drawn = self._layer.api, drawn_bodies(scene)
        self._draw_solids(shadows)
        if self._ghost:
            return
        self._draw_fronts()
        self._movers = Movers([api.add_frame(self.frame_of(body.name), show_axes=False) for body in self.drawn])
        self._names = names.Names(api, self.frame_of, scene, self.drawn, view)
        if isinstance(scene, Scene):
            for index, joint in enumerate(scene.joints):
                joints.add_joint(api, self.frame_of, scene, joint, index)

    def _draw_solids(self, shadows: bool) -> None:
        """All bodies of a kind at once, and the far sides of slightly larger ones, which are seen as their rims."""
        # Seen from one side alone, solids that cast shadows show stripes of their own.
        look: dict[str, Any] = {"cast_shadow": shadows, "side": "double" if shadows else "front"}
        if self._ghost:
            look["opacity"] = GHOST_OPACITY
        scale = GHOST_SIZE if self._ghost else 1.0
        rim_look = look | {"side": "back", "cast_shadow": False}
        for index, body in enumerate(_kinds([body.form.solid for body in self.drawn])):
            forms, colours = [self.drawn[k].form for k in body], [self.drawn[k].colour for k in body]
            sizes = scale * np.array([form.size for form in forms])
            solids = self._add(f"solids_{index}", body, forms[0].solid, sizes, colours, **look)
            self.grips.append(Grip(solids.handle, tuple(self.drawn[k].name for k in body)))
            sizes = scale * np.array([form.rim_size for form in forms])
            rims = [darker(colour) for colour in colours] if self._ghost else [EDGE] * len(body)
            self._add(f"rims_{index}", body, forms[0].rim, sizes, rims, **rim_look)

    def _draw_fronts(self) -> None:
        body = [index for index, drawn in enumerate(self.drawn) if drawn.front]
        if body:
            fronts = np.array([self.drawn[index].front for index in body])
            sizes = fronts[:, None] * [0.3, 0.0, 0.0] + [0.0, LINE, LINE]
            tops = np.array([self.drawn[index].middle[2] for index in body])
            places = np.column_stack((0.8 * fronts, 0.0 * fronts, tops))
            self._add("fronts", body, CENTRED_BOX, sizes, [EDGE] * len(body), places, cast_shadow=False)

    def _add(
        self,
        node: str,
        body: list[int],
        solid: Solid,
        sizes: Float[np.ndarray, "bodies 3"],
        colours: Sequence[Colour],
        places: Float[np.ndarray, "bodies 3"] | None = None,
        **look: Any,
    ) -> Instances:
        # The hyphen keeps them apart from the frames of bodies, whose names do not begin with one.
        instances = Instances(self._layer.api, f"{self._layer.node}/-{node}", solid, sizes, colours, **look)
        self._parts.append(_Part(instances, body, np.zeros((len(body), 3)) if places is None else places))
        return instances


def _kinds(solids: Sequence[Solid]) -> list[list[int]]:
    """Which of them are alike."""
    kinds: dict[bytes, list[int]] = {}
    for index, solid in enumerate(solids):
        kinds.setdefault(solid.vertices.tobytes(), []).append(index)
    return list(kinds.values())


def _looks(scene: Scene | LeverScene) -> tuple:
    """All of a scene's bodies that must be drawn anew where it changes; bodies that no joint marks are just moved."""
    if isinstance(scene, LeverScene):
        return tuple((body.name, body.size, body.fixed) for body in scene.bodies)
    shapes = tuple((body.name, body.shape, body.fixed) for body in scene.bodies)
    poses = tuple(body.pose_world_from_body for body in scene.bodies) if scene.joints else ()
    return shapes, scene.rigid_groups, scene.joints, poses
