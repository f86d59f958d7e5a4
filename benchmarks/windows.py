"""How fast training windows are drawn, from memory and from disk, on one core.

.venv/bin/python benchmarks/windows.py data.h5
"""

import time
from pathlib import Path
from typing import Annotated

import torch
import typer
from rich.console import Console
from rich.table import Table

from pushgraph.dataset.store import Dataset
from pushgraph.dataset.windows import WindowSampler


def main(
    data: Annotated[Path, typer.Argument(help="A dataset.")],
    frames: Annotated[int, typer.Option(help="Frames of a window.")] = 6,
    batch: Annotated[int, typer.Option(help="Windows of a batch.")] = 512,
    pools: Annotated[int, typer.Option(help="Memory for a pool: this fraction of the dataset.")] = 5,
) -> None:
    torch.set_num_threads(1)
    table = Table(title=f"{data}, windows of {frames} frames, batches of {batch}")
    for name in ("from", "pools", "steps", "seconds with loading", "windows / s"):
        table.add_column(name, justify="right")
    with Dataset(data) as dataset:
        size = 12 * int(dataset.pose_offset[-1]) + 24 * int(dataset.frame_offset[-1])
        for source, memory in (("memory", 2**40), ("disk", size // pools + 1)):
            sampler = WindowSampler(dataset, frames, batch, memory=memory)
            steps = sampler.pools * sampler.steps_per_pool
            begun = time.perf_counter()
            for step in range(steps):
                sampler.batch(step)
            seconds = time.perf_counter() - begun
            table.add_row(source, str(sampler.pools), str(steps), f"{seconds:.1f}", f"{steps * batch / seconds:,.0f}")
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
