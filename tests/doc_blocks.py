"""Runs the blocks of a page, in order, in one folder, as a reader would.

A block after a paragraph that ends "as `NAME`:" is saved under that name. Others of Python run as scripts; of console,
each line after `$` is a command, and what stands below it is what it prints. What prints "Error: ..." ends with
status 1, every other with 0.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

BIN = Path(sys.executable).parent
BLOCK = re.compile(r"(?P<before>[^\n]*)\n\n```(?P<kind>\w+)\n(?P<text>.*?)```", re.S)


def run_page(page: Path, folder: Path) -> int:
    """Run every block; returns how many commands and scripts were run."""
    count = 0
    for block in BLOCK.finditer(page.read_text()):
        name = re.search(r"as `([\w.-]+)`(, [\w ]+)?:$", block["before"])
        if name:
            (folder / name[1]).write_text(block["text"])
        elif block["kind"] == "python":
            run([sys.executable, "-c", block["text"]], folder)
            count += 1
        elif block["kind"] == "console":
            for command, printed in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n?)*)", block["text"], re.M):
                run(["bash", "-c", command], folder, printed)
                count += 1
        else:
            raise AssertionError(f"{page.name}: a block of {block['kind']} that is neither saved nor run")
    return count


def run(command: list[str], folder: Path, printed: str = "") -> None:
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    told = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == printed.startswith("Error: "), f"{command[-1]}: {done.returncode}: {told}"
    for line in printed.splitlines():
        assert " ".join(line.split()) in told, f"{command[-1]}: {line!r} is not in {told!r}"
