"""Generate a dataset: blocks of trajectories side by side, each kept as soon as it is done, then one file."""

import contextlib
import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from pushgraph.dataset.engines import ENGINES
from pushgraph.dataset.lever_store import LeverColumns, LeverDataset
from pushgraph.dataset.ragged import RaggedFile, Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import DatasetError
from pushgraph.json_file import parse, read_text
from pushgraph.simulation.lever_setup import LEVER_UP, draw_interaction
from pushgraph.simulation.setups import draw_trajectory, find_setup
from pushgraph.storage import check_replaceable, replacing

BLOCK = 8
"""Trajectories of a block: what a kill may lose, for each worker."""
SPARE = 32 * 2**20
"""Bytes of disk left free when the blocks become one file."""


def generate(
    setup: str,
    objects: int,
    count: int,
    seed: int,
    out: str | os.PathLike,
    workers: int = 1,
    engine: str = "processes",
    progress: Callable[[int], None] = lambda done: None,
) -> Path:
    """Write `count` trajectories of a setup to `out`; the same arguments give the same bytes, however often killed.

    Finished blocks wait in the folder `OUT.parts`; the same call goes on from there. `progress` is told how
    many trajectories are done. Raises DatasetError if `out` or its parts are of another recipe, another
    process is at them, or the disk is full; nothing is overwritten then.
    """
    if setup != LEVER_UP:
        find_setup(setup, objects)
    if engine not in ENGINES:
        raise DatasetError(f"no engine {engine!r}; valid: {', '.join(ENGINES)}")
    bounds = {"objects": (objects, 1, 1000), "count": (count, 1, 10**9), "seed": (seed, 0, 2**63 - 1)}
    for name, (value, least, most) in (bounds | {"workers": (workers, 1, 10_000)}).items():
        if not least <= value <= most:
            raise DatasetError(f"{name}: must be from {least} to {most}, got {value}")
    out = Path(out)
    check_replaceable(out)
    recipe = Recipe(setup=setup, objects=objects, seed=seed, first=0, count=count)
    if out.exists():
        _check_finished(out, recipe)
        if _parts(out).exists():  # killed after the file was whole
            with _parts_folder(out, recipe):
                pass
            shutil.rmtree(_parts(out))
        progress(count)
        return out
    with _parts_folder(out, recipe) as parts:
        blocks = [dataclasses.replace(recipe, first=k, count=min(BLOCK, count - k)) for k in range(0, count, BLOCK)]
        missing = [block for block in blocks if not _is_whole(_part(parts, block), block)]
        done = count - sum(block.count for block in missing)
        progress(done)
        for block, columns in ENGINES[engine](draw_block, missing, workers):
            dataset_class(setup).write(_part(parts, block), block, [columns])
            done += block.count
            progress(done)
        _join(out, recipe, [_part(parts, block) for block in blocks])
    shutil.rmtree(_parts(out))  # what is locked cannot be removed on Windows
    return out


def dataset_class(setup: str) -> type[RaggedFile]:
    """What reads datasets of a setup."""
    return LeverDataset if setup == LEVER_UP else Dataset


def draw_block(block: Recipe) -> Columns | LeverColumns:
    """Draw the trajectories of one block."""
    indices = range(block.first, block.first + block.count)
    if block.setup == LEVER_UP:
        return LeverColumns.of([draw_interaction(block.seed, index) for index in indices])
    return Columns.of([draw_trajectory(block.setup, block.objects, block.seed, index) for index in indices])


def _check_finished(out: Path, recipe: Recipe) -> None:
    with dataset_class(recipe.setup)(out) as dataset:
        differences = recipe.differences(dataset.recipe)
    if differences:
        raise DatasetError(f"{out}: holds another dataset ({differences}); choose another --out, or remove it first")


@contextlib.contextmanager
def _parts_folder(out: Path, recipe: Recipe) -> Iterator[Path]:
    """The folder of finished blocks, checked to be of this recipe and locked against other processes."""
    parts = _parts(out)
    try:
        parts.mkdir(parents=True, exist_ok=True)
        lock = FileLock(parts / "lock", timeout=0).acquire()
    except Timeout:
        raise DatasetError(f"{parts}: another process is generating this dataset") from None
    except OSError as error:
        raise DatasetError(f"{parts}: cannot be made: {error.strerror}") from None
    with lock:
        _check_recipe(parts, recipe)
        yield parts


def _check_recipe(parts: Path, recipe: Recipe) -> None:
    path = parts / "recipe.json"
    if not path.exists():
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(dataclasses.asdict(recipe), indent=2))
        return
    content = parse(read_text(path, "recipe", DatasetError), f"{path}: remove the folder to begin anew", DatasetError)
    kinds = {name: type(value) for name, value in dataclasses.asdict(recipe).items()}
    if not isinstance(content, dict) or {name: type(value) for name, value in content.items()} != kinds:
        raise DatasetError(f"{path}: damaged; remove the folder to begin anew")
    differences = recipe.differences(Recipe(**content))
    if differences:
        raise DatasetError(
            f"{path}: the folder holds the beginning of another dataset ({differences}); run the command it was begun "
            "with, choose another --out, or remove the folder"
        )


def _parts(out: Path) -> Path:
    return out.with_name(out.name + ".parts")


def _part(parts: Path, block: Recipe) -> Path:
    return parts / f"from_{block.first:08d}.h5"


def _is_whole(path: Path, block: Recipe) -> bool:
    if not path.exists():
        return False
    try:
        with dataset_class(block.setup)(path) as part:
            part.columns(0, len(part))
            return part.recipe == block
    except DatasetError:
        return False


def _join(out: Path, recipe: Recipe, parts: list[Path]) -> None:
    needed = sum(part.stat().st_size for part in parts) + SPARE
    free = shutil.disk_usage(out.parent).free
    if free < needed:
        raise DatasetError(
            f"{out}: the disk has {free / 2**20:.0f} MiB left, {needed / 2**20:.0f} MiB are needed to join the blocks; "
            "free some space and run the same command again"
        )
    reader = dataset_class(recipe.setup)
    lengths = dict.fromkeys(reader.layout.measured_by, 0)
    for part in parts:
        with reader(part) as dataset:
            lengths = {name: length + int(dataset.offsets[name][-1]) for name, length in lengths.items()}

    def stretches() -> Iterator[Columns | LeverColumns]:
        for part in parts:
            with reader(part) as dataset:
                yield dataset.columns(0, len(dataset))

    reader.write(out, recipe, stretches(), lengths)
