"""What the README and the examples say is run as it stands."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import run_page

import pushgraph as pg
from pushgraph.planning.tools import TOOLS, load_tool
from pushgraph.scene import Scene
from pushgraph.shape import Polygon
from pushgraph.simulation.planar import simulate

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
BIN = Path(sys.executable).parent


def run(command: list[str], folder: Path) -> str:
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_readme_s_python_runs_as_printed_and_swings_the_lid(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    assert len(code.strip().splitlines()) <= 12
    printed = run([sys.executable, "-c", code], tmp_path)
    rows = [[float(n) for n in re.findall(r"-?\d+\.\d*|-?\d+\.?", line)] for line in printed.strip().splitlines()]
    assert len(rows) == 3
    assert rows[2][2] - rows[1][2] < -0.5
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.mark.parametrize("block", re.findall(r"```console\n(.*?)```", README, re.S))
def test_the_readme_s_commands_run_as_printed(block: str, tmp_path: Path) -> None:
    for command in re.findall(r"^\$ (pushgraph .*)$", block, re.M):
        run(command.split(), tmp_path)
        check_output(command, tmp_path / command.split("--out ")[1].split()[0])


def check_output(command: str, out: Path) -> None:
    assert out.exists()
    if command.split()[1] in ("simulate", "predict"):
        wanted = {"track.h5", "track.csv", "picture.png"} | ({"animation.gif"} if "none" not in command else set())
        assert {path.name for path in out.iterdir()} == wanted
    if command.split()[1] == "observe":
        assert {path.name for path in out.iterdir()} == {"beliefs.json", "beliefs.png", "scene.json"}
    if command.split()[1] == "plan":
        wanted = {"plan.json", "expected.h5", "executed.h5", "picture.png", "animation.gif"}
        assert {path.name for path in out.iterdir()} == wanted
    if command.split()[1] == "evaluate":
        content = json.loads((out / "results.json").read_text())
        assert (content["suite"], content["protocol"]["seed"]) == ("physics", 1_000_000)
        assert {row["model"] for row in content["rows"]} == {"still", "image", "propnet", "contact", "noise_floor"}
        assert (out / "histogram.png").stat().st_size > 10_000


@pytest.mark.slow
def test_the_viewer_s_manual_runs_as_printed(tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="the extra [viewer] is not installed")
    for command in re.findall(r"^\$ (pushgraph .*)$", (ROOT / "docs" / "view.md").read_text(), re.M):
        run(command.split(), tmp_path)
    assert (tmp_path / "page.html").stat().st_size < 1.5e6


def test_the_readme_s_make_targets_and_links_exist() -> None:
    targets = re.findall(r"^    make (\w+)", README, re.M)
    assert targets == ["demo", "test"]
    makefile = (ROOT / "Makefile").read_text()
    assert all(f"\n{target}:" in makefile for target in targets)
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_the_loop_over_a_recording_runs_as_printed(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "track.md").read_text(), re.S)
    loop = "for poses, down in track.frames():"
    pages = (ROOT / "docs" / "track.md", ROOT / "docs" / "belief.md", ROOT / "README.md")
    assert all(loop in page.read_text() for page in pages)
    scene = Scene.load(ROOT / "src" / "pushgraph" / "scenes" / "demo.json")
    (tmp_path / "scene.json").write_text(scene.to_json())
    simulate(scene).save(tmp_path / "camera.csv")
    run([sys.executable, "-c", code + "\nassert regulator.frames == 115"], tmp_path)


def test_the_scene_in_the_manual_is_valid() -> None:
    text, outline = re.findall(r"```json\n(.*?)```", (ROOT / "docs" / "scene.md").read_text(), re.S)
    scene = Scene.from_json(text)
    assert scene.joints[0].kind == "fixed"
    assert json.loads(text)["version"] == 1
    assert scene.bodies[0].replace(shape=Polygon(**json.loads(outline))).shape.kind == "polygon"


@pytest.mark.slow
def test_the_page_of_the_first_scene_runs_as_printed(tmp_path: Path) -> None:
    assert run_page(ROOT / "docs" / "first-scene.md", tmp_path) == 15
    assert pg.Scene.load(tmp_path / "heavier.json").bodies[2].mass == 2.0
    assert {"both.png", "hook.png"} < {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_the_page_of_one_s_own_training_runs_as_printed(tmp_path: Path) -> None:
    assert run_page(ROOT / "docs" / "train-your-own.md", tmp_path) == 13
    for out, models in (("measured", ["propnet", "mine"]), ("measured-tiny", ["tiny"]), ("measured-cups", [])):
        content = json.loads((tmp_path / out / "results.json").read_text())
        assert {row["model"] for row in content["rows"]} == {"still", "contact", *models, "noise_floor"}
        assert (tmp_path / out / "histogram.png").stat().st_size > 10_000
    assert pg.load(tmp_path / "mine.safetensors").record["data"]["setup"] == "own"


def test_the_scene_files_of_the_pages_are_valid() -> None:
    page = (ROOT / "docs" / "first-scene.md").read_text()
    (text,) = re.findall(r"```json\n(.*?)```", page, re.S)
    assert pg.Scene.from_json(text).names == ("tray", "flap", "cup")


LONG = ("05_push_to_a_goal_by_gradient", "07_weigh_by_pushing", "09_own_network", "10_own_setup")
EXAMPLES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG))
    for path in sorted((ROOT / "examples").glob("*.py"))
]


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_examples_run_and_are_short(example: Path, tmp_path: Path) -> None:
    assert len(example.read_text().splitlines()) < 80
    assert run([sys.executable, str(example)], tmp_path)


@pytest.mark.slow
def test_the_plans_in_the_manual_run_as_printed(tmp_path: Path) -> None:
    manual = (ROOT / "docs" / "planning.md").read_text()
    first, *others = re.findall(r"```python\n(.*?)```", manual, re.S)
    assert run([sys.executable, "-c", first], tmp_path).split()[0] in TOOLS
    for code in others:
        assert "start=(" in run([sys.executable, "-c", code], tmp_path)
    (tool,) = re.findall(r"```json\n(.*?)```", manual, re.S)
    (tmp_path / "own.json").write_text(tool)
    assert len(load_tool(tmp_path / "own.json").tool.parts) == 3
