"""Trying out without a browser: what edits do to all that hangs on a body, undo, and the one folder."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scenes import body, workshop

from pushgraph.errors import CancelledError, PlanningError, PushGraphError, SceneError, StorageError
from pushgraph.scene import Scene
from pushgraph.tool import Push
from pushgraph.track import Track
from pushgraph.view import scene_edits
from pushgraph.view.folder import Folder
from pushgraph.view.workbench import Workbench


def test_what_hangs_on_a_body_goes_along() -> None:
    scene = workshop()
    moved = scene_edits.place_body(scene, "plate", (-0.3, 0.0, math.pi / 2))
    assert moved.joints[0].anchor == pytest.approx((-0.3 - 0.0525, 0.06))  # the hinge sits on its parent
    assert moved.bodies[1] == scene.bodies[1]
    turned = scene_edits.place_body(scene, "cup", (0.25, 0.3, math.pi / 2))
    np.testing.assert_allclose(turned.poses_world_from_body[3], (0.25, 0.38, math.pi / 2), atol=1e-12)  # of one piece
    renamed = scene_edits.change_body(scene, "cup", {"name": "mug"})
    assert renamed.rigid_groups == (("mug", "handle"),)
    left = scene_edits.delete_body(scene_edits.delete_body(scene, "lid"), "handle")
    assert (left.joints, left.rigid_groups, left.names) == ((), (), ("plate", "cup"))


def test_joints_and_pushes_are_edited() -> None:
    scene = workshop().replace(unknown_pairs=(("plate", "cup"),))
    joined = scene_edits.join(scene, {"kind": "fixed", "parent": "plate", "child": "cup"})
    assert len(joined.joints) == 2
    assert joined.unknown_pairs == ()
    assert scene_edits.part(joined, "lid", "plate").joints == joined.joints[1:]
    with pytest.raises(SceneError, match="'lid' and 'cup' are not joined"):
        scene_edits.part(scene, "lid", "cup")
    end = scene.pushes[1].waypoints[-1, :2]
    polar = scene_edits.move_push_end(scene, 1, "start", (0.3, -0.25)).pushes[1]
    np.testing.assert_allclose(polar.waypoints[:, :2], ((0.3, -0.25), end))
    path = scene_edits.change_push(scene, 0, {"end": None, "path": [[-0.1, 0.0], [-0.08, 0.0, 0.5]]})
    assert scene_edits.move_push_end(path, 0, "end", (-0.09, 0.1)).pushes[0].path == ((-0.1, 0.0), (-0.09, 0.1, 0.5))
    more = scene_edits.add_push(scene)
    assert math.dist(more.pushes[-1].start, more.pushes[-1].waypoints[-1, :2]) == pytest.approx(0.15, abs=1e-3)
    assert scene_edits.delete_push(more, 2) == scene
    with pytest.raises(SceneError, match=r"pushes: no push 7; valid: 0 to 1"):
        scene_edits.delete_push(scene, 7)


def test_what_is_refused_changes_nothing_and_what_is_done_is_undone(tmp_path: Path) -> None:
    bench = Workbench(workshop(), Folder(tmp_path))
    first = bench.work
    for refused in (
        lambda: bench.move_body("plate", (0.25, 0.0)),
        lambda: bench.turn_body("nobody", 1.0),
        lambda: bench.place_body("plate", (math.nan, 0.0, 0.0)),
        lambda: bench.set_goal({"body": "plate", "position": (9.0, 0.0)}),
        lambda: bench.plan(),
        lambda: bench.step_belief(),
        lambda: bench.correct_belief("plate", "lid", "fixed"),
        lambda: bench.save("plan", "plan"),
        lambda: bench.predict(believed=True),
        bench.undo,
    ):
        with pytest.raises(PushGraphError):
            refused()
        assert bench.work is first
    bench.set_goal({"body": "plate", "position": (0.0, 0.1)})
    bench.move_push_end(0, "end", (-0.1, 0.0))
    assert bench.work.goal is not None
    bench.delete("plate")
    assert bench.work.goal is None
    for _ in range(3):
        bench.undo()
    assert bench.work is first


WORK = {
    "simulate": Workbench.simulate,
    "watch": Workbench.step_belief,
    "plan": lambda bench, told: bench.plan(1, told),
}


SLOW = [pytest.param(work, marks=pytest.mark.slow) for work in ("watch", "plan")]


@pytest.mark.parametrize("work", ["simulate", *SLOW])
def test_what_is_cancelled_changes_nothing(work: str, tmp_path: Path) -> None:
    def cancelled(done: int, total: int) -> None:
        assert 0 <= done <= total
        if 3 * done > total:
            raise CancelledError("enough")

    bodies = body("cup", 0.0, 0.0), body("far", 0.4, 0.4)
    scene = Scene(bodies=bodies, pushes=(Push(start=(-0.13, 0.0), end=(-0.05, 0.0)),))
    bench = Workbench(scene, Folder(tmp_path))
    bench.set_goal({"body": "cup", "position": (0.1, 0.0)})
    bench.simulate()
    before = bench.work
    with pytest.raises(CancelledError):
        WORK[work](bench, cancelled)
    assert bench.work is before


@pytest.mark.slow
def test_forces_are_known_of_what_is_predicted_or_simulated_as_the_scene_is_now(tmp_path: Path) -> None:
    bench = Workbench(workshop(), Folder(tmp_path))
    bench.predict()
    bench.simulate()
    predicted, simulated = bench.work.tracks.values()
    assert [bench.forces(track).source for track in (predicted, simulated)] == ["predicted", "simulated"]
    assert bench.forces(simulated) is bench.forces(simulated)
    predicted.save(tmp_path / "track.h5")
    assert bench.forces(Track.load(tmp_path / "track.h5")).source == "predicted"
    moved = dataclasses.replace(predicted, poses=predicted.poses + 1e-3)
    with pytest.raises(PushGraphError, match="neither"):
        bench.forces(moved)


def test_pushes_of_hours_are_left_to_the_command_line(tmp_path: Path) -> None:
    bench = Workbench(workshop(), Folder(tmp_path))
    for _ in range(11):
        bench.add_push({"start": [-0.3, -0.3], "end": [-0.3, -0.3], "rest": 60.0})
    with pytest.raises(SceneError, match="at most 600 s"):
        bench.simulate()
    bench.set_goal({"body": "plate", "position": (0.0, 0.1)})
    with pytest.raises(PlanningError, match="goal"):
        bench.set_goal({"body": "nobody", "position": (0.0, 0.1)})


def test_the_folder_keeps_to_itself(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    (mine / "sub").mkdir(parents=True)
    (mine / "sub" / "b.json").write_text("{}")
    (mine / ".hidden.json").write_text("{}")
    (mine / "link.json").symlink_to(tmp_path / "secret.json")
    folder = Folder(mine)
    assert folder.files() == ["sub/b.json"]
    assert folder.to_read("sub/b.json") == mine / "sub" / "b.json"
    assert folder.to_write("sub/c", ".h5") == mine / "sub" / "c.h5"
    for name in ("../x.json", "/etc/passwd", "link.json", ".hidden.json", "sub", "", "a\nb.json", "sub//b.json"):
        with pytest.raises(StorageError):
            folder.to_read(name)
    for name in ("link.json", "sub/b.json", "../x", "new/x", "x.csv", "x.py/..", ".x"):
        with pytest.raises(StorageError):
            folder.to_write(name, ".json")
    assert folder.to_write("sub/b.json", ".json", replace=True) == mine / "sub" / "b.json"
    with pytest.raises(StorageError, match="it is a file"):
        Folder(mine / "sub" / "b.json")
