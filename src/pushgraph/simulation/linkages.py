"""Draw linkages: bars in closed loops of hinges and sliders, doors in their frames, and drawers."""

import math

import numpy as np

from pushgraph.body import Joint
from pushgraph.shape import Cuboid, Cylinder, PlacedShape
from pushgraph.simulation.block import Block

OPEN = 0.3
"""Share of linkages that lack joints: so their bodies' places do not tell who is joined."""
PLAY = (0.001, 0.004)
"""Between what slides or turns and what holds it (m)."""


def draw_ring(rng: np.random.Generator, size: float, bars: int) -> Block:
    """Bars around a polygon, hinged at its corners; of five or more, sometimes one slides instead."""
    angles = 2 * math.pi * (np.arange(bars) + rng.uniform(-0.15, 0.15, bars)) / bars
    radii = size / 2 * rng.uniform(0.75, 1.0, bars)
    corners = np.stack((radii * np.cos(angles), radii * np.sin(angles)), -1)
    sides = np.roll(corners, -1, 0) - corners
    width = float(rng.uniform(0.06, 0.13) * np.hypot(*sides.T).min())
    slides = int(rng.integers(bars)) if bars > 4 and rng.random() < 0.4 else None
    joints = []
    for k in range(bars):
        parent, child = str((k - 1) % bars), str(k)
        if k == slides:
            limits = (-float(rng.uniform(0, 0.3)) * width, float(rng.uniform(0.5, 3.0)) * width)
            axis = tuple(sides[k].tolist())
            joints.append(Joint(kind="prismatic", parent=parent, child=child, axis=axis, limits=limits))
        else:
            joints.append(_hinge(rng, corners[k], parent, child))
    return Block.loose([_bar(corners, k, width) for k in range(bars)], _some(rng, joints))


def draw_slider_crank(rng: np.random.Generator, size: float) -> Block:
    """A crank, hinged to a base, moves a rod, and that a disc or block, which slides along the base."""
    crank, rod = size * rng.uniform(0.25, 0.4), size * rng.uniform(0.5, 0.7)
    angle = rng.uniform(0.6, 1.8)
    pivot, elbow = np.zeros(2), crank * np.array([math.cos(angle), math.sin(angle)])
    end = np.array([elbow[0] + math.sqrt(rod**2 - elbow[1] ** 2), 0.0])
    width = float(size * rng.uniform(0.04, 0.08))
    block = float(size * rng.uniform(0.1, 0.16))
    below = -(block / 2 + width / 2 + float(rng.uniform(*PLAY)))
    base = Cuboid(size=(size * 1.2, width))
    slider = Cylinder(diameter=block) if rng.random() < 0.3 else Cuboid(size=(block, block))
    inset = _inset(pivot, elbow, end, width)
    parts = [
        PlacedShape(base, (0.45 * size, below, 0.0)),
        _between(pivot, elbow, width, width, inset),
        _between(elbow, end, width, inset, 0.75 * block + PLAY[0]),
        PlacedShape(slider, (*end.tolist(), 0.0)),
    ]
    joints = [
        _hinge(rng, pivot, "0", "1"),
        _hinge(rng, elbow, "1", "2"),
        _hinge(rng, end, "2", "3"),
        Joint(kind="prismatic", parent="0", child="3", axis=(1.0, 0.0), limits=_slide(rng, 0.3 * size)),
    ]
    return Block.loose(parts, _some(rng, joints))


def draw_door(rng: np.random.Generator, size: float) -> Block:
    """A leaf that hangs on a fixed post, and sometimes ends before another."""
    width = float(size * rng.uniform(0.08, 0.15))
    gap, post = float(rng.uniform(*PLAY)), float(size * rng.uniform(0.1, 0.2))
    parts = [
        PlacedShape(Cuboid(size=(post, post)), (-gap - post / 2, 0.0, 0.0)),
        PlacedShape(Cuboid(size=(size, width)), (size / 2, 0.0, 0.0)),
    ]
    if rng.random() < 0.5:
        parts.append(PlacedShape(Cuboid(size=(post, post)), (size + 0.05 * size + post / 2, 0.0, 0.0)))
    hinge = _hinge(rng, np.array([-gap / 2, float(rng.uniform(-0.5, 0.5)) * width]), "0", "1", least=0.3)
    return Block.loose(parts, _some(rng, [hinge]), fixed=(0, 2) if len(parts) == 3 else (0,))


