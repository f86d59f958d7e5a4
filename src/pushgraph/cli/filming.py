"""The command film."""

from pathlib import Path
from typing import Annotated

import typer

from pushgraph.cli.output import console


def film(
    track: Annotated[Path, typer.Argument(help="What pushgraph simulate wrote (HDF5).")],
    out: Annotated[Path, typer.Option(help="The recording to write: .csv or .h5.")] = Path("camera.csv"),
    rate: Annotated[float, typer.Option(min=1, max=1000, help="Frames a second.")] = 30.0,
    noise: Annotated[float, typer.Option(min=0, max=0.1, help="Of every sighting's x and y (m).")] = 0.001,
    yaw_noise: Annotated[float, typer.Option(min=0, max=90, help="Of every sighting's yaw (degrees).")] = 0.5,
    dropped: Annotated[float, typer.Option(min=0, max=0.9, help="Share of frames that are lost.")] = 0.03,
    frame: Annotated[str, typer.Option(help="'x y yaw' of the recording's origin in the world (m, rad).")] = ("0 0 0"),
    probe_off: Annotated[str, typer.Option(help="'x y': how far off the robot reports its tool (m).")] = "0 0",
    seed: Annotated[int, typer.Option(min=0, help="Of noise and lost frames.")] = 0,
) -> None:
    """Rehearse without a camera: write what one would have seen of a simulated track.

    Examples:

    `pushgraph film simulated/track.h5 --out camera.csv`

    `pushgraph film simulated/track.h5 --out moved.csv --frame "0.4 -0.2 1.571" --probe-off "0.002 0"`
    """
    import numpy as np

    from pushgraph.recording.files import save_sightings
    from pushgraph.simulation.camera import Camera
    from pushgraph.simulation.camera import film as film_track
    from pushgraph.track import Track

    x, y, yaw = _numbers(frame, 3, "--frame")
    off_x, off_y = _numbers(probe_off, 2, "--probe-off")
    camera = Camera(rate, noise, np.radians(yaw_noise), dropped, (x, y, yaw), (off_x, off_y))
    save_sightings(film_track(Track.load(track), np.random.default_rng(seed), camera), out)
    console.print(f"Written: {out}", soft_wrap=True, markup=False)


def _numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise typer.BadParameter(f"{text!r}; valid: {count} numbers", param_hint=option)
    return numbers
