"""How a training goes, on the console: a bar with the time left, what the log says, at the end a table."""

import sys
from typing import TYPE_CHECKING

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from pushgraph.cli.output import console
from pushgraph.training.recipe import Training

if TYPE_CHECKING:
    from pushgraph.training import running


class TrainingReport:
    """Tells how a training goes. It is sent to the process that leads before it begins, so the bar is made there."""

    def __init__(self, training: Training) -> None:
        self._training = training
        self._progress: Progress | None = None

    def say(self, message: str) -> None:
        """Print a message."""
        console.print(message, highlight=False, soft_wrap=True, markup=False)
        sys.stdout.flush()

    def tell(self, now: "running.Progress", loss: float) -> None:
        """Move the bar."""
        if self._progress is None:
            self._progress = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TextColumn("{task.percentage:.1f} %"),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                TextColumn("{task.fields[loss]}", markup=False),
                console=console,
                disable=not console.is_terminal,
            )
            name = f"{self._training.TASK}, {self._training.model}"
            self._bar = self._progress.add_task(name, total=self._training.steps, completed=now.step - 1, loss="")
            self._progress.start()
        self._progress.update(self._bar, completed=now.step, loss=f"loss {loss:.3f}")
        if now.step == self._training.steps:
            self.close()

    def close(self) -> None:
        """Nothing follows."""
        if self._progress is not None:
            self._progress.stop()


def validation_table(now: "running.Progress") -> Table:
    """The curve of a training."""
    names = [name for name in now.curve[0] if name not in ("step", "seconds", "loss")]
    table = Table(title="Validation")
    for name in ("step", "time (s)", "loss", *names):
        table.add_column(name.replace("_", " "), justify="right")
    for row in now.curve:
        best = " *" if row.get(names[0]) == now.best else ""
        numbers = [f"{row[name]:.3f}" if name in row else "-" for name in names]
        table.add_row(f"{row['step']}{best}", f"{row['seconds']:.0f}", f"{row['loss']:.4f}", *numbers)
    table.caption = "*: the weights that were kept"
    return table
