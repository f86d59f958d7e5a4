"""The command generate."""

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.output import BAR, console


def generate(
    setup: Annotated[
        str,
        typer.Argument(
            help="multiple-parts; jointed: half of it with joints anywhere; planar: the training mixture; "
            "planar-mixed: that, of many sizes; different-masses: cylinders of three classes of mass; "
            "different-masses-mixed: that, of two objects up to --objects; "
            "controlled-masses: 2 or 3 cylinders of which only the masses change; "
            "camera: 2 to 5 glued cylinders without yaw, pushed once by a hammer."
        ),
    ],
    count: Annotated[int, typer.Option(min=1, help="Trajectories.")],
    out: Annotated[Path, typer.Option(help="The dataset, HDF5.")],
    objects: Annotated[int, typer.Option(min=1, help="Objects in a scene; of mixed setups, the most.")] = 9,
    seed: Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test data.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")] = os.cpu_count() or 1,
    engine: Annotated[str, typer.Option(help="processes, or ray (the cluster at RAY_ADDRESS, or a local one).")] = (
        "processes"
    ),
) -> None:
    """Generate a dataset; killed or interrupted, the same command goes on where it was.

    Examples:

    `pushgraph generate multiple-parts --objects 9 --count 1000 --seed 1 --out train.h5`

    `pushgraph generate planar --count 30000 --out mixture.h5 --workers 16`

    `pushgraph generate controlled-masses --objects 2 --count 1000 --seed 1000000 --out two.h5`
    """
    from pushgraph.dataset.generate import generate as generate_dataset
    from pushgraph.dataset.store import Dataset
    from pushgraph.dataset.summary import table

    with Progress(*BAR, console=console) as progress:
        task = progress.add_task(setup, total=count)
        try:
            path = generate_dataset(
                setup, objects, count, seed, out, workers, engine, lambda done: progress.update(task, completed=done)
            )
        except KeyboardInterrupt:
            progress.console.print("Interrupted: what is done is kept, the same command goes on from there.")
            raise typer.Exit(130) from None
    with Dataset(path) as written:
        rows = table(written.summary)
    summary = Table(title=f"{setup}, {objects} objects, seed {seed}", show_header=False)
    for name, value in rows.items():
        summary.add_row(name, value)
    console.print(summary)
    console.print(f"Dataset: {path} ({path.stat().st_size / 2**20:.1f} MiB)", soft_wrap=True, markup=False)
