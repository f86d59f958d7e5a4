"""Every block of README, CONTRIBUTING and docs is run, from the top of its page to the bottom."""

import gzip
import json
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doc_blocks import PAGES, ROOT, blocks_of, check_block, run_page
from made_pushes import made

import pushgraph as pg
from pushgraph.adaptation.scenes import scene_of
from pushgraph.adaptation.unknowns import Unknowns
from pushgraph.belief_history import BeliefHistory
from pushgraph.pose import relative
from pushgraph.real_pushes import read_pushes
from pushgraph.recording.files import read_sightings
from pushgraph.recording.readers.paper_json import as_paper_json

ELSEWHERE = {"install.md": {"console", "python"}}
"""Kinds of blocks that tests/test_install.py runs, in new environments."""


def give_real_pushes(folder: Path) -> None:
    """Pushes of a real robot, as tables and as tracks."""
    data, outlines = made(folder, {"box": 32}, Unknowns(0.1, 0.4), noise=2e-4)
    packed = gzip.compress(data.read_bytes())
    for name in ("pushes.csv.gz", "others.csv.gz"):
        (folder / name).write_bytes(packed)
    (folder / "others.csv").write_bytes(data.read_bytes())
    pushes = read_pushes(data, outlines)
    scene = scene_of(pushes, 0)
    scene.save(folder / "scene.json")
    box = scene.bodies[0].replace(pose_world_from_body=(0.0, 0.0, 0.0))
    for name, aside in (("first.h5", 0.005), ("second.h5", -0.01)):
        there = pg.Push(start=(-0.1, aside), end=(-0.04, aside), speed=0.05)
        back = pg.Push(start=(0.15, -aside), end=(0.06, -aside), speed=0.05)
        pg.simulate(scene.replace(bodies=(box,), pushes=3 * (there, back))).save(folder / name)


def give_recordings(folder: Path) -> None:
    """Pushes, and what the paper's and its predecessor's robots recorded of two cylinders that are glued."""
    give_real_pushes(folder)
    nodes = np.zeros((1, 40, 4, 6))
    nodes[..., 0] = [0.1, 0.12, 0.11, 0.13]
    nodes[..., 0, 1] = 1
    nodes[..., 2] = [-0.3, 0.0, 0.12, 0.5]
    joined = np.zeros((1, 12, 1))
    joined[0, [4, 7]] = 1  # of nodes 1 and 2, in both orders: 0-1, 0-2, 0-3, 1-0, 1-2, 1-3, 2-0, 2-1
    for name, value in (("trajectories", [nodes]), ("relations", [joined])):
        (folder / f"real_world_{name}.pickle").write_bytes(pickle.dumps(value))
    tool = np.column_stack((np.linspace(-0.3, 0.05, 60), np.zeros(60)))
    moved = np.maximum(tool[:, 0] + 0.12, 0)
    poses = np.zeros((60, 3, 3))
    poses[:, 0, :2] = tool
    poses[:, 1:, 0] = moved[:, None] + [0.0, 0.125]
    shapes = [[robot, 0, 0.5, 0.12, 0.12] for robot in (1, 0, 0)]
    recorded = as_paper_json(poses, shapes, [[1, 0, 1]])
    (folder / "0.txt").write_text(recorded)
    (folder / "recordings").mkdir()
    (folder / "recordings" / "0.txt").write_text(recorded)


GIVEN = {"real-pushes.md": give_real_pushes, "real-robot.md": give_recordings}
"""What a page takes from its reader's own robot."""


def check_readme(folder: Path, session: dict[str, Any]) -> None:
    """The lid swings; every command writes what it should."""
    start, end = session["track"].poses[[0, -1]]
    assert (end - start)[2, 2] < -0.5
    assert (folder / "picture.png").stat().st_size > 10_000
    drawn = {"track.h5", "track.csv", "picture.png"}
    plan = {"plan.json", "expected.h5", "executed.h5", "picture.png", "animation.gif"}
    wanted = {"predicted": drawn | {"animation.gif"}, "predicted-loose": drawn, "seen": drawn, "planned": plan}
    wanted |= {"observed": {"beliefs.json", "beliefs.png", "scene.json"}, "predicted-believed": drawn}
    wanted |= {"result": drawn | {"animation.gif"}, "result-without-animation": drawn}
    for name, files in wanted.items():
        assert {path.name for path in (folder / name).iterdir()} == files
    content = json.loads((folder / "evaluation" / "results.json").read_text())
    assert (content["suite"], content["protocol"]["seed"]) == ("physics", 1_000_000)
    assert {row["model"] for row in content["rows"]} == {"still", "image", "propnet", "contact", "noise_floor"}
    assert (folder / "evaluation" / "histogram.png").stat().st_size > 10_000


