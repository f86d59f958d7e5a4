"""Files that are either whole or not there: written under a temporary name, then renamed."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import h5py

from pushgraph.checksum import checksum_line
from pushgraph.errors import StorageError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any error.

    Raises StorageError if the system refuses, with a full disk for instance; `path` is then as it was.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.stem}.partial{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(target)
    except OSError as error:
        raise StorageError(f"{target}: cannot be written: {error.strerror or error}; nothing was overwritten") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_hdf5(path: str | os.PathLike, checksum: bool = False) -> Iterator[h5py.File]:
    """Yield a new HDF5 file that becomes `path` on success; see `replacing`.

    checksum: whether the file ends with one; see `is_intact`. It is made in memory, because the HDF5 library crashes
    the process if the disk is full when it closes a file.
    """
    with h5py.File("in memory", "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with replacing(path) as temporary:
        temporary.write_bytes(image + checksum_line(image) if checksum else image)


def cache_folder() -> Path:
    """Where data and running trainings are kept outside of work trees: PUSHGRAPH_CACHE, or the user's cache folder."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(os.environ.get("PUSHGRAPH_CACHE") or base / "pushgraph")
