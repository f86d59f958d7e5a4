"""The report: tables of rows, one page that needs no other file, results that are reused only where they may be."""

import itertools
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import browser, opened
from matplotlib.figure import Figure

from pushgraph.cli import main
from pushgraph.errors import ReportError
from pushgraph.report import making, suites
from pushgraph.report.experiments import EXPERIMENTS, SIZES
from pushgraph.report.suites import Origin, run_or_reuse
from pushgraph.report.tables import View, table_of

ROWS = [
    {"model": "contact", "metric": "error_cm", "value": 0.123, "low": 0.1, "high": 0.2, "frames": 30, "objects": 9},
    {"model": "contact", "metric": "share", "value": 0.5, "low": 0.4, "high": 0.6, "frames": 30, "objects": 9},
    {"model": "contact", "metric": "error_cm", "value": 9.0, "low": 8.0, "high": 10.0, "frames": 300, "objects": 9},
    {"model": "all_fixed", "metric": "error_cm", "value": 2.0, "low": 1.0, "high": 3.0, "frames": 30, "objects": 9},
    {"model": "no_number", "metric": "error_cm", "value": None, "low": None, "high": None, "frames": 30, "objects": 9},
]


def test_a_table_shows_the_rows_that_are_asked_for_and_leaves_out_lines_without_numbers() -> None:
    view = View("Errors", ("objects", "model"), {"error (cm)": "error_cm", "share": "share"}, {"frames": (30,)})
    table = table_of(view, ROWS)
    assert table.head == ("objects", "model", "error (cm)", "share")
    assert table.cells == [
        ("9", "contact", "0.12 (0.10, 0.20)", "0.50 (0.40, 0.60)"),
        ("9", "all fixed", "2.00 (1.00, 3.00)", ""),
    ]


@pytest.mark.parametrize(
    ("view", "says"),
    [
        (View("Errors", ("model",), {"error (cm)": "eror_cm"}), "metric is 'eror_cm'; there are: error_cm, share"),
        (View("Errors", ("model",), {"error (cm)": "error_cm"}, {"frames": (30, 50)}), "frames is 50; there are: 30"),
    ],
)
def test_a_table_of_what_no_row_holds_is_refused(view, says) -> None:
    with pytest.raises(ReportError, match=says):
        table_of(view, ROWS)


