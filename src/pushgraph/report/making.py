"""Making a report: every experiment's results, then the page."""

import platform
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from pushgraph.cores import usable_cores
from pushgraph.errors import ReportError
from pushgraph.report.experiments import SIZES, Experiment
from pushgraph.report.page import Picture, Section, lines_of, markdown, save_page
from pushgraph.report.registry import all_experiments
from pushgraph.report.replays import save_replays
from pushgraph.report.suites import Made, hashes_of_weights, run_or_reuse
from pushgraph.report.tables import Table, table_of

TITLE = "pushgraph: every experiment, measured"
PAPER = (
    "A. E. Tekden, A. Erdem, E. Erdem, T. Asfour and E. Ugur: *Object and Relation Centric Representations for Push "
    "Effect Prediction* (2021)"
)


def make_report(
    out: Path,
    size: str = "normal",
    only: Sequence[str] = (),
    workers: int = 1,
    begin: Callable[[Experiment], None] = lambda experiment: None,
    output: Callable[[str], None] = lambda line: None,
) -> tuple[Path, Path]:
    """Run or reuse the experiments, and write `report.md` and `report.html` into `out`; returns both.

    only: names of experiments; all by default. Raises ReportError if there is no such size or experiment, or one fails.
    """
    if size not in SIZES:
        raise ReportError(f"no size {size!r}; valid: {', '.join(SIZES)}")
    experiments = all_experiments()
    names = [experiment.name for experiment in experiments]
    if unknown := [name for name in only if name not in names]:
        raise ReportError(f"no experiment {unknown[0]!r}; valid: {', '.join(names)}")
    sections, seconds = [], 0.0
    for experiment in experiments:
        if only and experiment.name not in only:
            continue
        begin(experiment)
        arguments = (*experiment.command, *experiment.counts[size], "--workers", str(workers))
        made = run_or_reuse(arguments, out / experiment.name, output)
        seconds += made.seconds
        sections.append(section_of(experiment, made))
    if not only:
        sections.append(_replays(out))
    return save_page(markdown(TITLE, _introduction(size, seconds), sections, out), out)


def section_of(experiment: Experiment, made: Made) -> Section:
    """What the page says of one experiment."""
    pictures = [Picture(made.folder / file, shows) for file, shows in experiment.figures.items()]
    text = (f"> **The paper:** {experiment.paper}", f"Made by `{made.origin.command}` in {made.seconds:,.0f} s.")
    tables = [table_of(view, made.rows) for view in experiment.views]
    return Section(experiment.title, text, [table for table in tables if table.cells], pictures)


def _replays(out: Path) -> Section:
    pages = save_replays(out / "replays")
    links = [f"- [{shows}]({page.relative_to(out)})" for shows, page in pages.items()]
    text = (
        "Predicted, and simulated as ghosts; each page replays in a browser without Python and without network.",
        "\n".join(links),
    )
    return Section("Replays", text)


def _introduction(size: str, seconds: float) -> list[str]:
    hashes: list[tuple[str, ...]] = [(name, f"`{digest}`") for name, digest in hashes_of_weights().items()]
    weights = Table("Weights", ("name", "SHA-256"), hashes)
    packages = ", ".join(f"{name} {version(name)}" for name in ("pushgraph", "torch", "mujoco", "numpy", "numba"))
    machine = f"{platform.machine()}, {usable_cores()} cores, {platform.system()}, Python {platform.python_version()}"
    return [
        f"The experiments of {PAPER} and what came after, measured on the weights of this installation. Every number "
        "below comes from the command that stands beside it; test scenes were never trained on.",
        f"Size `{size}`, {seconds / 60:,.0f} min of computing. {packages}. {machine}.",
        "Weights, by the beginning of their file's SHA-256:",
        lines_of(weights),
    ]
