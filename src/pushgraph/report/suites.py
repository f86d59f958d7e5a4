"""Suites, run as a user would run them, or reused if the same command ran on the same code and weights before."""

import contextlib
import hashlib
import importlib.metadata
import json
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pushgraph import own_modules
from pushgraph.checkpoint import shipped
from pushgraph.errors import CheckpointError, ReportError
from pushgraph.network.registry import NETWORKS
from pushgraph.storage import replacing

MADE = "made.json"
"""Tells, in a suite's folder, what its results were made with."""


@dataclass(frozen=True)
class Origin:
    """What decides results: the command, and digests of the package's code and of the weights."""

    command: str
    code: str
    weights: dict[str, str]
    version: str

    @classmethod
    def of(cls, arguments: Sequence[str]) -> "Origin":
        """Of what this installation would make now."""
        command = shlex.join(("pushgraph", *arguments))
        return cls(command, digest_of_code(), hashes_of_weights(), importlib.metadata.version("pushgraph"))


@dataclass(frozen=True)
class Made:
    """The results of a suite. folder: where they are, with the suite's figures. seconds: what it took."""

    origin: Origin
    folder: Path
    seconds: float
    rows: list[dict[str, Any]]


def run_or_reuse(arguments: Sequence[str], folder: Path, output: Callable[[str], None] = lambda line: None) -> Made:
    """Run `pushgraph ...` with its results in `folder`, unless the same command left them there with the same code.

    output: takes what the command prints, line by line. Raises ReportError if the command fails.
    """
    origin = Origin.of(arguments)
    seconds = _seconds_of(folder / MADE, origin)
    if seconds is None:
        seconds = _run(arguments, folder, output)
        with replacing(folder / MADE) as temporary:
            temporary.write_text(json.dumps({"origin": asdict(origin), "seconds": seconds}, indent=1))
    rows = json.loads((folder / "results.json").read_text())["rows"]
    return Made(origin, folder, seconds, rows)


def _seconds_of(note: Path, origin: Origin) -> float | None:
    """What the results beside this note took to make; None if there are none of that origin."""
    try:
        made = json.loads(note.read_text())
        return float(made["seconds"]) if made["origin"] == asdict(origin) else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _run(arguments: Sequence[str], folder: Path, output: Callable[[str], None]) -> float:
    (folder / MADE).unlink(missing_ok=True)
    command = [sys.executable, "-m", "pushgraph", *arguments, "--out", str(folder)]
    begun, lines = time.monotonic(), []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        for line in process.stdout or ():
            lines.append(line)
            output(line.rstrip())
    if process.returncode:
        last = "".join(lines[-20:])
        raise ReportError(f"{shlex.join(('pushgraph', *arguments))}: ended with status {process.returncode}:\n{last}")
    return round(time.monotonic() - begun, 1)


def digest_of_code() -> str:
    """SHA-256 of all modules of the package, and of the user's own that are imported."""
    source = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(source.rglob("*.py")):
        digest.update(str(path.relative_to(source)).encode() + path.read_bytes())
    for file in own_modules.used():
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()[:16]


def hashes_of_weights() -> dict[str, str]:
    """SHA-256 of every checkpoint's file that is installed, by name; what is not installed is left out."""
    found = {}
    for name in sorted(NETWORKS):
        with contextlib.suppress(CheckpointError):
            found[name] = hashlib.sha256(shipped(name).read_bytes()).hexdigest()[:16]
    return found
