"""The examples run as they stand."""

import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import ROOT, environment

LONG = ("05_push_to_a_goal_by_gradient", "07_weigh_by_pushing", "09_own_network", "10_own_setup")
EXAMPLES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG))
    for path in sorted((ROOT / "examples").glob("*.py"))
]


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_examples_run_and_are_short(example: Path, tmp_path: Path) -> None:
    assert len(example.read_text().splitlines()) < 80
    command = [sys.executable, example]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout
