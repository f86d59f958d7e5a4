"""Results that are kept to be used again: with what they stand for, and a checksum; anything else is made anew."""

import hashlib
import importlib.metadata
import io
import logging
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pushgraph.checksum import checksum_line, is_intact
from pushgraph.storage import replacing

_STANDS_FOR = "stands_for"


def fingerprint(*content: object) -> str:
    """What results stand for, told by its digest: content, which need only be told apart, and versions of what computes
    them."""
    digest = hashlib.sha256()
    versions = [importlib.metadata.version(name) for name in ("pushgraph", "mujoco", "numpy", "torch")]
    for one in (*versions, *content):
        octets = one.tobytes() if isinstance(one, np.ndarray) else repr(one).encode()
        digest.update(hashlib.sha256(octets).digest())
    return digest.hexdigest()


def keep(path: Path, stands_for: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name, with the fingerprint of what they stand for."""
    memory = io.BytesIO()
    # `allow_pickle` by name, for names of arrays are no settings.
    np.savez(memory, allow_pickle=False, **{_STANDS_FOR: np.array(stands_for), **arrays})
    content = memory.getvalue()
    with replacing(path) as temporary:
        temporary.write_bytes(content + checksum_line(content))


def kept(path: Path, stands_for: str) -> dict[str, np.ndarray] | None:
    """What was kept for exactly this; None, with a word if something else lies there, if it has to be made."""
    if not path.exists():
        return None
    try:
        if is_intact(path):
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            if str(arrays.pop(_STANDS_FOR, "")) == stands_for:
                return arrays
            fault = "stands for something else"
        else:
            fault = "is damaged, or of a former version"
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        fault = f"cannot be read ({error})"
    logging.getLogger("pushgraph").warning("%s: %s; it is made anew", path, fault)
    return None