def draw_drawer(rng: np.random.Generator, size: float) -> Block:
    """A drawer in a fixed frame of three walls, on its slider."""
    width, depth = float(size * rng.uniform(0.5, 1.0)), float(size * rng.uniform(0.5, 1.0))
    wall, play = float(size * rng.uniform(0.06, 0.12)), float(rng.uniform(*PLAY))
    aside = width / 2 + play + wall / 2
    frame = [
        PlacedShape(Cuboid(size=(depth + wall, wall)), (-wall / 2, aside, 0.0)),
        PlacedShape(Cuboid(size=(depth + wall, wall)), (-wall / 2, -aside, 0.0)),
        PlacedShape(Cuboid(size=(wall, width + 2 * play)), (-depth / 2 - wall / 2 - play, 0.0, 0.0)),
    ]
    pulled = float(rng.uniform(0.0, 0.4)) * depth
    drawer = PlacedShape(Cuboid(size=(depth, width)), (pulled, 0.0, 0.0))
    slider = Joint(
        kind="prismatic",
        parent="2",
        child="3",
        axis=(1.0, 0.0),
        limits=(-pulled, float(rng.uniform(0.3, 0.9)) * depth),
    )
    joints = _some(rng, [slider])
    return Block((*frame, drawer), (0, 0, 0, 1), tuple(joints), fixed=(0,))


def draw_walls(rng: np.random.Generator, size: float) -> Block:
    """A fixed wall, a corner, or a channel of two walls; or a fixed disc."""
    kind = rng.integers(4)
    if kind == 0:
        return Block.rigid([PlacedShape(Cylinder(diameter=size * float(rng.uniform(0.3, 0.8))))], fixed=True)
    thick = float(size * rng.uniform(0.08, 0.2))
    wall = Cuboid(size=(2 * size, thick))
    walls = [PlacedShape(wall)]
    if kind == 2:
        walls.append(PlacedShape(wall, (-size + thick / 2, size - thick / 2, math.pi / 2)))
    elif kind == 3:
        walls.append(PlacedShape(wall, (0.0, float(size * rng.uniform(1.0, 2.0)), 0.0)))
    return Block.rigid(walls, fixed=True)


def _some(rng: np.random.Generator, joints: list[Joint]) -> list[Joint]:
    """All of a linkage's joints, or in some linkages only some, or none."""
    if rng.random() >= OPEN:
        return joints
    return [joint for joint in joints if rng.random() < 0.5]


def _hinge(rng: np.random.Generator, anchor: np.ndarray, parent: str, child: str, least: float = 0.1) -> Joint:
    low, high = rng.uniform(least, 1.5, 2).tolist()
    return Joint(kind="revolute", parent=parent, child=child, anchor=tuple(anchor.tolist()), limits=(-low, high))


def _slide(rng: np.random.Generator, far: float) -> tuple[float, float]:
    low, high = (far * rng.uniform(0.1, 1.0, 2)).tolist()
    return -low, high


def _bar(corners: np.ndarray, index: int, width: float) -> PlacedShape:
    """A bar along one side of a polygon, so short that bars turn a good way before they meet at a corner."""
    before, here, there, after = (corners[(index + k) % len(corners)] for k in (-1, 0, 1, 2))
    return _between(here, there, width, _inset(before, here, there, width), _inset(here, there, after, width))


def _inset(before: np.ndarray, corner: np.ndarray, after: np.ndarray, width: float) -> float:
    """How far two bars end from their corner (m), so as to turn towards each other by half of their angle."""
    one, two = before - corner, after - corner
    angle = math.acos(np.clip(one @ two / (np.hypot(*one) * np.hypot(*two)), -1, 1))
    return width / 2 / math.tan(angle / 4) + PLAY[0]


def _between(start: np.ndarray, end: np.ndarray, width: float, inset: float, inset_end: float) -> PlacedShape:
    """A bar on the line between two points, ending that far short of each (m)."""
    along = end - start
    length = float(np.hypot(*along))
    along /= length
    middle = start + along * (inset + length - inset_end) / 2
    return PlacedShape(
        Cuboid(size=(length - inset - inset_end, width)), (*middle.tolist(), math.atan2(along[1], along[0]))
    )
