"""Figures of evaluations."""

import itertools
import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from pushgraph.evaluation.physics import HISTOGRAM, SceneErrors, histogram
from pushgraph.storage import replacing

COLOURS = {"still": "#bbbbbb", "propnet": "#d08000", "contact": "#2060c0", "noise_floor": "#40a060"}


def save_histogram(
    scenes: Sequence[SceneErrors], models: Sequence[str], path: str | os.PathLike, horizons: Sequence[int] = (30, 50)
) -> None:
    """The paper's histogram of trajectories over their mean rollout error, for each number of objects and horizon."""
    numbers = sorted({scene.objects for scene in scenes})
    figure = Figure(figsize=(6 * len(horizons), 3.2 * len(numbers) + 0.6), layout="constrained")
    grid = figure.subplots(len(numbers), len(horizons), squeeze=False, sharey="row")
    labels = [f"< {HISTOGRAM[0]:g}"]
    labels += [f"{low:g}-{high:g}" for low, high in itertools.pairwise(HISTOGRAM)]
    labels += [f"> {HISTOGRAM[-1]:g}"]
    width = 0.8 / len(models)
    for row, number in zip(grid, numbers, strict=True):
        chosen = [scene for scene in scenes if scene.objects == number]
        for axes, frames in zip(row, horizons, strict=True):
            for k, model in enumerate(models):
                counts = histogram(chosen, model, frames)
                place = np.arange(len(counts)) + (k - (len(models) - 1) / 2) * width
                axes.bar(place, counts, width, label=model.replace("_", " "), color=COLOURS.get(model))
            axes.set_xticks(range(len(labels)), labels, fontsize=8)
            axes.set(title=f"{number} objects, {frames} frames", xlabel="mean error (cm)", ylabel="trajectories")
            axes.grid(axis="y", alpha=0.3)
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)
