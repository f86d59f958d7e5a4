"""Files of tracks and recordings: sound ones, how they are read, what they state."""

import contextlib
import csv
import io
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from fuzz import Mutation, of_bytes, of_csv, of_hdf5
from fuzz_pool import Kind
from fuzz_statements import (
    NUMBER,
    agrees,
    as_tree,
    has_line,
    reseal,
    same_cells,
    strictly,
)
from test_damaged_recordings import SCENE, sound_file

from pushgraph.checksum import checksum_line
from pushgraph.lever_track import LeverTrack
from pushgraph.recording.files import read_sightings, save_sightings
from pushgraph.recording.recording import read_recording
from pushgraph.recording.sightings import COLUMNS as SIGHTED
from pushgraph.recording.sightings import ReadOptions
from pushgraph.simulation.lever_setup import draw_interaction
from pushgraph.spread import Spread
from pushgraph.track import Track


def long_rows(content: bytes) -> tuple[list[str], list[list[str]]]:
    encodings = ["utf-16"] if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        with contextlib.suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            break
    header, *rows = [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    return [name.strip() for name in header], rows


def read_track(path: Path) -> Any:
    track = Track.load(path, SCENE if path.suffix == ".csv" else None)
    arrays = {name: getattr(track, name) for name in ("times", "poses", "push", "seen", "wrench")}
    arrays |= {} if track.spread is None else track.spread._asdict()
    return {"scene": as_tree(track.scene)} | {
        name: None if values is None else (values.shape, np.asarray(values, dtype=float).tobytes())
        for name, values in arrays.items()
    }


def states_csv_track(content: bytes, loaded: Any) -> bool:
    """Every line is one pose of the track, in order, and the track has no other."""
    header, rows = long_rows(content)
    arrays = {
        name: np.frombuffer(loaded[name][1]).reshape(loaded[name][0]) for name in ("times", "poses", "push", "seen")
    }
    nodes, counted = ("robot", *SCENE.names), 0
    assert len(set(header)) == len(header)
    for row in rows:
        assert len(row) == len(header)
        cells = dict(zip(header, map(str.strip, row), strict=True))
        assert NUMBER.fullmatch(cells["time"])
        frame = int(np.flatnonzero(arrays["times"] == float(cells["time"]))[0])
        node = nodes.index(cells["node"])
        if not arrays["seen"][frame, node]:
            assert cells["x"] == cells["y"] == ""
            continue
        counted += 1
        assert same_cells([cells[c] for c in ("x", "y", "yaw")], arrays["poses"][frame, node].tolist())
        if node == 0:
            assert int(cells["push"]) == arrays["push"][frame]
    return counted == int(arrays["seen"].sum())


def states_h5_track(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        fields = [name for name in loaded if name != "scene" and loaded[name] is not None]
        for name in fields:
            array = file[name if name in file else f"spread/{name}"]
            assert not array.is_virtual
            assert not array.external
            if loaded[name] != (array.shape, np.asarray(array[()], dtype=float).tobytes()):
                return False
        assert ("wrench" in file) == (loaded["wrench"] is not None)
        assert [name.decode() for name in file["nodes"][()]] == ["robot", *SCENE.names]
        return agrees(strictly(file.attrs["scene"].encode()), loaded["scene"])


def make_h5_tracks(folder: Path, sealed: bool = True) -> list[Path]:
    times = np.arange(0, 1, 0.05)
    poses = np.zeros((len(times), 2, 3))
    poses[:, 0, 0], poses[:, 1] = 0.1 * times, (0.3, 0.2, 0.0)
    seen, push = np.ones((len(times), 2), dtype=bool), np.zeros(len(times), dtype=int)
    wrench = np.random.default_rng(0).normal(size=(len(times), 3))
    spread = Spread(*(np.full((len(times), 1), 2.0 + k) for k in range(len(Spread._fields))))
    Track(SCENE, times, poses, push, seen, wrench, spread).save(folder / "track.h5")
    if not sealed:
        unseal(folder / "track.h5")
    return [folder / "track.h5"]


def make_lever_track(folder: Path) -> list[Path]:
    draw_interaction(5, 0).track.save(folder / "lever.h5")
    return [folder / "lever.h5"]


def read_lever_track(path: Path) -> Any:
    track = LeverTrack.load(path)
    return {"scene": as_tree(track.scene), "poses": (track.poses.shape, np.asarray(track.poses, float).tobytes())}


def states_lever_track(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        poses = file["poses"]
        assert not poses.is_virtual
        assert not poses.external
        assert [name.decode() for name in file["nodes"][()]] == [
            "tool",
            *(b["name"] for b in loaded["scene"]["bodies"]),
        ]
        same = loaded["poses"] == (poses.shape, np.asarray(poses[()], dtype=float).tobytes())
        return same and agrees(strictly(file.attrs["scene"].encode()), loaded["scene"])


def read_sighted(path: Path) -> Any:
    """What stands in the recording, which must also do as a track, or be refused."""
    options = ReadOptions(episode=0)
    sightings = read_sightings(path, options)
    read_recording(path, SCENE, options=options).believed().at_frames()
    columns = {name: getattr(sightings, name).tolist() for name in SIGHTED}
    return {"names": list(sightings.names)} | {
        name: [None if isinstance(value, float) and math.isnan(value) else value for value in values]
        for name, values in columns.items()
    }


def states_sightings(content: bytes, loaded: Any) -> bool:
    header, rows = long_rows(content)
    cells = list(zip(*rows, strict=True))
    of_column = {name.lower(): list(cells[k]) for k, name in enumerate(header)}
    assert [loaded["names"][k] for k in loaded["node"]] == [name.strip() for name in of_column["node"]]
    lost = [""] * len(rows)
    return all(
        same_cells(of_column.get(name, lost), [math.nan if value is None else value for value in loaded[name]])
        for name in ("time", "x", "y", "yaw")
    )


def states_sighted_h5(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        return all(
            loaded[name] == [None if isinstance(v, float) and math.isnan(v) else v for v in file[name][()].tolist()]
            for name in ("time", "x", "y", "yaw", "node")
        )


def make_sightings(folder: Path) -> list[Path]:
    save_sightings(read_sightings(sound_file("csv", folder)), folder / "sightings.h5")
    return [folder / "sightings.h5"]


def unseal(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: -len(checksum_line(b""))])


def recording(name: str, file: str, mutations: Sequence[Mutation], states: Any = None) -> Kind:
    return Kind(name, lambda folder: [sound_file(file, folder)], read_sighted, mutations, states)


HDF5, CSV = (of_bytes, of_hdf5(reseal)), (of_bytes, of_csv, of_csv)
UNSEALED = partial(make_h5_tracks, sealed=False)
KINDS = [
    Kind("track CSV", lambda f: [sound_file("csv", f)], read_track, CSV, states_csv_track),
    Kind("track HDF5", make_h5_tracks, read_track, HDF5, states_h5_track, has_line),
    Kind("track HDF5, no checksum", UNSEALED, read_track, (of_bytes, of_hdf5()), states_h5_track),
    Kind("lever track", make_lever_track, read_lever_track, HDF5, states_lever_track, has_line),
    Kind("sightings HDF5", make_sightings, read_sighted, HDF5, states_sighted_h5, has_line),
    recording("recording CSV", "csv", CSV, states_sightings),
    recording("recording CSV, wide", "wide", (of_bytes, of_csv)),
    recording("recording of Motive", "motive", (of_bytes, of_csv)),
    recording("ROS bag", "bag", (of_bytes,)),
    recording("MCAP", "MCAP", (of_bytes,)),
    recording("ROS 2 SQLite", "SQLITE3", (of_bytes,)),
    recording("LeRobot parquet", "parquet", (of_bytes,)),
]
