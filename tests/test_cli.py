"""The command: what it prints, writes and refuses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import body, workshop

import pushgraph
from pushgraph.cli import main
from pushgraph.cli.choices import contenders, networks, one_of
from pushgraph.cli.choices import engines as choices_of_engines
from pushgraph.cli.choices import setups as choices_of_setups
from pushgraph.errors import ViewerError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene, Table
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import SETUPS
from pushgraph.tool import Push
from pushgraph.track import Track
from pushgraph.viewer.animation import save_animation


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        main(list(arguments))
    return exit_.value.code


def test_simulate_writes_what_it_says_and_the_table_is_the_track(tmp_path: Path, capsys) -> None:
    path = tmp_path / "scene.json"
    path.write_text(workshop().to_json())
    assert run("simulate", str(path), "--out", str(tmp_path / "out")) == 0
    printed = capsys.readouterr().out
    track = Track.load(tmp_path / "out" / "track.h5")
    assert track.poses.tobytes() == simulate(workshop()).poses.tobytes()
    again = Track.load(tmp_path / "out" / "track.csv", workshop())
    np.testing.assert_array_equal(again.poses, track.poses)
    row = re.search(r"lid\s+│\s+(\S+) │\s+(\S+) │", printed)
    assert float(row[1]) == pytest.approx(track.poses[-1, 2, 0], abs=1e-4)
    with Image.open(tmp_path / "out" / "animation.gif") as animation:
        assert animation.n_frames > 20
        assert animation.info["duration"] == pytest.approx(50, abs=10)
    with Image.open(tmp_path / "out" / "picture.png") as picture:
        assert picture.size[0] > 800


def test_an_arm_simulates_writes_its_joints_and_is_shown(tmp_path: Path, capsys) -> None:
    scene = workshop().replace(pushes=(Push(start=(-0.2, 0.0), end=(-0.1, 0.0)),))
    path, out = tmp_path / "scene.json", tmp_path / "out"
    path.write_text(scene.to_json())
    arguments = ("simulate", str(path), "--out", str(out), "--animation", "none")
    assert run(*arguments, "--robot", "ur10", "--render", str(out / "arm.gif")) == 0
    assert {one.name for one in out.iterdir()} == {
        "track.h5", "track.csv", "picture.png", "joint_trajectory.json", "arm.gif",
    }  # fmt: skip
    assert "arm.gif" in capsys.readouterr().out
    assert Track.load(out / "track.h5").scene.arm is not None
    assert len(JointTrajectory.load(out / "joint_trajectory.json").points) > 100
    assert run(*arguments, "--render", "arm.gif") == 2
    assert run(*arguments, "--robot", "ur5") == 2
    path.write_text(scene.replace(pushes=(Push(start=(-0.9, 0.3), end=(-0.8, 0.3)),)).to_json())
    assert run(*arguments, "--robot", "ur10") == 1
    assert "pushes[0]: the tool at (-0.900, 0.300)" in capsys.readouterr().err


def test_unknown_values_are_simulated_at_nominal_ones_and_it_says_so(tmp_path: Path, capsys) -> None:
    scene = json.loads(workshop().to_json())
    del scene["bodies"][0]["mass"]
    scene["side_friction"] = None
    scene["unknown_pairs"] = "unlisted"
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    assert run("simulate", str(path), "--out", str(tmp_path / "out"), "--animation", "none") == 0
    printed = capsys.readouterr().out
    assert "mass of 'plate' is unknown: taken as 0.6 kg, a nominal value" in printed
    assert "side_friction is unknown: taken as 0.25, a nominal value" in printed
    assert "taken as not joined" in printed


@pytest.mark.parametrize("command", ["simulate", "predict"])
def test_what_is_assumed_and_what_is_doubtful_is_printed(command: str, tmp_path: Path, capsys) -> None:
    scene = Scene(
        bodies=(body("box", 0.0, 0.0, mass=None), body("post", 0.0, 0.3).replace(fixed=True, mass=1.0)),
        table=Table(size=(0.3, 0.8)),
        pushes=(Push(start=(-0.2, 0), end=(0.2, 0), force_limit=1000.0),),
    )
    path = tmp_path / "scene.json"
    path.write_text(scene.to_json())
    assert run(command, str(path), "--out", str(tmp_path / "out"), "--animation", "none") == 0
    printed = capsys.readouterr().out
    table = printed.index("Final poses")
    assert "Note: mass of 'box' is unknown: taken as 0.6 kg" in printed[:table]
    assert "Note: 'box' leaves the table at 1." in printed[table:]
    assert "is ignored" not in printed[:table]


def test_what_the_paper_s_network_does_not_know_is_printed(tmp_path: Path, capsys) -> None:
    push = Push(start=(-0.2, 0), end=(0.2, 0), force_limit=1000.0)
    scene = Scene(bodies=(body("box", 0.0, 0.0), body("post", 0.0, 0.3).replace(fixed=True)), pushes=(push,))
    path = tmp_path / "scene.json"
    path.write_text(scene.to_json())
    out = str(tmp_path / "out")
    assert run("predict", str(path), "--model", "propnet", "--out", out, "--animation", "none") == 0
    printed = capsys.readouterr().out
    assert "Note: 'post' cannot move: predicted" in printed
    assert "Note: force_limit of pushes[0] is ignored" in printed


def test_predict_refuses_a_push_that_comes_down_on_a_body(tmp_path: Path, capsys) -> None:
    pushes = (Push(start=(-0.2, 0), end=(0.1, 0)), Push(start=(0.21, 0), end=(0.3, 0)))
    path = tmp_path / "scene.json"
    path.write_text(Scene(bodies=(body("box", 0.0, 0.0),), pushes=pushes).to_json())
    for command in ("simulate", "predict"):
        assert run(command, str(path), "--out", str(tmp_path / "out"), "--animation", "none") == 1
        assert "pushes[1].start: the tool would come down on body 'box'" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_help_shows_an_example_for_every_command(capsys) -> None:
    for command in (
        "demo",
        "predict",
        "simulate",
        "generate",
        "train physics",
        "evaluate physics",
        "evaluate belief",
        "evaluate coupled",
        "evaluate camera",
        "film",
    ):
        assert run(*command.split(), "--help") == 0
        assert f"pushgraph {command}" in capsys.readouterr().out


def test_a_scene_that_is_not_there_is_said_with_the_shipped_ones(capsys) -> None:
    assert run("simulate", "nowhere.json") == 1
    assert (
        "nowhere.json: cannot read this scene: No such file or directory; shipped scenes: demo"
        in capsys.readouterr().err
    )


def test_the_shipped_scene_is_found_beside_a_folder_of_its_name(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert run("simulate", "demo", "--animation", "none") == 0
    assert (tmp_path / "demo" / "picture.png").exists()


@pytest.mark.parametrize("name", ["[/x]", "[red]", "x" * 300, "a\0b"])
def test_odd_names_of_files_are_no_tracebacks(name: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("simulate", name) == 1
    assert name[:4] in capsys.readouterr().err
    assert run("generate", name, "--count", "1", "--out", "x.h5") == 1
    assert "there is none of this name; valid: multiple-parts, jointed" in capsys.readouterr().err
    if len(name) < 10 and "\0" not in name:
        assert run("simulate", "demo", "--animation", "none", "--out", name) == 0
        assert name in capsys.readouterr().out


def test_a_folder_and_a_binary_file_are_no_scenes(tmp_path: Path, capsys) -> None:
    assert run("simulate", str(tmp_path)) == 1
    (tmp_path / "scene.json").write_bytes(bytes(range(256)))
    assert run("simulate", str(tmp_path / "scene.json")) == 1
    assert capsys.readouterr().err.count("Error: ") == 2


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "demo", "--animation", "avi"),
        ("generate", "multiple-parts"),
        ("generate", "multiple-parts", "--count", "0", "--out", "x.h5"),
        ("generate", "multiple-parts", "--count", "1", "--objects", "-1", "--out", "x.h5"),
        ("fly",),
        ("predict", "demo", "--relations", "some"),
        ("plan", "demo", "--goal", "box", "0", "0", "--risk", "none"),
        ("observe", "demo", "track.csv", "--masses", "mean"),
        ("train", "physics", "--samples", "0", "--data", "x", "--validation", "y", "--out", "z"),
    ],
)
def test_wrong_usage_is_refused(arguments: tuple[str, ...], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("generate", "dominoes", "--count", "1", "--out", "x.h5"), "setup 'dominoes': .*valid: multiple-parts, "),
        (("generate", "multiple-parts", "--count", "1", "--engine", "spark", "--out", "x.h5"), "valid: processes, ray"),
        (("train", "physics", "--model", "belief", "--data", "x", "--validation", "y", "--out", "z"), "contact"),
        (("evaluate", "physics", "--setup", "lever-up"), "setup 'lever-up': there is none of this name"),
        (("evaluate", "clutter", "--contender", "nobody"), "valid: belief, "),
    ],
)
def test_names_that_no_registry_holds_are_errors_of_ours(arguments, says, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 1
    assert re.search(says, capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_animations_are_gif_or_mp4(tmp_path: Path, monkeypatch) -> None:
    track = simulate(workshop())
    with pytest.raises(ViewerError, match=r"ends in \.gif or \.mp4"):
        save_animation(track, tmp_path / "a.avi")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ViewerError, match="needs the program ffmpeg"):
        save_animation(track, tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())


def test_the_version_is_said(capsys) -> None:
    assert run("--version") == 0
    assert capsys.readouterr().out == f"pushgraph {pushgraph.__version__}\n"


def test_choices_are_completed_and_those_of_registries_are_all_in_the_help(capsys, monkeypatch) -> None:
    for choices, command in (
        (choices_of_setups(), "generate"),
        (choices_of_engines(), "generate"),
        (networks("physics")(), "train physics"),
        (networks("belief")(), "train belief"),
        (networks("lever-up")(), "train lever-up"),
        (contenders(), "evaluate clutter"),
    ):
        assert run(*command.split(), "--help") == 0
        words = capsys.readouterr().out
        assert all(name in words for name in choices), command
    assert one_of(choices_of_setups)["autocompletion"]("planar") == ["planar", "planar-mixed"]
    monkeypatch.setitem(SETUPS, "plates", SETUPS["planar"])
    assert one_of(choices_of_setups)["autocompletion"]("plat") == ["plates"]
