"""Runs what pages show, from top to bottom, in one folder, as a reader would.

A block after a paragraph that ends "as `NAME`:" is saved under that name. Other Python blocks are typed into one
session, one after the other; of console blocks each line after `$` is a command, and what stands below it is what it
prints. What prints "Error: ..." ends with status 1, every other with 0. Other JSON are fields of the scene file that
was saved last, and must be valid there. Text holds neither. Nothing else is a valid block, so none can be overlooked.
"""

import contextlib
import io
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pushgraph.cli import main
from pushgraph.scene import Scene

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
MOST = {"--count": 4, "--samples": 2000}
"""What these options of a command say is lowered to this, where it would take long."""
FEW = {
    **{"--count": 1, "--objects": 2, "--samples": 640, "--scenes": 4, "--drives": 1, "--workers": 1, "--draws": 1},
    **{"--drawn": 2, "--repeats": 1, "--drags": 1, "--tables": 2, "--steps": 2, "--largest-batch": 1, "--sizes": 2},
    **{"--only": "lever-up", "--quick": "", "--variant": "messages-1-steps"},
}
"""The same for commands in the text, most of which name a measurement; there it is also said where nothing was."""
NOT_RUN = {
    r"make ([\w-]+)": "sets up an environment from the network, or trains for days: its recipe is read alone",
    r"pip install (--[\w-]+ )?'?[\w.]+(\[[\w,]+\])?'?": "tests/test_install.py installs into a new environment",
    r"pip wheel --no-deps \. \./baselines": "tests/test_install.py builds the wheels",
    r"\.venv/bin/python tests/golden/make\.py": "replaces the files that other tests compare with",
    r"python -m mujoco\.viewer": "opens a window",
}
"""Commands that are not run, and why."""
CODE = re.compile(r"^\s*(\$|import |from \w|def |pushgraph |pip |make |python |\.venv/)", re.M)


class Block(NamedTuple):
    """A block of a page. kind: what stands behind its fence, "indented" without one. name: of a file."""

    kind: str
    text: str
    line: int
    name: str | None


def blocks_of(page: Path) -> list[Block]:
    """Every fenced or indented block of a page."""
    found, lines, before, blank = [], iter(enumerate(page.read_text().splitlines(), 1)), "", True
    for number, line in lines:
        name = re.search(r"as `([\w.-]+)`(, [\w ]+)?:$", before)
        if line.lstrip().startswith("```"):
            text = "".join(f"{one}\n" for _, one in itertools.takewhile(lambda told: told[1].strip() != "```", lines))
            found.append(Block(line.strip("` "), text, number, name[1] if name else None))
        elif line.startswith("    ") and blank:
            found.append(Block("indented", line, number, None))
        blank = not line.strip()
        before = before if blank else line
    return found


def check_block(page: Path, block: Block) -> None:
    """Raise AssertionError if a block is of no kind that is run, saved or text."""
    where = f"{page.name}, line {block.line}"
    assert block.name or block.kind in ("console", "python", "json", "text"), f"{where}: a block of {block.kind!r}"
    assert block.kind != "text" or not CODE.search(block.text), f"{where}: code in a block of text"
    assert block.kind != "console" or block.text.startswith("$ "), f"{where}: no command after $"


def run_page(page: Path, folder: Path) -> dict[str, Any]:
    """Run every block; returns the names of the Python session."""
    session: dict[str, Any] = {"__name__": page.name}
    saved = ""
    for block in blocks_of(page):
        check_block(page, block)
        if block.name:
            (folder / block.name).write_text(block.text)
            saved = block.text
        elif block.kind == "python":
            with contextlib.chdir(folder):
                exec(compile("\n" * block.line + block.text, page.name, "exec"), session)
        elif block.kind == "console":
            for command, printed in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n?)*)", block.text, re.M):
                run(at_most(command), folder, printed)
        elif block.kind == "json":
            Scene.from_json(json.dumps(json.loads(saved) | json.loads(block.text)))
    return session


def at_most(command: str, most: Mapping[str, Any] = MOST) -> str:
    """The command with what it asks for lowered."""

    def lower(said: re.Match) -> str:
        return f"{said[1]} {min(int(said[2]), most[said[1]])}"

    return re.sub(rf"({'|'.join(most)}) (\d+)", lower, command)


def code_in_text(page: Path) -> list[str]:
    """What is written as code within the text of a page, outside of its blocks."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.M | re.S)
    spans = (span for paragraph in re.split(r"\n\s*\n", text) for span in re.findall(r"`([^`]+)`", paragraph))
    return [" ".join(span.split()) for span in spans]


def commands_in_text(page: Path) -> list[str]:
    """What of that begins like a command."""
    program = re.compile(r"(pushgraph|make|pip|python|\.venv/bin/\w+) |benchmarks/\w+\.py\b")
    return [span for span in code_in_text(page) if program.match(span)]


def run(command: str, folder: Path, printed: str = "") -> None:
    """Run a command in a folder; raise AssertionError if its status is another, or it does not print this."""
    reason = next((reason for pattern, reason in NOT_RUN.items() if re.fullmatch(pattern + r"( +#.*)?", command)), None)
    if reason is not None:
        return check_not_run(command)
    if re.match("pushgraph view(?!.*--save)", command):
        return serve(command, folder)
    if command.startswith("pushgraph ") and "--import" not in command and not re.search("[|<>&;]", command):
        status, told = in_this_process(shlex.split(command, comments=True)[1:], folder)
    else:
        done = subprocess.run(shell(command), cwd=folder, env=environment(), capture_output=True, text=True)
        status, told = done.returncode, done.stdout + done.stderr
    told = " ".join(told.split())
    assert status == printed.startswith("Error: "), f"{command}: {status}: {told}"
    for line in printed.splitlines():
        assert " ".join(line.split()) in told, f"{command}: {line!r} is not in {told!r}"


def in_this_process(arguments: list[str], folder: Path) -> tuple[int, str]:
    """Status and output of the command `pushgraph`, whose imports take seconds elsewhere."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told), contextlib.chdir(folder):
        try:
            main(arguments)
        except SystemExit as stop:
            return int(stop.code or 0), told.getvalue()
    return 0, told.getvalue()


def shell(command: str) -> list[str]:
    return ["bash", "-c", command.replace(".venv/bin/", f"{BIN}/")]


def environment() -> dict[str, str]:
    return os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}


def check_not_run(command: str) -> None:
    """What can be checked of a command that is not run."""
    words = shlex.split(command, comments=True)
    if words[0] == "make":
        subprocess.run(["make", "--dry-run", *words[1:]], cwd=ROOT, check=True, capture_output=True)
    if extras := re.search(r"pushgraph\[([\w,]+)\]", command):
        there = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert set(extras[1].split(",")) <= set(there), command


def serve(command: str, folder: Path) -> None:
    """Start a command that goes on until Ctrl-C, and press that once it tells its address."""
    command = f"exec {command}"
    with subprocess.Popen(shell(command), cwd=folder, env=environment(), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert any("http://" in line for line in process.stdout), command
        process.send_signal(signal.SIGINT)
    assert process.returncode == 0, command
