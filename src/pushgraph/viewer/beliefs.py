"""Pictures of beliefs: probabilities over time, and bars beside predictions."""

import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Patch

from pushgraph.belief_history import BeliefHistory
from pushgraph.believed_mass import BelievedMass
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.mass_history import MassHistory
from pushgraph.mass_prior import MassClass, class_of
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.viewer.drawing import (
    SceneArtist,
    draw_outlines,
    joint_marks,
    outline_mark,
    prepare,
    view_limits,
)
from pushgraph.viewer.names import place_names

JOINT_COLOURS = {"none": "#dddddd", "fixed": "#303030", "prismatic": "#e0a800", "revolute": "#3070c0"}
CERTAIN = 0.98
"""A pair that was never less sure of not being joined than this is left out of pictures."""
MOST_STRIPES = 16


class Moment(NamedTuple):
    """What was believed at some moment, and what was predicted with it."""

    predicted: Track
    joints: Float[np.ndarray, "pairs joints"]
    masses: Sequence[BelievedMass]


def telling_pairs(probabilities: Float[np.ndarray, "frames pairs joints"]) -> list[int]:
    """Pairs that ever may have been joined, the likeliest first, as many as a picture holds."""
    joined = 1 - probabilities[..., JOINT_CODES["none"]]
    telling = np.flatnonzero(joined.max(0) > 1 - CERTAIN)
    order = np.argsort(-joined[-1, telling], kind="stable")
    return telling[order][:MOST_STRIPES].tolist()


def telling_bodies(masses: MassHistory) -> list[int]:
    """Bodies of which most was learnt, in their order, as many as a picture holds."""
    learnt = np.abs(masses.probabilities[-1] - masses.probabilities[0]).sum(-1)
    return sorted(np.argsort(-learnt, kind="stable")[:MOST_STRIPES].tolist())


def mass_colours(classes: Sequence[MassClass]) -> dict[str, str]:
    """A colour for each class by name, in the classes' order: the heavier, the darker."""
    rising = sorted(range(len(classes)), key=lambda k: classes[k].lowest)
    shades = matplotlib.colormaps["YlGn"](np.linspace(0.25, 0.95, len(classes)))
    return {one.name: to_hex(shades[rising.index(k)]) for k, one in enumerate(classes)}


