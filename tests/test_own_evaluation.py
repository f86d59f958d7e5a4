"""Evaluation on own data, of own checkpoints and in own setups; results that are kept are those of what they say."""

import json
import logging
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import body, workshop

import pushgraph as pg
from pushgraph.checkpoint import shipped
from pushgraph.cli import main
from pushgraph.errors import EvaluationError, OwnModuleError
from pushgraph.evaluation import kept, physics
from pushgraph.evaluation.blocks import numbers_of
from pushgraph.evaluation.coupled import evaluate_coupled
from pushgraph.evaluation.figures import save_histogram
from pushgraph.evaluation.masses import evaluate_masses
from pushgraph.evaluation.physics import evaluate_physics
from pushgraph.own_modules import VARIABLE, use
from pushgraph.track import Track

SEED = 1_000_000
SETUP = '''"""A setup of one's own: a cup, pushed once."""

import pushgraph as pg
from pushgraph.simulation.plan import Plan


def cups(rng, objects, index):
    cups = tuple(
        pg.Body(name=f"cup{k}", shape=pg.Cylinder(diameter=0.1), pose_world_from_body=(0.2 * k, 0.0, 0.0), mass=0.5)
        for k in range(objects)
    )
    push = pg.Push(start=(-0.2, float(rng.uniform(-0.02, 0.02))), end=(0.0, 0.0))
    return Plan(pg.Scene(bodies=cups, pushes=(push,)), "dense", None)


pg.register_setup("cups", cups)
'''


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    return int(stop.value.code or 0)


def rows(out: Path, **labels) -> list[dict]:
    content = json.loads((out / "results.json").read_text())["rows"]
    return [row for row in content if labels.items() <= row.items()]


@pytest.fixture(scope="module")
def own(tmp_path_factory) -> Path:
    """Two tracks: of four bodies, and of a single one, as if recorded without a sensor."""
    push = pg.Push(start=(-0.2, 0.0), end=(-0.02, 0.01))
    alone = pg.Scene(bodies=(body("cup", 0.0, 0.0),), pushes=(push,), tool=pg.Tool.round(0.05))
    tracks = [pg.simulate(workshop()), pg.simulate(alone)]
    felt_nothing = [Track(track.scene, track.times, track.poses, track.push, track.seen) for track in tracks]
    return pg.write_dataset(felt_nothing, tmp_path_factory.mktemp("own") / "own.h5")


@pytest.fixture
def short(monkeypatch) -> None:
    """Rollouts of 30 frames alone."""
    monkeypatch.setattr(physics, "HORIZONS", (30, 31))
    monkeypatch.setattr(save_histogram, "__defaults__", ((30,),))


def test_several_of_one_s_own_stand_side_by_side_on_own_data(own: Path, tmp_path: Path, capsys, short) -> None:
    contact = str(shipped("contact"))
    models = ["--model", f"mine={contact}", "--model", "contact", "--model", f"other={contact}"]
    assert run("evaluate", "physics", "--data", str(own), *models, "--workers", "1", "--out", str(tmp_path)) == 0
    told = rows(tmp_path, metric="mean_error_cm", frames=30, density="all", objects=4)
    assert [row["model"] for row in told] == ["still", "mine", "contact", "other", "noise_floor"]
    values = {row["model"]: row["value"] for row in told}
    assert values["mine"] == values["contact"] == values["other"] < 0.3 < values["still"]
    assert values["noise_floor"] is not None  # its pushes are known, so the simulator can be asked
    assert {row["objects"] for row in rows(tmp_path)} == {1, 4}
    assert {row["density"] for row in rows(tmp_path)} == {"all"}
    protocol = json.loads((tmp_path / "results.json").read_text())["protocol"]
    assert (protocol["data"], protocol["recipe"]["setup"], protocol["count"]) == ("own.h5", "own", 2)
    assert (tmp_path / "histogram.png").stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert "Rollouts, 1 objects" in printed
    assert " mine " in printed


@pytest.mark.slow
def test_data_of_a_setup_gives_the_numbers_of_the_setup(tmp_path: Path, short) -> None:
    path = pg.generate("multiple-parts", objects=2, count=2, seed=SEED, out=tmp_path / "data.h5")
    drawn, _ = evaluate_physics([2], 2, SEED, {"contact": "contact"})
    read, _ = evaluate_physics([], None, SEED, {"contact": "contact"}, data=path)
    assert [row["density"] for row in drawn.rows] == [row["density"] for row in read.rows]
    for one, other in zip(drawn.rows, read.rows, strict=True):
        if one["model"] != "noise_floor":  # the floor starts a rounding beside
            assert other["value"] == pytest.approx(one["value"], abs=2e-3), one


@pytest.mark.slow
def test_beliefs_are_measured_on_own_data_whose_joints_are_known(own: Path, tmp_path: Path) -> None:
    models = ["--model", f"mine={shipped('belief')}", "--model", "belief"]
    assert run("evaluate", "belief", "--data", str(own), *models, "--workers", "1", "--out", str(tmp_path)) == 0
    told = rows(tmp_path, metric="accuracy", observed_frames=200, pairs="all", noise="none", joint="all")
    assert [(row["model"], row["objects"]) for row in told] == [("mine", 4), ("belief", 4), ("informed", 4)]
    assert told[0]["value"] == told[1]["value"]
    results, _ = evaluate_coupled([], None, 0, {"contact": "contact", "belief": "belief"}, data=own)
    errors = {row["model"]: row["value"] for row in results.rows if row["observed_frames"] == 0}
    assert errors["oracle"] < errors["no_joint"]
    results, _ = evaluate_masses([], None, 0, {"belief": "belief"}, data=own)
    assert {row["input"] for row in results.rows} == {"motion"}


