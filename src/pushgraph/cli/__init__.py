"""The command `pushgraph`."""

import importlib.metadata
import sys
import warnings
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from pushgraph import own_modules
from pushgraph.cli import (
    adapting,
    comparing,
    data,
    evaluating,
    evaluating_lever,
    evaluating_masses,
    evaluating_plans,
    evaluating_real,
    evaluating_recordings,
    filming,
    planning,
    recordings,
    reporting,
    scenes,
    training,
    viewing,
)
from pushgraph.cli.output import console
from pushgraph.errors import AssumptionWarning, PushGraphError

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
for command in (
    comparing.demo,
    comparing.compare,
    scenes.predict,
    recordings.observe,
    recordings.track,
    scenes.simulate,
    filming.film,
    data.generate,
    adapting.adapt,
    viewing.view,
    reporting.report,
):
    app.command()(command)
# A goal's yaw follows its --goal, and may be negative: not to be taken for an option.
app.command(context_settings={"ignore_unknown_options": True})(planning.plan)
app.add_typer(training.app, name="train")
for suites in (evaluating_lever, evaluating_masses, evaluating_plans, evaluating_real, evaluating_recordings):
    for name, measure in suites.COMMANDS.items():
        evaluating.app.command(name)(measure)
app.add_typer(evaluating.app, name="evaluate")


def _say_version(wanted: bool | None) -> None:
    if wanted:
        console.print(f"pushgraph {importlib.metadata.version('pushgraph')}", highlight=False)
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool | None, typer.Option("--version", callback=_say_version, is_eager=True, help="Show the version and exit.")
    ] = None,
    own: Annotated[
        list[Path] | None,
        typer.Option(
            "--import",
            help="Python files that register networks, setups and suites of your own; again. They are run.",
            show_default=f"those in {own_modules.VARIABLE}",
        ),
    ] = None,
) -> None:
    """See what a push will do: scenes of pushed objects, simulated, predicted and learned from.

    Exit status: 0 if all went well, 1 if something cannot be done as asked, 2 if a command or an option is not written
    as `--help` says, 130 if it was interrupted.
    """
    own_modules.use([str(path) for path in own or ()])


def main(arguments: list[str] | None = None) -> None:
    """Run the command; our errors become a message and exit status 1."""
    # What is assumed is printed by the commands.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AssumptionWarning)
            app(arguments)
    except PushGraphError as error:
        message = str(error).encode(errors="backslashreplace").decode()  # names of files need be no text
        Console(stderr=True, soft_wrap=True).print(f"[bold red]Error:[/] {escape(message)}", highlight=False)
        sys.exit(1)
