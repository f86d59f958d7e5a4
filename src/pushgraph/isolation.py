"""Binary files from outside are read in a process of their own, with bounds on its memory and time.

Their libraries trust what a file declares: a damaged one may crash them, or make them allocate and search without end.
"""

import importlib
import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pushgraph.errors import PushGraphError, TrackError

MEMORY, MEMORY_PER_BYTE = 700_000_000, 20
"""Bytes that reading may allocate, and more for each byte of the file."""
PATIENCE, PATIENCE_PER_BYTE = 15.0, 1e-6
"""Seconds that reading may take, and more for each byte of the file."""
REFUSED = 3
"""Exit status of a reader that says why it does not read the file."""

Reader = Callable[..., dict[str, Any]]
"""A function of a module, of a path and what JSON can hold; returns named arrays, and what JSON can hold."""


def read_isolated(reader: Reader, path: Path, *arguments: Any) -> dict[str, Any]:
    """What the reader reads; raises TrackError if it refuses, crashes, or takes more memory or time than it may."""
    size = sum(part.stat().st_size for part in ([path] if path.is_file() else path.rglob("*")) if part.is_file())
    job = [reader.__module__, reader.__name__, str(path), arguments, MEMORY + MEMORY_PER_BYTE * size]
    command = [sys.executable, "-m", __name__, json.dumps(job)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PATIENCE + PATIENCE_PER_BYTE * size)
    except subprocess.TimeoutExpired as error:
        raise TrackError(f"reading was given up after {error.timeout:.0f} s: the file is damaged") from None
    if done.returncode == REFUSED:
        raise TrackError(done.stderr.decode(errors="replace").strip())
    if done.returncode:
        raise TrackError(f"the file is damaged: its library failed{_last_words(done)}")
    return _unpacked(done.stdout)


def _last_words(done: subprocess.CompletedProcess) -> str:
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    if done.returncode < 0:
        return f" with signal {-done.returncode}"
    return f": {lines[-1][:300]}" if lines else ""


def _packed(found: dict[str, Any]) -> bytes:
    memory = io.BytesIO()
    arrays: dict[str, Any] = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    rest = {name: value for name, value in found.items() if name not in arrays}
    np.savez(memory, json=np.array(json.dumps(rest)), **arrays)
    return memory.getvalue()


def _unpacked(content: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        found = dict(arrays)
    return json.loads(str(found.pop("json"))) | found


def _bound_memory(most: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has no such bounds
        return
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _main(job: str) -> None:
    module, name, path, arguments, memory = json.loads(job)
    _bound_memory(memory)
    try:
        content = _packed(getattr(importlib.import_module(module), name)(Path(path), *arguments))
    except PushGraphError as error:
        message = str(error)
    except MemoryError:
        message = "the file is damaged: reading it takes more memory than its size explains"
    except Exception as error:  # whatever the library meets in a damaged file
        message = f"cannot be read, it may be damaged: {str(error) or type(error).__name__}"[:1000]
    else:
        sys.stdout.buffer.write(content)
        return
    sys.stderr.write(message)
    sys.exit(REFUSED)


if __name__ == "__main__":
    _main(sys.argv[1])
