"""The table top with a line every 10 cm, and where a scene is first seen from."""

from typing import Any

import numpy as np
import viser
from jaxtyping import Float, UInt8

from pushgraph.lever_scene import LeverScene, corners
from pushgraph.scene import Scene, Table
from pushgraph.view.drawing.colours import GRID, LIT_TABLE, TABLE
from pushgraph.view.drawing.layer import Layer, add_lines, add_solid
from pushgraph.view.drawing.names import View
from pushgraph.view.drawing.placing import in_space, start_of
from pushgraph.view.drawing.solids import box

THICKNESS = 0.02
LINES = 0.1
PIXEL, MOST_PIXELS = 0.002, 2048
"""Size of a pixel where the table is an image (m), larger on larger tables."""
ELEVATION, LOW = np.radians(52), np.radians(28)
NEARER = 0.92
"""What is seen from above is not as high as it is wide."""
ASIDE = np.radians(50)
"""So far from where its base faces is an arm seen from."""
ARM_HEIGHT = 0.5
"""Of an arm at work above its base (m)."""
FIELD = np.radians(40)
"""Of view, from lower to upper rim."""
LETTERS = (40, 75)
"""So many lines of text are as high as what is seen: smaller than the first where bodies are small, but never smaller
than the second."""
BODY_LETTERS = 0.35
"""Height of a line of text, over the usual breadth of a body."""


class DrawnTable:
    """The table of a scene; one of a lever scene is as large as what lies on it.

    Where there are no shadows to fall on it, it is an image, which is several times faster to draw.
    """

    def __init__(self, api: viser.SceneApi, node: str) -> None:
        self._layer = Layer(api, node)

    def show(self, scene: Scene | LeverScene, shadows: bool) -> None:
        """Draw it, if it is another than before."""
        table, height = (scene.table, 0.0) if isinstance(scene, Scene) else _under(scene)
        self._layer.draw((table, height, shadows), lambda: self._draw(table, height, shadows))

    def clear(self) -> None:
        """Remove it."""
        self._layer.clear()

    def _draw(self, table: Table, height: float, shadows: bool) -> None:
        api, node = self._layer.api, f"{self._layer.node}/top"
        place = in_space(np.array(table.pose_world_from_table), height).tolist()
        api.add_frame(node, show_axes=False, position=place[:3], wxyz=place[3:])
        x, y = table.size
        if not shadows:
            # An image faces down, its first row ahead: half a turn about x brings its face up.
            look: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False, "wxyz": (0.0, 1.0, 0.0, 0.0)}
            api.add_image(f"{node}/image", _from_above(table), x, y, position=(0.0, 0.0, -1e-3), **look)
            return
        top = box((x, y, THICKNESS))
        add_solid(api, f"{node}/solid", top, TABLE, position=(0.0, 0.0, -THICKNESS / 2 - 1e-3), cast_shadow=False)
        on_x, on_y = (_lines(length) for length in (x, y))
        along = [[[at, -y / 2], [at, y / 2]] for at in on_x] + [[[-x / 2, at], [x / 2, at]] for at in on_y]
        flat = np.concatenate((np.array(along), np.zeros((len(along), 2, 1))), -1)
        add_lines(api, f"{node}/grid", flat, GRID, 1.0)


def _lines(length: float) -> Float[np.ndarray, " lines"]:
    most = int(length / 2 / LINES + 1e-9)  # rounding shall not lose the lines at the rims
    return np.arange(-most, most + 1) * LINES


def _from_above(table: Table) -> UInt8[np.ndarray, "rows columns 3"]:
    pixel = max(PIXEL, max(table.size) / MOST_PIXELS)
    columns, rows = (max(2, round(length / pixel)) for length in table.size)
    image = np.full((rows, columns, 3), LIT_TABLE, dtype=np.uint8)
    for axis, (length, pixels) in enumerate(zip(table.size, (columns, rows), strict=True)):
        at = np.minimum((_lines(length) / length + 0.5) * pixels, pixels - 1).astype(int)
        image.swapaxes(0, 1 - axis)[at] = GRID
    return image


def _under(scene: LeverScene) -> tuple[Table, float]:
    low, high = extent(scene)
    size = tuple(np.ceil((high - low)[:2] * 10 + 2) / 10)
    x, y = ((low + high) / 2)[:2].round(2).tolist()
    return Table(size=size, pose_world_from_table=(x, y, 0.0)), min(0.0, float(low[2]))


def extent(scene: Scene | LeverScene) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lowest and highest coordinates (m) of the bodies and of the pushes' way-points."""
    if isinstance(scene, LeverScene):
        places = [corners(body.size, body.pose) for body in scene.bodies]
        path = scene.tool_poses(np.array([point.time for point in scene.path]))[:, :3]
        points = np.concatenate((*places, path))
        return points.min(0), points.max(0)
    centres = start_of(scene)[1:, :3]
    reach = np.array([[body.shape.reach, body.shape.reach, 0.0] for body in scene.bodies])
    tops = centres + [[0.0, 0.0, body.shape.height] for body in scene.bodies]
    ways = [np.column_stack((push.waypoints[:, :2], np.zeros(len(push.waypoints)))) for push in scene.pushes]
    points = np.concatenate((centres - reach, tops + reach, *ways))
    return points.min(0), points.max(0)


def view_of(scene: Scene | LeverScene) -> View:
    """From so far away that all of it is seen.

    A table from the side of negative y, or with an arm from the side that its base faces; a lever scene from beside the
    tool, low enough to see the board rise.
    """
    low, high = extent(scene)
    if isinstance(scene, LeverScene):
        board, tool = scene.bodies[scene.board].position, scene.path[0].position
        return _seen(low, high, np.arctan2(tool[1] - board[1], tool[0] - board[0]) - np.pi / 3, LOW)
    breadth = 2 * float(np.median([body.shape.reach for body in scene.bodies]))
    if scene.arm is None:
        return _seen(low, high, -np.pi / 2, ELEVATION, breadth)
    x, y, yaw = scene.arm.pose_world_from_base
    base = np.array([x, y, scene.arm.base_height])
    low, high = np.minimum(low, base), np.maximum(high, base + [0, 0, ARM_HEIGHT])
    return _seen(low, high, yaw + ASIDE, LOW, breadth)


def _seen(
    low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], azimuth: float, elevation: float, breadth: float = np.inf
) -> View:
    """Of a box, from a direction (rad) and from above (rad). breadth: of a usual body (m)."""
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 + 0.05
    level = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    position = middle + NEARER * reach / np.tan(FIELD / 2) * np.array([*level, np.sin(elevation)])
    target, eye = (tuple(point.round(3).tolist()) for point in (middle, position))
    largest, smallest = (2 * NEARER * reach / count for count in LETTERS)
    return View(target, eye, round(max(smallest, min(largest, BODY_LETTERS * breadth)), 4))
