"""The guide to real robots is followed step by step, as it stands, on what a simulated camera sees."""

import json
import pickle
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from pushgraph.belief_history import BeliefHistory
from pushgraph.cli import main
from pushgraph.pose import relative
from pushgraph.recording.files import read_sightings
from pushgraph.scene import Scene
from pushgraph.track import Track

GUIDE = (Path(__file__).parents[1] / "docs" / "real-robot.md").read_text()
BLOCKS = re.findall(r"```(json|console|python)\n(.*?)```", GUIDE, re.S)
*STEPS, CONVERSION = BLOCKS


def follow(kind: str, text: str) -> None:
    if kind == "json":
        Path("scene.json").write_text(text)
    elif kind == "python":
        exec(compile(text, "real-robot.md", "exec"), {})
    else:
        for command in re.findall(r"^\$ pushgraph (.*)$", text, re.M):
            with pytest.raises(SystemExit) as done:
                main(shlex.split(command))
            assert not done.value.code, command


def test_every_step_of_the_guide_runs_and_the_hinge_is_found(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for kind, text in STEPS:
        follow(kind, text)
    history = BeliefHistory.load("observed/beliefs.json")
    assert history.likeliest == {("box", "lid"): "revolute", ("box", "can"): "none", ("lid", "can"): "none"}
    assert Scene.load("next.json").joints[0].kind == "revolute"
    predicted = Track.load("predicted/track.h5")
    np.testing.assert_array_less(0.1, np.hypot(*(predicted.poses[-1] - predicted.poses[0])[1:, :2].T))
    # The recording of the moved origin is brought back to the scene's frame; its tool is told 2 mm beside where it was.
    told, moved = Track.load("seen.h5"), Track.load("moved.h5")
    np.testing.assert_allclose(moved.poses[0, 1:, :2], told.poses[0, 1:, :2], atol=0.008)
    off = np.hypot(*(moved.poses[0, 0] - told.poses[0, 0])[:2])
    np.testing.assert_allclose(off, 0.0014 * np.sqrt(2), atol=1e-6)
    assert relative(told.poses[0, 0], moved.poses[0, 0])[2] == 0


def test_the_predecessor_s_pickles_become_recordings(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    nodes = np.zeros((1, 3, 4, 6))
    nodes[..., 0] = [0.1, 0.12, 0.11, 0.13]
    nodes[..., 0, 1] = 1
    nodes[..., 2] = [-0.3, 0.0, 0.12, 0.5]
    joined = np.zeros((1, 12, 1))
    joined[0, [4, 7]] = (
        1  # nodes 1 and 2, in both orders: of 0 there are three pairs, then come 1-0, 1-2, 1-3, 2-0, 2-1
    )
    Path("real_world_trajectories.pickle").write_bytes(pickle.dumps([nodes]))
    Path("real_world_relations.pickle").write_bytes(pickle.dumps([joined]))
    follow(*CONVERSION)
    scene = Scene.from_json(read_sightings(Path("recordings/0.txt")).scene)
    assert [body.shape.diameter for body in scene.bodies] == [0.12, 0.11, 0.13]
    assert [(joint.kind, joint.parent, joint.child) for joint in scene.joints] == [("fixed", "1", "2")]
    assert json.loads(Path("recordings/0.txt").read_text())["shapes"][0] == [1, 0, 0, 0.1, 0.1]
