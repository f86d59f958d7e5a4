"""Figures of the evaluations of masses."""

import itertools
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from pushgraph.evaluation.controlled_masses import (
    HISTOGRAM,
    MIX_UPS,
    REFERENCE_HISTOGRAM,
    ControlledScene,
    confusion,
    hardly_different,
    histogram,
    mix_ups,
    reference_histogram,
)
from pushgraph.evaluation.coupled import CoupledErrors, mean_and_standard_error
from pushgraph.evaluation.coupled_masses import FIRST_PUSH, MODELS, STARTS
from pushgraph.evaluation.figures import COLOURS, colours_of, save_figure
from pushgraph.evaluation.masses import INPUTS, SUBSETS
from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation.masses import controlled_scene

INPUT_LINES = dict(zip(INPUTS, ("-", "--", ":"), strict=True))
MISTAKES = dict(zip(MIX_UPS, ("the right class", "light-normal or\nnormal-heavy", "light-heavy"), strict=True))
BODY_COLOURS = ("#2060c0", "#c04040", "#40a060")


def save_mass_curves(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike) -> None:
    """The paper's curve: mean error over observed frames, for each number of objects and subset of bodies."""
    rows = [row for row in rows if row["metric"] == "mean_abs_error_kg" and row["value"] is not None]
    numbers = sorted({row["objects"] for row in rows})
    figure = Figure(figsize=(13, 3.4 * len(numbers) + 0.6), layout="constrained")
    grid = figure.subplots(len(numbers), len(SUBSETS), squeeze=False, sharex=True, sharey=True)
    handles, colours = {}, colours_of(row["model"] for row in rows)
    for panels, number in zip(grid, numbers, strict=True):
        for axes, subset in zip(panels, SUBSETS, strict=True):
            here = [row for row in rows if (row["objects"], row["subset"]) == (number, subset)]
            here = [row for row in here if row["observed_frames"] != "end"]
            for model, given in dict.fromkeys((row["model"], row["input"]) for row in here):
                curve = [row for row in here if (row["model"], row["input"]) == (model, given)]
                label = f"{model}, {given}".replace("_", " ")
                places, values = zip(*((row["observed_frames"], row["value"]) for row in curve), strict=True)
                (handles[label],) = axes.plot(places, values, INPUT_LINES[given], color=colours[model])
            title = f"{number} objects, {'all' if subset == 'all' else 'those ' + subset}"
            axes.set(title=title, xlabel="observed frames", ylabel="mean error (kg)", ylim=(0, None))
            axes.grid(alpha=0.3)
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, frameon=False)
    save_figure(figure, path)


def save_mass_histograms(scenes: Sequence[ControlledScene], path: str | os.PathLike) -> None:
    """Scenes by mean error, by the reference's root mean square error, and by their worst mistake."""
    numbers = sorted({scene.objects for scene in scenes})
    figure = Figure(figsize=(15, 3.4 * len(numbers) + 0.6), layout="constrained")
    grid = figure.subplots(len(numbers), 3, squeeze=False, sharey="row")
    kinds = (
        (histogram, "mean error (kg)", _bins(HISTOGRAM)),
        (reference_histogram, "reference: root mean square, robot included (kg)", _bins(REFERENCE_HISTOGRAM)),
        (mix_ups, "mixed up", list(MISTAKES.values())),
    )
    for panels, number in zip(grid, numbers, strict=True):
        chosen = [scene for scene in scenes if scene.objects == number]
        contenders = list(chosen[0].answers)
        colours = colours_of(model for model, _ in contenders)
        for axes, (count, what, names) in zip(panels, kinds, strict=True):
            for k, (model, given) in enumerate(contenders):
                place = np.arange(len(names)) + 0.8 * ((k + 0.5) / len(contenders) - 0.5)
                style = {"color": colours[model], "hatch": "//" if given == "force" else None, "edgecolor": "white"}
                label = f"{model}, {given}".replace("_", " ")
                axes.bar(place, count(chosen, model, given), 0.8 / len(contenders), label=label, **style)
            axes.set_xticks(range(len(names)), names, fontsize=8)
            axes.set(title=f"{number} objects", xlabel=what, ylabel="scenes")
            axes.grid(axis="y", alpha=0.3)
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    save_figure(figure, path)


