"""Arrays of HDF5 files that anyone may have made: read only what stands in the file itself."""

import h5py
import numpy as np

from pushgraph.errors import TrackError

STRONGEST_COMPRESSION = 1100
"""No filter of HDF5 packs more bytes than this into one: gzip manages 1032."""


def stored(file: h5py.File, name: str) -> np.ndarray:
    """Read an array; raises TrackError if it points elsewhere or claims more than the file can hold.

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
    return np.asarray(array[()])
