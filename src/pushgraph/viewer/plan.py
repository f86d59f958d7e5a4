"""A picture of a plan: the start and what is planned, and where that is expected to end, beside the goal."""

import os
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pushgraph.planning.goal import Goal, index_of
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.viewer.drawing import MovableArtist, outline
from pushgraph.viewer.names import place_names
from pushgraph.viewer.picture import draw_ends

GOAL_COLOUR = "#209040"


def save_plan(tracks: Mapping[str, Track], goal: Goal, path: str | os.PathLike) -> None:
    """Write a picture of the tracks of one plan, by title, such as expected and simulated."""
    figure = Figure(figsize=(5.5 * (1 + len(tracks)), 6), layout="constrained")
    mark = Line2D([], [], color=GOAL_COLOUR, lw=2.0, label="the goal")
    panels = draw_ends(figure, tracks, [mark])
    for axes, _ in panels:
        _draw_goal(axes, next(iter(tracks.values())), goal)
    place_names(figure, panels)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def _draw_goal(axes: Axes, track: Track, goal: Goal) -> None:
    """The outline of the body where it shall be; turned as it is, if any turn will do."""
    body = index_of(track.scene, goal.body)
    yaw = track.poses[-1, 1 + body, 2] if goal.yaw is None else goal.yaw
    shape = track.scene.bodies[body].shape
    MovableArtist(axes, outline(shape, fc="none", ec=GOAL_COLOUR, lw=2.0, zorder=9)).move(
        np.array([*goal.position, yaw])
    )
    axes.plot(*goal.position, "+", color=GOAL_COLOUR, ms=12, mew=2, zorder=9)
