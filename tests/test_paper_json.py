"""The paper's recordings: read as they are published, refused by key and row."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pushgraph.cli import main
from pushgraph.errors import EvaluationError, TrackError
from pushgraph.evaluation.camera import AFTER_CONTACT, MODELS, STARTS, evaluate_recordings, recorded
from pushgraph.recording.files import read_sightings
from pushgraph.recording.readers.paper_json import as_paper_json
from pushgraph.recording.recording import read_recording
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.setups import draw_trajectory

SHAPES = [[1, 0, 1, 0.1, 0.1], [0, 0, 0.6, 0.12, 0.12], [0, 0, 0, 0.11, 0.11], [0, 1, 0.4, 0.1, 0.08]]
EDGES = [[1, 0, 1], [3, 1, 2], [0, 0, 2]]


def content() -> dict[str, Any]:
    """A tool on its way to a cylinder glued to another, to which a cuboid is hinged; two frames."""
    poses = np.array([[-0.2, 0, 0], [0, 0, 0], [0, 0.12, 0], [0.11, 0.12, 0.1]])
    moved = poses + [[0.01, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0.01]]
    return json.loads(as_paper_json(np.stack((poses, moved)), SHAPES, EDGES))


def written(folder: Path, data: object, name: str = "0.txt") -> Path:
    path = folder / name
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


@pytest.mark.parametrize("name", ["0.txt", "0.json"])
def test_a_recording_holds_its_scene_and_twenty_frames_a_second(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, content(), name)
    sightings = read_sightings(path)
    scene = Scene.from_json(sightings.scene)
    assert scene.names == ("1", "2", "3")
    assert [body.shape for body in scene.bodies] == [
        *(Cylinder(diameter=d) for d in (0.12, 0.11)),
        Cuboid(size=(0.1, 0.08)),
    ]
    assert [body.mass for body in scene.bodies] == [0.6, None, 0.4]
    assert [body.yaw_known for body in scene.bodies] == [False, False, True]
    assert [(joint.kind, joint.parent, joint.child) for joint in scene.joints] == [
        ("fixed", "1", "2"),
        ("revolute", "2", "3"),
    ]
    track = read_recording(path, scene).track
    assert track.times.tolist() == [0.0, 0.05]
    np.testing.assert_allclose(track.poses[1, 0], [-0.19, 0, 0])
    np.testing.assert_allclose(track.poses[1, 3], [0.11, 0.12, 0.11])


def test_bodies_pressed_into_each_other_by_noise_are_parted_in_the_scene(tmp_path: Path) -> None:
    data = content()
    data["2"] = [[0, 0.112, 0]] * 2  # 3 mm deep
    first, second, _ = Scene.from_json(read_sightings(written(tmp_path, data)).scene).bodies
    distance = np.subtract(second.pose_world_from_body, first.pose_world_from_body)[1]
    assert 0.114 - 1e-9 <= distance <= 0.115


def broken(**changes: Any) -> dict[str, Any]:
    return content() | changes


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (json.dumps(content())[:-40], "not valid JSON, it may be truncated"),
        ({key: rows for key, rows in content().items() if key != "edges"}, "no key 'edges'"),
        ({key: rows for key, rows in content().items() if key != "2"}, "keys 0, 1, 3: must be 0 to 2"),
        (broken(**{"2": content()["2"][:1]}), "key '2': has 1 frames, key '0' has 2"),
        (broken(**{"1": [[0, 0, 0], [0, 0]]}), "key '1': row 1: must be 3 numbers"),
        (broken(**{"1": [[0, 0, 0], [0, "x", 0]]}), "key '1': row 1, column 1: must be a number, got x"),
        (broken(**{"1": [[None, None, None]] * 2}), "key '1': was never seen"),
        (broken(shapes=SHAPES[:3]), "shapes: has 3 rows; needed: 4"),
        (broken(shapes=SHAPES[1:] + SHAPES[:1]), r"shapes: the robot must be row 0 and no other; rows \[3\]"),
        (broken(shapes=[*SHAPES[:3], [0, 2, 1, 0.1, 0.1]]), "shapes: row 3: kind 2; valid: 0 cylinder, 1 cuboid"),
        (broken(shapes=[*SHAPES[:3], [0, 0, 1, 0.1, 0.2]]), "row 3: a cylinder of diameters 0.1 and 0.2"),
        (broken(shapes=[SHAPES[0], [0, 0, 1, 0.3, 0.3], *SHAPES[2:]]), "overlaps others in the first frame"),
        (broken(shapes=[*SHAPES[:3], [0, 1, -1, 0.1, 0.1]]), "its scene does not fit together"),
        (broken(edges=[[1, 0, 3]]), "edges: row 0: joins 0 and 3; valid: two of 0 to 2"),
        (broken(edges=[[5, 0, 1]]), "edges: row 0: joint 5; valid: 0 none, 1 fixed"),
        (broken(edges=[[1, 0, 1], [1, 1, 0]]), "joined already"),
    ],
)
def test_what_does_not_fit_together_is_named(data: object, says: str, tmp_path: Path) -> None:
    with pytest.raises(TrackError, match=says) as error:
        read_sightings(written(tmp_path, data))
    assert "0.txt" in str(error.value)


def test_recordings_make_the_figures_rows(tmp_path: Path) -> None:
    track = draw_trajectory("camera", 5, 1_000_000, 1).track
    poses = track.poses.copy()
    poses[:, 1:, 2] = 0.0
    scene = track.scene
    diameters = [body.shape.diameter for body in scene.bodies]
    shapes = [
        [1, 1, 1, 0.04, 0.12],
        *([0, 0, body.mass, d, d] for body, d in zip(scene.bodies, diameters, strict=True)),
    ]
    index = {name: k for k, name in enumerate(scene.names)}
    edges = [[1, index[joint.parent], index[joint.child]] for joint in scene.joints]
    (tmp_path / "recordings").mkdir()
    written(tmp_path / "recordings", as_paper_json(poses, shapes, edges))
    track.save(tmp_path / "recordings" / "1.h5")
    results, scenes = evaluate_recordings([tmp_path / "recordings"], {"contact": "contact", "belief": "belief"})
    values = {(row["model"], row["metric"], row["start"]): row["value"] for row in results.rows}
    assert set(values) == {(m, "final_error_cm", s) for m in MODELS for s in STARTS} | {
        (m, "motion_cm", "all") for m in MODELS
    }
    assert len(scenes) == 2
    moved = 100 * np.hypot(*(track.poses[-1] - track.poses[0])[1:, :2].T).mean()
    assert values["true_joints", "motion_cm", "all"] == pytest.approx(moved, abs=0.05)
    assert values["true_joints", "final_error_cm", AFTER_CONTACT[0]] < 0.1 * moved
    assert values["believed_joints", "final_error_cm", 80] < 0.2


def test_the_command_writes_the_curves_and_names_what_is_no_prior(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit) as done:
        main(["evaluate", "camera", "--count", "2", "--workers", "1", "--out", str(tmp_path)])
    assert not done.value.code
    content = json.loads((tmp_path / "results.json").read_text())
    assert (content["suite"], content["protocol"]["count"]) == ("camera", 2)
    assert {tuple(set(row) & {"start", "objects"}) for row in content["rows"]} == {("start",)}
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    for prior, says in (("glued=1", "no joint 'glued'"), ("fixed", "valid: JOINT=NUMBER")):
        with pytest.raises(SystemExit) as done:
            main(["evaluate", "camera", "--count", "1", "--workers", "1", "--prior", prior, "--out", str(tmp_path)])
        assert done.value.code
        assert says in " ".join(capsys.readouterr().err.split())


def test_recordings_without_their_truth_are_refused(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match="joints of kind revolute; this suite is of fixed joints only"):
        recorded(written(tmp_path, content()))
    (tmp_path / "seen.csv").write_text("time,node,x,y,yaw\n0,robot,0,0,0\n0,cup,1,0,0\n")
    with pytest.raises(EvaluationError, match=r"seen.csv: holds no scene.*pushgraph track"):
        recorded(tmp_path / "seen.csv")
