"""Sequences of straight pushes that follow each other without lifting."""

import math
from collections.abc import Sequence
from itertools import product

from pushgraph.tool import Push

QUARTERS = tuple(k * math.pi / 2 for k in range(4))
"""+x, +y, -x, -y (rad)."""


def sequences(
    start: tuple[float, float] = (0.0, 0.0),
    yaw: float = 0.0,
    directions: Sequence[float] = QUARTERS,
    pushes: int = 3,
    length: float = 0.20,
    speed: float = 0.10,
) -> list[Push]:
    """All ways to push so often, each time a length (m) in one of the directions (rad), as one path each.

    start: where the end-effector begins (m). yaw: how the tool is turned throughout (rad). speed: m/s. By default those
    of the paper: 64 sequences of three pushes of 20 cm.
    """
    times = tuple((k + 1) * length / speed for k in range(pushes))
    steps = [(length * round(math.cos(d), 12), length * round(math.sin(d), 12)) for d in directions]
    found = []
    for chosen in product(steps, repeat=pushes):
        x, y = start
        path = []
        for step_x, step_y in chosen:
            x, y = x + step_x, y + step_y
            path.append((x, y))
        found.append(Push(start=start, path=tuple(path), times=times, yaw=yaw, rest=0.0))
    return found
