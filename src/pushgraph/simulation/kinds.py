"""The kinds of scenes that the training mixture holds beside the paper's, each wide in something that a scene may say.

Whatever a kind is about, frictions, masses, tools and joints are drawn as well. The kinds `pieces`, `polygons`,
`rings`, `walls`, `rows` and `loops` choose their own number of bodies, MOST_BODIES at most, parts of pieces and of
polygons counted: datasets are padded to the largest scene.
"""

import math
from collections.abc import Callable

import numpy as np

from pushgraph.shape import Cylinder
from pushgraph.simulation.aiming import Way
from pushgraph.simulation.block import Block
from pushgraph.simulation.linkages import draw_door, draw_drawer, draw_ring, draw_slider_crank, draw_walls
from pushgraph.simulation.outlines import (
    draw_bar,
    draw_composite,
    draw_cut_polygon,
    draw_plate,
    draw_shape,
    log_uniform,
    ring_of_discs,
    row_of_bodies,
)
from pushgraph.simulation.plan import Density, Plan
from pushgraph.simulation.pushers import GRAVITY, draw_blade, draw_composite_tool, draw_probe, draw_style
from pushgraph.simulation.scenery import PAPER_SIZE, draw_scene
from pushgraph.tool import Tool

MOST_BODIES = 40
SIZE = (0.02, 0.30)
"""Size of a scene's bodies (m), times a factor for each."""
FACTOR = (0.5, 2.0)
CRUSHING = 150.0
"""A pusher that accelerates the lightest body like this (m/s^2) would press it deep into a wall."""