class Sources(HTMLParser):
    """Everything that a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tables = 0

    def handle_starttag(self, tag, attrs) -> None:
        self.tables += tag == "table"
        self.found += [value for name, value in attrs if name in ("src", "href")]


def rows_shown(name: str) -> list[dict]:
    """A row for all that the tables of an experiment ask for."""
    views = [view for experiment in EXPERIMENTS if experiment.name == name for view in experiment.views]
    return [
        {"model": "contact", "metric": metric, "value": 1.0, "low": 0.0, "high": 2.0}
        | dict(zip(view.where, labels, strict=True))
        for view in views
        for labels in itertools.product(*view.where.values())
        for metric in view.columns.values()
    ]


@pytest.fixture
def measured(monkeypatch) -> list[list[str]]:
    """Suites that write the same rows and an empty figure at once; lists what was run."""
    ran: list[list[str]] = []

    def run(arguments, folder: Path, output) -> float:
        ran.append(list(arguments))
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "results.json").write_text(json.dumps({"rows": [*ROWS, *rows_shown(folder.name)]}))
        for experiment in EXPERIMENTS:
            for figure in experiment.figures:
                Figure((1, 1)).savefig(folder / figure)
        return 1.5

    monkeypatch.setattr(suites, "_run", run)
    return ran


def test_the_page_holds_every_experiment_and_loads_nothing(measured, tmp_path) -> None:
    markdown, page = making.make_report(tmp_path, "quick")
    text = page.read_text()
    sources = Sources()
    sources.feed(text)
    pictures = [source for source in sources.found if source.startswith("data:image/png;base64,")]
    assert len(pictures) == sum(len(experiment.figures) for experiment in EXPERIMENTS)
    assert {*sources.found} - {*pictures} == {"replays/demo.html", "replays/lever-up.html"}
    assert (tmp_path / "replays" / "demo.html").stat().st_size > 100_000
    assert sources.tables >= 1
    for experiment, arguments in zip(EXPERIMENTS, measured, strict=True):
        assert f"<h2>{experiment.title}</h2>" in text
        assert " ".join(arguments) in text
    named = re.findall(r"!\[.*\]\((.*)\)", markdown.read_text())
    assert named
    assert all((tmp_path / name).is_file() for name in named)


@pytest.mark.slow
def test_the_page_is_whole_in_a_real_browser_without_a_network(measured, tmp_path) -> None:
    _, page = making.make_report(tmp_path, "quick")
    with browser() as chromium, opened(chromium, page, shows="table", color_scheme="dark") as seen:
        sizes = seen.page.eval_on_selector_all("img", "pictures => pictures.map(picture => picture.naturalWidth)")
        assert all(size > 0 for size in sizes)
        wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert seen.page.evaluate(wide) <= 0
        assert len(seen.page.screenshot(full_page=True)) > 20_000
        assert not seen.errors
        assert not seen.requests


def test_results_are_reused_only_of_the_same_command_code_and_weights(measured, tmp_path, monkeypatch) -> None:
    arguments = ("evaluate", "coupled", "--count", "1")
    first = run_or_reuse(arguments, tmp_path)
    again = run_or_reuse(arguments, tmp_path)
    assert first == again
    assert len(measured) == 1
    run_or_reuse((*arguments, "--seed", "1000001"), tmp_path)
    assert len(measured) == 2
    monkeypatch.setattr(suites, "digest_of_code", lambda: "other")
    run_or_reuse((*arguments, "--seed", "1000001"), tmp_path)
    assert len(measured) == 3
    monkeypatch.setattr(suites, "hashes_of_weights", lambda: {"contact": "other"})
    made = run_or_reuse((*arguments, "--seed", "1000001"), tmp_path)
    assert len(measured) == 4
    assert made.origin.weights == {"contact": "other"}
    (tmp_path / suites.MADE).write_text("{")
    run_or_reuse((*arguments, "--seed", "1000001"), tmp_path)
    assert len(measured) == 5


def test_what_results_come_from_names_code_weights_and_command() -> None:
    origin = Origin.of(("evaluate", "physics"))
    assert origin.command == "pushgraph evaluate physics"
    assert "contact" in origin.weights
    assert re.fullmatch("[0-9a-f]{16}", origin.code)


def test_a_suite_that_fails_is_told_with_its_last_words_and_leaves_no_results(tmp_path) -> None:
    with pytest.raises(ReportError, match="evaluate no-such-suite"):
        run_or_reuse(("evaluate", "no-such-suite"), tmp_path)
    assert not (tmp_path / suites.MADE).exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [(["--only", "phyics"], "no experiment 'phyics'; valid: physics"), (["--quick", "--full"], "not both")],
)
def test_what_cannot_be_reported_is_refused(options, says, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["report", "--out", str(tmp_path), *options])
    assert exit_.value.code
    assert says in " ".join(capsys.readouterr().err.replace("│", "").split())
    assert not list(tmp_path.iterdir())


def test_every_experiment_has_every_size_and_figures_of_its_own() -> None:
    names = [experiment.name for experiment in EXPERIMENTS]
    assert len(set(names)) == len(names)
    for experiment in EXPERIMENTS:
        assert set(experiment.counts) == set(SIZES)
        counts = [int(options[options.index("--count") + 1]) for options in map(experiment.counts.get, SIZES)]
        assert np.all(np.diff(counts) >= 0)


@pytest.mark.slow
def test_a_quick_report_of_one_experiment_is_made_of_its_own_numbers(tmp_path) -> None:
    markdown, _ = making.make_report(tmp_path, "quick", only=("coupled-masses",))
    rows = json.loads((tmp_path / "coupled-masses" / "results.json").read_text())["rows"]
    first = next(row for row in rows if (row["model"], row["observed_frames"]) == ("oracle", 0))
    assert f"{first['value']:.2f} ({first['low']:.2f}, {first['high']:.2f})" in markdown.read_text()
