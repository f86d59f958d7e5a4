"""Suites of one's own: registered once, measured by a command of their own, shown in the report."""

import json
from collections.abc import Iterator

import numpy as np
import pytest

import pushgraph as pg
from pushgraph.cli import main
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.results import Results
from pushgraph.report.registry import SUITES, all_experiments
from pushgraph.report.suites import digest_of_code
from pushgraph.report.tables import View

VIEW = View("What was asked", ("objects", "model"), {"seed": "seed"})


def measure(objects, count, seed, models, workers, progress) -> Results:
    """Rows that tell what was asked for."""
    results = Results("asked", {"count": count, "models": dict(models)}, ("objects",))
    for number in objects:
        for model in models:
            results.add(model, "seed", "1", np.full(count, float(seed)), np.arange(count), objects=number)
    progress(count * len(objects))
    return results


@pytest.fixture
def asked() -> Iterator[None]:
    pg.register_suite("asked", measure, ("contact",), (VIEW,), "What is asked for")
    yield
    SUITES.clear()


def test_a_suite_is_measured_by_a_command_that_tells_it_what_was_asked(asked, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["evaluate", "asked", "--count", "3", "--seed", "1000007", "--objects", "4", "--out", str(tmp_path)])
    assert stop.value.code == 0
    assert "1000007.00 (1000007.00, 1000007.00)" in capsys.readouterr().out
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["protocol"] == {"count": 3, "models": {"contact": "contact"}}
    assert [(row["model"], row["objects"], row["value"]) for row in content["rows"]] == [("contact", 4, 1_000_007)]


def test_a_suite_is_listed_and_stands_in_the_report_last(asked, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    assert "What is asked for." in capsys.readouterr().out
    *shipped, own = all_experiments()
    assert (own.name, own.command, own.counts["full"]) == ("asked", ("evaluate", "asked"), ("--count", "200"))
    SUITES.clear()
    assert all_experiments() == tuple(shipped)


@pytest.mark.parametrize("name", ["physics", "real", "asked"])
def test_names_are_taken_once(asked, name) -> None:
    with pytest.raises(EvaluationError, match=f"'{name}': there is a suite of this name already"):
        pg.register_suite(name, lambda *_: Results("other", {}, ()), ("contact",), (VIEW,), "Another")


@pytest.mark.parametrize("name", ["", "Own", "my suite", "--help"])
def test_a_name_that_no_command_can_have_is_refused(name) -> None:
    with pytest.raises(EvaluationError, match="a name is of small letters, digits and -"):
        pg.register_suite(name, measure, ("contact",), (VIEW,), "Another")


def test_results_are_of_the_user_s_own_files_too(tmp_path, monkeypatch) -> None:
    own = tmp_path / "own.py"
    own.write_text("LIMIT = 1\n")
    shipped = digest_of_code()
    monkeypatch.setenv("PUSHGRAPH_IMPORT", str(own))
    first = digest_of_code()
    own.write_text("LIMIT = 2\n")
    assert len({shipped, first, digest_of_code()}) == 3
