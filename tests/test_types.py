"""Type checkers see the public names: they find what is wrong in a user's script, and nothing in the examples."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pushgraph

ROOT = Path(__file__).parents[1]
SCRIPT = '''"""Two boxes on a hinge, pushed."""

import numpy as np

import pushgraph as pg

box = pg.Body(
    name="box",
    shape=pg.Cuboid(size=(0.16, 0.08)),
    pose_world_from_body=(0.0, 0.0, 0.0),
    mas=0.3,  # planted
)
lid = pg.Body(
    name="lid", shape=pg.Cuboid(size=(0.16, 0.08)), pose_world_from_body=(0.175, 0.0, 0.0), mass=0.3
)
hinge = pg.Joint(kind="hinge", parent="box", child="lid")  # planted
push = pg.Push(start=(0.23, 0.12), end=(0.20, -0.08), speed="fast")  # planted
scene = pg.Scene(bodies=(box, lid), joints=(hinge,), pushes=3)  # planted
predictor = pg.load("contact")
track = predictor.predict(scene, pushes=[push], spread=True)
print(track.poses[-1].round(3))
print(np.hypot(*(track.poses[-1] - track.poses[0])[1:, :2].T))
pg.save_picture(track.final, "picture.png")  # planted
'''
PLANTED = [number for number, line in enumerate(SCRIPT.splitlines(), start=1) if line.endswith("# planted")]


def lines_of_errors(output: str, file: str) -> set[int]:
    return {int(line) for line in re.findall(rf"{re.escape(file)}:(\d+):(?:\d+ -)? error", output)}


def run(*command: str) -> str:
    environment = os.environ | {"MYPYPATH": str(ROOT / "src")}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True).stdout


def test_public_names_stand_in_one_list_and_the_package_is_typed() -> None:
    stub = (ROOT / "src" / "pushgraph" / "__init__.pyi").read_text()
    listed = re.findall(r"^from (\S+) import (\w+) as (\w+)$", stub, re.M)
    assert all(name == again for _, name, again in listed)
    assert {*pushgraph.__all__} == {name for _, name, _ in listed} | {"__version__"}
    assert len(listed) == stub.count("import ") - 1  # the docstring has one more
    for module, name, _ in listed:
        assert getattr(pushgraph, name) is getattr(importlib.import_module(module), name)
    assert (ROOT / "src" / "pushgraph" / "py.typed").exists()
    assert re.fullmatch(r"\d+\.\d+\.\d+.*", pushgraph.__version__)


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_planted_errors_are_found_and_none_in_the_examples(checker: str, tmp_path: Path) -> None:
    if importlib.util.find_spec(checker) is None:
        pytest.skip(f"{checker} is not installed")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert len(PLANTED) == 5
    settings = ("--pythonpath", sys.executable) if checker == "pyright" else ("--config-file", "pyproject.toml")
    printed = run(sys.executable, "-m", checker, *settings, str(script), "examples")
    found = lines_of_errors(printed, script.name)  # its folder may be that of an earlier run that is cached
    if checker == "mypy":  # it names the line on which a call begins
        found = {min(line for line in PLANTED if line >= one) for one in found}
    assert sorted(found) == PLANTED, printed
    assert printed.count("error") - printed.count("errors") == len(PLANTED), printed
