"""Bodies as the rigid parts that contact is computed between: cuboids and cylinders are one part, polygons several."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.contact import Contact, RoundedBox, contact_between
from pushgraph.shape import Cuboid, Cylinder, Polygon, rounded_boxes, take


class Parts(NamedTuple):
    """The parts of several bodies, in their order (float64)."""

    boxes: RoundedBox  # [parts]
    owner: Int[np.ndarray, " parts"]
    """Index of the body of each part."""
    pose_body_from_part: Float[np.ndarray, "parts 3"]

    @property
    def are_bodies(self) -> bool:
        """Whether every body is one part, at its own origin."""
        return len(np.unique(self.owner)) == len(self.owner) and not self.pose_body_from_part.any()

    @property
    def circles(self) -> Float[np.ndarray, " parts"]:
        """Radius of the circle around each part (m)."""
        return np.hypot(*self.boxes.half_extents.T) + self.boxes.radius

    def poses(self, poses_world_from_body: Float[np.ndarray, "*batch bodies 3"]) -> Float[np.ndarray, "*batch parts 3"]:
        """Poses of the parts (pose_world_from_part) where the bodies are here."""
        if self.are_bodies:
            return poses_world_from_body
        return pose.compose(poses_world_from_body[..., self.owner, :], self.pose_body_from_part)

    def least(self, values: Float[np.ndarray, "*batch parts"]) -> Float[np.ndarray, "*batch bodies"]:
        """The least value among the parts of each body."""
        if self.are_bodies:
            return values
        first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        return np.minimum.reduceat(values, first, axis=-1)


class BodyContact(NamedTuple):
    """Contact of pairs of bodies, in the frame of the first of each, and the parts that are nearest there."""

    contact: Contact
    part_a: Int[np.ndarray, " pairs"]
    part_b: Int[np.ndarray, " pairs"]


def parts_of(shapes: Sequence[Cylinder | Cuboid | Polygon]) -> Parts:
    """The parts of these bodies."""
    placed = [(k, part) for k, shape in enumerate(shapes) for part in shape.parts]
    return Parts(
        boxes=rounded_boxes([part.shape for _, part in placed]),
        owner=np.array([k for k, _ in placed], dtype=np.int64),
        pose_body_from_part=np.array([part.pose_body_from_part for _, part in placed], dtype=float),
    )


def contacts_of_bodies(
    parts: Parts, poses_world_from_body: Float[np.ndarray, "bodies 3"], pairs: Sequence[tuple[int, int]]
) -> BodyContact:
    """Contact of each pair of bodies: that of the two parts that are nearest to each other, or overlap deepest."""
    poses = parts.poses(np.asarray(poses_world_from_body, dtype=float))
    owned = [np.flatnonzero(parts.owner == body) for body in range(len(poses_world_from_body))]
    both = [np.stack(np.meshgrid(owned[a], owned[b], indexing="ij"), -1).reshape(-1, 2) for a, b in pairs]
    a, b = np.concatenate(both).T
    contact = contact_between(take(parts.boxes, a), take(parts.boxes, b), pose.relative(poses[a], poses[b]))
    if parts.are_bodies:
        return BodyContact(contact, a, b)
    counts = [len(combinations) for combinations in both]
    first = np.cumsum([0, *counts[:-1]])
    index = first + [int(gap.argmin()) for gap in np.split(contact.gap, first[1:])]
    a, b = a[index], b[index]
    contact = Contact(*(values[index] for values in contact))
    place = parts.pose_body_from_part[a]
    points = (pose.transform(place[:, None], points) for points in (contact.points_a, contact.points_b))
    points_a, points_b = points
    normal = pose.rotate(contact.normal, place[:, 2])
    return BodyContact(contact._replace(normal=normal, points_a=points_a, points_b=points_b), a, b)
