"""Pictures of beliefs: probabilities over time, and bars beside predictions."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.viewer.drawing import SceneArtist, draw_outlines, prepare, view_limits

JOINT_COLOURS = {"none": "#dddddd", "fixed": "#303030", "prismatic": "#e0a800", "revolute": "#3070c0"}
CERTAIN = 0.98
"""A pair that was never less sure of not being joined than this is left out of pictures."""
MOST_PAIRS = 16


def telling_pairs(probabilities: Float[np.ndarray, "frames pairs joints"]) -> list[int]:
    """Pairs that ever may have been joined, the likeliest first, as many as a picture holds."""
    joined = 1 - probabilities[..., JOINT_CODES["none"]]
    telling = np.flatnonzero(joined.max(0) > 1 - CERTAIN)
    order = np.argsort(-joined[-1, telling], kind="stable")
    return telling[order][:MOST_PAIRS].tolist()


def save_beliefs(
    pairs: Sequence[tuple[str, str]],
    times: Float[np.ndarray, " frames"],
    probabilities: Float[np.ndarray, "frames pairs joints"],
    path: str | os.PathLike,
) -> None:
    """Write a picture of the probabilities of every joint over time, one stripe a pair."""
    shown = telling_pairs(probabilities)
    figure = Figure(figsize=(9, 1.2 + 0.7 * max(1, len(shown))), layout="constrained")
    for axes, pair in zip(
        figure.subplots(max(1, len(shown)), 1, squeeze=False, sharex=True)[:, 0], shown, strict=False
    ):
        axes.stackplot(times, probabilities[:, pair].T, colors=list(JOINT_COLOURS.values()))
        axes.set(ylim=(0, 1), yticks=[], xlim=(times[0], max(times[-1], times[0] + 1e-3)))
        axes.set_ylabel(" - ".join(pairs[pair]), rotation=0, ha="right", va="center", fontsize=9)
    figure.supxlabel("time (s)", fontsize=9)
    figure.legend(handles=_legend(), loc="outside upper center", ncols=len(JOINT_COLOURS), frameon=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_believed_predictions(
    simulated: Track,
    moments: Mapping[str, tuple[Track, Float[np.ndarray, "pairs joints"]]],
    pairs: Sequence[tuple[str, str]],
    path: str | os.PathLike,
) -> None:
    """Write a picture of what was predicted at some moments, by title, over bars of what was believed then.

    Dashed outlines show how it truly ended.
    """
    shown = telling_pairs(np.stack([probabilities for _, probabilities in moments.values()]))
    figure = Figure(figsize=(5.2 * (1 + len(moments)), 8.2), layout="constrained")
    rows = figure.subplots(2, 1 + len(moments), height_ratios=(3, 1), squeeze=False)
    limits = view_limits([simulated, *(track for track, _ in moments.values())])
    prepare(rows[0][0], limits, "Simulated")
    SceneArtist(rows[0][0], simulated.scene).move(simulated.poses[-1], down=True)
    rows[1][0].axis("off")
    rows[1][0].legend(handles=_legend(), loc="center", frameon=False)
    for top, bottom, (title, (track, probabilities)) in zip(rows[0][1:], rows[1][1:], moments.items(), strict=True):
        prepare(top, limits, title)
        SceneArtist(top, track.scene).move(track.poses[-1], down=True)
        draw_outlines(top, simulated)
        _bars(bottom, [" - ".join(pairs[pair]) for pair in shown], probabilities[shown])
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def _bars(axes: Axes, names: Sequence[str], probabilities: Float[np.ndarray, "pairs joints"]) -> None:
    left = np.zeros(len(names))
    for column, colour in zip(probabilities.T, JOINT_COLOURS.values(), strict=True):
        axes.barh(names, column, left=left, color=colour)
        left = left + column
    axes.set(xlim=(0, 1), xlabel="belief")
    axes.invert_yaxis()


def _legend() -> list[Patch]:
    return [Patch(color=colour, label=kind) for kind, colour in JOINT_COLOURS.items()]
