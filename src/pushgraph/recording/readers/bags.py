"""ROS 1 and 2 bags and MCAP: every topic whose messages hold poses, through `rosbags`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pushgraph.errors import TrackError
from pushgraph.extras import extra
from pushgraph.recording.sightings import NO_PUSH, ReadOptions, Sightings, SightingsBuilder, planar

POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PoseArray",
    "geometry_msgs/msg/Pose",
    "geometry_msgs/msg/Pose2D",
    "nav_msgs/msg/Odometry",
    "tf2_msgs/msg/TFMessage",
)
"""Types of messages that are read."""
PUSH_TOPIC = "push"
"""Messages with whole numbers on a topic of this last name say which push is under way."""


def read_bag(path: Path, options: ReadOptions) -> Sightings:
    """Read a bag: a ROS 1 file, a ROS 2 folder or one of its files, an MCAP file with ROS 2 messages.

    A node is named by its topic, by its frame where a message holds transforms, by topic and place in it where it holds
    an array. Times are the messages' stamps, or when they were recorded if they have none.
    """
    with extra("rosbags", "reading bags"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    builder, push = SightingsBuilder(), NO_PUSH
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        found = {c.topic: c.msgtype for c in reader.connections}
        wanted = [c for c in reader.connections if c.msgtype in POSES or _says_push(c)]
        if not any(c.msgtype in POSES for c in wanted):
            topics = ", ".join(f"{topic} ({kind})" for topic, kind in found.items()) or "none"
            raise TrackError(f"no topic with poses; valid types: {', '.join(POSES)}; topics: {topics[:500]}")
        for connection, recorded, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            if _says_push(connection):
                push = max(int(message.data), -1)
                continue
            for name, stamp, (position, quaternion) in _poses(message, connection.topic):
                time = stamp if stamp is not None else recorded * 1e-9
                builder.add(name, time, *planar(position, quaternion, options.up or "z"), push)
    return builder.finish()


def _says_push(connection: Any) -> bool:
    last = connection.topic.rpartition("/")[2]
    return last == PUSH_TOPIC and connection.msgtype.rpartition("/")[2] in ("Int8", "Int16", "Int32", "Int64")


def _poses(message: Any, topic: str) -> Iterator[tuple[str, float | None, tuple[list[float], list[float]]]]:
    """Name, stamp (s) and spatial pose of everything that a message places."""
    if hasattr(message, "transforms"):
        for transform in message.transforms:
            yield from _poses(transform, topic)
        return
    stamp = _seconds(message.header.stamp) if hasattr(message, "header") else None
    if hasattr(message, "transform"):
        yield message.child_frame_id, stamp, _of(message.transform.translation, message.transform.rotation)
    elif hasattr(message, "poses"):
        for index, pose in enumerate(message.poses):
            yield f"{topic}/{index}", stamp, _of(pose.position, pose.orientation)
    elif hasattr(message, "theta"):
        yield topic, stamp, ([message.x, message.y, 0.0], _about_z(message.theta))
    else:
        pose = message
        while hasattr(pose, "pose"):
            pose = pose.pose
        yield topic, stamp, _of(pose.position, pose.orientation)


def _of(position: Any, rotation: Any) -> tuple[list[float], list[float]]:
    return [position.x, position.y, position.z], [rotation.x, rotation.y, rotation.z, rotation.w]


def _about_z(yaw: float) -> list[float]:
    from math import cos, sin

    return [0.0, 0.0, sin(yaw / 2), cos(yaw / 2)]


def _seconds(stamp: Any) -> float | None:
    """A stamp of zero was never set."""
    time = stamp.sec + stamp.nanosec * 1e-9
    return time if time else None
