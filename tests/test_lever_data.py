"""Datasets and the evaluation of levering up: bytes that do not depend on the way, errors worked by hand."""

import hashlib
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from pushgraph import pose_3d
from pushgraph.cli import main
from pushgraph.dataset import generate as generation
from pushgraph.dataset.generate import generate
from pushgraph.dataset.lever_store import LeverDataset, table
from pushgraph.dataset.store import Dataset
from pushgraph.errors import DatasetError, EvaluationError
from pushgraph.evaluation.lever_up import LeverErrors, evaluate_lever_up, rigid, simulate_lever_again, still
from pushgraph.lever_scene import WayPoint
from pushgraph.lever_track import LeverTrack
from pushgraph.simulation.lever_setup import LEVER_UP, draw_interaction


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return generate(LEVER_UP, 1, 10, 5, tmp_path_factory.mktemp("lever") / "data.h5")


def test_a_dataset_holds_what_the_setup_draws(data: Path) -> None:
    with LeverDataset(data) as dataset:
        assert len(dataset) == 10
        assert dataset.side[:5].tolist() == ["east", "north", "west", "south", "east"]
        for index in (0, 9, -1):
            drawn = draw_interaction(5, index % 10).track
            assert dataset[index].scene == drawn.scene
            np.testing.assert_allclose(dataset[index].poses, drawn.poses, atol=1e-7)
        assert dataset.summary["raised"].tolist() == [dataset[k].raised for k in range(10)]
        assert table(dataset.summary)["interactions"] == "10 (2.5 drives)"
    with pytest.raises(DatasetError, match="'format' must be 'pushgraph.dataset'"):
        Dataset(data)


def test_killed_after_a_block_it_goes_on_to_the_same_bytes(data: Path, tmp_path: Path, monkeypatch) -> None:
    drawn = []

    def killed(block):
        if drawn:
            raise KeyboardInterrupt
        drawn.append(block)
        return original(block)

    original = generation.draw_block
    monkeypatch.setattr(generation, "draw_block", killed)
    with pytest.raises(KeyboardInterrupt):
        generate(LEVER_UP, 1, 10, 5, tmp_path / "data.h5")
    monkeypatch.setattr(generation, "draw_block", original)
    generate(LEVER_UP, 1, 10, 5, tmp_path / "data.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["data.h5"]
    digests = {hashlib.sha256(path.read_bytes()).hexdigest() for path in (data, tmp_path / "data.h5")}
    assert len(digests) == 1
    with h5py.File(data) as file:
        assert file["poses"].shape[1] == 7


def test_errors_are_distances_and_angles() -> None:
    true = draw_interaction(5, 0).track
    poses = true.poses.copy()
    node = 1 + true.scene.board
    poses[:, node, 0] += 0.003
    poses[-1, node, 1] += 0.004
    turn = pose_3d.from_rotation_vector(np.array([0.0, np.radians(2.0), 0.0]))
    poses[-1, node, 3:] = -pose_3d.multiply(turn, poses[-1, node, 3:])
    errors = LeverErrors.between(LeverTrack(true.scene, poses), true)
    assert errors.final_position == pytest.approx(0.005)
    assert np.degrees(errors.final_rotation) == pytest.approx(2.0)
    assert errors.rollout_position == pytest.approx((0.003 * (len(poses) - 1) + 0.005) / len(poses))


def test_still_stays_and_rigid_goes_with_the_tool_from_the_touch_on() -> None:
    """The tool rises under the board: all of its way from where it touches is the board's."""
    scene = draw_interaction(5, 0).track.scene
    board = scene.bodies[scene.board]
    bottom, edge = board.position[2] - board.size[2] / 2, board.position[0] + board.size[0] / 2
    tip = scene.tool.boxes[0]
    below = np.array([edge - 0.005, 0.0, bottom - 0.002]) - tip.position - np.array([0.0, 0.0, tip.size[2] / 2])
    places = (below, below + np.array([0.0, 0.0, 0.012]))
    path = tuple(WayPoint(time=t, position=tuple(place.tolist())) for t, place in zip((0.0, 1.2), places, strict=True))
    scene = scene.replace(path=path)
    assert np.ptp(still(scene).board, axis=0).max() == 0
    moved = rigid(scene).board - rigid(scene).board[0]
    np.testing.assert_allclose(moved[[3, 4, 24], 2], [0.0, 0.0, 0.010], atol=1e-9)
    np.testing.assert_allclose(moved[:, [0, 1, 4, 5]], 0, atol=1e-9)


def test_the_noise_floor_starts_beside_and_flat() -> None:
    track = draw_interaction(5, 1).track
    again = simulate_lever_again(track.scene, np.random.default_rng(0))
    start = pose_3d.relative(track.board[0], again.board[0])
    assert 1e-5 < np.hypot(*start[:2]) < 5e-3
    assert abs(start[2]) < 1e-9
    np.testing.assert_allclose(start[4:6], 0, atol=1e-9)


def test_the_suite_has_a_row_for_every_selection() -> None:
    results, cases = evaluate_lever_up(1, 1_000_000, {})
    assert [case.side for case in cases] == ["east", "north", "west", "south"]
    rows = {
        (row["model"], row["metric"], row["subset"], row["side"], row["ledge"]): row["value"] for row in results.rows
    }
    assert len(rows) == len(results.rows) == 3 * 3 * 2 * 7
    finals = [1e3 * case.errors["rigid"].final_position for case in cases]
    assert rows["rigid", "final_position_error_mm", "all", "all", "all"] == pytest.approx(np.median(finals))
    north = 1e3 * cases[1].errors["still"].final_position
    assert rows["still", "final_position_error_mm", "all", "north", "all"] == pytest.approx(north)
    assert all(row["interactions"] == 500 for row in results.rows)
    with pytest.raises(EvaluationError, match="training"):
        evaluate_lever_up(1, 0, {})


@pytest.mark.slow
def test_the_command_shows_boards_beside_the_truth(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["evaluate", "lever-up", "--count", "1", "--workers", "1", "--out", str(tmp_path)])
    assert exit_.value.code == 0
    printed = capsys.readouterr().out
    assert all(group in printed for group in ("east side", "south side", "with a ledge", "without"))
    names = {one.name for one in tmp_path.iterdir()}
    assert names == {"results.json", "median.png", "median.gif", "largest.png", "largest.gif"}
    rows = json.loads((tmp_path / "results.json").read_text())["rows"]
    (network,) = (
        row["value"]
        for row in rows
        if row["model"] == "lever_up"
        and (row["metric"], row["subset"], row["side"], row["ledge"])
        == ("final_position_error_mm", "all", "all", "all")
    )
    assert network < 1
    assert {row["interactions"] for row in rows} == {500}
