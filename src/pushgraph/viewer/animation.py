"""An animation of a track, seen from above."""

import contextlib
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pushgraph.errors import ViewerError
from pushgraph.storage import replacing
from pushgraph.track import FRAME, Track
from pushgraph.viewer.drawing import SceneArtist, prepare, view_limits

MOST_PICTURES = 75
SIZE = 5.0
DPI = 90


def check_animation(path: str | os.PathLike) -> None:
    """Raise ViewerError if an animation of this name cannot be made here."""
    ending = Path(path).suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise ViewerError(f"{path}: an animation ends in .gif or .mp4")
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise ViewerError(f"{path}: an MP4 needs the program ffmpeg, which is not installed; ask for a .gif")


def save_animation(track: Track | Mapping[str, Track], path: str | os.PathLike) -> None:
    """Write a GIF or an MP4, in real time; long tracks show every n-th frame.

    Several tracks, by title, stand side by side; the shorter ones stay as they end. Raises ViewerError for another
    ending, or if an MP4 is asked for and ffmpeg is not installed or fails.
    """
    check_animation(path)
    tracks = {"": track} if isinstance(track, Track) else dict(track)
    longest = max(tracks.values(), key=lambda one: len(one.times))
    stride = max(1, -(-len(longest.times) // MOST_PICTURES))
    figure = Figure(figsize=(SIZE * len(tracks), SIZE), dpi=DPI)
    FigureCanvasAgg(figure)
    limits = view_limits(list(tracks.values()))
    panels = []
    for column, (title, one) in enumerate(tracks.items()):
        axes = figure.add_axes(((column + 0.14) / len(tracks), 0.1, 0.82 / len(tracks), 0.82))
        prepare(axes, limits, "")
        panels.append((one, SceneArtist(axes, one.scene), axes.set_title(" "), title))
    with opened_writer(figure, path, stride) as writer:
        for frame in range(0, len(longest.times), stride):
            for one, scene, heading, title in panels:
                last = min(frame, len(one.times) - 1)
                scene.move(one.poses[last], bool(one.down[last]))
                heading.set_text(f"{title + ', ' if title else ''}{longest.times[frame]:.2f} s")
            writer.grab_frame()


@contextlib.contextmanager
def opened_writer(figure: Figure, path: str | os.PathLike, stride: int) -> Iterator[AbstractMovieWriter]:
    """What grabs the figure, once every `stride` frames of a track, into an animation that ends up at `path`."""
    writer_class = PillowWriter if Path(path).suffix.lower() == ".gif" else FFMpegWriter
    writer = writer_class(fps=1 / (FRAME * stride))  # type: ignore[arg-type]  # any rate serves, whole or not
    try:
        with replacing(path) as temporary, writer.saving(figure, str(temporary), DPI):
            yield writer
    except subprocess.CalledProcessError as error:
        raise ViewerError(f"{path}: ffmpeg failed with exit status {error.returncode}; ask for a .gif") from None
