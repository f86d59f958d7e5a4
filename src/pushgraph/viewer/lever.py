"""Pictures and animations of boards that are levered up."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pushgraph import pose_3d
from pushgraph.lever_scene import LeverScene, corners
from pushgraph.lever_track import LeverTrack
from pushgraph.storage import replacing
from pushgraph.viewer.animation import DPI, check_animation, opened_writer
from pushgraph.viewer.box_view import DrawnBox, View, image_of

BOARD_COLOUR, FIXED_COLOUR, TOOL_COLOUR, TRUE_COLOUR = (
    (0.25, 0.70, 0.42),
    (0.78, 0.80, 0.84),
    (0.90, 0.52, 0.22),
    (0.15, 0.3, 0.7),
)
TRUE_ALPHA = 0.35
SNAPSHOTS = 4
MOST_PICTURES = 31
PIXELS = (400, 230)
ELEVATION, BESIDE = np.radians(16.0), np.radians(65.0)
"""How high the view looks down, and from how far beside the tool."""
MARGIN = 1.08
"""Width of the view relative to the scene's largest extent."""


def save_lever_picture(
    tracks: Mapping[str, LeverTrack], path: str | os.PathLike, frames: Sequence[int] | None = None
) -> None:
    """Write a picture: a row of moments of each track, by title; transparent: the board of the first track then.

    frames: the moments; by default, evenly spread from the start to the end.
    """
    first = next(iter(tracks.values()))
    moments = np.linspace(0, len(first.poses) - 1, SNAPSHOTS).round().astype(int) if frames is None else frames
    figure = Figure(figsize=(3.6 * len(moments), 2.6 * len(tracks)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(tracks), len(moments), squeeze=False)
    for row, (title, track) in zip(grid, tracks.items(), strict=True):
        for axes, frame in zip(row, moments, strict=True):
            _draw(axes, track, int(frame), first)
            _set_heading(axes, title, first.times[frame])
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_lever_animation(tracks: Mapping[str, LeverTrack], path: str | os.PathLike) -> None:
    """Write a GIF or an MP4 of tracks side by side, in real time; long ones show every n-th frame."""
    check_animation(path)
    first = next(iter(tracks.values()))
    stride = max(1, -(-len(first.poses) // MOST_PICTURES))
    figure = Figure(figsize=(4.5 * len(tracks), 3.2), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(tracks), squeeze=False)[0]
    with opened_writer(figure, path, stride) as writer:
        for frame in range(0, len(first.poses), stride):
            for axes, (title, track) in zip(panels, tracks.items(), strict=True):
                axes.clear()
                _draw(axes, track, frame, first)
                _set_heading(axes, title, first.times[frame])
            writer.grab_frame()


def _set_heading(axes: Axes, title: str, time: float) -> None:
    axes.set_title(f"{title + ', ' if title else ''}{time:.2f} s", fontsize=10)


def _draw(axes: Axes, track: LeverTrack, frame: int, true: LeverTrack) -> None:
    """Draw a track at a frame, and the board of the true track as a transparent one."""
    boxes = _boxes(track.scene, track.poses[min(frame, len(track.poses) - 1)])
    if true is not track:
        board = true.scene.bodies[true.scene.board]
        boxes.append(DrawnBox(board.size, true.board[min(frame, len(true.board) - 1)], TRUE_COLOUR, TRUE_ALPHA))
    axes.imshow(image_of(boxes, _view(true)))
    axes.set_axis_off()


def _boxes(scene: LeverScene, poses: Float[np.ndarray, "nodes 7"]) -> list[DrawnBox]:
    bodies = [
        DrawnBox(body.size, pose, FIXED_COLOUR if body.fixed else BOARD_COLOUR)
        for body, pose in zip(scene.bodies, poses[1:], strict=True)
    ]
    return bodies + [DrawnBox(box.size, pose_3d.compose(poses[0], box.pose), TOOL_COLOUR) for box in scene.tool.boxes]


def _view(track: LeverTrack) -> View:
    """From beside the tool, wide enough for all bodies at the start."""
    points = np.concatenate([corners(body.size, body.pose) for body in track.scene.bodies])
    middle, extent = (points.max(0) + points.min(0)) / 2, (points.max(0) - points.min(0)).max()
    outward = track.poses[0, 0, :2] - middle[:2]
    azimuth = float(np.arctan2(outward[1], outward[0])) - BESIDE
    return View.from_direction(azimuth, ELEVATION, middle, MARGIN * np.sqrt(2) * extent, PIXELS)
