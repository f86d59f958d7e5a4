"""The one folder that the page reads from and writes to: names are looked up in it, and nowhere else."""

import os
import re
import stat
from pathlib import Path

from pushgraph.errors import StorageError
from pushgraph.storage import size_of

MOST_BYTES = 64 * 2**20
"""Larger files are not read."""
SUFFIXES = (".json", ".h5", ".csv")
MOST_FILES = 500
"""So many files are listed, in the folder and in those right in it."""
MOST_SEEN = 20_000
"""So many entries are looked at."""
_NAME = re.compile(r"[\w. +()-]{1,100}")


class Folder:
    """A folder; raises StorageError if there is none at `path`."""

    def __init__(self, path: str | os.PathLike) -> None:
        try:
            self.path = Path(path).resolve(strict=True)
        except OSError as error:
            raise StorageError(f"{path}: cannot be opened as a folder: {error.strerror}") from None
        if not self.path.is_dir():
            raise StorageError(f"{path}: cannot be opened as a folder: it is a file")

    def files(self) -> list[str]:
        """Names of the files that may be read, in the folder and in those right in it."""
        found: list[str] = []
        looked_at = 0
        for folder, folders, names in os.walk(self.path):
            depth = len(Path(folder).relative_to(self.path).parts)
            folders[:] = sorted(name for name in folders if depth == 0 and not name.startswith("."))
            for name in sorted(names):
                looked_at += 1
                path = Path(folder, name)
                if path.suffix in SUFFIXES and not name.startswith(".") and not path.is_symlink():
                    found.append(str(path.relative_to(self.path)))
            if len(found) >= MOST_FILES or looked_at >= MOST_SEEN:
                break
        return found[:MOST_FILES]

    def to_read(self, name: str) -> Path:
        """The file of this name; raises StorageError if it is none that may be read."""
        path = self._inside(name)
        try:
            size = size_of(path)
        except OSError as error:
            raise StorageError(f"{name!r}: cannot be read: {error.strerror or error}") from None
        if size > MOST_BYTES:
            raise StorageError(f"{name!r}: cannot be read: it is larger than {MOST_BYTES >> 20} MiB")
        return path

    def to_write(self, name: str, suffix: str, replace: bool = False) -> Path:
        """Where a file of this name may be written, its suffix added if it has none; raises StorageError if nowhere.

        replace: whether it may stand in the place of another.
        """
        path = self._inside(name)
        if path.suffix.lower() not in SUFFIXES:
            path = path.with_name(path.name + suffix)
        if path.suffix.lower() != suffix:
            raise StorageError(f"{name!r}: cannot be written: its name must end in {suffix}")
        if not path.parent.is_dir():
            raise StorageError(f"{name!r}: cannot be written: there is no folder {path.parent.name!r}")
        if os.path.lexists(path) and not (replace and stat.S_ISREG(path.lstat().st_mode)):
            raise StorageError(f"{name!r}: cannot be written: it is there already; nothing was overwritten")
        return path

    def _inside(self, name: str) -> Path:
        """The path of a name, checked part by part: neither links, nor ways out, nor hidden files."""
        parts = name.replace("\\", "/").split("/") if isinstance(name, str) else []
        path = self.path
        for part in parts:
            if not _NAME.fullmatch(part) or part.startswith(".") or part != part.strip():
                raise StorageError(
                    f"{name!r}: no name of a file in this folder; valid: letters, digits and _ . + ( ) - and spaces, "
                    "in the folder itself or one of its own"
                )
            path = path / part
            if path.is_symlink():
                raise StorageError(f"{name!r}: links are not followed")
        if not parts or len(parts) > 8:
            raise StorageError(f"{name!r}: no name of a file in this folder")
        return path
