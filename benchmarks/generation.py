"""How fast datasets are generated, and how that grows with the workers.

.venv/bin/python benchmarks/generation.py --count 200
"""

import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pushgraph.dataset.generate import generate
from pushgraph.dataset.store import Dataset


def main(
    setup: Annotated[str, typer.Option(help="Setup.")] = "multiple-parts",
    objects: Annotated[int, typer.Option(help="Objects in a scene.")] = 9,
    count: Annotated[int, typer.Option(help="Trajectories.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed.")] = 1,
    workers: Annotated[list[int] | None, typer.Option(help="Workers, again for each number. [default: 1, 2]")] = None,
) -> None:
    table = Table(title=f"{setup}, {objects} objects, {count} trajectories")
    for name in ("workers", "seconds", "trajectories / s", "simulated s / s", "gain"):
        table.add_column(name, justify="right")
    first = None
    with tempfile.TemporaryDirectory() as folder:
        for number in workers or [1, 2]:
            begun = time.perf_counter()
            path = generate(setup, objects, count, seed, Path(folder) / f"{number}.h5", workers=number)
            seconds = time.perf_counter() - begun
            with Dataset(path) as dataset:
                simulated = 0.05 * dataset.summary["frames"].sum()
            first = first or seconds
            table.add_row(
                str(number),
                f"{seconds:.1f}",
                f"{count / seconds:.2f}",
                f"{simulated / seconds:.0f}",
                f"{first / seconds:.2f}",
            )
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
