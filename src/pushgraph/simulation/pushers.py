"""Draw what pushes: tools from probes to blades, speeds, distances, and rests in which all comes to rest."""

import math
from typing import Any

import numpy as np

from pushgraph import pose
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.aiming import PUSHES, PushStyle
from pushgraph.simulation.outlines import log_uniform
from pushgraph.tool import Part, Tool

GRAVITY = 9.81
PUSH_SECONDS = 5.0
"""A push lasts so long at most; nine of them are some thousand frames."""
SLOW_PUSHES = 4
SLOW_SECONDS = 11.0
LONGEST_REST = 2.5


def draw_tool(rng: np.random.Generator, scale: float = 1.0) -> Tool:
    """Half of the tools are round, a quarter cuboids, a quarter composed of several parts."""
    kind = rng.random()
    if kind < 0.5:
        return Tool.round(max(0.003, scale * log_uniform(rng, 0.005, 0.12)))
    if kind < 0.75:
        return Tool(parts=(Part(shape=Cuboid(size=_sides(rng, scale))),))
    return draw_composite_tool(rng, scale)


def draw_composite_tool(rng: np.random.Generator, scale: float = 1.0) -> Tool:
    """Two to four cuboids and discs, which need not touch, at any place around the end-effector."""
    place = scale * rng.uniform(-0.15, 0.15, 2)
    parts = []
    for _ in range(int(rng.integers(2, 5))):
        shape: Cuboid | Cylinder
        if rng.random() < 0.7:
            shape = Cuboid(size=_sides(rng, scale))
        else:
            shape = Cylinder(diameter=max(0.003, scale * float(rng.uniform(0.02, 0.12))))
        parts.append(Part(shape=shape, pose_tool_from_part=(*place.tolist(), float(rng.uniform(-math.pi, math.pi)))))
        step = pose.rotate(np.array([rng.uniform(0.04, 0.10), 0.0]), float(rng.uniform(-math.pi, math.pi)))
        place = place + scale * step
    return Tool(parts=tuple(parts))


def draw_probe(rng: np.random.Generator) -> Tool:
    """A round pusher of 3 to 10 mm."""
    return Tool.round(log_uniform(rng, 0.003, 0.01))


def draw_blade(rng: np.random.Generator, narrowest: float = 0.05, widest: float = 0.6) -> Tool:
    """A flat tool, square to its x-axis."""
    return Tool(parts=(Part(shape=Cuboid(size=(log_uniform(rng, 0.003, 0.03), log_uniform(rng, narrowest, widest)))),))


def is_round(tool: Tool) -> bool:
    """Whether it does not matter how the tool is turned."""
    return len(tool.parts) == 1 and isinstance(tool.parts[0].shape, Cylinder)


def draw_style(
    rng: np.random.Generator, scene: Scene, size: float, speeds: tuple[float, float] = (0.02, 0.5), **fields: Any
) -> PushStyle:
    """Pushes among bodies of this size (m): as long as they are worth, and brief enough.

    Slow ones are few and short. All rest until what slides has stopped.
    """
    assert scene.table.friction is not None
    speed = log_uniform(rng, *speeds)
    slow = speed < 0.02
    longest = speed * (SLOW_SECONDS if slow else PUSH_SECONDS)
    wanted = 2.5 * size * float(rng.uniform(0.7, 1.3))
    turned = not is_round(scene.tool)
    rotation = float(rng.uniform(0.2, 0.9)) if turned and rng.random() < 0.5 else 0.0
    rotation = min(rotation, longest / 2 / scene.tool.reach)
    style = PushStyle(
        # It takes v^2 / a to come to full speed and to stop.
        distance=min(max(wanted, 0.05, 1.2 * speed**2), longest - rotation * scene.tool.reach),
        speed=speed,
        turned=turned,
        rotation=rotation,
        pushes=SLOW_PUSHES if slow else PUSHES,
        rest=min(0.2 + 0.8 * speed / (scene.table.friction * GRAVITY), LONGEST_REST),
    )
    return style._replace(**fields)


def _sides(rng: np.random.Generator, scale: float) -> tuple[float, float]:
    wide, narrow = scale * rng.uniform(0.02, 0.18), scale * rng.uniform(0.02, 0.10)
    return max(0.003, float(wide)), max(0.003, float(narrow))
