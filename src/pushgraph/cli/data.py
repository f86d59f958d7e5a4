"""The command generate."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.choices import engines, one_of, setups
from pushgraph.cli.output import BAR, console
from pushgraph.cores import usable_cores


def generate(
    setup: Annotated[
        str,
        typer.Argument(
            help="multiple-parts; jointed: half of it with joints anywhere; planar: the training mixture; "
            "planar-mixed: that, of many sizes; different-masses: cylinders of three classes of mass; "
            "different-masses-mixed: that, of two objects up to --objects; "
            "controlled-masses: 2 or 3 cylinders of which only the masses change; "
            "camera: 2 to 5 glued cylinders without yaw, pushed once by a hammer; "
            "lever-up: a board levered up from the four sides of drives.",
            **one_of(setups, "SETUP"),
        ),
    ],
    out: Annotated[Path, typer.Option(help="The dataset, HDF5.")],
    count: Annotated[int | None, typer.Option(min=1, help="Trajectories.")] = None,
    drives: Annotated[int | None, typer.Option(min=1, help="Of lever-up, instead of --count: four each.")] = None,
    objects: Annotated[int, typer.Option(min=1, help="Objects in a scene; of mixed setups, the most.")] = 9,
    seed: Annotated[int, typer.Option(min=0, help="From 1,000,000 on: test data.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.", show_default="one a core")] = usable_cores(),
    engine: Annotated[
        str, typer.Option(help="processes, or ray (the cluster at RAY_ADDRESS, or a local one).", **one_of(engines))
    ] = "processes",
) -> None:
    """Generate a dataset; killed or interrupted, the same command goes on where it was.

    Examples:

    `pushgraph generate multiple-parts --objects 9 --count 1000 --seed 1 --out train.h5`

    `pushgraph generate planar --count 30000 --out mixture.h5 --workers 16`

    `pushgraph generate controlled-masses --objects 2 --count 1000 --seed 1000000 --out two.h5`

    `pushgraph generate lever-up --drives 125 --out lever-up.h5`
    """
    from pushgraph.dataset import lever_store, summary
    from pushgraph.dataset.generate import dataset_class
    from pushgraph.dataset.generate import generate as generate_dataset
    from pushgraph.simulation.lever_setup import LEVER_UP, SIDES

    if (count is None) == (drives is None) or (drives is not None and setup != LEVER_UP):
        raise typer.BadParameter(f"give --count, or for {LEVER_UP} --drives", param_hint="--count")
    levers = setup == LEVER_UP
    objects = 1 if levers else objects
    count = len(SIDES) * (drives or 0) if count is None else count
    with Progress(*BAR, console=console) as progress:
        task = progress.add_task(setup, total=count)
        try:
            path = generate_dataset(
                setup, objects, count, seed, out, workers, engine, lambda done: progress.update(task, completed=done)
            )
        except KeyboardInterrupt:
            progress.console.print("Interrupted: what is done is kept, the same command goes on from there.")
            raise typer.Exit(130) from None
    with dataset_class(setup)(path) as written:
        rows = (lever_store if levers else summary).table(written.summary)
    closing = Table(title=f"{setup}, seed {seed}" if levers else f"{setup}, {objects} objects, seed {seed}")
    closing.show_header = False
    for name, value in rows.items():
        closing.add_row(name, value)
    console.print(closing)
    console.print(f"Dataset: {path} ({path.stat().st_size / 2**20:.1f} MiB)", soft_wrap=True, markup=False)
