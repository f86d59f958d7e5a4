"""The curve of a training: loss and validation error against time."""

import os
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from pushgraph.storage import replacing


def save_curve(curve: Sequence[Mapping[str, int | float]], number: str, label: str, path: str | os.PathLike) -> None:
    """Draw the rows of a training's curve (see `training.running.Progress`): the loss, and one of the numbers."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    minutes = [row["seconds"] / 60 for row in curve]
    panels = (("loss", "loss"), (number, f"validation: {label}"))
    for axes, (name, label) in zip(figure.subplots(1, 2), panels, strict=True):
        values = [row[name] for row in curve]
        axes.plot(minutes, values, marker=".")
        axes.set(xlabel="minutes", ylabel=label, yscale="log" if min(values) > 0 else "linear")
        axes.grid(alpha=0.3, which="both")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)
