"""Files that are either whole or not there: written under a temporary name, then renamed."""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import h5py
import platformdirs

from pushgraph.checksum import checksum_line
from pushgraph.errors import StorageError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any error.

    Raises StorageError if the system refuses, with a full disk for instance, or if `path` is something else than a
    plain file, such as a device or a folder; it is then as it was.
    """
    target = Path(path)
    check_replaceable(target)
    temporary = target.with_name(f".{target.stem}.partial{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("r+b") as written:  # Windows flushes only what may be written
            os.fsync(written.fileno())
        temporary.replace(target)
    except OSError as error:
        raise StorageError(f"{target}: cannot be written: {error.strerror or error}; nothing was overwritten") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_replaceable(path: str | os.PathLike) -> None:
    """Raise StorageError if something else than a plain file stands at a path."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # nothing stands there, or it will be refused by name where it is written
        return
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no plain file"
        raise StorageError(f"{path}: cannot be written: it is {kind}; nothing was overwritten")


def read_plain(path: Path, most: int) -> bytes:
    """The bytes of a plain file of no more than `most`; raises OSError for anything else, which may never end."""
    if size_of(path) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB")
    return path.read_bytes()


def size_of(path: Path) -> int:
    """Bytes of a plain file; raises OSError for anything else."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is a folder" if stat.S_ISDIR(status.st_mode) else "it is no plain file")
    return status.st_size


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
    return Path(os.environ.get("PUSHGRAPH_CACHE") or platformdirs.user_cache_path("pushgraph", appauthor=False))
