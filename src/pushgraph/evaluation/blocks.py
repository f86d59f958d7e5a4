"""Test scenes in blocks, which processes measure side by side: drawn from a setup, or read from a dataset."""

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from pushgraph.dataset.engines import run_in_processes
from pushgraph.dataset.store import Dataset
from pushgraph.errors import EvaluationError
from pushgraph.simulation.setups import FIRST_TEST_SEED, Trajectory, draw_trajectory

SETUP = "multiple-parts"
BLOCK = 25
"""Scenes that one process handles at a time."""
PathLike = str | os.PathLike

Measured = TypeVar("Measured")


class Block(NamedTuple):
    """Some test scenes, and the checkpoints (names or paths) that are measured on them.

    data: the dataset that they are read from, if they are: of its trajectories with so many objects, in order.
    """

    objects: int
    seed: int
    first: int
    count: int  # type: ignore[assignment]  # a tuple's own `count` is of no use here
    models: tuple[tuple[str, str], ...]
    setup: str = SETUP
    data: str | None = None

    def draw(self) -> list[Trajectory]:
        """Simulate the scenes, or read them."""
        numbers = range(self.first, self.first + self.count)
        if self.data is None:
            return [draw_trajectory(self.setup, self.objects, self.seed, index) for index in numbers]
        with Dataset(self.data) as dataset:
            chosen = np.flatnonzero(_objects_in(dataset) == self.objects)[self.first : self.first + self.count].tolist()
            density, kind = dataset.density, dataset.kind
            return [Trajectory(dataset[k], str(density[k]), str(kind[k]), Counter()) for k in chosen]


def measure_blocks(
    work: Callable[[Block], list[Measured]],
    objects: Sequence[int],
    count: int | None,
    seed: int,
    models: Mapping[str, PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    setup: str = SETUP,
    block: int = BLOCK,
    data: PathLike | None = None,
) -> list[Measured]:
    """What `work` measures in `count` test scenes for each number of objects, in order; `models` are checkpoints.

    setup: that scenes are drawn from. data: the dataset that they are read from instead; without a count, all of it.
    block: scenes that one process handles at a time. Raises EvaluationError if the scenes of this seed are for
    training.
    """
    if data is None and seed < FIRST_TEST_SEED:
        raise EvaluationError(f"seed {seed}: seeds below {FIRST_TEST_SEED:,} are for training and validation data")
    chosen = tuple((name, str(path)) for name, path in models.items())
    source = None if data is None else str(data)
    blocks = [
        Block(number, seed, first, min(block, last - first), chosen, setup, source)
        for number, last in zip(objects, scenes_of(objects, count, data), strict=True)
        for first in range(0, last, block)
    ]
    measured: dict[Block, list[Measured]] = {}
    for done, of_block in run_in_processes(work, blocks, min(workers, len(blocks))):
        measured[done] = of_block
        progress(sum(map(len, measured.values())))
    return [of_scene for one in blocks for of_scene in measured[one]]


def scenes_of(objects: Sequence[int], count: int | None, data: PathLike | None) -> list[int]:
    """How many scenes are measured for each number of objects."""
    if data is None:
        if count is None:
            raise EvaluationError("count: how many scenes to draw must be said, for there is no data")
        return [count] * len(objects)
    with Dataset(data) as dataset:
        there = Counter(_objects_in(dataset).tolist())
    return [there[number] if count is None else min(count, there[number]) for number in objects]


def numbers_of(objects: Sequence[int], data: PathLike | None, least: int = 1) -> tuple[int, ...]:
    """The numbers of objects that a suite measures, which needs `least`: those asked for, of data all if none are.

    Raises EvaluationError if one is too small, or not in the data.
    """
    if data is None:
        if min(objects, default=least) < least:
            raise EvaluationError(f"objects: this suite needs {least} in a scene at least, got {min(objects)}")
        return tuple(objects)
    with Dataset(data) as dataset:
        there = [number for number in sorted(set(_objects_in(dataset).tolist())) if number >= least]
    missing = [number for number in objects if number not in there]
    if missing or not there:
        raise EvaluationError(
            f"{data}: no trajectory of {missing[0] if missing else least} objects"
            + (f"; valid: {', '.join(map(str, there))}" if there else " or more, which this suite needs")
        )
    return tuple(objects or there)


def origin(setup: str, count: int | None, seed: int, data: PathLike | None) -> dict[str, Any]:
    """Where scenes come from, for the protocol of results."""
    if data is None:
        return {"setup": setup, "count": count, "seed": seed}
    with Dataset(data) as dataset:
        recipe = dataclasses.asdict(dataset.recipe)
    return {"data": Path(data).name, "recipe": recipe, "count": count or recipe["count"], "seed": seed}


def _objects_in(dataset: Dataset) -> np.ndarray:
    """Of every trajectory."""
    return np.diff(dataset.pose_offset) // np.diff(dataset.frame_offset) - 1
