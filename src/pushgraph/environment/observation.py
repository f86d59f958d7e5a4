"""What an agent is shown of a scene: arrays of fixed shapes, padded with zeros."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.planning.goal import Goal, index_of
from pushgraph.pose import wrap_angle
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Polygon

Observation = dict[str, np.ndarray]
FARTHEST = 100.0
"""The largest coordinate that a scene may hold (m)."""
HEAVIEST = 1000.0
"""The largest mass that a scene may hold (kg)."""


def observation_space(bodies: int, tool_parts: int) -> spaces.Space[dict[str, Any]]:
    """Of scenes of so many bodies, and tools of so many parts, at most. Lengths in m, angles in rad, the world frame.

    poses: pose_world_from_body, yaw from -pi to pi. present: whether there is such a body. movable: whether it can be
    moved. sizes: see `size_of`. masses: kg, zero where unknown. joints: JOINT_CODES of what the scene says to be
    joined, rigid groups included. goal_body: one-hot. goal: where it shall be, x, y, cosine and sine of its yaw; these
    two are zero if any yaw will do. tool: pose_tool_from_part and size of each part. table: its pose and full size.
    """

    def real(shape: tuple[int, ...], low: float = -FARTHEST, high: float = FARTHEST) -> spaces.Box:
        return spaces.Box(low, high, shape, np.float32)

    lowest = np.tile(np.array([-FARTHEST, -FARTHEST, -math.pi], np.float32), (bodies, 1))
    return spaces.Dict(
        {
            "poses": spaces.Box(lowest, -lowest, dtype=np.float32),
            "present": spaces.MultiBinary(bodies),
            "movable": spaces.MultiBinary(bodies),
            "sizes": real((bodies, 3), 0.0),
            "masses": real((bodies,), 0.0, HEAVIEST),
            "joints": spaces.Box(0, max(JOINT_CODES.values()), (bodies, bodies), np.int8),
            "goal_body": spaces.MultiBinary(bodies),
            "goal": real((4,)),
            "tool": real((tool_parts, 6)),
            "table": real((5,)),
        }
    )


def describe(scene: Scene, goal: Goal, shown: Observation) -> None:
    """Fill in all but the poses: what stays as it is while an episode lasts."""
    for name, values in shown.items():
        if name != "poses":
            values[...] = 0
    bodies, parts = len(scene.bodies), len(scene.tool.parts)
    shown["present"][:bodies] = 1
    shown["movable"][:bodies] = ~scene.immovable
    shown["sizes"][:bodies] = [size_of(body.shape) for body in scene.bodies]
    shown["masses"][:bodies] = [body.mass or 0.0 for body in scene.bodies]
    index = {name: k for k, name in enumerate(scene.names)}
    for joint in scene.joints:
        a, b = index[joint.parent], index[joint.child]
        shown["joints"][[a, b], [b, a]] = JOINT_CODES[joint.kind]
    for group in scene.rigid_groups:
        members = [index[name] for name in group]
        shown["joints"][np.ix_(members, members)] = JOINT_CODES["fixed"] * (1 - np.eye(len(group), dtype=np.int8))
    shown["goal_body"][index_of(scene, goal.body)] = 1
    heading = (0.0, 0.0) if goal.yaw is None else (math.cos(goal.yaw), math.sin(goal.yaw))
    shown["goal"][:] = (*goal.position, *heading)
    shown["tool"][:parts] = [(*part.pose_tool_from_part, *part.shape.core) for part in scene.tool.parts]
    shown["table"][:] = (*scene.table.pose_world_from_table, *scene.table.size)


def shown_poses(poses: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Poses as the agent sees them: float32, yaw from -pi to pi."""
    return np.concatenate((poses[..., :2], wrap_angle(poses[..., 2:])), -1).astype(np.float32)


def size_of(shape: Cylinder | Cuboid | Polygon) -> tuple[float, float, float]:
    """Half extents and radius of the rounded box that a shape is (m); of a polygon, its reach along x and y, and 0."""
    if isinstance(shape, Polygon):
        x, y = np.abs(np.array(shape.points)).max(0).tolist()
        return x, y, 0.0
    return shape.core
