"""What the commands print with."""

from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

console = Console()
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""
BAR = (
    TextColumn("{task.description}", markup=False),
    BarColumn(),
    MofNCompleteColumn(),
    TimeElapsedColumn(),
    TextColumn("left"),
    TimeRemainingColumn(),
)


def warn(sentences: Iterable[str]) -> None:
    """Print what is assumed, or doubtful, a line each."""
    for sentence in sentences:
        console.print(f"Note: {sentence}", style="yellow", soft_wrap=True, markup=False, highlight=False)


def say_files(paths: Iterable[Path]) -> None:
    """Tell which files were written."""
    console.print("Written: " + ", ".join(str(path) for path in paths), soft_wrap=True, markup=False)