def save_beliefs(history: BeliefHistory, path: str | os.PathLike) -> None:
    """Write a picture of the probabilities over time: of joints, one stripe a pair, and of masses, one a body."""
    pairs, masses = telling_pairs(history.probabilities), history.mass_history
    bodies = [] if masses is None else telling_bodies(masses)
    rows = max(1, len(pairs), len(bodies))
    figure = Figure(figsize=(17 if bodies else 9, 1.2 + 0.7 * rows), layout="constrained")
    panels = figure.subfigures(1, 2 if bodies else 1, squeeze=False)[0]
    names = [" - ".join(history.pairs[pair]) for pair in pairs]
    _stripes(panels[0], history.times, history.probabilities[:, pairs], names, JOINT_COLOURS, rows)
    if masses is not None:
        names = [f"{masses.believed[body].body}\n{_kilograms(masses.believed[body])}" for body in bodies]
        colours = mass_colours(history.scene.classes_of_mass)
        _stripes(panels[1], masses.times, masses.probabilities[:, bodies], names, colours, rows)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_believed_predictions(
    simulated: Track, moments: Mapping[str, Moment], pairs: Sequence[tuple[str, str]], path: str | os.PathLike
) -> None:
    """Write a picture of what was predicted at some moments, by title, over bars of what was believed then.

    Dashed outlines show how it truly ended. Masses stand there if any were learnt, the true ones first.
    """
    shown = telling_pairs(np.stack([moment.joints for moment in moments.values()]))
    *_, last = moments.values()
    colours = mass_colours(simulated.scene.classes_of_mass)
    heights = (3, 1, 1) if last.masses else (3, 1)
    figure = Figure(figsize=(5.2 * (1 + len(moments)), 5.2 * sum(heights) / 3 + 1.2), layout="constrained")
    rows = figure.subplots(len(heights), 1 + len(moments), height_ratios=heights, squeeze=False)
    limits = view_limits([simulated, *(moment.predicted for moment in moments.values())])
    prepare(rows[0][0], limits, "Simulated")
    artist = SceneArtist(rows[0][0], simulated.scene)
    artist.move(simulated.poses[-1], down=True)
    panels = [(rows[0][0], artist.names)]
    rows[1][0].axis("off")
    rows[1][0].legend(handles=_handles(JOINT_COLOURS), loc="center", frameon=False)
    for (top, middle, *_), (title, moment) in zip(rows.T[1:], moments.items(), strict=True):
        prepare(top, limits, title)
        artist = SceneArtist(top, moment.predicted.scene)
        artist.move(moment.predicted.poses[-1], down=True)
        panels.append((top, artist.names))
        draw_outlines(top, simulated)
        _bars(middle, [" - ".join(pairs[pair]) for pair in shown], moment.joints[shown], JOINT_COLOURS)
        middle.set_xlabel("belief in joints")
    if last.masses:
        _true_masses(rows[2][0], simulated, [mass.body for mass in last.masses], colours)
        for bottom, moment in zip(rows[2][1:], moments.values(), strict=True):
            probabilities = np.array([[mass.classes[name] for name in colours] for mass in moment.masses])
            _bars(bottom, [f"{mass.body}, {mass.mass[0]:.2f} kg" for mass in moment.masses], probabilities, colours)
            bottom.set_xlabel("belief in classes of mass")
    scenes = [simulated.scene, *(moment.predicted.scene for moment in moments.values())]
    marks = [*joint_marks(scenes), outline_mark("simulated")]
    figure.legend(handles=marks, loc="outside upper center", ncols=len(marks), frameon=False)
    place_names(figure, panels)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def _stripes(
    figure: FigureBase,
    times: Float[np.ndarray, " frames"],
    probabilities: Float[np.ndarray, "frames stripes kinds"],
    names: Sequence[str],
    colours: Mapping[str, str],
    rows: int,
) -> None:
    """Stacked probabilities over time, one below the other, on a figure with room for so many rows."""
    grid = figure.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
    for axes, name, stripe in zip(grid, names, np.moveaxis(probabilities, 1, 0), strict=False):
        axes.stackplot(times, stripe.T, colors=list(colours.values()))
        axes.set(ylim=(0, 1), yticks=[], xlim=(times[0], max(times[-1], times[0] + 1e-3)))
        axes.set_ylabel(name, rotation=0, ha="right", va="center", fontsize=9)
    for axes in grid[len(names) :]:
        axes.axis("off")
    if len(names):
        lowest = grid[len(names) - 1]
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("time (s)", fontsize=9)
    figure.legend(handles=_handles(colours), loc="outside upper center", ncols=len(colours), frameon=False)


def _bars(
    axes: Axes, names: Sequence[str], probabilities: Float[np.ndarray, "rows kinds"], colours: Mapping[str, str]
) -> None:
    left = np.zeros(len(names))
    for column, colour in zip(probabilities.T, colours.values(), strict=True):
        axes.barh(names, column, left=left, color=colour)
        left = left + column
    axes.set(xlim=(0, 1))
    axes.invert_yaxis()


def _true_masses(axes: Axes, simulated: Track, names: Sequence[str], colours: Mapping[str, str]) -> None:
    """Bars of the true masses of some bodies, in the colours of their classes."""
    classes = simulated.scene.classes_of_mass
    masses = {body.name: body.mass for body in simulated.scene.bodies if body.name in names and body.mass is not None}
    shades = [colours[classes[class_of(classes, mass)].name] for mass in masses.values()]
    axes.barh(list(masses), list(masses.values()), color=shades)
    axes.set_xlabel("true mass (kg)")
    axes.invert_yaxis()
    axes.legend(
        handles=_handles({f"{one.name}, {one.lowest:g} to {one.highest:g} kg": colours[one.name] for one in classes}),
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        frameon=False,
    )


def _kilograms(mass: BelievedMass) -> str:
    median, low, high = mass.mass
    return f"{median:.2g} kg ({low:.2g} to {high:.2g})"


def _handles(colours: Mapping[str, str]) -> list[Patch]:
    return [Patch(color=colour, label=name) for name, colour in colours.items()]
