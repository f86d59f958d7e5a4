"""HDF5: tracks as pushgraph writes them, and sightings as `pushgraph track` writes them without a scene."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pushgraph.errors import TrackError
from pushgraph.recording.sightings import COLUMNS, NO_PUSH, ReadOptions, Sightings
from pushgraph.stored_array import stored, stored_names
from pushgraph.track_hdf5 import FORMAT as TRACK
from pushgraph.wrench import COMPONENTS

SIGHTINGS = "pushgraph.sightings"


def read_hdf5(path: Path, options: ReadOptions) -> Sightings:
    """Read the poses of a track, or sightings; raises TrackError for any other file."""
    with h5py.File(path, "r") as file:
        kind = str(file.attrs.get("format"))
        if kind not in (TRACK, SIGHTINGS):
            raise TrackError(f"attribute 'format' must be {TRACK!r} or {SIGHTINGS!r}")
        if str(file.attrs.get("version")) != "1":
            raise TrackError(f"version {file.attrs.get('version')} of {kind}; this pushgraph reads 1")
        names = tuple(stored_names(file, "nodes"))
        return _of_track(file, names) if kind == TRACK else _of_sightings(file, names)


def _of_track(file: h5py.File, names: tuple[str, ...]) -> Sightings:
    times, poses, push = (np.asarray(stored(file, name)) for name in ("times", "poses", "push"))
    frames = len(times)
    if times.ndim != 1 or poses.shape != (frames, len(names), 3) or push.shape != (frames,):
        raise TrackError(f"times, poses, push: shapes {times.shape}, {poses.shape}, {push.shape} do not fit")
    x, y, yaw = poses.reshape(-1, 3).astype(float).T
    nothing = np.full(len(x), np.nan)
    times, push = np.repeat(times.astype(float), len(names)), np.repeat(push.astype(np.int64), len(names))
    node = np.tile(np.arange(len(names)), frames)
    scene = file.attrs.get("scene")
    if not isinstance(scene, str):
        raise TrackError("attribute 'scene' must be the scene as JSON")
    wrench = np.asarray(stored(file, "wrench")) if "wrench" in file else np.full((frames, 3), np.nan)
    if wrench.shape != (frames, 3) or wrench.dtype.kind not in "fiu":
        raise TrackError(f"wrench: must be numbers, {(frames, 3)}; got {wrench.dtype} {wrench.shape}")
    force_x, force_y, moment = np.repeat(wrench.astype(float), len(names), axis=0).T
    return Sightings(names, times, node, x, y, yaw, nothing, nothing, push, force_x, force_y, moment, scene=scene)


def _of_sightings(file: h5py.File, names: tuple[str, ...]) -> Sightings:
    columns: dict[str, Any] = {name: np.asarray(stored(file, name)) for name in COLUMNS if name in file}
    for name in set(COLUMNS) - set(COMPONENTS) - set(columns):
        raise TrackError(f"{name}: is missing")
    rows = len(columns["time"])
    columns = {name: np.full(rows, np.nan) for name in COMPONENTS} | columns
    for name, column in columns.items():
        whole = name in ("node", "push")
        if column.shape != (rows,) or column.dtype.kind not in ("iu" if whole else "fiu"):
            raise TrackError(f"{name}: must be {'whole ' * whole}numbers, one a row; got {column.dtype} {column.shape}")
        columns[name] = column.astype(np.int64 if whole else float)
    if ((columns["node"] < 0) | (columns["node"] >= len(names))).any():
        raise TrackError(f"node: must be 0 to {len(names) - 1}")
    return replace(Sightings(names, **columns), push=np.maximum(columns["push"], NO_PUSH))
