"""What a run writes beside its state: config.toml, metrics.csv, log.txt, and curves for TensorBoard if asked for."""

import csv
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pushgraph.extras import extra
from pushgraph.storage import replacing
from pushgraph.training.configuration import save_configuration
from pushgraph.training.recipe import Training
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress

CONFIG, METRICS, LOG, TENSORBOARD = "config.toml", "metrics.csv", "log.txt", "tensorboard"


class Recorder:
    """Records a training in its run folder, and says what happens. numbers: names of the validation's."""

    def __init__(
        self,
        training: Training,
        run: TrainingRun,
        numbers: Sequence[str],
        rate: Callable[[int], float],
        tell: Callable[[Progress, float], None],
        say: Callable[[str], None],
    ) -> None:
        self._training, self._run, self._numbers = training, run, numbers
        self._rate, self._tell, self._say = rate, tell, say
        self._writer = _summary_writer() if run.tensorboard else None
        self._board: Any = None

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self._run.folder

    def begin(self, now: Progress) -> None:
        """The state was loaded, if there was one."""
        save_configuration(self._training, self._run, self.folder / CONFIG)
        if self._writer is not None:
            self._board = self._writer(self.folder / TENSORBOARD, purge_step=now.step + 1)
        if now.curve:
            self.say(f"goes on from step {now.step} of {self._training.steps}, {now.seconds:.0f} s into the run")
            self._write_metrics(now)
        else:
            self.say(f"begins: {self._training.TASK}, {self._training.model}, {self._training.steps} steps")

    def step(self, now: Progress, loss: float) -> None:
        """A step was made."""
        if self._board is not None:
            self._board.add_scalar("loss", loss, now.step)
            self._board.add_scalar("learning_rate", self._rate(now.step - 1), now.step)
        self._tell(now, loss)

    def validated(self, now: Progress) -> None:
        """The curve has a new row."""
        self._write_metrics(now)
        row = now.curve[-1]
        numbers = ", ".join(f"{name} {row[name]:.4g}" for name in self._numbers if name in row)
        left = f", {(self._training.steps - now.step) * now.seconds / now.step:.0f} s left" if now.step else ""
        steps = f"step {now.step} of {self._training.steps}, {now.seconds:.0f} s{left}"
        self.say(f"{steps}: loss {row['loss']:.4f}; validation: {numbers}")
        if self._board is not None:
            for name in (name for name in self._numbers if name in row):
                self._board.add_scalar(f"validation/{name}", row[name], now.step)

    def say(self, message: str) -> None:
        """Say something, and write it into the log."""
        with (self.folder / LOG).open("a", encoding="utf-8") as log:
            log.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {message}\n")
        self._say(message)

    def close(self) -> None:
        """Nothing follows."""
        if self._board is not None:
            self._board.close()

    def _write_metrics(self, now: Progress) -> None:
        """The whole table anew: rows that a killed process wrote after its last save are gone."""
        samples = self._training.batch * self._training.frames
        before = {"step": 0, "seconds": 0.0}
        with replacing(self.folder / METRICS) as temporary, temporary.open("w", newline="") as file:
            table = csv.writer(file)
            head = ("step", "samples", "seconds", "samples_per_second", "learning_rate", "loss")
            table.writerow([*head, *self._numbers])
            for row in now.curve:
                steps, seconds = row["step"] - before["step"], row["seconds"] - before["seconds"]
                speed = steps * samples / seconds if seconds > 0 else ""
                rate = self._rate(max(0, int(row["step"]) - 1))
                cells = (row["step"], row["step"] * samples, row["seconds"], speed, rate, row["loss"])
                table.writerow([*cells, *(row.get(name, "") for name in self._numbers)])
                before = row


def _summary_writer() -> Any:
    with extra("tensorboard", "--tensorboard"):
        from torch.utils.tensorboard import SummaryWriter
    return SummaryWriter
