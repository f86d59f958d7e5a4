"""Draw outlines: discs and cuboids, plates and bars, polygons, and pieces of many parts."""

import math
from collections.abc import Callable

import numpy as np

from pushgraph import pose
from pushgraph.shape import Cuboid, Cylinder, PlacedShape, Polygon
from pushgraph.simulation.block import Block, centred
from pushgraph.simulation.placement import NoRoom

Stroke = tuple[float, float, float, float, float]
"""A bar from x, y to x, y, and its width, all as shares of the size of what it is part of."""

STROKES: dict[str, Callable[[float, float], list[Stroke]]] = {
    "bar": lambda width, _: [(-0.5, 0.0, 0.5, 0.0, width)],
    "L": lambda width, leg: [(-0.5, 0.0, 0.5, 0.0, width), (-0.5 + width / 2.0, 0.0, -0.5 + width / 2.0, leg, width)],
    "T": lambda width, leg: [(-0.5, 0.0, 0.5, 0.0, width), (0.0, 0.0, 0.0, -leg, width)],
    "cross": lambda width, leg: [(-0.5, 0.0, 0.5, 0.0, width), (0.0, -leg / 2.0, 0.0, leg / 2.0, width)],
    "hammer": lambda width, leg: [(0.0, 0.0, 0.0, -1.0, 0.6 * width), (-leg / 2.0, 0.0, leg / 2.0, 0.0, 1.4 * width)],
    "U": lambda width, leg: [
        (-0.5, 0.0, 0.5, 0.0, width),
        (-0.5 + width / 2.0, 0.0, -0.5 + width / 2.0, leg, width),
        (0.5 - width / 2.0, 0.0, 0.5 - width / 2.0, leg, width),
    ],
    "Z": lambda width, leg: [
        (-0.5, 0.0, 0.5, 0.0, width),
        (-0.5 + width / 2.0, 0.0, -0.5 + width / 2.0, leg, width),
        (0.5 - width / 2.0, 0.0, 0.5 - width / 2.0, -leg, width),
    ],
}
"""Outlines of bars, given the width of one and the length of the shorter ones, as shares of their size."""


def draw_shape(rng: np.random.Generator, size: float) -> Cylinder | Cuboid:
    """A disc or a cuboid, no side longer than `size` (m) nor shorter than half of it."""
    if rng.random() < 0.5:
        return Cylinder(diameter=size)
    return Cuboid(size=(size, size * float(rng.uniform(0.5, 1.0))))


def draw_plate(rng: np.random.Generator, length: float) -> Cuboid:
    """A plate on edge, 3 to 10 mm thick."""
    return Cuboid(size=(length, min(log_uniform(rng, 0.003, 0.01), length)))


def draw_bar(rng: np.random.Generator, length: float) -> Cuboid:
    """A bar, 3 to 10 times as long as wide."""
    return Cuboid(size=(length, length / log_uniform(rng, 3.0, 10.0)))


def draw_composite(rng: np.random.Generator, size: float, parts: int) -> Block:
    """A piece of so many parts (or few more): strokes of cells, or shapes that overlap at random."""
    if rng.random() < 0.35:
        return draw_cluster(rng, size, parts)
    strokes = STROKES[list(STROKES)[rng.integers(len(STROKES))]](rng.uniform(0.12, 0.3), rng.uniform(0.35, 0.9))
    return Block.rigid(centred(_cells(strokes, size, parts)))


def draw_cluster(rng: np.random.Generator, size: float, parts: int) -> Block:
    """A piece of discs and cuboids, each of which overlaps an earlier one."""
    width = size / (1.0 + 0.5 * math.sqrt(parts))
    placed: list[PlacedShape] = []
    for _ in range(parts):
        shape = draw_shape(rng, width * float(rng.uniform(0.6, 1.0)))
        centre = np.zeros(2)
        if placed:
            beside = placed[rng.integers(len(placed))]
            away = rng.uniform(0.5, 0.9) * (_half_width(beside.shape) + _half_width(shape))
            centre = np.array(beside.pose_body_from_part[:2]) + _direction(rng) * away
        placed.append(PlacedShape(shape, (float(centre[0]), float(centre[1]), float(rng.uniform(-math.pi, math.pi)))))
    return Block.rigid(centred(placed))


