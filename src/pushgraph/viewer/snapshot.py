"""A scene at one moment, as an image: all of the table, and where a body shall be."""

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pushgraph.planning.goal import Goal, index_of
from pushgraph.scene import Scene
from pushgraph.viewer.drawing import MovableArtist, SceneArtist, outline, prepare

SIZE, DPI = 5.0, 100


def draw_snapshot(scene: Scene, poses: Float[np.ndarray, "nodes 3"], goal: Goal) -> UInt8[np.ndarray, "height width 3"]:
    """poses: of the tool, NaN if it is nowhere, and the bodies, in the world."""
    figure = Figure(figsize=(SIZE, SIZE), dpi=DPI, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    x, y, _ = scene.table.pose_world_from_table
    half = max(scene.table.size) / 2
    prepare(axes, (x - half, x + half, y - half, y + half), "")
    SceneArtist(axes, scene).move(poses, down=False)
    body = index_of(scene, goal.body)
    yaw = poses[1 + body, 2] if goal.yaw is None else goal.yaw
    wanted = MovableArtist(axes, outline(scene.bodies[body].shape, fc="none", ls="--", lw=1.2, zorder=4))
    wanted.move(np.array([*goal.position, yaw]))
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
