"""A camera above the table: what it, and the robot's own log, tell of a simulated track."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import ROBOT
from pushgraph.recording.sightings import COLUMNS, Sightings
from pushgraph.track import LIFTED, ON_TIME, Track


class Camera(NamedTuple):
    """rate: frames a second. noise, yaw_noise: standard deviation of x and of y (m), and of the yaw (rad), of every
    sighting of a body. dropped: share of frames that show no body. pose_world_from_origin: of what the poses are told
    in. probe_off: how far from where it is the robot reports its tool (m, along the origin's axes); it is exact else.
    """

    rate: float = 30.0
    noise: float = 1e-3
    yaw_noise: float = math.radians(0.5)
    dropped: float = 0.03
    pose_world_from_origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    probe_off: tuple[float, float] = (0.0, 0.0)


DEFAULT_CAMERA = Camera()


def film(track: Track, rng: np.random.Generator, camera: Camera = DEFAULT_CAMERA) -> Sightings:
    """What a camera sees of a track: no yaws of bodies whose yaw is not known, and no body in frames that are dropped.

    Poses between the track's frames are interpolated.
    """
    begin, end = track.times[[0, -1]]
    times = begin + np.arange(math.floor((end - begin) * camera.rate + ON_TIME) + 1) / camera.rate
    poses = _poses_at(track, times)
    poses[:, 1:] += rng.normal(size=poses[:, 1:].shape) * [camera.noise, camera.noise, camera.yaw_noise]
    poses = pose.compose(pose.inverse(np.array(camera.pose_world_from_origin, dtype=float)), poses)
    poses[:, 0, :2] += camera.probe_off
    blind = [not body.yaw_known for body in track.scene.bodies]
    poses[:, 1:, 2][:, blind] = np.nan
    shown = np.ones(poses.shape[:2], dtype=bool)
    shown[:, 1:] = (rng.random(len(times)) >= camera.dropped)[:, None]
    frame, node = np.nonzero(shown)
    nothing = np.full(len(frame), np.nan)
    columns = {
        **dict.fromkeys(COLUMNS, nothing),
        **{"time": times[frame], "node": node, "push": np.where(node == 0, _push_at(track, times)[frame], LIFTED)},
        **dict(zip(("x", "y", "yaw"), poses[frame, node].T, strict=True)),
    }
    return Sightings((ROBOT, *track.scene.names), **columns)


def _poses_at(track: Track, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times nodes 3"]:
    nodes = track.poses.reshape(len(track.times), -1)
    return np.stack([np.interp(times, track.times, column) for column in nodes.T], -1).reshape(len(times), -1, 3)


def _push_at(track: Track, times: Float[np.ndarray, " times"]) -> np.ndarray:
    """The push under way; between frames of which one is lifted the tool is lifted."""
    before = (np.searchsorted(track.times, times + ON_TIME) - 1).clip(min=0)
    after = np.searchsorted(track.times, times - ON_TIME).clip(max=len(track.times) - 1)
    return np.where(track.push[before] == track.push[after], track.push[before], LIFTED)
