"""An animation of a track, seen from above."""

import contextlib
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pushgraph.errors import ViewerError
from pushgraph.storage import replacing
from pushgraph.track import FRAME, LIFTED, Track
from pushgraph.viewer.drawing import TOOL_COLOUR, SceneArtist, prepare, view_limits
from pushgraph.viewer.gif import GifWriter

MOST_PICTURES = 1200
"""Of an animation: a minute in full."""
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
    """Write a GIF or an MP4, in real time, of every frame; of tracks longer than a minute of every n-th.

    It says which push is under way, and shows the way that the tool has come.

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
        panels.append(_Panel(axes, title, one))
    with opened_writer(figure, path, stride, [pair for panel in panels for pair in panel.moving]) as writer:
        for frame in range(0, len(longest.times), stride):
            for panel in panels:
                panel.show(frame, longest.times[frame])
            writer.grab_frame()


class _Panel:
    """A track on axes of its own, frame by frame; it stays as it ends."""

    def __init__(self, axes: Axes, title: str, track: Track) -> None:
        self._title, self._track = title, track
        self._way = np.where(track.down[:, None], track.poses[:, 0, :2], np.nan)
        still = axes.get_children()
        (self._trail,) = axes.plot([], [], color=TOOL_COLOUR, lw=1, ls=":")
        self._scene = SceneArtist(axes, track.scene)
        self._heading = axes.text(0.5, 1.02, "", transform=axes.transAxes, ha="center", fontsize=12)
        moving = [artist for artist in axes.get_children() if artist not in still]
        self.moving = [(axes, artist) for artist in sorted(moving, key=lambda artist: artist.get_zorder())]
        """What moves, with the axes it is on, in the order of drawing."""

    def show(self, frame: int, time: float) -> None:
        track, last = self._track, min(frame, len(self._track.times) - 1)
        self._scene.move(track.poses[last], bool(track.down[last]))
        self._trail.set_data(*self._way[: last + 1].T)
        under_way = int(track.push[last])
        said = f"push {under_way + 1}" if under_way != LIFTED else "lifted"
        self._heading.set_text(", ".join(part for part in (self._title, f"{time:.2f} s", said) if part))


@contextlib.contextmanager
def opened_writer(
    figure: Figure, path: str | os.PathLike, stride: int, moving: Sequence[tuple[Axes, Artist]] = ()
) -> Iterator[AbstractMovieWriter]:
    """What grabs the figure, once every `stride` frames of a track, into an animation that ends up at `path`.

    moving: see GifWriter.
    """
    rate: Any = 1 / (FRAME * stride)  # matplotlib's types ask for a whole number, its code does not
    writer = GifWriter(rate, moving) if Path(path).suffix.lower() == ".gif" else FFMpegWriter(rate)
    try:
        with replacing(path) as temporary, writer.saving(figure, str(temporary), DPI):
            yield writer
    except subprocess.CalledProcessError as error:
        raise ViewerError(f"{path}: ffmpeg failed with exit status {error.returncode}; ask for a .gif") from None
