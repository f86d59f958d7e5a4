"""The setup and the network of docs/extending.md within the package: a file, and a line of a registry."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import ROOT, blocks_of

FILES = {block.name: block.text for block in blocks_of(ROOT / "docs" / "extending.md") if block.name}
ADDED = [
    ("ring.py", "simulation", "setups.py", "ring", "SETUPS: dict[str, Setup] = {\n"),
    ("along.py", "network", "dynamics.py", "AlongDynamics", "DYNAMICS: dict[str, type[PhysicsNetwork]] = {\n"),
]
COMMANDS = """\
generate ring --objects 3 --count 2 --seed 0 --workers 1 --out train.h5
train physics --model along --data train.h5 --validation train.h5 --samples 64 --processes 1 --out along.safetensors
evaluate physics --setup ring --objects 3 --count 1 --workers 1 --model along=along.safetensors --out measured
"""


@pytest.mark.slow
def test_what_is_added_to_the_package_is_a_file_and_a_line(tmp_path: Path) -> None:
    package = tmp_path / "package" / "pushgraph"
    shutil.copytree(ROOT / "src" / "pushgraph", package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, folder, registry, what, opening in ADDED:
        text, registered = re.subn(r"\n\npg\.register_\w+\(.*\)\n$", "", FILES[name])
        assert registered == 1
        (package / folder / name).write_text(text)
        lines = (package / folder / registry).read_text()
        assert lines.count(opening) == 1
        stem = name.removesuffix(".py")
        brought = f"from pushgraph.{folder}.{stem} import {what}\n\n{opening}    {stem!r}: {what},\n"
        (package / folder / registry).write_text(lines.replace(opening, brought))
    environment = os.environ | {"PYTHONPATH": str(package.parent)}
    for command in COMMANDS.splitlines():
        done = subprocess.run(
            [sys.executable, "-m", "pushgraph", *command.split()],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "measured" / "results.json").is_file()
