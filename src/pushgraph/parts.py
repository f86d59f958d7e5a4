"""Bodies as the rigid parts that contact is computed between: cuboids and cylinders are one part, polygons several."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import Contact, RoundedBox, contact_between
from pushgraph.shape import Cuboid, Cylinder, Polygon, rounded_boxes, take


class Parts(NamedTuple):
    """The parts of several bodies, in their order (float64)."""

    boxes: RoundedBox  # [parts]
    owner: Int[Tensor, " parts"]
    """Index of the body of each part."""
    pose_body_from_part: Float[Tensor, "parts 3"]

    @property
    def are_bodies(self) -> bool:
        """Whether every body is one part, at its own origin."""
        return len(self.owner.unique()) == len(self.owner) and not self.pose_body_from_part.any()

    @property
    def circles(self) -> Float[np.ndarray, " parts"]:
        """Radius of the circle around each part (m)."""
        return (self.boxes.half_extents.norm(dim=-1) + self.boxes.radius).numpy()

    def poses(self, poses_world_from_body: Float[np.ndarray, "*batch bodies 3"]) -> Float[np.ndarray, "*batch parts 3"]:
        """Poses of the parts (pose_world_from_part) where the bodies are here."""
        if self.are_bodies:
            return poses_world_from_body
        return pose.compose(poses_world_from_body[..., self.owner.numpy(), :], self.pose_body_from_part.numpy())

    def least(self, values: Float[np.ndarray, "*batch parts"]) -> Float[np.ndarray, "*batch bodies"]:
        """The least value among the parts of each body."""
        if self.are_bodies:
            return values
        first = np.flatnonzero(np.diff(self.owner.numpy(), prepend=-1))
        return np.minimum.reduceat(values, first, axis=-1)


class BodyContact(NamedTuple):
    """Contact of pairs of bodies, in the frame of the first of each, and the parts that are nearest there."""

    contact: Contact
    part_a: Int[Tensor, " pairs"]
    part_b: Int[Tensor, " pairs"]


def parts_of(shapes: Sequence[Cylinder | Cuboid | Polygon]) -> Parts:
    """The parts of these bodies."""
    placed = [(k, part) for k, shape in enumerate(shapes) for part in shape.parts]
    return Parts(
        boxes=rounded_boxes([part.shape for _, part in placed]),
        owner=torch.tensor([k for k, _ in placed], dtype=torch.long),
        pose_body_from_part=torch.tensor([part.pose_body_from_part for _, part in placed], dtype=torch.float64),
    )


def contacts_of_bodies(
    parts: Parts, poses_world_from_body: Float[np.ndarray, "bodies 3"], pairs: Sequence[tuple[int, int]]
) -> BodyContact:
    """Contact of each pair of bodies: that of the two parts that are nearest to each other, or overlap deepest."""
    poses = torch.from_numpy(parts.poses(np.asarray(poses_world_from_body, dtype=float)))
    owned = [(parts.owner == body).nonzero()[:, 0] for body in range(len(poses_world_from_body))]
    both = [torch.cartesian_prod(owned[a], owned[b]) for a, b in pairs]
    a, b = torch.cat(both).unbind(-1)
    contact = contact_between(take(parts.boxes, a), take(parts.boxes, b), pose.relative(poses[a], poses[b]))
    if parts.are_bodies:
        return BodyContact(contact, a, b)
    counts = [len(combinations) for combinations in both]
    nearest = [int(gap.argmin()) for gap in contact.gap.split(counts)]
    index = torch.tensor(nearest) + torch.tensor([0, *counts[:-1]]).cumsum(0)
    a, b = a[index], b[index]
    contact = Contact(*(values[index] for values in contact))
    place = parts.pose_body_from_part[a]
    points = (pose.transform(place[:, None], points) for points in (contact.points_a, contact.points_b))
    points_a, points_b = points
    normal = pose.rotate(contact.normal, place[:, 2])
    return BodyContact(contact._replace(normal=normal, points_a=points_a, points_b=points_b), a, b)
