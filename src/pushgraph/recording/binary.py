"""Sightings of binary files, read in a process of their own; this module imports little, so that it starts quickly."""

from pathlib import Path
from typing import Any

from pushgraph.checksum import is_intact
from pushgraph.errors import TrackError
from pushgraph.isolation import read_isolated
from pushgraph.recording.readers.bags import read_bag
from pushgraph.recording.readers.hdf5 import read_hdf5
from pushgraph.recording.readers.lerobot import read_parquet
from pushgraph.recording.sightings import Declared, ReadOptions, Sightings

BINARY = {
    **dict.fromkeys((".h5", ".hdf5"), read_hdf5),
    **dict.fromkeys((".bag", ".mcap", ".db3"), read_bag),
    ".parquet": read_parquet,
}


def read_binary(path: Path, options: ReadOptions) -> Sightings:
    """Read a file of such a kind, or a folder of ROS 2; raises TrackError if it cannot be read."""
    if path.suffix.lower() in (".h5", ".hdf5") and is_intact(path) is False:
        raise TrackError("the file is damaged, its bytes are not those that were saved")
    fields = read_isolated(fields_of_binary, path, *options)
    names, declared, remarks = (fields.pop(name) for name in ("names", "declared", "remarks"))
    return Sightings(tuple(names), **fields, declared=Declared(*declared), remarks=tuple(remarks))


def fields_of_binary(path: Path, up: str | None, episode: int | None) -> dict[str, Any]:
    """Fields of its sightings."""
    reader = read_bag if path.is_dir() else BINARY[path.suffix.lower()]
    return dict(vars(reader(path, ReadOptions(up, episode))))
