import json
from pathlib import Path

import numpy as np
import pytest
from made_pushes import made, rows_of, write
from typer.testing import CliRunner

from pushgraph.adaptation.unknowns import Unknowns
from pushgraph.cli import app
from pushgraph.errors import EvaluationError
from pushgraph.evaluation import real_splits
from pushgraph.evaluation.real import LABELS, errors_of, evaluate_real, spread_out
from pushgraph.evaluation.real_splits import jobs_of
from pushgraph.evaluation.repeatability import repeatability, repeated
from pushgraph.real_pushes import read_pushes


def test_errors_are_distances_in_mm_and_turns_in_degrees() -> None:
    found = errors_of(np.array([[0.003, 0.004, 3.1]]), np.array([[0.0, 0.0, -3.1]]))
    np.testing.assert_allclose(found, [[5.0, np.degrees(2 * np.pi - 6.2)]])


def test_pushes_done_twice_tell_what_repeats(tmp_path: Path) -> None:
    rows = rows_of(6, "box")
    pushes = read_pushes(*write(tmp_path, rows + [dict(row) for row in rows[:2]]))
    pushes.after[6, :2] += [0.002, 0.0]
    pairs = repeated(pushes)
    assert pairs.tolist() == [[0, 6], [1, 7]]
    np.testing.assert_allclose(repeatability(pushes, pairs)[:, 0], [2 / np.sqrt(2), 0], atol=1e-9)


def test_the_suite_measures_every_model(tmp_path: Path) -> None:
    data, outlines = made(tmp_path, {"box": 12, "disc": 8}, Unknowns(0.2))
    results, measures = evaluate_real(data, outlines, simulated=2)
    everything = {
        (row["model"], row["metric"]): row for row in results.rows if all(row[name] in ("all", 0) for name in LABELS)
    }
    assert everything["zero_shot", "position_error_mm"]["value"] < 0.01
    assert everything["zero_shot", "coverage_68"]["value"] == 1
    assert everything["mujoco", "position_error_mm"]["value"] < 1.5
    motion = 1e3 * np.hypot(*measures.pushes.motion[:, :2].T).mean()
    assert everything["still", "position_error_mm"]["value"] == pytest.approx(motion)
    assert everything["floor", "position_error_mm"]["value"] is None
    shapes = {row["shape"] for row in results.rows}
    assert shapes == {"all", "box", "disc"}
    assert {row["speed"] for row in results.rows} == {"all", 20.0}
    few, _ = evaluate_real(data, outlines, count=6, simulated=1)
    assert few.protocol["count"] == 6


def test_pushes_are_spread_over_materials(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(9, "box") + rows_of(2, "disc")))
    assert spread_out(pushes, 3).tolist() == [0, 4, 8, 9, 10]


def test_splits_leave_out_what_they_ask(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(60, "box") + rows_of(40, "disc")))
    jobs = jobs_of(pushes, 0, "contact", tmp_path)
    assert all(not set(job.learnt_from) & set(job.asked) for job in jobs)
    assert {len(job.learnt_from) for job in jobs if job.split == "push"} == {10, 30}
    for job in jobs:
        if job.split == "shape":
            assert not set(pushes.shape[job.learnt_from]) & set(pushes.shape[job.asked])
    assert [job.asked.tolist() for job in jobs] == [job.asked.tolist() for job in jobs_of(pushes, 0, "x", tmp_path)]
    with pytest.raises(EvaluationError, match="too few pushes to split.*the most are 20"):
        jobs_of(pushes.take(np.arange(20)), 0, "contact", tmp_path)


def test_the_commands_adapt_and_evaluate(tmp_path: Path) -> None:
    data, outlines = map(str, made(tmp_path, {"box": 30}, Unknowns(0.1, 0.4), noise=2e-4))
    learnt, out = tmp_path / "learnt.safetensors", tmp_path / "out"
    given = ["--data", data, "--outlines", outlines]
    told = CliRunner().invoke(app, ["adapt", *given, "--out", str(learnt)])
    assert told.exit_code == 0, told.output
    assert "side friction 0.1" in " ".join(told.output.split())
    assert not list(tmp_path.glob("*.partial*"))
    more = ["--adaptation", str(learnt), "--out", str(out), "--workers", "1", "--simulated", "1"]
    told = CliRunner().invoke(app, ["evaluate", "real", *given, *more])
    assert told.exit_code == 0, told.output
    rows = json.loads((out / "results.json").read_text())["rows"]
    means = {
        row["model"]: row["value"]
        for row in rows
        if row["metric"] == "position_error_mm" and all(row[name] in ("all", 0) for name in LABELS)
    }
    assert means["adapted"] < 0.5 * means["zero_shot"]
    assert (out / "shapes.png").is_file()


def test_splits_of_other_pushes_or_seeds_are_not_taken_for_these(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = []
    monkeypatch.setattr(real_splits, "jobs_of", lambda *arguments: folders.append(arguments[3]) or [])
    pushes = read_pushes(*write(tmp_path, rows_of(30, "box")))
    for some, seed in ((pushes, 0), (pushes, 0), (pushes, 1), (pushes.take(np.arange(29)), 0)):
        real_splits.evaluate_splits(some, seed, folder=tmp_path)
    assert folders[0] == folders[1]
    assert len(set(folders)) == 3
