"""Test scenes in blocks, which processes measure side by side."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import EvaluationError
from pushgraph.simulation.setups import FIRST_TEST_SEED, Trajectory, draw_trajectory

SETUP = "multiple-parts"
BLOCK = 25
"""Scenes that one process handles at a time."""

Measured = TypeVar("Measured")


class Block(NamedTuple):
    """Some test scenes, and the checkpoints (names or paths) that are measured on them."""

    objects: int
    seed: int
    first: int
    count: int  # type: ignore[assignment]  # a tuple's own `count` is of no use here
    models: tuple[tuple[str, str], ...]
    setup: str = SETUP

    def draw(self) -> list[Trajectory]:
        """Simulate the scenes."""
        return [
            draw_trajectory(self.setup, self.objects, self.seed, index)
            for index in range(self.first, self.first + self.count)
        ]


def measure_blocks(
    work: Callable[[Block], list[Measured]],
    objects: Sequence[int],
    count: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    setup: str = SETUP,
    block: int = BLOCK,
) -> list[Measured]:
    """What `work` measures in `count` test scenes for each number of objects, in order; `models` are checkpoints.

    setup: that scenes are drawn from. block: scenes that one process handles at a time. Raises EvaluationError if the
    scenes of this seed are for training.
    """
    if seed < FIRST_TEST_SEED:
        raise EvaluationError(f"seed {seed}: seeds below {FIRST_TEST_SEED:,} are for training and validation data")
    chosen = tuple((name, str(path)) for name, path in models.items())
    blocks = [
        Block(number, seed, first, min(block, count - first), chosen, setup)
        for number in objects
        for first in range(0, count, block)
    ]
    measured: dict[Block, list[Measured]] = {}
    for done, of_block in run_in_processes(work, blocks, min(workers, len(blocks))):
        measured[done] = of_block
        progress(sum(map(len, measured.values())))
    return [of_scene for one in blocks for of_scene in measured[one]]
