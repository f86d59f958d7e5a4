"""A picture of a track: the scene and the planned pushes on the left, where everything ended on the right."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.viewer.drawing import (
    JOINT_MARKS,
    PALETTE,
    SPREAD_COLOUR,
    TOOL_COLOUR,
    SceneArtist,
    draw_outlines,
    draw_spread,
    prepare,
    view_limits,
)


def save_picture(track: Track, path: str | os.PathLike) -> None:
    """Write a picture of a track; the ending of the name says which kind (png, pdf, svg)."""
    figure = Figure(figsize=(11, 6), layout="constrained")
    before, after = figure.subplots(1, 2)
    limits = view_limits([track])
    seconds = track.times[-1] - track.times[0]
    prepare(before, limits, "Start, and the planned pushes")
    prepare(after, limits, f"After {seconds:.1f} s, with the paths taken")
    SceneArtist(before, track.scene).move(track.poses[0], down=True)
    _draw_pushes(before, track)
    _draw_paths(after, track)
    SceneArtist(after, track.scene).move(track.poses[-1], down=True)
    draw_spread(after, track)
    handles = [Line2D([], [], ls="-", color=TOOL_COLOUR, marker=">", label="push of the tool")]
    kinds = sorted({joint.kind for joint in track.scene.joints})
    handles += [
        Line2D([], [], ls="", markeredgecolor="black", label=f"{kind} joint", **JOINT_MARKS[kind]) for kind in kinds
    ]
    if track.spread is not None:
        handles.append(Line2D([], [], color=SPREAD_COLOUR, lw=1, label="true centres, with 68 and 95 %"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_comparison(tracks: Mapping[str, Track], path: str | os.PathLike) -> None:
    """Write a picture of several tracks of one scene, by title: the start with the pushes, then how each ended.

    In the later pictures dashed outlines show how the first track ended. Ellipses show where true centres are with 68
    and 95 %, as far as a track states that.
    """
    figure = Figure(figsize=(5.5 * (1 + len(tracks)), 6), layout="constrained")
    draw_ends(figure, tracks)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def draw_ends(figure: Figure, tracks: Mapping[str, Track]) -> list[Axes]:
    """Draw what `save_comparison` writes; returns the panels."""
    before, *after = figure.subplots(1, 1 + len(tracks))
    limits = view_limits(list(tracks.values()))
    first = next(iter(tracks.values()))
    prepare(before, limits, "Start, and the planned pushes")
    SceneArtist(before, first.scene).move(first.poses[0], down=True)
    _draw_pushes(before, first)
    for axes, (title, track) in zip(after, tracks.items(), strict=True):
        prepare(axes, limits, f"{title}, after {track.times[-1] - track.times[0]:.1f} s")
        _draw_paths(axes, track)
        SceneArtist(axes, track.scene).move(track.poses[-1], down=True)
        draw_spread(axes, track)
        if track is not first:
            draw_outlines(axes, first)
    return [before, *after]


def _draw_pushes(axes: Axes, track: Track) -> None:
    for number, push in enumerate(track.scene.pushes, start=1):
        points = push.waypoints[:, :2]
        start = points[0]
        axes.plot(*points[:-1].T, color=TOOL_COLOUR, lw=1.5, zorder=6)
        arrow = {"arrowstyle": "-|>", "color": TOOL_COLOUR, "lw": 1.5}
        axes.annotate("", points[-1], points[-2], arrowprops=arrow, zorder=6)
        style: dict[str, Any] = {"color": "white", "fontsize": 8, "weight": "bold", "zorder": 7}
        axes.text(start[0], start[1], f" {number}", ha="center", va="center", **style)
        axes.plot(*start, "o", ms=10, color=TOOL_COLOUR, zorder=6)


def _draw_paths(axes: Axes, track: Track) -> None:
    for node in range(1, len(track.nodes)):
        axes.plot(*track.poses[:, node, :2].T, color=PALETTE[(node - 1) % len(PALETTE)], lw=1.2)
    tool = np.where(track.down[:, None], track.poses[:, 0, :2], np.nan)
    axes.plot(*tool.T, color=TOOL_COLOUR, lw=1, ls=":")