@pytest.mark.parametrize(
    ("suite", "says"),
    [
        ("controlled-masses", "it compares beliefs with simulations of every ratio of masses"),
        ("tools", "it makes its own pushes"),
        ("clutter", "it makes its own pushes"),
        ("lever-up", "boards are levered from the four sides of drives that it draws itself"),
    ],
)
def test_suites_that_cannot_use_data_say_why(suite: str, says: str, own: Path, capsys) -> None:
    assert run("evaluate", suite, "--data", str(own)) == 1
    assert f"--data: this suite cannot measure on a dataset: {says}" in capsys.readouterr().err


def test_data_that_does_not_serve_is_refused_in_words(own: Path, tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"own\.h5: no trajectory of 3 objects; valid: 1, 4"):
        numbers_of([3], own)
    with pytest.raises(EvaluationError, match="objects: this suite needs 2 in a scene at least, got 1"):
        evaluate_masses([1], 1, SEED, {})
    alone = pg.Scene(bodies=(body("cup", 0, 0, mass=None),), pushes=(pg.Push(start=(-0.2, 0), end=(-0.1, 0)),))
    light = pg.write_dataset([pg.load().predict(alone)], tmp_path / "light.h5")
    with pytest.raises(EvaluationError, match="no trajectory of 2 objects or more, which this suite needs"):
        evaluate_masses([], None, 0, {}, data=light)
    unknown = workshop().replace(bodies=tuple(one.replace(mass=None) for one in workshop().bodies))
    unweighed = pg.write_dataset([pg.load().predict(unknown)], tmp_path / "unweighed.h5")
    with pytest.raises(EvaluationError, match="body 'plate': its true mass is not known"):
        evaluate_masses([], None, 0, {}, data=unweighed)


@pytest.fixture
def setup_file(tmp_path: Path, monkeypatch):
    """A file that registers a setup; nothing of it is left afterwards."""
    file = tmp_path / "own_cups.py"
    file.write_text(SETUP)
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("pushgraph.simulation.setups.SETUPS", {"multiple-parts": None})
    yield file
    sys.modules.pop("own_cups", None)


def test_own_setups_are_evaluated_by_command(setup_file: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    evaluate = ("evaluate", "physics", "--setup", "cups", "--objects", "2", "--count", "1", "--model", "contact")
    assert run(*evaluate, "--workers", "1", "--out", str(out)) == 1
    assert "setup 'cups': there is none of this name; valid: multiple-parts" in capsys.readouterr().err
    assert run("--import", str(setup_file), *evaluate, "--workers", "1", "--out", str(out)) == 0
    assert rows(out, model="contact", metric="mean_error_cm", frames=30, density="all")[0]["value"] < 0.5
    assert json.loads((out / "results.json").read_text())["protocol"]["setup"] == "cups"


@pytest.mark.slow
def test_processes_that_are_started_know_the_own_setup(setup_file: Path, tmp_path: Path) -> None:
    generate = ("generate", "cups", "--objects", "1", "--count", "16", "--workers", "2")
    assert run("--import", str(setup_file), *generate, "--out", str(tmp_path / "cups.h5")) == 0


def test_files_that_cannot_be_imported_are_named(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    broken, late, text = (tmp_path / name for name in ("own_broken.py", "json.py", "own.txt"))
    broken.write_text("1 / 0")
    late.write_text("")
    text.write_text("")
    for file, says in (
        (broken, "own_broken.py: cannot be imported: ZeroDivisionError: division by zero"),
        (late, "there is a module 'json' already; rename the file"),
        (text, "it is no Python file"),
        (tmp_path / "nothing.py", "it is no Python file"),
    ):
        with pytest.raises(OwnModuleError, match=says):
            use([str(file)])


def test_what_is_kept_is_used_for_what_it_stands_for_alone(tmp_path: Path, caplog) -> None:
    path, poses = tmp_path / "kept.npz", np.arange(6.0).reshape(2, 3)
    same = kept.fingerprint("weights", 3, poses)
    assert same == kept.fingerprint("weights", 3, poses.copy()) != kept.fingerprint("weights", 4, poses)
    assert kept.kept(path, same) is None
    assert not caplog.records
    kept.keep(path, same, {"poses": poses})
    (found,) = kept.kept(path, same).values()
    np.testing.assert_array_equal(found, poses)
    content = path.read_bytes()
    for damaged, says in (
        (content[:200] + bytes([content[200] ^ 1]) + content[201:], "damaged"),
        (content[:-50], "damaged"),
        (b"", "damaged"),
    ):
        path.write_bytes(damaged)
        with caplog.at_level(logging.WARNING):
            assert kept.kept(path, same) is None
        assert says in caplog.text
        assert "it is made anew" in caplog.text
        caplog.clear()
    path.write_bytes(content)
    assert kept.kept(path, kept.fingerprint("other")) is None
    assert "stands for something else; it is made anew" in caplog.text
