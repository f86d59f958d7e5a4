"""A picture of a track: the scene and the planned pushes on the left, where everything ended on the right."""

import io
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from pushgraph.scene import Scene
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.viewer.drawing import (
    PALETTE,
    SPREAD_COLOUR,
    TOOL_COLOUR,
    SceneArtist,
    draw_outlines,
    draw_spread,
    joint_marks,
    limits_of,
    outline_mark,
    prepare,
    view_limits,
)
from pushgraph.viewer.names import place_names

PUSH_MARK = Line2D([], [], ls="-", color=TOOL_COLOUR, marker=">", label="push of the tool")
PATH_MARK = Line2D([], [], color=PALETTE[0], lw=1.2, label="path of a body's origin")
TOOL_PATH_MARK = Line2D([], [], color=TOOL_COLOUR, ls=":", lw=1, label="path of the tool")


def save_picture(track: Track | Scene, path: str | os.PathLike) -> None:
    """Write a picture of a track, or of a scene and its pushes; the name's ending says which kind (png, pdf, svg)."""
    figure = draw_scene(track) if isinstance(track, Scene) else draw_track(track)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_comparison(tracks: Mapping[str, Track], path: str | os.PathLike) -> None:
    """Write a picture of several tracks of one scene, by title: the start with the pushes, then how each ended.

    In the later pictures dashed outlines show how the first track ended. Ellipses show where true centres are with 68
    and 95 %, as far as a track states that.
    """
    figure = Figure(figsize=(5.5 * (1 + len(tracks)), 6), layout="constrained")
    place_names(figure, draw_ends(figure, tracks))
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def png_of(shown: Track | Scene) -> bytes:
    """The picture of a track or a scene, as a notebook shows it."""
    figure = draw_scene(shown) if isinstance(shown, Scene) else draw_track(shown)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=80)
    return image.getvalue()


def draw_scene(scene: Scene) -> Figure:
    """The scene and its planned pushes."""
    figure = Figure(figsize=(5.5, 6), layout="constrained")
    axes = figure.subplots()
    waypoints = np.concatenate([np.full((1, 3), np.nan), *(push.waypoints for push in scene.pushes)])
    limits = limits_of(scene, np.vstack((scene.poses_world_from_body, waypoints)))
    prepare(axes, limits, "Start, and the planned pushes")
    start = np.full(3, np.nan) if not scene.pushes else waypoints[1]
    names = _draw_start(axes, scene, np.vstack((start, scene.poses_world_from_body)))
    _add_legend(figure, [scene], spread=False)
    place_names(figure, [(axes, names)])
    return figure


def draw_track(track: Track) -> Figure:
    """The scene and the planned pushes on the left, where everything ended on the right."""
    figure = Figure(figsize=(11, 6), layout="constrained")
    place_names(figure, draw_ends(figure, {"": track}))
    return figure


def draw_ends(
    figure: Figure, tracks: Mapping[str, Track], marks: Sequence[Line2D] = ()
) -> list[tuple[Axes, list[Text]]]:
    """Draw what `save_comparison` writes; returns the panels, each with its names, which are still to be placed.

    marks: what the legend shall explain beside its own.
    """
    before, *after = figure.subplots(1, 1 + len(tracks))
    limits = view_limits(list(tracks.values()))
    title, first = next(iter(tracks.items()))
    prepare(before, limits, "Start, and the planned pushes")
    panels = [(before, _draw_start(before, first.scene, first.poses[0]))]
    for axes, (of, track) in zip(after, tracks.items(), strict=True):
        heading = f"{of}, after" if of else "After"
        prepare(axes, limits, f"{heading} {track.times[-1] - track.times[0]:.1f} s")
        _draw_paths(axes, track)
        artist = SceneArtist(axes, track.scene)
        artist.move(track.poses[-1], down=True)
        panels.append((axes, artist.names))
        draw_spread(axes, track)
        if track is not first:
            draw_outlines(axes, first)
    extra = [PATH_MARK, TOOL_PATH_MARK]
    if len(tracks) > 1:
        extra.append(outline_mark(title))
    spread = any(track.spread is not None for track in tracks.values())
    _add_legend(figure, [track.scene for track in tracks.values()], spread, [*extra, *marks])
    return panels


def _draw_start(axes: Axes, scene: Scene, poses: Float[np.ndarray, "nodes 3"]) -> list[Text]:
    """The scene and its pushes; returns the names of the bodies."""
    artist = SceneArtist(axes, scene)
    artist.move(poses, down=True)
    _draw_pushes(axes, scene)
    return artist.names


def _add_legend(figure: Figure, scenes: Sequence[Scene], spread: bool, marks: Sequence[Line2D] = ()) -> None:
    """What lines and marks mean, below the panels."""
    handles = [*[PUSH_MARK] * any(scene.pushes for scene in scenes), *joint_marks(scenes), *marks]
    if spread:
        handles.append(Line2D([], [], color=SPREAD_COLOUR, lw=1, label="true centres, with 68 and 95 %"))
    columns = max(1, int(figure.get_figwidth() / 2.4))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def _draw_pushes(axes: Axes, scene: Scene) -> None:
    for number, push in enumerate(scene.pushes, start=1):
        points = push.waypoints[:, :2]
        start = points[0]
        axes.plot(*points.T, color=TOOL_COLOUR, lw=1.5, zorder=6)
        arrow = {"arrowstyle": "-|>", "color": TOOL_COLOUR, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", points[-1], points[-2], arrowprops=arrow, zorder=6)
        style: dict[str, Any] = {"color": "white", "fontsize": 8, "weight": "bold", "zorder": 7}
        axes.text(start[0], start[1], f" {number}", ha="center", va="center", **style)
        axes.plot(*start, "o", ms=10, color=TOOL_COLOUR, zorder=6)


def _draw_paths(axes: Axes, track: Track) -> None:
    for node in range(1, len(track.nodes)):
        axes.plot(*track.poses[:, node, :2].T, color=PALETTE[(node - 1) % len(PALETTE)], lw=1.2)
    tool = np.where(track.down[:, None], track.poses[:, 0, :2], np.nan)
    axes.plot(*tool.T, color=TOOL_COLOUR, lw=1, ls=":")
