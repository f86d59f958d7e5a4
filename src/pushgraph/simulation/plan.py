"""What a setup draws: a scene, and how it shall be pushed."""

from typing import Literal, NamedTuple

from pushgraph.scene import Scene
from pushgraph.simulation.aiming import PushStyle

Density = Literal["dense", "sparse"]
DENSITIES: tuple[Density, Density] = ("dense", "sparse")


class Plan(NamedTuple):
    """A scene, and how it shall be pushed; style: None if the scene itself says with which pushes."""

    scene: Scene
    density: Density
    style: PushStyle | None = None
    kind: str = "paper"
    """Which of the kinds of `pushgraph.simulation.kinds` it is, or that of the paper."""