def frictions(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Bodies of the paper's size, both frictions near the ends of their ranges."""
    table = log_uniform(rng, 0.05, 0.15) if rng.random() < 0.5 else log_uniform(rng, 0.6, 1.5)
    side = rng.uniform(0.0, 0.1) if rng.random() < 0.5 else rng.uniform(0.5, 1.0)
    scene = draw_scene(
        rng, _bodies(rng, objects, PAPER_SIZE, (0.7, 1.4)), density, PAPER_SIZE, frictions=(table, float(side))
    )
    return Plan(scene, density, draw_style(rng, scene, PAPER_SIZE))


def sizes(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Bodies of 1 to 60 cm."""
    size = log_uniform(rng, *SIZE)
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def plates(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Plates of 3 to 10 mm, some other bodies among them."""
    size = log_uniform(rng, 0.04, 0.2)
    blocks = [
        Block.of(draw_plate(rng, size * factor) if rng.random() < 0.7 else draw_shape(rng, size * factor))
        for factor in _factors(rng, objects)
    ]
    scene = draw_scene(rng, blocks, density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def bars(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Bars 3 to 10 times as long as wide, some other bodies among them."""
    size = log_uniform(rng, 0.05, 0.3)
    blocks = [
        Block.of(draw_bar(rng, size * factor) if rng.random() < 0.8 else draw_shape(rng, 0.5 * size * factor))
        for factor in _factors(rng, objects)
    ]
    scene = draw_scene(rng, blocks, density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def pieces(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Pieces of 2 to 40 parts: bars of cells, L, T, crosses, hammers, clusters; some single bodies."""
    size = log_uniform(rng, 0.06, 0.3)
    blocks: list[Block] = []
    for factor in _factors(rng, int(rng.integers(1, objects + 1))):
        left = MOST_BODIES - sum(len(block.parts) for block in blocks)
        if left < 2:
            break
        if rng.random() < 0.25:
            blocks.append(Block.of(draw_shape(rng, 0.6 * size * factor)))
            continue
        piece = draw_composite(rng, size * factor, round(log_uniform(rng, 2.0, float(left))))
        if len(piece.parts) <= left:
            blocks.append(piece)
    scene = draw_scene(rng, blocks or [draw_composite(rng, size, 8)], density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def polygons(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Polygons, cut into the parts that networks know; some other bodies."""
    size = log_uniform(rng, 0.04, 0.3)
    blocks: list[Block] = []
    for factor in _factors(rng, int(rng.integers(1, objects + 1))):
        left = MOST_BODIES - sum(len(block.parts) for block in blocks)
        if left < 10:
            break
        if blocks and rng.random() < 0.25:
            blocks.append(Block.of(draw_shape(rng, size * factor)))
        else:
            blocks.append(draw_cut_polygon(rng, size * factor, min(left, 20)))
    scene = draw_scene(rng, blocks, density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def rings(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Discs, and rings of discs: loose ones with bodies inside, or rigid ones."""
    size = log_uniform(rng, 0.06, 0.3)
    blocks: list[Block] = []
    for _ in range(int(rng.integers(1, 3))):
        count = int(rng.integers(5, 15))
        if rng.random() < 0.5:
            overlap = -0.1 * size * math.sin(math.pi / count)
            blocks.append(Block.rigid(ring_of_discs(rng, size, count, overlap)))
            continue
        parts = ring_of_discs(rng, size, count, float(rng.uniform(0.0, 0.2)) * size * math.sin(math.pi / count))
        inner = size * (1 - math.sin(math.pi / count)) * float(rng.uniform(0.4, 0.9))
        if inner > 0.2 * size:
            parts.append(parts[0]._replace(shape=Cylinder(diameter=inner), pose_body_from_part=(0.0, 0.0, 0.0)))
        blocks.append(Block.loose(parts))
    blocks += [Block.of(Cylinder(diameter=0.4 * size * factor)) for factor in _factors(rng, min(objects, 10))]
    scene = draw_scene(rng, blocks, density, size)
    return Plan(scene, density, draw_style(rng, scene, size))


def walls(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Walls, corners, channels, doors and drawers. The pusher stalls, as pushers do, where it can crush."""
    size = log_uniform(rng, 0.04, 0.2)
    blocks: list[Block] = []
    for _ in range(int(rng.integers(1, 4))):
        fixture = (draw_walls, draw_door, draw_drawer)[rng.integers(3)]
        blocks.append(fixture(rng, size * float(rng.uniform(1.0, 2.0))))
    blocks += _bodies(rng, min(objects, 24), size, (0.6, 1.5))
    scene = draw_scene(rng, blocks, density, size, even=True)
    masses = [body.mass for body in scene.bodies if not body.fixed and body.mass is not None]
    assert scene.table.friction is not None
    force = scene.table.friction * max(masses) * GRAVITY * float(rng.uniform(3.0, 8.0))
    force = min(force, CRUSHING * min(masses))
    return Plan(scene, density, draw_style(rng, scene, size, (0.02, 0.3), rotation=0.0, force_limit=force))


def rows(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Rows of 3 to 20 touching bodies, pushed by flat tools along and across."""
    count = int(rng.integers(3, 21))
    size = log_uniform(rng, 0.02, 0.12)
    blocks = [Block.loose(row_of_bodies(rng, size, count))]
    blocks += _bodies(rng, min(objects // 2, 20), size)
    tool = draw_blade(rng, 0.5 * size, 4 * size)
    scene = draw_scene(rng, blocks, density, size, tool=tool, even=True)
    first, last = (scene.poses_world_from_body[k, :2] for k in (0, count - 1))
    along = math.atan2(*(last - first)[::-1])
    return Plan(scene, density, draw_style(rng, scene, size, square=True, along=along, rotation=0.0))


def joints(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Hinges anywhere, sliders in any direction, limits that are soon met."""
    size = log_uniform(rng, 0.05, 0.2)
    blocks = _bodies(rng, objects, size, (0.7, 1.4))
    if objects > 3 and rng.random() < 0.3:
        blocks[:2] = [draw_composite(rng, 1.5 * size, int(rng.integers(2, 7)))]
    scene = draw_scene(rng, blocks, density, size, anywhere=1.0)
    return Plan(scene, density, draw_style(rng, scene, size))


def loops(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Four-bars, rings of more bars, some with a slider, and slider-cranks."""
    size = log_uniform(rng, 0.12, 0.5)
    blocks: list[Block] = []
    for _ in range(int(rng.integers(1, 3))):
        if rng.random() < 0.3:
            blocks.append(draw_slider_crank(rng, size))
        else:
            blocks.append(draw_ring(rng, size, int(rng.integers(4, 9))))
    blocks += _bodies(rng, min(objects // 2, 8), 0.3 * size)
    scene = draw_scene(rng, blocks, density, 0.4 * size, anywhere=0.5)
    return Plan(scene, density, draw_style(rng, scene, 0.4 * size))


def tools(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Probes of 3 mm to blades of 60 cm, and tools of several parts, turning."""
    size = log_uniform(rng, 0.05, 0.2)
    kind = rng.integers(4)
    if kind == 0:
        tool = draw_probe(rng)
    elif kind == 1:
        tool = draw_blade(rng)
    elif kind == 2:
        tool = draw_composite_tool(rng, log_uniform(rng, 0.3, 1.5))
    else:
        tool = Tool.round(log_uniform(rng, 0.01, 0.4))
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size, tool=tool)
    square = kind == 1 and rng.random() < 0.5
    return Plan(scene, density, draw_style(rng, scene, size, square=bool(square)))


def fast(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Pushes at 0.4 to 1 m/s, after which bodies slide on; rests until they have stopped."""
    size = log_uniform(rng, 0.05, 0.2)
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size, margin=2.0)
    return Plan(scene, density, draw_style(rng, scene, size, (0.4, 1.0)))


def slow(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Short pushes at 2 to 20 mm/s."""
    size = log_uniform(rng, 0.02, 0.15)
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size)
    return Plan(scene, density, draw_style(rng, scene, size, (0.002, 0.02)))


def corners(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Pushes at corners and past edges."""
    size = log_uniform(rng, 0.04, 0.2)
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size)
    return Plan(scene, density, draw_style(rng, scene, size, grazes=True))


def paths(rng: np.random.Generator, objects: int, density: Density) -> Plan:
    """Pushes out and back again, and along way-points."""
    size = log_uniform(rng, 0.04, 0.2)
    scene = draw_scene(rng, _bodies(rng, objects, size), density, size)
    style = draw_style(rng, scene, size, (0.05, 0.5))
    ways: tuple[Way, ...] = ("straight", "back", "bent", "bent")
    return Plan(scene, density, style._replace(distance=0.55 * style.distance, ways=ways))


KINDS: dict[str, Callable[[np.random.Generator, int, Density], Plan]] = {
    kind.__name__: kind
    for kind in (
        frictions,
        sizes,
        plates,
        bars,
        pieces,
        polygons,
        rings,
        walls,
        rows,
        joints,
        loops,
        tools,
        fast,
        slow,
        corners,
        paths,
    )
}


def _factors(rng: np.random.Generator, count: int, bounds: tuple[float, float] = FACTOR) -> list[float]:
    return [log_uniform(rng, *bounds) for _ in range(count)]


def _bodies(rng: np.random.Generator, count: int, size: float, factors: tuple[float, float] = FACTOR) -> list[Block]:
    return [Block.of(draw_shape(rng, size * factor)) for factor in _factors(rng, count, factors)]
