"""Figures of evaluations."""

import itertools
import os
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pushgraph.evaluation.belief import INFORMED, NOISES, OBSERVED, SceneAnswers, certainty
from pushgraph.evaluation.coupled import MODELS, STARTS, CoupledErrors, mean_and_standard_error
from pushgraph.evaluation.metrics import reliability
from pushgraph.evaluation.physics import HISTOGRAM, SceneErrors, histogram
from pushgraph.evaluation.spread import CONDITIONS, SceneSpread, levels
from pushgraph.storage import replacing

COLOURS = {
    **{"still": "#bbbbbb", "propnet": "#d08000", "image": "#8060c0", "contact": "#2060c0", "noise_floor": "#40a060"},
    **{"belief": "#2060c0", "paper_recipe": "#d08000", "informed": "#40a060"},
    **{"oracle": "#202020", "informed_oracle": "#40a060"},
    **{"ratio_observer": "#40a060", "exact": "#40a060", "mean_guess": "#d08000", "median_guess": "#bbbbbb"},
    **{"no_joint": "#bbbbbb", "all_fixed": "#c04040", "all_fixed_5cm": "#e0a0a0"},
}
OWN_COLOURS = ("#8060c0", "#c04040", "#20a0a0", "#a0a020", "#e070b0")
"""Of what has no colour of its own, in turn."""
JOINT_COLOURS = {"none": "#2060c0", "fixed": "#c04040", "prismatic": "#40a060", "revolute": "#d08000"}
LINES = ("-", "--", "-.", (0, (5, 1, 1, 1, 1, 1)))
"""Of beliefs, in turn."""
SPREAD_COLOURS = dict(
    zip(CONDITIONS, ("#202020", "#c04040", "#d08000", "#40a060", "#2060c0", "#8060c0"), strict=True)
)
RELIABLE_AT = (40, 200)
"""Observed frames of the reliability diagram."""


def colours_of(models: Iterable[str]) -> dict[str, str]:
    """A colour for every model."""
    own = itertools.cycle(OWN_COLOURS)
    return {model: COLOURS.get(model) or next(own) for model in dict.fromkeys(models)}


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
    width, colours = 0.8 / len(models), colours_of(models)
    for row, number in zip(grid, numbers, strict=True):
        chosen = [scene for scene in scenes if scene.objects == number]
        for axes, frames in zip(row, horizons, strict=True):
            for k, model in enumerate(models):
                counts = histogram(chosen, model, frames)
                place = np.arange(len(counts)) + (k - (len(models) - 1) / 2) * width
                axes.bar(place, counts, width, label=model.replace("_", " "), color=colours[model])
            axes.set_xticks(range(len(labels)), labels, fontsize=8)
            axes.set(title=f"{number} objects, {frames} frames", xlabel="mean error (cm)", ylabel="trajectories")
            axes.grid(axis="y", alpha=0.3)
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    save_figure(figure, path)


def save_belief_curves(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike) -> None:
    """The paper's curves over observed frames, of adjacent pairs without noise; precision and recall by joint."""
    rows = [row for row in rows if (row["pairs"], row["noise"]) == ("adjacent", "none") and row["value"] is not None]
    numbers = sorted({row["objects"] for row in rows})
    figure = Figure(figsize=(13, 3.4 * len(numbers) + 0.6), layout="constrained")
    grid = figure.subplots(len(numbers), 3, squeeze=False, sharex=True, sharey="col")
    curves: defaultdict[tuple[Any, ...], dict[int, float]] = defaultdict(dict)
    for row in rows:
        key = tuple(row[name] for name in ("objects", "metric", "model", "joint"))
        curves[key][row["observed_frames"]] = row["value"]
    models = list(dict.fromkeys(row["model"] for row in rows))
    lines = dict(zip(models, itertools.cycle(LINES), strict=False)) | {INFORMED: ":"}
    handles, colours = {}, colours_of(models)
    for panels, number in zip(grid, numbers, strict=True):
        for axes, metric in zip(panels, ("accuracy", "precision", "recall"), strict=True):
            for model in models:
                for joint in ("all",) if metric == "accuracy" else JOINT_COLOURS:
                    colour = JOINT_COLOURS.get(joint, colours[model])
                    curve = sorted(curves[number, metric, model, joint].items())
                    label = f"{joint}: {model}".replace("_", " ")
                    style: dict[str, Any] = {"linestyle": lines[model], "color": colour}
                    (handles[label],) = axes.plot(*np.reshape(curve, (-1, 2)).T, **style)
            axes.set(title=f"{metric}, {number} objects", xlabel="observed frames")
            axes.grid(alpha=0.3)
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    save_figure(figure, path)


