"""Tracks in HDF5, with a checksum of the file's bytes at its end.

The HDF5 library can hang or crash on damaged bytes: it reads a file here only if the checksum says that it is whole,
and one without a checksum in a process of its own, for which this module imports little.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from jaxtyping import Float

from pushgraph.checksum import is_intact
from pushgraph.errors import TrackError
from pushgraph.isolation import read_isolated
from pushgraph.storage import replacing_hdf5
from pushgraph.stored_array import stored, stored_names
from pushgraph.track_frames import Frames

FORMAT = "pushgraph.track"
VERSION = 1
_ARRAYS = {"times": ("f", 1), "poses": ("f", 3), "push": ("i", 1), "seen": ("b", 2), "wrench": ("f", 2)}
"""Kind of number and number of axes of each array."""
_UNITS = {"times": "s", "poses": "x (m), y (m), yaw (rad)", "wrench": "force (N), world; moment (N m)"}


class StoredTrack(NamedTuple):
    """What a file holds. scene: as JSON, or empty. nodes: their names. spread: arrays of a `Spread` by name."""

    scene: str
    nodes: tuple[str, ...]
    frames: Frames
    spread: Mapping[str, Float[np.ndarray, "frames bodies"]] | None


def save_hdf5(path: Path, track: StoredTrack, spread_units: Mapping[str, str]) -> None:
    """Write a track; the same track makes the same bytes."""
    with replacing_hdf5(path, checksum=True) as file:
        file.attrs.update(format=FORMAT, version=VERSION, scene=track.scene)
        file["nodes"] = list(track.nodes)
        for name, array in track.frames._asdict().items():
            if array is not None:
                file.create_dataset(name, data=array).attrs["unit"] = _UNITS.get(name, "")
        for name, array in (track.spread or {}).items():
            file.create_dataset(f"spread/{name}", data=array).attrs["unit"] = spread_units[name]


def load_hdf5(path: Path, spread_fields: Sequence[str]) -> StoredTrack:
    """Read a track; raises TrackError if the file holds none, or is damaged."""
    if not path.is_file():
        raise TrackError("cannot read this track: there is no such file")
    try:
        intact = is_intact(path)
        if intact is False:
            raise TrackError("cannot read this track: the file is damaged, its bytes are not those that were saved")
        found = contents(path, spread_fields) if intact else read_isolated(contents, path, spread_fields)
    except OSError as error:
        raise TrackError(f"cannot read this track: {error.strerror or error}") from None
    frames = Frames(**{name: found[name] for name in _ARRAYS if name in found})
    spread = {name: found[f"spread/{name}"] for name in spread_fields if f"spread/{name}" in found}
    return StoredTrack(found["scene"], tuple(found["nodes"]), frames, spread or None)


def contents(path: Path, spread_fields: Sequence[str]) -> dict[str, Any]:
    """Scene, nodes, and arrays by their names in the file."""
    with h5py.File(path, "r") as file:
        if str(file.attrs.get("format")) != FORMAT:
            raise TrackError(f"not a track: attribute 'format' must be {FORMAT!r}")
        if str(file.attrs.get("version")) != str(VERSION):
            raise TrackError(f"track version {file.attrs.get('version')}, this pushgraph reads {VERSION}")
        scene = file.attrs.get("scene")
        found: dict[str, Any] = {"scene": scene if isinstance(scene, str) else ""}
        found["nodes"] = stored_names(file, "nodes")
        for name, (kind, axes) in _ARRAYS.items():
            if name in file or name != "wrench":
                found[name] = _array(file, name, kind, axes)
        if "spread" in file:
            found |= {name: _array(file, name, "f", 2) for name in (f"spread/{field}" for field in spread_fields)}
    return found


def _array(file: h5py.File, name: str, kind: str, axes: int) -> np.ndarray:
    array = stored(file, name)
    if array.dtype.kind != kind or array.ndim != axes:
        raise TrackError(f"{name}: must be {axes}-dimensional of kind {kind!r}, got {array.dtype} of {array.shape}")
    return array
