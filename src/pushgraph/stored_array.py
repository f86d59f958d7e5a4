"""Arrays of HDF5 files that anyone may have made: read only what stands in the file itself."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pushgraph.errors import TrackError

ROWS = 16384
"""Rows of a piece."""
STRONGEST_COMPRESSION = 1100
"""No filter of HDF5 packs more bytes than this into one: gzip manages 1032."""


def stored(file: h5py.File, name: str) -> np.ndarray:
    """Read an array; raises TrackError if it points elsewhere or claims more than the file can hold."""
    return np.asarray(stored_here(file, name)[()])


def stored_names(file: h5py.File, name: str) -> list[str]:
    """Read a row of names; raises as `stored`."""
    names = stored(file, name)
    if names.ndim != 1 or not all(isinstance(one, bytes) for one in names.tolist()):
        raise TrackError(f"{name}: must be a row of names, got {names.dtype} of {names.shape}")
    try:
        return [one.decode() for one in names.tolist()]
    except UnicodeDecodeError as error:
        raise TrackError(f"{name}: must be text in UTF-8, got {error.object!r}") from None


def stored_here(file: h5py.File, name: str) -> h5py.Dataset:
    """An array that was not read yet; raises as `stored`.

    Virtual and external arrays may lead anywhere, even to themselves, and a declared size costs its author nothing.
    """
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        raise TrackError(f"{name}: missing, or a link; the array must stand in this file itself")
    array = file[name]
    if not isinstance(array, h5py.Dataset) or array.shape is None:
        raise TrackError(f"{name}: must be an array")
    if array.is_virtual or array.external:
        raise TrackError(f"{name}: its values stand in another array or file; copy them into this one")
    if array.nbytes > STRONGEST_COMPRESSION * max(array.id.get_storage_size(), 1):
        raise TrackError(f"{name}: claims {array.nbytes} bytes, which the file does not hold")
    return array


def read_through(path: Path, format: str, *names: str) -> dict[str, Any]:
    """Read arrays of a file of a format piece by piece and keep nothing, to see whether it can be done.

    For `read_isolated`: what can be read there can be read here.
    """
    with h5py.File(path, "r") as file:
        if str(file.attrs.get("format")) != format:
            raise TrackError(f"not a dataset: attribute 'format' must be {format!r}")
        for name in names:
            array = stored_here(file, name)
            for first in range(0, len(array), ROWS):
                array[first : first + ROWS]
    return {}
