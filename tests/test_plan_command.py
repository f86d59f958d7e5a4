"""The command plan, as a user runs it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pushgraph.cli import app
from pushgraph.errors import PlanningError
from pushgraph.planning.plan import load_plan
from pushgraph.scene import Scene
from pushgraph.track import Track

SCENE = {
    "format": "pushgraph.scene",
    "version": 1,
    "bodies": [
        {"name": "cup", "shape": {"kind": "cylinder", "diameter": 0.1}, "pose_world_from_body": [0.2, 0.0, 0.0]},
        {"name": "tin", "shape": {"kind": "cylinder", "diameter": 0.1}, "pose_world_from_body": [0.2, 0.4, 0.0]},
    ],
}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(SCENE))
    return path


def run(*arguments: object) -> str:
    done = CliRunner().invoke(app, ["plan", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_pushes_of_the_own_tool_reach_a_pose(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = run(scene, "--goal", "cup", 0.3, -0.1, -30, "--pushes", 1, "--execute", "--out", out)
    assert {path.name for path in out.iterdir()} == {
        *("plan.json", "expected.h5", "executed.h5", "picture.png", "animation.gif")
    }
    assert "Push 1: from" in said
    tool, planned = load_plan(out / "plan.json")
    assert (tool, len(planned.pushes)) == ("own", 1)
    end = Track.load(out / "executed.h5").poses[-1, 1]
    assert end[:2] == pytest.approx([0.3, -0.1], abs=0.02)
    # A plan is a scene that other commands read.
    assert Scene.from_json(json.dumps(json.loads((out / "plan.json").read_text())["scene"])) == planned


def test_the_best_of_several_tools(scene: Path, tmp_path: Path) -> None:
    tool = tmp_path / "hook.json"
    tool.write_text('{"parts": [{"shape": {"kind": "cuboid", "size": [0.02, 0.1]}}]}')
    quiet = ("--animation", "none", "--out", tmp_path / "out", "--pushes", 2)
    said = run(scene, "--goal", "cup", 0.35, 0.0, "--tools", tool, "--tools", "stick", *quiet)
    assert "Tool: hook" in said or "Tool: stick" in said
    assert load_plan(tmp_path / "out" / "plan.json")[1].pushes[0].times is not None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--goal", "lid", 0, 0), "no body 'lid'; valid: cup, tin"),
        (("--goal", "cup", 3, 0), "off the table of 2 x 2 m"),
        (("--goal", "cup", 0, 0, "--tools", "spoon"), "neither a file"),
        (("--goal", "cup", 0, 0, "--tools", "stick", "--start", 0.2, 0.0), "from body 'cup'"),
        (("--goal", "cup", 0, 0, "--tools", "l", "--start", -0.9, 0.9, "--robot", "ur10"), "out of the arm.s reach"),
    ],
)
def test_what_cannot_be_is_told(scene: Path, tmp_path: Path, arguments: tuple, said: str) -> None:
    with pytest.raises(PlanningError, match=said):
        run(scene, *arguments, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
