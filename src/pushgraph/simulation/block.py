"""Blocks: what is placed as one, such as a piece of several parts, a row of touching bodies, or a door in its frame."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.body import Body, Joint
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, PlacedShape

LIGHTEST = 1e-3
"""No body weighs less (kg): the least that a scene may give."""


class Block(NamedTuple):
    """Parts in the frame of their block, each a body of the scene: its datasets hold cuboids and cylinders only.

    pieces: for each part the number of its rigid piece. joints: between parts, named by their numbers, in the frame of
    the block. fixed: the pieces that cannot move.
    """

    parts: tuple[PlacedShape, ...]
    pieces: tuple[int, ...]
    joints: tuple[Joint, ...] = ()
    fixed: tuple[int, ...] = ()

    @classmethod
    def of(cls, shape: Cylinder | Cuboid) -> "Block":
        """A body by itself."""
        return cls((PlacedShape(shape),), (0,))

    @classmethod
    def rigid(cls, parts: Sequence[PlacedShape], fixed: bool = False) -> "Block":
        """One piece of some parts."""
        return cls(tuple(parts), (0,) * len(parts), fixed=(0,) * fixed)

    @classmethod
    def loose(cls, parts: Sequence[PlacedShape], joints: Sequence[Joint] = (), fixed: Sequence[int] = ()) -> "Block":
        """Bodies that keep their places to each other only until they are pushed."""
        return cls(tuple(parts), tuple(range(len(parts))), tuple(joints), tuple(fixed))

    @property
    def poses_block_from_part(self) -> Float[np.ndarray, "parts 3"]:
        """Poses of the parts."""
        return np.array([part.pose_body_from_part for part in self.parts], dtype=float)

    @property
    def reach(self) -> float:
        """Radius of a circle around the origin of the block that holds it (m)."""
        away = np.hypot(*self.poses_block_from_part[:, :2].T)
        return float(max(far + part.shape.reach for far, part in zip(away, self.parts, strict=True)))


def area_of(shape: Cylinder | Cuboid) -> float:
    """Seen from above (m^2)."""
    half_x, half_y, radius = shape.core
    return math.pi * radius**2 if radius else 4 * half_x * half_y


def centred(parts: Sequence[PlacedShape]) -> tuple[PlacedShape, ...]:
    """The same parts around the middle of their centres."""
    poses = np.array([part.pose_body_from_part for part in parts], dtype=float)
    poses[:, :2] -= (poses[:, :2].min(0) + poses[:, :2].max(0)) / 2
    return tuple(PlacedShape(part.shape, tuple(place)) for part, place in zip(parts, poses.tolist(), strict=True))


def arrange(
    blocks: Sequence[Block],
    poses_world_from_block: Float[np.ndarray, "blocks 3"],
    masses: Sequence[Sequence[float]],
    **fields: Any,
) -> Scene:
    """The scene of placed blocks, whose parts become its bodies; `masses` (kg) are those of each block's parts."""
    bodies: list[Body] = []
    joints: list[Joint] = []
    groups: list[tuple[str, ...]] = []
    for block, place, own in zip(blocks, poses_world_from_block, masses, strict=True):
        names = [f"body{len(bodies) + k}" for k in range(len(block.parts))]
        poses = pose.compose(np.asarray(place, dtype=float), block.poses_block_from_part).tolist()
        for name, part, pose_world_from_part, mass, piece in zip(
            names, block.parts, poses, own, block.pieces, strict=True
        ):
            bodies.append(
                Body(
                    name=name,
                    shape=part.shape,
                    pose_world_from_body=tuple(pose_world_from_part),
                    mass=max(mass, LIGHTEST),
                    fixed=piece in block.fixed,
                )
            )
        for piece in sorted(set(block.pieces)):
            members = tuple(name for name, number in zip(names, block.pieces, strict=True) if number == piece)
            groups += [members] * (len(members) > 1)
        joints += [_joint_in_world(joint, names, np.asarray(place, dtype=float)) for joint in block.joints]
    return Scene(bodies=tuple(bodies), joints=tuple(joints), rigid_groups=tuple(groups), **fields)


def _joint_in_world(joint: Joint, names: Sequence[str], pose_world_from_block: np.ndarray) -> Joint:
    anchor, axis = (None if value is None else np.array(value) for value in (joint.anchor, joint.axis))
    return joint.replace(
        parent=names[int(joint.parent)],
        child=names[int(joint.child)],
        anchor=None if anchor is None else tuple(pose.transform(pose_world_from_block, anchor).tolist()),
        axis=None if axis is None else tuple(pose.rotate(axis, pose_world_from_block[2]).tolist()),
    )
