"""Figures of the suite `real`."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pushgraph.evaluation.figures import save_figure
from pushgraph.evaluation.real import ALL, METRICS

COLOURS = {
    **{"still": "#bbbbbb", "poly4": "#d08000", "ellipsoid": "#e0c080", "mujoco": "#8060c0"},
    **{"zero_shot": "#80b0f0", "adapted": "#2060c0", "gp": "#c04040", "gp_poly4": "#d08000", "floor": "#40a060"},
}
NAMES = {"position_error_mm": "position error (mm)", "rotation_error_deg": "rotation error (degrees)"}


def save_shapes(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike) -> None:
    """Mean errors of each shape and of all, a bar for each model; those at rest left out."""
    rows = [row for row in rows if (row["surface"], row["speed"], row["split"]) == (ALL, ALL, ALL)]
    models = [model for model in dict.fromkeys(row["model"] for row in rows) if model != "still"]
    shapes = list(dict.fromkeys(row["shape"] for row in rows))
    figure = Figure(figsize=(11, 7), layout="constrained")
    for axes, (metric, _) in zip(figure.subplots(2, 1, sharex=True), METRICS, strict=True):
        values = {(row["model"], row["shape"]): row["value"] for row in rows if row["metric"] == metric}
        width = 0.8 / len(models)
        for k, model in enumerate(models):
            heights = [values.get((model, shape)) or 0.0 for shape in shapes]
            axes.bar(np.arange(len(shapes)) + k * width, heights, width, color=COLOURS.get(model), label=model)
        axes.set_xticks(np.arange(len(shapes)) + 0.4, shapes)
        axes.set(ylabel=NAMES[metric])
        axes.grid(axis="y", alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, [label.replace("_", " ") for label in labels], loc="outside lower center", ncols=8)
    save_figure(figure, path)


def save_learning_curve(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike) -> None:
    """Mean errors over the number of pushes of the same shape and surface that were learnt from."""
    everything = [row for row in rows if (row["shape"], row["surface"], row["speed"]) == (ALL, ALL, ALL)]
    rows = [row for row in everything if row["split"] == "push"]
    floor = {row["metric"]: row["value"] for row in everything if row["model"] == "floor"}
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    for axes, (metric, _) in zip(figure.subplots(1, 2), METRICS, strict=True):
        own = [row for row in rows if row["metric"] == metric]
        for model in dict.fromkeys(row["model"] for row in own):
            curve = sorted(
                (row["pushes"], row["value"], row["low"], row["high"]) for row in own if row["model"] == model
            )
            pushes, value, low, high = np.array(curve, dtype=float).T
            axes.plot(pushes, value, "o-", color=COLOURS.get(model), label=model.replace("_", " "))
            axes.fill_between(pushes, low, high, color=COLOURS.get(model), alpha=0.15)
        if floor.get(metric) is not None:
            axes.axhline(floor[metric], color=COLOURS["floor"], linestyle=":", label="floor")
        axes.set(xscale="log", xlabel="pushes learnt from", ylabel=NAMES[metric], ylim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    save_figure(figure, path)
