"""GIFs of figures: what stands still is drawn once, what moves in every frame, with one palette for all."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.animation import AbstractMovieWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image


class GifWriter(AbstractMovieWriter):
    """Writes a figure's frames as a GIF, several times faster than by drawing and palette of each by itself.

    moving: what changes from frame to frame, in the order of drawing; nothing if everything does.
    """

    def __init__(self, fps: Any, moving: Sequence[tuple[Axes, Artist]] = ()) -> None:
        super().__init__(fps)
        self._moving, self._images = moving, list[Image.Image]()

    def setup(self, fig: Figure, outfile: str | Path, dpi: int | float | None = None) -> None:
        """Begin; see AbstractMovieWriter."""
        super().setup(fig, outfile, dpi)
        self._canvas = fig.canvas if isinstance(fig.canvas, FigureCanvasAgg) else FigureCanvasAgg(fig)
        for _, artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(fig.bbox)

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Take the figure as it stands."""
        if self._moving:
            self._canvas.restore_region(self._still)
            for axes, artist in self._moving:
                axes.draw_artist(artist)
        else:
            self._canvas.draw()
        size = self._canvas.get_width_height()
        image = Image.frombuffer("RGBA", size, self._canvas.buffer_rgba(), "raw", "RGBA", 0, 1).convert("RGB")
        if not self._images:
            self._images.append(image.quantize(256))
        else:
            self._images.append(image.quantize(palette=self._images[0], dither=Image.Dither.NONE))

    def finish(self) -> None:
        """Write the file; see AbstractMovieWriter."""
        first, *others = self._images
        milliseconds = round(1000 / self.fps)
        first.save(self.outfile, "GIF", save_all=True, append_images=others, duration=milliseconds, loop=0)
