"""Scenes whose polygons are taken apart: the networks know cuboids and cylinders, and rigid groups of them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.body import Body, Joint
from pushgraph.parts import contacts_of_bodies, parts_of
from pushgraph.patch import area_shares
from pushgraph.scene import Scene
from pushgraph.scene_file import TRUSTED
from pushgraph.shape import Polygon

LIGHTEST = 1e-3
"""No part weighs less (kg): the least that a body may weigh."""


class SceneInParts(NamedTuple):
    """A scene without polygons, and how to tell from its bodies, the parts, where those of the first scene are."""

    scene: Scene
    first: Int[np.ndarray, " bodies"]
    """Index of the first part of each body."""
    pose_body_from_first: Float[np.ndarray, "bodies 3"]

    @property
    def owner(self) -> Int[np.ndarray, " parts"]:
        """Index of the body of each part."""
        return np.searchsorted(self.first, np.arange(len(self.scene.bodies)), "right") - 1

    def body_poses(
        self, poses_world_from_part: Float[np.ndarray, "*batch parts 3"]
    ) -> Float[np.ndarray, "*batch bodies 3"]:
        """Poses of the bodies (pose_world_from_body), from those of the parts; there may be more rows than parts."""
        first = poses_world_from_part[..., self.first, :]
        if not self.pose_body_from_first.any():
            return first
        return pose.compose(first, pose.inverse(self.pose_body_from_first))


def in_parts(scene: Scene) -> SceneInParts:
    """The same scene with each polygon replaced by the rigid group of its parts; as it is, if it has no polygon.

    A polygon's mass is split over its parts by the area that they share. Its joints sit on the parts that are nearest
    to each other, with anchor, axis and limits as in `Scene.joint_frame`.
    """
    count = len(scene.bodies)
    if not any(isinstance(body.shape, Polygon) for body in scene.bodies):
        return SceneInParts(scene, np.arange(count), np.zeros((count, 3)))
    parts = parts_of([body.shape for body in scene.bodies])
    owner = parts.owner.numpy()
    first = np.searchsorted(owner, np.arange(count))
    poses = parts.poses(scene.poses_world_from_body)
    names = [f"{k}" for k in range(len(owner))]
    of_body = {body.name: [names[k] for k in np.flatnonzero(owner == b)] for b, body in enumerate(scene.bodies)}
    bodies: list[Body] = []
    for body in scene.bodies:
        shapes = body.shape.parts
        shares = area_shares(tuple(shapes)) if len(shapes) > 1 else [1.0]
        for part, share in zip(shapes, shares, strict=True):
            k = len(bodies)
            mass = body.mass if body.mass is None or len(shapes) == 1 else max(body.mass * float(share), LIGHTEST)
            place = tuple(poses[k].tolist())
            bodies.append(
                Body(
                    name=names[k],
                    shape=part.shape,
                    pose_world_from_body=place,
                    mass=mass,
                    yaw_known=body.yaw_known,
                    fixed=body.fixed,
                )
            )

    def nearest(pair: tuple[str, str]) -> tuple[str, str]:
        indices = scene.names.index(pair[0]), scene.names.index(pair[1])
        touch = contacts_of_bodies(parts, scene.poses_world_from_body, [indices])
        return names[int(touch.part_a[0])], names[int(touch.part_b[0])]

    def joint(old: Joint) -> Joint:
        parent, child = nearest((old.parent, old.child))
        frame = scene.joint_frame(old)
        return Joint(
            kind=old.kind,
            parent=parent,
            child=child,
            anchor=tuple(frame.anchor.tolist()),
            axis=tuple(frame.axis.tolist()) if old.kind == "prismatic" else None,
            limits=None if old.kind == "fixed" else frame.limits,
        )

    grouped = {name for group in scene.rigid_groups for name in group}
    groups = [tuple(part for name in group for part in of_body[name]) for group in scene.rigid_groups]
    groups += [tuple(own) for name, own in of_body.items() if name not in grouped and len(own) > 1]
    unknown = scene.unknown_pairs
    fields = {name: getattr(scene, name) for name in Scene.model_fields} | {
        "bodies": tuple(bodies),
        "joints": tuple(map(joint, scene.joints)),
        "rigid_groups": tuple(groups),
        "unknown_pairs": unknown if isinstance(unknown, str) else tuple(map(nearest, unknown)),
    }
    # It was checked as a whole: no part overlaps what its body does not.
    taken_apart = Scene.model_validate(fields, context=TRUSTED)
    return SceneInParts(taken_apart, first, parts.pose_body_from_part.numpy()[first])
