"""The command `pushgraph report`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pushgraph.cli.output import console
from pushgraph.cli.suites import CORES, Workers

if TYPE_CHECKING:
    from pushgraph.report.experiments import Experiment


def report(
    out: Annotated[Path, typer.Option(help="Folder for the page and the results of every suite.")] = Path("report"),
    quick: Annotated[bool, typer.Option("--quick", help="A few scenes of each: some minutes.")] = False,
    full: Annotated[bool, typer.Option("--full", help="As many scenes as the paper: a night.")] = False,
    only: Annotated[list[str] | None, typer.Option(help="Of these experiments alone; again.")] = None,
    workers: Workers = CORES,
) -> None:
    """Run every experiment and write one page with all tables and figures, as HTML and Markdown.

    What was measured before in the same folder, by the same code, weights and command, is taken from there.

    Examples:

    `pushgraph report --quick --out report`

    `pushgraph report --only physics --only lever-up`
    """
    from pushgraph.report.making import make_report

    if quick and full:
        raise typer.BadParameter("a report is quick or full, not both", param_hint="--quick, --full")
    size = "quick" if quick else "full" if full else "normal"
    with console.status("") as status:

        def begin(experiment: "Experiment") -> None:
            status.update(f"{experiment.name}: {experiment.title}")
            console.print(f"{experiment.name}: {experiment.title}", highlight=False)

        pages = make_report(out, size, only or (), workers, begin)
    console.print(f"Written: {', '.join(map(str, pages))}", soft_wrap=True, markup=False)
