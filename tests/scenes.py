"""Small scenes that several tests use."""

import numpy as np

from pushgraph.body import Body, Joint
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.tool import Part, Push, Tool
from pushgraph.track import Track


def body(name: str, x: float, y: float, shape=None, yaw: float = 0.0, mass: float | None = 0.5) -> Body:
    return Body(name=name, shape=shape or Cylinder(diameter=0.12), pose_world_from_body=(x, y, yaw), mass=mass)


def workshop() -> Scene:
    """Four bodies, a hinge, a rigid group, two pushes."""
    return Scene(
        bodies=(
            body("plate", 0.0, 0.0, Cuboid(size=(0.14, 0.10))),
            body("lid", 0.0, 0.105, Cuboid(size=(0.14, 0.10)), mass=0.3),
            body("cup", 0.25, 0.0),
            body("handle", 0.33, 0.0, Cuboid(size=(0.08, 0.02)), mass=0.1),
        ),
        joints=(Joint(kind="revolute", parent="plate", child="lid", anchor=(0.06, 0.0525)),),
        rigid_groups=(("cup", "handle"),),
        pushes=(
            Push(start=(-0.2, 0.0), end=(-0.05, 0.0)),
            Push(start=(0.25, -0.2), direction=1.5, distance=0.2, speed=0.1),
        ),
    )


def flat_tool(depth: float, width: float) -> Tool:
    """A plate across the x axis of the end-effector."""
    return Tool(parts=(Part(shape=Cuboid(size=(depth, width))),))


def moved_by(track: Track) -> np.ndarray:
    """How far each body has moved from start to end: x, y (mm) and yaw (degrees)."""
    return (track.poses[-1, 1:] - track.poses[0, 1:]) * [1e3, 1e3, 180 / np.pi]


def mirrored(scene: Scene) -> Scene:
    """The scene's mirror image across the x axis."""

    def point(old):
        return None if old is None else (old[0], -old[1], *(-yaw for yaw in old[2:]))

    def shape(old):
        return old.replace(points=tuple(map(point, old.points))) if isinstance(old, Polygon) else old

    def joint(old: Joint) -> Joint:
        limits = (-old.limits[1], -old.limits[0]) if old.kind == "revolute" and old.limits else old.limits
        return old.replace(anchor=point(old.anchor), axis=point(old.axis), limits=limits)

    def push(old: Push) -> Push:
        return old.replace(
            start=point(old.start),
            end=point(old.end),
            direction=None if old.direction is None else -old.direction,
            path=None if old.path is None else tuple(map(point, old.path)),
            yaw=-old.yaw,
            rotation=-old.rotation,
        )

    return scene.replace(
        bodies=tuple(
            b.replace(
                shape=shape(b.shape),
                pose_world_from_body=point(b.pose_world_from_body),
                support=None if b.support is None else tuple(map(point, b.support)),
            )
            for b in scene.bodies
        ),
        joints=tuple(map(joint, scene.joints)),
        tool=Tool(parts=tuple(p.replace(pose_tool_from_part=point(p.pose_tool_from_part)) for p in scene.tool.parts)),
        pushes=tuple(map(push, scene.pushes)),
        table=scene.table.replace(pose_world_from_table=point(scene.table.pose_world_from_table)),
    )
