"""Draw scenes from above with matplotlib: the parts that pictures and animations share."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Patch
from matplotlib.patches import Polygon as Outline
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Affine2D

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.track import Track

PALETTE = [to_rgb(matplotlib.colormaps["tab10"](k)) for k in range(10)]
TOOL_COLOUR = "#333333"
SPREAD_COLOUR = "#c02080"
JOINT_MARKS: dict[str, dict[str, Any]] = {
    "fixed": {"marker": "s", "color": "black"},
    "revolute": {"marker": "o", "color": "white"},
    "prismatic": {"marker": "D", "color": "gold"},
}


class SceneArtist:
    """A scene on the axes, to be moved from frame to frame: bodies, joints and the tool."""

    def __init__(self, axes: Axes, scene: Scene) -> None:
        group_of = {name: group[0] for group in scene.rigid_groups for name in group}
        colours = {name: PALETTE[k % len(PALETTE)] for k, name in enumerate(scene.names)}
        self._bodies = [
            _BodyArtist(axes, body.shape, body.name, fc=(*colours[group_of.get(body.name, body.name)], 0.6))
            for body in scene.bodies
        ]
        self.names = [body.label for body in self._bodies]
        """The names of the bodies, as they stand on the axes; see `pushgraph.viewer.names`."""
        self._joints = [_JointArtist(axes, scene, joint) for joint in scene.joints]
        self._tool = [
            (np.array(part.pose_tool_from_part), MovableArtist(axes, outline(part.shape, fc=TOOL_COLOUR)))
            for part in scene.tool.parts
        ]

    def move(self, poses: Float[np.ndarray, "nodes 3"], down: bool) -> None:
        """Show one frame of a track; the tool is faint while lifted, a body that was not seen is hidden."""
        for body, pose_world_from_body in zip(self._bodies, poses[1:], strict=True):
            body.move(pose_world_from_body)
        for joint in self._joints:
            joint.move(poses[1:])
        for pose_tool_from_part, patch in self._tool:
            patch.move(pose.compose(poses[0], pose_tool_from_part))
            patch.artist.set_alpha(0.85 if down else 0.15)


class MovableArtist:
    """Something that is drawn at the origin, and moved from there."""

    def __init__(self, axes: Axes, artist: Patch | Line2D) -> None:
        self._axes, self.artist = axes, artist
        axes.add_artist(artist)

    def move(self, pose_world: Float[np.ndarray, "3"]) -> None:
        """Show it there; hide it where the position is not known."""
        x, y, yaw = np.nan_to_num(pose_world)
        self.artist.set_visible(bool(np.isfinite(pose_world[:2]).all()))
        self.artist.set_transform(Affine2D().rotate(yaw).translate(x, y) + self._axes.transData)


class _BodyArtist:
    """The outline of a body, a tick at its front that shows how it is turned, and its name."""

    def __init__(self, axes: Axes, shape: Cylinder | Cuboid | Polygon, name: str, **style: Any) -> None:
        front = max(0.0, _front(shape))
        heading = Line2D([0.7 * front, front], [0, 0], color="black", lw=1.2, alpha=0.6)
        self._parts = [MovableArtist(axes, outline(shape, **style)), MovableArtist(axes, heading)]
        self.label = axes.text(0, 0, name, ha="center", va="center", fontsize=7, clip_on=True, zorder=10)
        self.label.set_path_effects([withStroke(linewidth=2.0, foreground="white", alpha=0.8)])

    def move(self, pose_world_from_body: Float[np.ndarray, "3"]) -> None:
        for part in self._parts:
            part.move(pose_world_from_body)
        self.label.set_visible(bool(np.isfinite(pose_world_from_body[:2]).all()))
        self.label.set_position(np.nan_to_num(pose_world_from_body[:2]))


class _JointArtist:
    """A mark at the anchor of a joint, which the parent carries along."""

    def __init__(self, axes: Axes, scene: Scene, joint: Joint) -> None:
        self._parent = scene.names.index(joint.parent)
        pose_body_from_world = pose.inverse(scene.poses_world_from_body[self._parent])
        self._anchor_in_parent = pose.transform(pose_body_from_world, scene.joint_frame(joint).anchor)
        (self._mark,) = axes.plot([], [], ms=6, mec="black", zorder=5, **JOINT_MARKS[joint.kind])

    def move(self, poses_world_from_body: Float[np.ndarray, "bodies 3"]) -> None:
        x, y = pose.transform(poses_world_from_body[self._parent], self._anchor_in_parent)
        self._mark.set_data([x], [y])


def _front(shape: Cylinder | Cuboid | Polygon) -> float:
    """How far a shape reaches along its own x (m)."""
    return max(x for x, _ in shape.points) if isinstance(shape, Polygon) else shape.core[0] + shape.core[2]


def outline(shape: Cylinder | Cuboid | Polygon, **style: Any) -> Patch:
    """The shape seen from above, at the origin of its own frame."""
    style = {"ec": "black", "lw": 0.8, **style}
    if isinstance(shape, Polygon):
        return Outline(shape.points, **style)
    half_x, half_y, radius = shape.core
    if radius:
        return Circle((0, 0), radius, **style)
    return Outline([(half_x, half_y), (-half_x, half_y), (-half_x, -half_y), (half_x, -half_y)], **style)


def draw_outlines(axes: Axes, track: Track) -> None:
    """Dashed outlines of the bodies where a track ends."""
    for body, pose_world_from_body in zip(track.scene.bodies, track.poses[-1, 1:], strict=True):
        patch = MovableArtist(axes, outline(body.shape, fc="none", ls="--", lw=1.2, zorder=4))
        patch.move(pose_world_from_body)


def draw_spread(axes: Axes, track: Track) -> None:
    """Ellipses that hold the true centres of bodies at a track's end with 68 and 95 %; none if it states no spread."""
    if track.spread is None:
        return
    for probability, line in ((0.68, "-"), (0.95, "--")):
        final = track.spread.take(-1).ellipse(probability)
        for (x, y, _), direction, along, across in zip(track.poses[-1, 1:], *final, strict=True):
            style = {"fc": "none", "ec": SPREAD_COLOUR, "lw": 1.0, "ls": line, "zorder": 8}
            axes.add_patch(Ellipse((x, y), 2 * along, 2 * across, angle=np.degrees(direction), **style))


