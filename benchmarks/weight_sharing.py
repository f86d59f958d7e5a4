"""What sharing weights costs or gains: belief on the frozen physics network, or with a solver of its own.

Both are trained from the same seed on the same sequences for the same number of frames, then validated alike.

.venv/bin/python benchmarks/weight_sharing.py --data planar.h5 --validation validation.h5 --samples 400000
"""

import json
import time
from pathlib import Path
from typing import Annotated

import torch
import typer
from rich.console import Console
from rich.table import Table
from torch import nn

from pushgraph.network.belief_network import BeliefNetwork
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.training.belief import BeliefTask, BeliefTraining
from pushgraph.training.loop import CLIP, Schedule
from pushgraph.training.processes import Processes


class SeparateBelief(BeliefNetwork):
    """Belief with a solver of its own, trained for nothing else; it is not told the shared one's foresight."""

    def __init__(self, hidden: int) -> None:
        super().__init__(hidden)
        self.own = ContactDynamics()

    def evidence(self, frame, foresight):
        return super().evidence(frame, self.own.foresee(frame.before, frame.control))


def trained(network: nn.Module, training: BeliefTraining) -> tuple[dict[str, float], float]:
    """Numbers of the validation after a training, and its seconds."""
    task = BeliefTask(training, Processes(), torch.device("cpu"))
    schedule = Schedule(training.steps, training.learning_rate)
    optimizer = torch.optim.AdamW(network.parameters(), lr=training.learning_rate)
    begun = time.monotonic()
    for step in range(training.steps):
        for group in optimizer.param_groups:
            group["lr"] = schedule.rate(step)
        loss = task.loss(network, step)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        optimizer.step()
    seconds = time.monotonic() - begun
    with torch.no_grad():
        sums, weights = task.validate(network.eval())
        return dict(zip(task.numbers, (sums / weights).tolist(), strict=True)), seconds


def main(
    data: Annotated[Path, typer.Option()],
    validation: Annotated[Path, typer.Option()],
    samples: Annotated[int, typer.Option(help="Observed frames that each is trained on.")] = 400_000,
    hidden: Annotated[int, typer.Option()] = 64,
    out: Annotated[Path, typer.Option(help="Folder for the figures, JSON.")] = Path("weight_sharing"),
) -> None:
    training = BeliefTraining(
        data=str(data), validation=str(validation), samples=samples, frames=100, learning_rate=3e-3, hidden=hidden
    )
    physics = sum(values.numel() for values in ContactDynamics().parameters())
    figures = {}
    for name, kind in (("shared", BeliefNetwork), ("separate", SeparateBelief)):
        torch.manual_seed(0)
        network = kind(hidden)
        own = sum(values.numel() for values in network.parameters())
        numbers, seconds = trained(network, training)
        figures[name] = {"parameters_with_physics": physics + own, "seconds": seconds} | numbers
    console = Console()
    table = Table(title=f"Physics and belief, {training.steps} steps of {training.batch} sequences of 100 frames")
    for column in ("", *figures["shared"]):
        table.add_column(column, justify="right")
    for name, row in figures.items():
        table.add_row(name, *(f"{value:,.4g}" if value < 1e4 else f"{value:,.0f}" for value in row.values()))
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    (out / "weight_sharing.json").write_text(json.dumps(figures, indent=1))
    console.print(f"Written: {out / 'weight_sharing.json'}")


if __name__ == "__main__":
    typer.run(main)
