"""What the commands print with."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

console = Console()
BAR = (
    TextColumn("{task.description}", markup=False),
    BarColumn(),
    MofNCompleteColumn(),
    TimeElapsedColumn(),
    TextColumn("left"),
    TimeRemainingColumn(),
)


def check_choice(option: str, value: str, valid: Sequence[str]) -> None:
    """Refuse an option's value that is none of the valid ones."""
    if value not in valid:
        raise typer.BadParameter(f"{value!r}; valid: {', '.join(valid)}", param_hint=f"--{option}")


def say_files(paths: Iterable[Path]) -> None:
    """Tell which files were written."""
    console.print("Written: " + ", ".join(str(path) for path in paths), soft_wrap=True, markup=False)
