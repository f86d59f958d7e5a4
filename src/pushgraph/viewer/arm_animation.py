"""An animation of an arm at work, in three dimensions, drawn by matplotlib: it needs no graphics driver."""

import os
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from pushgraph import pose
from pushgraph.arm import Arm
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.simulation.arm import ArmExecution
from pushgraph.simulation.arm_surface import ArmSurface
from pushgraph.viewer.animation import DPI, check_animation, opened_writer
from pushgraph.viewer.drawing import PALETTE, TOOL_COLOUR

ARM_COLOUR, TABLE_COLOUR = "#9db4c8", "#efe9dd"
HEIGHT = 1.2
"""Of what is shown above the table (m)."""
SIDES = 24
"""Of a drawn cylinder."""
SIZE = 6.0
MOST_PICTURES = 75
LIGHT = np.array([0.3, -0.4, 0.87])


def save_arm_animation(execution: ArmExecution, path: str | os.PathLike) -> None:
    """Write a GIF or an MP4 in real time, of every n-th frame; raises ViewerError as `save_animation` does."""
    check_animation(path)
    track = execution.track
    scene = track.scene
    surface = ArmSurface(scene)
    stride = max(1, -(-len(track.times) // MOST_PICTURES))
    figure = Figure(figsize=(SIZE, SIZE), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = Axes3D(figure, (0.0, 0.0, 1.0, 0.95), computed_zorder=False)
    figure.add_axes(axes)
    _prepare(axes, scene, surface.arm)
    solids = Poly3DCollection([np.zeros((3, 3))], zorder=2)
    axes.add_collection3d(solids)
    heading = figure.text(0.5, 0.94, "", ha="center")
    with opened_writer(figure, path, stride) as writer:
        for frame in range(0, len(track.times), stride):
            angles = execution.joint_positions[frame]
            triangles, colours = _solids(scene, track.poses[frame], surface.lift(angles))
            triangles.append(surface.at(angles))
            colours += [to_rgb(ARM_COLOUR)] * len(triangles[-1])
            corners = np.concatenate(triangles)
            solids.set_verts(list(corners))
            solids.set_facecolor(_shaded(corners, np.array(colours)))
            heading.set_text(f"{track.times[frame]:.2f} s")
            writer.grab_frame()


def _prepare(axes: Axes3D, scene: Scene, arm: Arm) -> None:
    """The table, seen from the side of the arm that its base faces away from."""
    half = np.array(scene.table.size) / 2
    corners = pose.transform(
        np.array(scene.table.pose_world_from_table), half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    )
    shown = np.vstack((corners, [arm.pose_world_from_base[:2]]))
    centre, reach = (shown.min(0) + shown.max(0)) / 2, np.ptp(shown, axis=0).max() / 2
    table = Poly3DCollection([np.column_stack((corners, np.zeros(4)))], facecolor=TABLE_COLOUR, edgecolor="grey")
    table.set_zorder(1)
    axes.add_collection3d(table)
    axes.set(
        xlim=(centre[0] - reach, centre[0] + reach),
        ylim=(centre[1] - reach, centre[1] + reach),
        zlim=(min(0.0, arm.base_height), HEIGHT),
    )
    axes.set_box_aspect((2 * reach, 2 * reach, HEIGHT - min(0.0, arm.base_height)), zoom=1.2)
    towards = np.degrees(arm.pose_world_from_base[2])
    axes.view_init(elev=32, azim=towards + 50)
    axes.set_axis_off()


def _solids(
    scene: Scene, poses: Float[np.ndarray, "nodes 3"], lift: float
) -> tuple[list[np.ndarray], list[tuple[float, float, float]]]:
    """Triangles of the bodies and of the tool's parts, and a colour for each."""
    triangles, colours = [], []
    for index, (body, place) in enumerate(zip(scene.bodies, np.nan_to_num(poses[1:]), strict=True)):
        triangles.append(_prism(pose.transform(place, _outline(body.shape)), 0.0, body.shape.height))
        colours += [PALETTE[index % len(PALETTE)]] * len(triangles[-1])
    for part in scene.tool.parts:
        place = pose.compose(poses[0], np.asarray(part.pose_tool_from_part, dtype=float))
        triangles.append(_prism(pose.transform(place, _outline(part.shape)), lift, lift + part.shape.height))
        colours += [to_rgb(TOOL_COLOUR)] * len(triangles[-1])
    return triangles, colours


def _outline(shape: Cylinder | Cuboid | Polygon) -> Float[np.ndarray, "corners 2"]:
    if isinstance(shape, Polygon):
        return np.array(shape.points)
    half_x, half_y, radius = shape.core
    if radius:
        angles = np.arange(SIDES) * (2 * np.pi / SIDES)
        return radius * np.column_stack((np.cos(angles), np.sin(angles)))
    return np.array([[half_x, half_y], [-half_x, half_y], [-half_x, -half_y], [half_x, -half_y]])


def _prism(corners: Float[np.ndarray, "corners 2"], low: float, high: float) -> Float[np.ndarray, "triangles 3 3"]:
    """Sides and top of an upright prism; the top of a hollow outline is a fan, so it is shown roughly."""
    lower, upper = (np.column_stack((corners, np.full(len(corners), z))) for z in (low, high))
    next_lower, next_upper = np.roll(lower, -1, axis=0), np.roll(upper, -1, axis=0)
    middle = np.broadcast_to(upper.mean(0), upper.shape)
    return np.concatenate(
        [
            np.stack((lower, next_lower, next_upper), 1),
            np.stack((lower, next_upper, upper), 1),
            np.stack((middle, upper, next_upper), 1),
        ]
    )


def _shaded(
    corners: Float[np.ndarray, "triangles 3 3"], colours: Sequence | Float[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "triangles 3"]:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    return np.asarray(colours) * (0.55 + 0.45 * np.abs(normals @ LIGHT) / lengths)[:, None]
