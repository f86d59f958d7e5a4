"""Compile functions, and keep the machine code for exactly these sources."""

import functools
import hashlib
import inspect
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from pushgraph.storage import cache_folder

_PACKAGE = Path(__file__).parents[2]
_SOURCES = ("graph/*.py", "network/**/*.py", "contact*.py", "track.py")
"""What compiled functions are made of, constants included: numba itself looks at one file alone."""


def compiled(function: Callable) -> Callable:
    """`numba.njit`: compiled when it is first called, and on this machine never again."""
    function = inspect.unwrap(function)  # without the checks of shapes that tests put around it
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, _folder()
    try:
        return numba.njit(function, cache=bool(config.CACHE_DIR), nogil=True)
    finally:
        config.CACHE_DIR = before


@functools.cache
def _folder() -> str:
    """Where machine code is kept, empty if that cannot be written."""
    files = sorted(path for pattern in _SOURCES for path in _PACKAGE.glob(pattern))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]
    folder = cache_folder() / "compiled" / digest
    if not folder.is_dir():
        logging.getLogger("pushgraph").warning("Compiling the contact solve, once on this machine: half a minute.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return ""
    return str(folder)