def save_reliability(scenes: Sequence[SceneAnswers], models: Sequence[str], path: str | os.PathLike) -> None:
    """How often answers about adjacent pairs are right, against how sure they were; dots as large as their share."""
    figure = Figure(figsize=(4 * len(RELIABLE_AT), 4 * len(NOISES) + 0.6), layout="constrained")
    grid = figure.subplots(len(NOISES), len(RELIABLE_AT), squeeze=False, sharex=True, sharey=True)
    colours = colours_of(models)
    for panels, noise in zip(grid, NOISES, strict=True):
        for axes, observed in zip(panels, RELIABLE_AT, strict=True):
            time = OBSERVED.index(observed)
            axes.plot((0, 1), (0, 1), color="#bbbbbb", linewidth=1)
            for model in models:
                bins = reliability(*certainty(scenes, model, noise, "adjacent", time))
                style = {"color": colours[model], "label": model.replace("_", " ")}
                there = bins.share > 0
                axes.plot(bins.sure[there], bins.right[there], **style)
                axes.scatter(bins.sure[there], bins.right[there], 200 * bins.share[there], color=style["color"])
            axes.set(title=f"{observed} observed frames, noise: {noise}", xlabel="probability", ylabel="share right")
            axes.grid(alpha=0.3)
    grid[0, 0].legend()
    save_figure(figure, path)


def save_coupled_curves(scenes: Sequence[CoupledErrors], path: str | os.PathLike) -> None:
    """The paper's curves of the mean rollout error over observed frames, with standard errors."""
    numbers = sorted({scene.objects for scene in scenes})
    figure = Figure(figsize=(5 * len(numbers), 4.2), layout="constrained")
    (row,) = figure.subplots(1, len(numbers), squeeze=False)
    for axes, number in zip(row, numbers, strict=True):
        for model in MODELS:
            mean, error = mean_and_standard_error(scenes, number, model)
            axes.plot(STARTS, mean, color=COLOURS[model], label=model.replace("_", " "))
            axes.fill_between(STARTS, mean - error, mean + error, color=COLOURS[model], alpha=0.15, linewidth=0)
        axes.set(title=f"{number} objects", xlabel="observed frames", ylabel="mean error (cm)", ylim=(0, None))
        axes.grid(alpha=0.3)
    handles, names = row[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)
    save_figure(figure, path)


def save_coverage(scenes: Sequence[SceneSpread], path: str | os.PathLike) -> None:
    """How often the truth lies within regions of any stated probability, after 50 frames, of bodies that moved."""
    numbers = sorted({scene.objects for scene in scenes})
    figure = Figure(figsize=(4.5 * len(numbers), 8.4), layout="constrained")
    grid = figure.subplots(2, len(numbers), squeeze=False, sharex=True, sharey=True)
    probability = np.linspace(0, 1, 101)
    handles = {}
    for panels, name in zip(grid, ("level", "yaw_level"), strict=True):
        for axes, number in zip(panels, numbers, strict=True):
            axes.plot((0, 1), (0, 1), color="#bbbbbb", linewidth=1)
            for condition in CONDITIONS:
                chosen = [scene for scene in scenes if scene.objects == number]
                found = np.sort(levels(chosen, condition, 50, name))
                if not len(found):
                    continue
                label = f"joints {condition.joints}"
                label += f" after {condition.observed_frames} frames" if condition.joints == "believed" else ""
                label += "" if condition.masses == "known" else ", masses unknown"
                held = np.searchsorted(found, probability) / len(found)
                (handles[label],) = axes.plot(probability, held, color=SPREAD_COLOURS[condition])
            what = "position" if name == "level" else "yaw"
            axes.set(title=f"{what}, {number} objects", xlabel="stated probability", ylabel="share within")
            axes.grid(alpha=0.3)
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    save_figure(figure, path)


def save_figure(figure: Figure, path: str | os.PathLike) -> None:
    """Write a figure; the kind of file is as the name ends."""
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)