def save_confusion(scenes: Sequence[ControlledScene], path: str | os.PathLike) -> None:
    """Shares of the classes that were told, of bodies truly of each class, from motion."""
    numbers = sorted({scene.objects for scene in scenes})
    models = [model for model, given in scenes[0].answers if given == "motion" and model != "median_guess"]
    figure = Figure(figsize=(3.6 * len(models), 3.4 * len(numbers)), layout="constrained")
    grid = figure.subplots(len(numbers), len(models), squeeze=False)
    names = [one.name for one in MASS_CLASSES]
    for panels, number in zip(grid, numbers, strict=True):
        for axes, model in zip(panels, models, strict=True):
            counts = confusion([scene for scene in scenes if scene.objects == number], model, "motion")
            shares = counts / np.maximum(counts.sum(1, keepdims=True), 1)
            axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
            for (true, said), share in np.ndenumerate(shares):
                axes.text(said, true, f"{share:.2f}", ha="center", va="center", color="w" if share > 0.5 else "k")
            axes.set_xticks(range(len(names)), names)
            axes.set_yticks(range(len(names)), names)
            axes.set(title=f"{model.replace('_', ' ')}, {number} objects", xlabel="said", ylabel="true")
    save_figure(figure, path)


def save_alike(scenes: Sequence[ControlledScene], path: str | os.PathLike) -> bool:
    """The two scenes that look most alike although their masses differ, and what is said of both; whether there are."""
    found = hardly_different(scenes)
    if found is None:
        return False
    *pair, apart = found
    chosen = [scenes[k] for k in pair]
    contenders = [key for key in chosen[0].answers if key[0] != "median_guess"]
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    figure.suptitle(f"Bodies are {1000 * apart:.2g} mm apart on average, and weigh differently")
    for column, (above, below) in enumerate(figure.subplots(2, 2, sharey="row").T):
        _draw_motion(above, controlled_scene(chosen[column].objects), chosen[column])
        _draw_intervals(below, chosen[column], contenders)
        above.set_title(f"observation {'AB'[column]}")
    handles, names = figure.axes[-1].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    save_figure(figure, path)
    return True


def save_coupled_mass_curves(scenes: Sequence[CoupledErrors], path: str | os.PathLike) -> None:
    """Mean rollout error over observed frames, with standard errors; dots stand for the end of the first push."""
    numbers = sorted({scene.objects for scene in scenes})
    figure = Figure(figsize=(5 * len(numbers), 4.2), layout="constrained")
    (row,) = figure.subplots(1, len(numbers), squeeze=False)
    for axes, number in zip(row, numbers, strict=True):
        for model in MODELS:
            mean, error = mean_and_standard_error(scenes, number, model)
            style = {"color": COLOURS[model]}
            axes.plot(STARTS, mean[:-1], label=model.replace("_", " "), **style)
            axes.fill_between(STARTS, (mean - error)[:-1], (mean + error)[:-1], alpha=0.15, linewidth=0, **style)
            axes.errorbar(STARTS[-1] + 15, mean[-1], error[-1], fmt="o", **style)
        axes.set_xticks([*STARTS[::2], STARTS[-1] + 15], [*map(str, STARTS[::2]), FIRST_PUSH.replace("_", "\n")])
        axes.set(title=f"{number} objects", xlabel="observed frames", ylabel="mean error (cm)", ylim=(0, None))
        axes.grid(alpha=0.3)
    handles, names = row[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)
    save_figure(figure, path)


def _draw_motion(axes: Axes, scene: Scene, observed: ControlledScene) -> None:
    for k, (body, colour) in enumerate(zip(scene.bodies, BODY_COLOURS, strict=False)):
        assert isinstance(body.shape, Cylinder)
        for pose, style in ((observed.poses[0, k], ":"), (observed.poses[-1, k], "-")):
            axes.add_patch(Circle(tuple(pose[:2]), body.shape.diameter / 2, fill=False, linestyle=style, color=colour))
        axes.plot(*observed.poses[:, k, :2].T, color=colour, linewidth=1)
        axes.annotate(
            f"{observed.masses[k]:.2f} kg", tuple(observed.poses[-1, k, :2]), ha="center", va="center", fontsize=8
        )
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_aspect("equal")


def _draw_intervals(axes: Axes, observed: ControlledScene, contenders: Sequence[tuple[str, str]]) -> None:
    places = np.arange(observed.objects)
    axes.plot(places - 0.3, observed.masses, "k_", markersize=14, label="true")
    colours = colours_of(model for model, _ in contenders)
    for k, (model, given) in enumerate(contenders):
        answer = observed.answers[model, given]
        ends = np.stack((answer.median - answer.low, answer.high - answer.median))
        place = places - 0.15 + 0.45 * k / max(1, len(contenders) - 1)
        label, marker = f"{model}, {given}".replace("_", " "), "s" if given == "force" else "o"
        axes.errorbar(place, answer.median, ends, capsize=3, label=label, fmt=marker, color=colours[model])
    axes.set_xticks(places, [f"body {k}" for k in places])
    axes.set(ylabel="mass, 68 % interval (kg)", yscale="log")
    axes.grid(alpha=0.3)


def _bins(edges: Sequence[float]) -> list[str]:
    between = [f"{low:.3g}-{high:.3g}" for low, high in itertools.pairwise(edges)]
    return [f"< {edges[0]:.3g}", *between, f"> {edges[-1]:.3g}"]