def check_first_scene(folder: Path, _: dict[str, Any]) -> None:
    assert pg.Scene.load(folder / "table.json").names == ("tray", "flap", "cup")
    assert pg.Scene.load(folder / "heavier.json").bodies[2].mass == 2.0
    assert {"both.png", "hook.png"} < {path.name for path in folder.iterdir()}


def check_train_your_own(folder: Path, _: dict[str, Any]) -> None:
    for out, models in (("measured", ["propnet", "mine"]), ("measured-tiny", ["tiny"]), ("measured-cups", [])):
        content = json.loads((folder / out / "results.json").read_text())
        assert {row["model"] for row in content["rows"]} == {"still", "contact", *models, "noise_floor"}
        assert (folder / out / "histogram.png").stat().st_size > 10_000
    assert pg.load(folder / "mine.safetensors").record["data"]["setup"] == "own"


def check_real_robot(folder: Path, _: dict[str, Any]) -> None:
    """The hinge is found; a moved origin is brought back; pickles become recordings."""
    history = BeliefHistory.load(folder / "observed" / "beliefs.json")
    assert history.likeliest == {("box", "lid"): "revolute", ("box", "can"): "none", ("lid", "can"): "none"}
    assert pg.Scene.load(folder / "next.json").joints[0].kind == "revolute"
    predicted = pg.Track.load(folder / "predicted" / "track.h5")
    np.testing.assert_array_less(0.1, np.hypot(*(predicted.poses[-1] - predicted.poses[0])[1:, :2].T))
    # The recording of the moved origin is brought back to the scene's frame; its tool is told 2 mm beside where it was.
    told, moved = (pg.Track.load(folder / name) for name in ("seen.h5", "moved.h5"))
    np.testing.assert_allclose(moved.poses[0, 1:, :2], told.poses[0, 1:, :2], atol=0.008)
    off = np.hypot(*(moved.poses[0, 0] - told.poses[0, 0])[:2])
    np.testing.assert_allclose(off, 0.0014 * np.sqrt(2), atol=1e-6)
    assert relative(told.poses[0, 0], moved.poses[0, 0])[2] == 0
    scene = pg.Scene.from_json(read_sightings(folder / "recordings" / "0.txt").scene)
    assert [body.shape.diameter for body in scene.bodies] == [0.12, 0.11, 0.13]
    assert [(joint.kind, joint.parent, joint.child) for joint in scene.joints] == [("fixed", "1", "2")]
    assert json.loads((folder / "recordings" / "0.txt").read_text())["shapes"][0] == [1, 0, 0, 0.1, 0.1]


def check_track(_: Path, session: dict[str, Any]) -> None:
    assert session["regulator"].frames == sum(1 for _ in session["track"].frames()) > 100


def check_view(folder: Path, _: dict[str, Any]) -> None:
    assert (folder / "page.html").stat().st_size < 1.5e6


CHECKS: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    "README.md": check_readme,
    "first-scene.md": check_first_scene,
    "train-your-own.md": check_train_your_own,
    "real-robot.md": check_real_robot,
    "track.md": check_track,
    "view.md": check_view,
}
"""What shall be there once a page was run, beside that nothing failed."""
RUN = [
    pytest.param(page, id=page.name, marks=[pytest.mark.slow] * (page.name != "README.md"))
    for page in PAGES
    if blocks_of(page) and page.name not in ELSEWHERE
]


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", RUN)
def test_the_page_runs_as_printed(page: Path, tmp_path: Path) -> None:
    GIVEN.get(page.name, lambda folder: None)(tmp_path)
    session = run_page(page, tmp_path)
    CHECKS.get(page.name, lambda folder, session: None)(tmp_path, session)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_block_of_a_page_escapes(page: Path) -> None:
    for block in blocks_of(page):
        check_block(page, block)
        assert block.kind in ELSEWHERE.get(page.name, {block.kind})


def test_the_readme_s_first_lines_are_short() -> None:
    (code,) = (block.text for block in blocks_of(ROOT / "README.md") if block.kind == "python")
    assert len(code.strip().splitlines()) <= 12


def test_the_loop_over_a_recording_is_told_alike() -> None:
    loop = "for poses, down in track.frames():"
    pages = (ROOT / "docs" / "track.md", ROOT / "docs" / "belief.md", ROOT / "README.md")
    assert all(loop in page.read_text() for page in pages)


def test_every_python_name_on_a_page_exists() -> None:
    for page in PAGES:
        for name in re.findall(r"\bpg\.(\w+)", page.read_text()):
            assert hasattr(pg, name), f"{page.name}: pg.{name}"
