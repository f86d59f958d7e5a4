"""The command adapt."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pushgraph.cli.output import BAR, INTERRUPTED, console

if TYPE_CHECKING:
    from pushgraph.adaptation.adapted import Adaptation
    from pushgraph.adaptation.session import Session


def adapt(
    data: Annotated[Path | None, typer.Option(help="Recorded pushes: CSV, packed with gzip or not.")] = None,
    outlines: Annotated[Path | None, typer.Option(help="Outlines of the objects of --data: JSON.")] = None,
    track: Annotated[
        list[Path] | None, typer.Option(help="Instead: a recorded track (HDF5); several if repeated.")
    ] = None,
    surface: Annotated[str, typer.Option(help="Name of the table on which --track was recorded.")] = "table",
    out: Annotated[Path, typer.Option(help="File to write (safetensors).")] = Path("adaptation.safetensors"),
    count: Annotated[int | None, typer.Option(min=1, help="Pushes, spread over all.", show_default="all")] = None,
    contact: Annotated[str, typer.Option(help="Checkpoint that predicts.")] = "contact",
    grain: Annotated[
        bool, typer.Option("--grain", help="Tables may have a grain, along which friction is greater.")
    ] = False,
) -> None:
    """Learn from recorded pushes of a real robot: side frictions, pressures, the probe's offset, then a correction.

    Pushes come as a table with outlines, or as tracks, of which those count that move one body alone. A fifth of each
    shape on each surface is left out and tells what it is worth; then everything is learnt from. Where it is not worth
    anything there, the zero-shot prediction stays. The same command goes on after a kill.

    Examples:

    `pushgraph adapt --data pushes.csv --outlines outlines.json --out my.safetensors`

    `pushgraph adapt --track first.h5 --track second.h5 --surface bench --out my.safetensors`

    `pushgraph evaluate real --data others.csv --outlines outlines.json --adaptation my.safetensors`
    """
    from pushgraph.adaptation.recorded import pushes_of_tracks
    from pushgraph.adaptation.session import adapt_recorded
    from pushgraph.real_pushes import read_pushes
    from pushgraph.track import Track

    if data is not None and outlines is not None and not track:
        pushes, source = read_pushes(data, outlines), data.name
    elif track and data is None and outlines is None:
        pushes = pushes_of_tracks({str(path): Track.load(path) for path in track}, surface)
        source = ", ".join(path.name for path in track)
    else:
        raise typer.BadParameter("give --data with --outlines, or --track", param_hint="--data, --track")
    with Progress(*BAR, console=console) as progress:
        bars = {what: progress.add_task(what, total=None) for what in ("validated", "learnt")}
        try:
            session = adapt_recorded(
                pushes,
                source,
                out,
                count,
                contact,
                lambda what, done, n: progress.update(bars[what], completed=done, total=n),
                grain,
            )
        except KeyboardInterrupt:
            progress.stop()
            console.print("Stopped; what was learnt so far is kept, and the same command goes on from there")
            raise typer.Exit(INTERRUPTED) from None
    console.print(_validation_table(session))
    console.print(_unknowns_table(session.adaptation))
    console.print(f"Written: {out}", soft_wrap=True, markup=False)


def _validation_table(session: "Session") -> Table:
    table = Table(title="Pushes left out: mean errors, mm / degrees", pad_edge=False)
    for name in ("surface", "shape", "pushes", "before", "after", "kept"):
        table.add_column(name, justify="left" if name in ("surface", "shape", "kept") else "right")
    for row in session.validation:
        cells = (f"{row.before[0]:.2f} / {row.before[1]:.2f}", f"{row.after[0]:.2f} / {row.after[1]:.2f}")
        table.add_row(row.surface, row.shape, str(row.pushes), *cells, "adapted" if row.kept else "zero-shot")
    return table


def _unknowns_table(adaptation: "Adaptation") -> Table:
    table = Table(title="What was learnt, with standard deviations", pad_edge=False)
    table.add_column("material")
    table.add_column("unknowns")
    everything = [("all", adaptation.shared), *((" ".join(name), own) for name, own in adaptation.materials.items())]
    for name, own in everything:
        table.add_row(name, "; ".join(own.estimate.lines()))
    return table
