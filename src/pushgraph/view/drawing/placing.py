"""Where bodies and tool are in a frame of a track, as poses in space."""

import numpy as np
from jaxtyping import Float

from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.scene import Scene
from pushgraph.track import Track

LIFT = 0.12
"""How high a tool that no arm holds is shown while it is lifted (m)."""


def in_space(
    poses: Float[np.ndarray, "*batch 3"], height: Float[np.ndarray, "*#batch"] | float = 0.0
) -> Float[np.ndarray, "*batch 7"]:
    """Poses x, y, yaw at a height above the table (m); where the yaw is not known, as if it were 0."""
    half = np.nan_to_num(poses[..., 2]) / 2
    zeros = np.zeros_like(half)
    return np.stack((poses[..., 0], poses[..., 1], zeros + height, np.cos(half), zeros, zeros, np.sin(half)), -1)


def start_of(scene: Scene | LeverScene) -> Float[np.ndarray, "nodes 7"]:
    """Tool and bodies before anything moves: the tool lifted over the first push, or unseen without one."""
    if isinstance(scene, LeverScene):
        return np.vstack((scene.tool_poses(np.zeros(1)), scene.poses_world_from_body))
    tool = scene.pushes[0].waypoints[:1] if scene.pushes else np.full((1, 3), np.nan)
    return np.vstack((in_space(tool, LIFT), in_space(scene.poses_world_from_body)))


def placed(track: Track | LeverTrack, frame: int) -> Float[np.ndarray, "nodes 7"]:
    """Tool and bodies in a frame; NaN where a body was not seen."""
    if isinstance(track, LeverTrack):
        return track.poses[frame]
    poses = np.where(track.seen[frame, :, None], track.poses[frame], np.nan)
    height = np.zeros(len(poses))
    height[0] = 0.0 if track.down[frame] else LIFT
    return in_space(poses, height)


def frame_at(times: Float[np.ndarray, " frames"], time: float) -> int:
    """The last frame that is not later than a time (s); the first, if all are."""
    return max(0, int(np.searchsorted(times, time + 1e-6, side="right")) - 1)
