"""The commands of `pushgraph evaluate` for suites of the user's own."""

from pathlib import Path
from typing import Any

import typer
from rich.table import Table
from typer.core import TyperGroup

from pushgraph.cli.output import console
from pushgraph.cli.suites import (
    CORES,
    Count,
    Models,
    Objects,
    Out,
    Seed,
    Workers,
    measure,
    models_of,
    numbers_of,
    say_written,
)
from pushgraph.report.registry import SUITES, Suite
from pushgraph.report.tables import table_of


class SuiteGroup(TyperGroup):
    """The shipped suites, and those that `--import` has registered by the time that one is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all suites."""
        return [*super().list_commands(ctx), *SUITES]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command that measures a suite, or None."""
        own = SUITES.get(cmd_name)
        return super().get_command(ctx, cmd_name) if own is None else command_of(cmd_name, own)


def command_of(name: str, suite: Suite) -> Any:
    """The command that measures a suite, writes its results and prints its tables."""

    def run(
        count: Count = None,
        seed: Seed = 1_000_000,
        out: Out = Path(f"evaluation-{name}"),
        objects: Objects = None,
        model: Models = None,
        workers: Workers = CORES,
    ) -> None:
        models = models_of(model, suite.models)
        results, _ = measure(
            lambda *asked: (suite.measure(*asked), None), numbers_of(objects), count, seed, models, workers
        )
        tables = [table_of(view, results.rows) for view in suite.experiment.views]
        results.save(out / "results.json")
        for told in tables:
            table = Table(*told.head, title=told.title)
            for cells in told.cells:
                table.add_row(*cells)
            console.print(table)
        say_written(out)

    app = typer.Typer(add_completion=False)
    app.command(name, help=f"{suite.experiment.title}.")(run)
    return typer.main.get_command(app)
