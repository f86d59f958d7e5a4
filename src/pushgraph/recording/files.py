"""From a file to sightings, whatever its format."""

from pathlib import Path

from pushgraph.errors import TrackError
from pushgraph.recording.isolation import read_isolated
from pushgraph.recording.readers.bags import read_bag
from pushgraph.recording.readers.csv_table import read_csv
from pushgraph.recording.readers.hdf5 import read_hdf5
from pushgraph.recording.readers.lerobot import read_parquet
from pushgraph.recording.readers.motive import is_motive, read_motive
from pushgraph.recording.sightings import DEFAULTS, ReadOptions, Sightings

BINARY = {
    **dict.fromkeys((".h5", ".hdf5"), read_hdf5),
    **dict.fromkeys((".bag", ".mcap", ".db3"), read_bag),
    ".parquet": read_parquet,
}
TEXT = (".csv", ".tsv", ".txt")


def read_sightings(path: Path, options: ReadOptions = DEFAULTS) -> Sightings:
    """Read a recording; raises TrackError, which names the file, if it cannot be read or holds no poses."""
    try:
        if options.up not in (None, "x", "y", "z"):
            raise TrackError(f"up {options.up!r}; valid: x, y, z")
        if path.is_dir():
            return read_isolated(read_bag, path, options)
        suffix = path.suffix.lower()
        if not path.is_file():
            raise TrackError("there is no such file")
        if suffix in BINARY:
            return read_isolated(BINARY[suffix], path, options)
        if suffix not in TEXT:
            raise TrackError(f"unknown kind of file; valid: {', '.join((*TEXT, *BINARY))}, a folder of ROS 2")
        with path.open("rb") as file:
            motive = is_motive(file.read(64))
        return (read_motive if motive else read_csv)(path, options)
    except TrackError as error:
        raise TrackError(f"{path}: {error}") from None
    except OSError as error:
        raise TrackError(f"{path}: cannot be read: {error.strerror or error}") from None
