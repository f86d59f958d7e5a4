"""From a file to sightings, whatever its format; and from sightings to a file of our own."""

import csv
import math
from pathlib import Path

import h5py
import numpy as np

from pushgraph.errors import TrackError
from pushgraph.recording.binary import BINARY, read_binary
from pushgraph.recording.readers.csv_table import read_csv
from pushgraph.recording.readers.hdf5 import SIGHTINGS
from pushgraph.recording.readers.motive import is_motive, read_motive
from pushgraph.recording.readers.paper_json import is_paper_json, read_paper_json
from pushgraph.recording.sightings import COLUMNS, DEFAULTS, NO_PUSH, ReadOptions, Sightings
from pushgraph.storage import replacing, replacing_hdf5
from pushgraph.wrench import COMPONENTS

TEXT = (".csv", ".tsv", ".txt", ".json")
CSV_HEADER = ("time", "node", "x", "y", "yaw", "push")


def read_sightings(path: Path, options: ReadOptions = DEFAULTS) -> Sightings:
    """Read a recording; raises TrackError, which names the file, if it cannot be read or holds no poses."""
    try:
        if options.up not in (None, "x", "y", "z"):
            raise TrackError(f"up {options.up!r}; valid: x, y, z")
        if path.is_dir():
            return read_binary(path, options)
        suffix = path.suffix.lower()
        if not path.is_file():
            raise TrackError("there is no such file")
        if suffix in BINARY:
            return read_binary(path, options)
        if suffix not in TEXT:
            raise TrackError(f"unknown kind of file; valid: {', '.join((*TEXT, *BINARY))}, a folder of ROS 2")
        with path.open("rb") as file:
            start = file.read(64)
        if suffix == ".json" or is_paper_json(start):
            return read_paper_json(path, options)
        return (read_motive if is_motive(start) else read_csv)(path, options)
    except TrackError as error:
        raise TrackError(f"{path}: {error}") from None
    except OSError as error:
        raise TrackError(f"{path}: cannot be read: {error.strerror or error}") from None


def save_sightings(sightings: Sightings, path: Path) -> None:
    """Write sightings in m, rad and s, as HDF5 or CSV by the file's name; `read_sightings` reads both."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        with replacing_hdf5(path, checksum=True) as file:
            file.attrs.update(format=SIGHTINGS, version=1)
            file.create_dataset("nodes", data=list(sightings.names), dtype=h5py.string_dtype())
            for name in COLUMNS:
                file[name] = getattr(sightings, name)
        return
    if path.suffix.lower() != ".csv":
        raise TrackError(f"{path}: cannot be written; valid endings: .h5, .csv")
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        measured = np.isfinite(sightings.wrench).any()
        header = CSV_HEADER + COMPONENTS if measured else CSV_HEADER
        writer.writerow(header)
        columns = [getattr(sightings, name).tolist() for name in header]
        for time, node, x, y, yaw, push, *wrench in zip(*columns, strict=True):
            pushing = math.nan if push == NO_PUSH else push
            numbers = ["" if math.isnan(value) else value for value in (x, y, yaw, pushing, *wrench)]
            writer.writerow((time, sightings.names[node], *numbers))