def draw_polygon(rng: np.random.Generator, size: float) -> Polygon:
    """A triangle, a polygon convex or not, an outline of bars, or a smooth one; about `size` across (m)."""
    kind = rng.integers(5)
    if kind == 0:
        points = _star(rng, 3, 0.6)
    elif kind == 1:
        points = _star(rng, int(rng.integers(4, 8)), 0.85)
    elif kind == 2:
        points = _star(rng, int(rng.integers(5, 9)), 0.4)
    elif kind == 3:
        points = _letter(rng)
    else:
        points = _smooth(rng)
    return Polygon(points=tuple(map(tuple, (size * points).round(6).tolist())))


def draw_cut_polygon(rng: np.random.Generator, size: float, most_parts: int) -> Block:
    """The parts of a polygon of so many at most: the networks are trained on cuboids and cylinders."""
    for _ in range(20):
        try:
            parts = draw_polygon(rng, size).parts
        except ValueError:
            continue
        if len(parts) <= most_parts:
            return Block.rigid(parts)
    raise NoRoom


def ring_of_discs(rng: np.random.Generator, size: float, count: int, gap: float) -> list[PlacedShape]:
    """Discs in a circle of diameter `size` (m) through their centres, so far from each other (negative: overlap)."""
    diameter = size * math.sin(math.pi / count) - gap
    angles = rng.uniform(0, 2 * math.pi) + 2 * math.pi * np.arange(count) / count
    centres = size / 2 * np.stack((np.cos(angles), np.sin(angles)), -1)
    return [PlacedShape(Cylinder(diameter=diameter), (*centre, 0.0)) for centre in centres.tolist()]


def row_of_bodies(rng: np.random.Generator, size: float, count: int) -> list[PlacedShape]:
    """Bodies that touch each other, in a row along x."""
    alike = draw_shape(rng, size) if rng.random() < 0.5 else None
    placed, at = [], 0.0
    for _ in range(count):
        shape = alike or draw_shape(rng, size * float(rng.uniform(0.5, 1.0)))
        half = _half_width(shape)
        placed.append(PlacedShape(shape, (at + half, 0.0, 0.0)))
        at += 2 * half
    return list(centred(placed))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two, as likely in every stretch of equal ratio."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _cells(strokes: list[Stroke], size: float, parts: int) -> list[PlacedShape]:
    lengths = [math.dist(stroke[:2], stroke[2:4]) for stroke in strokes]
    counts = [max(1, round(parts * length / sum(lengths))) for length in lengths]
    placed = []
    for (x, y, u, v, width), length, count in zip(strokes, lengths, counts, strict=True):
        for k in range(count):
            share = (k + 0.5) / count
            cell = Cuboid(size=(max(size * length / count, 1e-3), max(size * width, 1e-3)))
            centre = (size * (x + share * (u - x)), size * (y + share * (v - y)))
            placed.append(PlacedShape(cell, (*centre, math.atan2(v - y, u - x))))
    return placed


def _star(rng: np.random.Generator, corners: int, innermost: float) -> np.ndarray:
    angles = 2 * math.pi * (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) / corners
    return _around(0.5 * rng.uniform(innermost, 1.0, corners), angles)


def _smooth(rng: np.random.Generator) -> np.ndarray:
    angles = 2 * math.pi * np.arange(12) / 12
    radii = 1.0 + sum(rng.normal(0, 0.25 / k) * np.cos(k * angles + rng.uniform(0, 2 * math.pi)) for k in (1, 2, 3))
    radii = np.maximum(radii, 0.35)
    return _around(0.5 * radii / radii.max(), angles)


def _letter(rng: np.random.Generator) -> np.ndarray:
    """An L, T or hammer as one outline."""
    width, leg = rng.uniform(0.15, 0.35), rng.uniform(0.4, 0.9)
    kind = rng.integers(3)
    if kind == 0:
        points = [(0, 0), (1, 0), (1, width), (width, width), (width, leg), (0, leg)]
    else:
        stem, top = (width, width) if kind == 1 else (0.6 * width, 1.4 * width)
        left, right = (1 - stem) / 2, (1 + stem) / 2
        points = [(0, 0), (1, 0), (1, -top), (right, -top), (right, -top - leg), (left, -top - leg), (left, -top)]
        points += [(0, -top)]
    corners = np.array(points, dtype=float)
    return corners - (corners.min(0) + corners.max(0)) / 2


def _around(radii: np.ndarray, angles: np.ndarray) -> np.ndarray:
    return np.stack((radii * np.cos(angles), radii * np.sin(angles)), -1)


def _direction(rng: np.random.Generator) -> np.ndarray:
    return pose.rotate(np.array([1.0, 0.0]), float(rng.uniform(-math.pi, math.pi)))


def _half_width(shape: Cylinder | Cuboid) -> float:
    """Half of its extent along its own x (m)."""
    half_x, _, radius = shape.core
    return radius or half_x
