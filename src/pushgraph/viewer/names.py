"""Names of bodies, placed where no line runs through them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

STEP = 3.0
"""Lines are looked at so often along their way (pixels)."""
MARGIN = 1.0
"""Around a name (pixels)."""
HIT, COVERED, AWAY = 1.0, 50.0, 0.15
"""What a name costs: each point of a line in it, another name beneath it, and each of its own heights that it stands
from the middle of its body."""
REACH = 4
"""Names move so many of their heights, at most."""


def place_names(figure: Figure, panels: Sequence[tuple[Axes, Sequence[Text]]]) -> None:
    """Move the names on each panel to the nearest place that is free of lines, outlines, marks and other names."""
    canvas = figure.canvas if isinstance(figure.canvas, FigureCanvasAgg) else FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    renderer = canvas.get_renderer()
    for axes, names in panels:
        drawn, taken = _drawn(axes), np.zeros((0, 4))
        to_data = axes.transData.inverted()
        for name in (name for name in names if name.get_visible()):
            box = name.get_window_extent(renderer)
            half = np.array([box.width, box.height]) / 2
            middle = np.array([box.x0, box.y0]) + half
            place = _place(middle, half + MARGIN, drawn, taken)
            x, y = to_data.transform(place)
            name.set_position((float(x), float(y)))
            taken = np.vstack((taken, [*(place - half), *(place + half)]))


def _place(
    middle: Float[np.ndarray, "2"],
    half: Float[np.ndarray, "2"],
    drawn: Float[np.ndarray, "points 2"],
    taken: Float[np.ndarray, "names 4"],
) -> Float[np.ndarray, "2"]:
    """The cheapest centre of a name; all in pixels."""
    steps = np.arange(-2 * REACH, 2 * REACH + 1) * half[1]
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    centres = middle + np.stack((x, y), -1)
    around = drawn[(np.abs(drawn - middle) < np.abs(steps).max() + half).all(-1)]
    hits = (np.abs(around[None] - centres[:, None]) < half).all(-1).sum(-1)
    low, high = centres[:, None] - half, centres[:, None] + half
    covered = ((low < taken[:, 2:]) & (high > taken[:, :2])).all(-1).sum(-1)
    cost = HIT * hits + COVERED * covered + AWAY * np.hypot(x, y) / (2 * half[1])
    return centres[int(cost.argmin())]


def _drawn(axes: Axes) -> Float[np.ndarray, "points 2"]:
    """Points along all that is drawn on the axes, in pixels."""
    found = [np.zeros((0, 2))]
    for line in axes.lines:
        points = np.asarray(line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float)))
        found.append(_along(points))
        if line.get_marker() not in (None, "None", ""):
            radius = line.get_markersize() * axes.figure.dpi / 144
            turns = np.linspace(0, 2 * np.pi, 12)
            ring = radius * np.stack((np.cos(turns), np.sin(turns)), -1)
            found += [points + offset for offset in (*ring, *ring / 2, np.zeros(2))]
    for patch in axes.patches:
        for polygon in patch.get_path().to_polygons(patch.get_transform(), closed_only=False):
            found.append(_along(np.asarray(polygon)))
    points = np.concatenate(found)
    return points[np.isfinite(points).all(-1)]


def _along(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "samples 2"]:
    """Points every STEP along a line."""
    if len(points) < 2:
        return points
    lengths = np.hypot(*np.diff(points, axis=0).T)
    counts = np.maximum(1, np.nan_to_num(lengths / STEP).astype(int))
    first = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[first]
    return np.vstack((points[first] + share[:, None] * (points[first + 1] - points[first]), points[-1:]))