def joint_marks(scenes: Sequence[Scene]) -> list[Line2D]:
    """What a legend shows of the joints of scenes."""
    kinds = sorted({joint.kind for scene in scenes for joint in scene.joints})
    return [Line2D([], [], ls="", mec="black", label=f"{kind} joint", **JOINT_MARKS[kind]) for kind in kinds]


def outline_mark(title: str) -> Line2D:
    """What a legend shows of the outlines of the track with this title."""
    return Line2D([], [], color="black", ls="--", lw=1.2, label=f"outlines as {title.lower()}")


def view_limits(tracks: Sequence[Track], margin: float = 0.06) -> tuple[float, float, float, float]:
    """Left, right, bottom, top (m) of a square that holds everything the tracks show."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for track in tracks:
        radii = _reaches(track.scene)
        positions = track.poses[..., :2]
        low = np.minimum(low, np.nanmin(positions - radii[:, None], axis=(0, 1)))
        high = np.maximum(high, np.nanmax(positions + radii[:, None], axis=(0, 1)))
    return _square(low, high, margin)


def limits_of(
    scene: Scene, poses: Float[np.ndarray, "places 3"], margin: float = 0.06
) -> tuple[float, float, float, float]:
    """The same of a scene. poses: of its bodies, then of the tool at any number of places."""
    tool, *bodies = _reaches(scene)
    radii = np.array([*bodies, *[tool] * (len(poses) - len(bodies))])[:, None]
    return _square(np.nanmin(poses[:, :2] - radii, 0), np.nanmax(poses[:, :2] + radii, 0), margin)


def _reaches(scene: Scene) -> Float[np.ndarray, " nodes"]:
    return np.array([scene.tool.reach, *(body.shape.reach for body in scene.bodies)])


def _square(low: np.ndarray, high: np.ndarray, margin: float) -> tuple[float, float, float, float]:
    centre, half = (low + high) / 2, (high - low).max() / 2 + margin
    return centre[0] - half, centre[0] + half, centre[1] - half, centre[1] + half


def prepare(axes: Axes, limits: tuple[float, float, float, float], title: str) -> None:
    """A square view in metres."""
    axes.set(xlim=limits[:2], ylim=limits[2:], aspect="equal", xlabel="x (m)", ylabel="y (m)", title=title)
    axes.grid(alpha=0.2)
