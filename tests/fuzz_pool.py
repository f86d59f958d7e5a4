"""Mutated files read in a process with bounds: tracebacks, crashes, hangs and memory without end are counted."""

import contextlib
import json
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import jaxtyping
from fuzz import Mutation

from pushgraph import isolation
from pushgraph.errors import PushGraphError

MOST_SECONDS, MOST_BYTES = 20.0, 1_000_000_000
REFUSED, SAME, STATED = "refused", "same content", "other content, as the file states"
SILENT, UNCLEAR, TRACEBACK = "silent", "unclear message", "traceback"
HANG, CRASH, MEMORY = "hang", "crash", "out of memory"
OUTCOMES = (REFUSED, SAME, STATED, SILENT, UNCLEAR, TRACEBACK, HANG, CRASH, MEMORY)
FAILURES = OUTCOMES[3:]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    make: writes sound files into a folder. read: the content of one, to be compared. states: whether the content is
    what a file of these bytes states, as another way of reading it finds; None: nothing is known to compare with.
    sealed: whether these bytes bear a checksum; one that is not made anew must not let changed content pass.
    """

    name: str
    make: Callable[[Path], Sequence[Path]]
    read: Callable[[Path], Any]
    mutations: Sequence[Mutation]
    states: Callable[[bytes, Any], bool] | None = None
    sealed: Callable[[bytes], bool] = lambda content: False


@dataclass
class Found:
    """What became of the mutations. faults: outcome and what is known of it, by number."""

    count: Counter[str] = field(default_factory=Counter)
    faults: dict[int, tuple[str, str]] = field(default_factory=dict)
    slowest: float = 0.0


def attack(kind: Kind, count: int, seed: int, first: int = 0) -> Found:
    """Read so many mutations of a kind of file, one after the other."""
    found, context = Found(), multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as folder:
        sound = list(kind.make(Path(folder)))
        begun = first
        while begun < first + count:
            mine, theirs = context.Pipe(duplex=False)
            child = context.Process(target=_read_all, args=(theirs, kind, sound, range(begun, first + count), seed))
            child.start()
            theirs.close()
            for index in range(begun, first + count):
                outcome, what, seconds = _answer(mine, child)
                found.count[outcome] += 1
                found.slowest = max(found.slowest, seconds)
                if outcome in FAILURES:
                    found.faults[index] = outcome, what
                begun = index + 1
                if outcome in (HANG, CRASH):
                    break
            mine.close()
            child.kill()
            child.join()
    return found


def mutated(kind: Kind, sound: Path, index: int, seed: int) -> tuple[bytes, bool]:
    """The bytes of one mutation, and whether they were changed without regard to what they mean."""
    rng = Random(f"{kind.name} {seed} {index}")
    mutation = kind.mutations[index % len(kind.mutations)]
    return mutation(sound.read_bytes(), rng), index % len(kind.mutations) == 0


def _answer(pipe: Connection, child: Any) -> tuple[str, str, float]:
    began = time.monotonic()
    try:
        if pipe.poll(MOST_SECONDS + 5):
            return pipe.recv()
    except EOFError:
        child.join()
        killed = child.exitcode == -signal.SIGKILL
        return MEMORY if killed else CRASH, f"exit status {child.exitcode}", time.monotonic() - began
    return HANG, f"over {MOST_SECONDS:g} s", time.monotonic() - began


def run_forked(command: Sequence[str], capture_output: bool, timeout: float) -> subprocess.CompletedProcess:
    """Stands for `subprocess.run` of an isolated reader: the same reader in a fork, which begins at once."""
    job = json.loads(command[-1])
    job[-1] += _status_bytes("VmData")
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            status = 1
            try:
                os.dup2(out.fileno(), 1), os.dup2(err.fileno(), 2)
                sys.stdout, sys.stderr = (os.fdopen(fd, "w", closefd=False) for fd in (1, 2))
                isolation._main(json.dumps(job))
                status = 0
            except SystemExit as end:
                status = int(end.code or 0)
            finally:
                sys.stdout.flush(), sys.stderr.flush()
                os._exit(status)
        until = time.monotonic() + timeout
        while not (ended := os.waitpid(child, os.WNOHANG))[0]:
            if time.monotonic() > until:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                raise subprocess.TimeoutExpired(command, timeout)
            time.sleep(0.001)
        out.seek(0), err.seek(0)
        status = os.waitstatus_to_exitcode(ended[1])
        return subprocess.CompletedProcess(command, status, out.read(), err.read())


def _read_all(pipe: Connection, kind: Kind, sound: Sequence[Path], indices: range, seed: int) -> None:
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1), os.dup2(nothing.fileno(), 2)
    most = _status_bytes("VmData") + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    isolation.subprocess.run = run_forked  # type: ignore[assignment]
    # Shapes are checked by the package itself, too, in words for its users: those are what is tried here.
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        whole = [kind.read(path) for path in sound]
    except Exception:
        pipe.send((TRACEBACK, "the sound file: " + traceback.format_exc(limit=-3), 0.0))
        os._exit(1)
    for index in indices:
        original = sound[index % len(sound)]
        content, blind = mutated(kind, original, index, seed)
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(original.parent, folder, dirs_exist_ok=True)
            path = Path(folder) / original.name
            path.write_bytes(content)
            began = time.monotonic()
            answer = _outcome(kind, path, content, blind, whole[index % len(sound)])
            outcome, what = answer
            pipe.send((outcome, what.encode("ascii", "backslashreplace").decode(), time.monotonic() - began))
    os._exit(0)


def _outcome(kind: Kind, path: Path, content: bytes, blind: bool, whole: Any) -> tuple[str, str]:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    held, began = _status_bytes("VmRSS"), time.monotonic()
    try:
        loaded = kind.read(path)
    except PushGraphError as error:
        named = str(path) in str(error) or str(path.parent) in str(error)
        clear = named and len(str(error)) > len(str(path)) + 8
        answer = (REFUSED, str(error)) if clear else (UNCLEAR, f"{type(error).__name__}: {error}")
    except MemoryError:
        return MEMORY, traceback.format_exc(limit=-3)
    except (Exception, SystemExit) as error:
        outcome = MEMORY if "allocate memory" in str(error) else TRACEBACK
        return outcome, traceback.format_exc(limit=-3)
    else:
        answer = _judged(kind, content, blind, loaded, whole)
    if _status_bytes("VmHWM") - held > MOST_BYTES:
        return MEMORY, "more than allowed"
    if time.monotonic() - began > MOST_SECONDS:
        return HANG, f"over {MOST_SECONDS:g} s"
    return answer


def _judged(kind: Kind, content: bytes, blind: bool, loaded: Any, whole: Any) -> tuple[str, str]:
    if loaded == whole:
        return SAME, ""
    if blind and kind.sealed(content):
        return SILENT, "other content in spite of its checksum"
    if kind.states is None:
        return STATED, "not compared"
    try:
        stated = kind.states(content, loaded)
    except Exception as error:
        return SILENT, f"it loads, but says nothing that makes sense: {error!r}"
    return (STATED, "") if stated else (SILENT, "it loads as something else than it states")


def _status_bytes(name: str) -> int:
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(name + ":")]
    return 1024 * int(line.split()[1])
