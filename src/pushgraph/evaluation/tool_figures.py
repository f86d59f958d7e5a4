"""The paper's figure of tools: mean errors and successes, as predicted and as executed."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pushgraph.evaluation.figures import save_figure
from pushgraph.evaluation.tools import ALL
from pushgraph.planning.tools import TOOLS

BARS = {
    ("learned", "open"): ("#2060c0", "learned, open loop"),
    ("learned", "closed"): ("#103060", "learned, closed loop"),
    ("mujoco", "open"): ("#40a060", "MuJoCo as the dynamics"),
}
PANELS = {"predicted": "Predicted", "tool": "Executed in simulation"}
METRICS = {"mean_error_cm": "mean final distance (cm)", "success_5cm": "tasks under 5 cm"}


def save_tools(rows: Sequence[Mapping[str, Any]], tasks: int, path: str | os.PathLike) -> None:
    """Write the figure; bars for each tool alone, and for all."""
    names = [*TOOLS, ALL]
    figure = Figure(figsize=(12, 7), layout="constrained")
    grid = figure.subplots(len(METRICS), len(PANELS), sharey="row")
    values = {tuple(row[key] for key in ("model", "loop", "executed", "tool", "metric")): row["value"] for row in rows}
    width = 0.8 / len(BARS)
    for panels, (metric, label) in zip(grid, METRICS.items(), strict=True):
        scale = tasks if metric.startswith("success") else 1
        for axes, (executed, title) in zip(panels, PANELS.items(), strict=True):
            for k, ((model, loop), (colour, name)) in enumerate(BARS.items()):
                heights = [values.get((model, loop, executed, tool, metric)) for tool in names]
                if None in heights:
                    continue
                places = np.arange(len(names)) + (k - 1) * width
                axes.bar(places, scale * np.array(heights), width, color=colour, label=name)
            axes.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=8)
            axes.set(title=title, ylabel=f"{label} of {tasks}" if scale > 1 else label)
            axes.grid(axis="y", alpha=0.3)
    handles, labels = grid[0][1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    save_figure(figure, path)
