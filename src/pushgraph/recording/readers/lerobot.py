"""Parquet files of LeRobot data sets: columns, and vectors with names from `meta/info.json`, through `pyarrow`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pushgraph.errors import TrackError
from pushgraph.extras import extra
from pushgraph.recording.readers.wide_table import columns_of_wrench, coordinates_of_nodes, sightings_of_table
from pushgraph.recording.sightings import Declared, ReadOptions, Sightings

LONGEST_VECTOR = 4096


def read_parquet(path: Path, options: ReadOptions) -> Sightings:
    """Read one episode; raises TrackError if the file holds several and none is chosen."""
    with extra("lerobot", "reading parquet files"):
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    try:
        file = parquet.ParquetFile(path)
        plain = [f.name for f in file.schema_arrow if _holds_numbers(f.type, arrow)]
        table = file.read(columns=plain)
    except (arrow.ArrowException, OSError) as error:
        raise TrackError(f"no parquet file: {error}") from None
    if "episode_index" in plain:
        table = _episode(table, options.episode)
    names: list[str] = []
    columns: list[np.ndarray] = []
    for name in plain:
        values = _matrix(table[name], name)
        names += _names_of(name, values.shape[1], path)
        columns += list(values.T)
    time = next((k for k, name in enumerate(names) if name in ("timestamp", "time", "t")), None)
    if time is None:
        raise TrackError(f"no column 'timestamp'; columns: {', '.join(names)[:500]}")
    nodes = coordinates_of_nodes(names)
    if not nodes:
        raise TrackError(f"no columns such as cup_x, cup_y, cup_yaw; columns: {', '.join(names)[:500]}")
    push = columns[names.index("push")].astype(int).tolist() if "push" in names else None
    wrench = columns_of_wrench(names)
    return sightings_of_table(nodes, wrench, columns[time], np.stack(columns, -1), push, Declared(), options)


def _holds_numbers(kind: Any, arrow: Any) -> bool:
    types = arrow.types
    if types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind):
        kind = kind.value_type
    return types.is_integer(kind) or types.is_floating(kind)


def _episode(table: Any, wanted: int | None) -> Any:
    of_row = table["episode_index"].to_pylist()
    episodes = sorted(set(of_row))
    if wanted is None and len(episodes) > 1:
        raise TrackError(f"holds episodes {episodes[0]} to {episodes[-1]}; choose one with --episode")
    wanted = episodes[0] if wanted is None and episodes else wanted
    if wanted not in episodes:
        raise TrackError(f"no episode {wanted}; valid: {', '.join(map(str, episodes[:20]))}")
    return table.take([row for row, episode in enumerate(of_row) if episode == wanted])


def _matrix(column: Any, name: str) -> np.ndarray:
    """Values of a column, [lines, 1], or [lines, length] if it holds vectors of one length."""
    rows = column.to_pylist()
    lengths = {len(row) for row in rows if isinstance(row, list)}
    if not lengths:
        return np.array([np.nan if row is None else row for row in rows], dtype=float).reshape(-1, 1)
    if len(lengths) > 1 or max(lengths) > LONGEST_VECTOR:
        raise TrackError(f"column {name!r}: its vectors must all have one length, at most {LONGEST_VECTOR}")
    (length,) = lengths
    return np.array([[np.nan] * length if row is None else row for row in rows], dtype=float).reshape(-1, length)


def _names_of(column: str, length: int, path: Path) -> Sequence[str]:
    """Names of a vector's entries as the data set's `meta/info.json` has them, or their numbers."""
    if length == 1:
        return [column]
    for folder in path.parents[:4]:
        info = folder / "meta" / "info.json"
        if info.is_file():
            try:
                names = json.loads(info.read_text(encoding="utf-8"))["features"][column]["names"]
            except (OSError, ValueError, KeyError, TypeError):
                break
            while isinstance(names, dict):  # some sets say which axis it is: {"motors": [...]}
                names = next(iter(names.values()), None)
            if isinstance(names, list) and len(names) == length:
                return [str(name) for name in names]
    return [f"{column}[{k}]" for k in range(length)]
