"""Scenes whose polygons are taken apart: the networks know cuboids and cylinders, and rigid groups of them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.body import Body, Joint
from pushgraph.parts import contacts_of_bodies, parts_of
from pushgraph.patch import BodyPatch, area_shares, patches_of_members
from pushgraph.scene import NOMINAL_MASS, Scene
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
    patches: Mapping[int, BodyPatch] = MappingProxyType({})
    """How the weight is spread, and where it presses, of first parts that bear that of their whole bodies: those of
    polygons with a support."""

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

    A polygon's mass is split over its parts by the area that they share; the first bears nearly all of it, where the
    polygon has a support. Its joints sit on the parts that are nearest to each other, with anchor, axis and limits as
    in `Scene.joint_frame`.
    """
    count = len(scene.bodies)
    if not any(isinstance(body.shape, Polygon) for body in scene.bodies):
        return SceneInParts(scene, np.arange(count), np.zeros((count, 3)))
    parts = parts_of([body.shape for body in scene.bodies])
    owner = parts.owner
    first = np.searchsorted(owner, np.arange(count))
    poses = parts.poses(scene.poses_world_from_body)
    names = [f"{k}" for k in range(len(owner))]
    of_body = {body.name: [names[k] for k in np.flatnonzero(owner == b)] for b, body in enumerate(scene.bodies)}
    bodies: list[Body] = []
    patches: dict[int, BodyPatch] = {}
    for body in scene.bodies:
        shapes = body.shape.parts
        shares = area_shares(tuple(shapes)).tolist() if len(shapes) > 1 else [1.0]
        mass_known = body.mass is not None
        if isinstance(body.shape, Polygon) and body.support is not None:
            shares = [1.0, *[0.0] * (len(shapes) - 1)]
            patches[len(bodies)] = _patch_of_first(body)
            mass_known = True
        for part, share in zip(shapes, shares, strict=True):
            k = len(bodies)
            mass = body.mass
            if mass_known and share != 1:
                mass = max((NOMINAL_MASS if mass is None else mass) * float(share), LIGHTEST)
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
    return SceneInParts(taken_apart, first, parts.pose_body_from_part[first], patches)


def _patch_of_first(body: Body) -> BodyPatch:
    """Of a whole polygon, in the frame of its first part."""
    pose_first_from_body = pose.inverse(np.array(body.shape.parts[0].pose_body_from_part, dtype=float))
    (found,) = patches_of_members([body])
    return BodyPatch(*(patch._replace(points=pose.transform(pose_first_from_body, patch.points)) for patch in found))
