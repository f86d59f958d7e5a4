"""Which bodies touched each other or the tool while they moved, judged on true poses."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.evaluation.metrics import MOVED
from pushgraph.evaluation.recording import Recording
from pushgraph.graph.scene_batch import SceneBatch, pairs_of

TOUCHING = 1e-3
"""Surfaces touch up to this gap (m)."""
MOVING = 1e-4
"""A body moves in a frame in which it comes farther than this (m)."""


class Touched(NamedTuple):
    """What had happened by each frame.

    pairs: bodies that touched while either of them moved. pushed: bodies that came a centimetre with the robot, alone
    or in a chain of bodies that touched and moved.
    """

    pairs: Bool[Tensor, "batch frames pairs"]
    pushed: Bool[Tensor, "batch frames bodies"]

    @property
    def bodies(self) -> Bool[Tensor, "batch frames bodies"]:
        """Those of touched pairs."""
        count = self.pushed.shape[2]
        touched = torch.zeros_like(self.pushed)
        for pair, (a, b) in enumerate(pairs_of(count).T.tolist()):
            touched[..., a] |= self.pairs[..., pair]
            touched[..., b] |= self.pairs[..., pair]
        return touched


def find_touched(scenes: SceneBatch, seen: Recording) -> Touched:
    """Follow scenes from their first frame on."""
    way = torch.zeros_like(seen.bodies[..., 0])
    way[:, 1:] = (seen.bodies[:, 1:] - seen.bodies[:, :-1])[..., :2].norm(dim=-1)
    moving = way > MOVING
    a, b = pairs_of(seen.bodies.shape[2])
    of_bodies = _touching(scenes, seen.bodies)
    pairs = of_bodies & (moving[..., a] | moving[..., b])

    with_robot = _touching_tool(scenes, seen) & seen.down[..., None] & moving
    chained = torch.zeros(*moving.shape, moving.shape[-1], dtype=torch.bool)
    chained[..., a, b] = chained[..., b, a] = of_bodies & moving[..., a] & moving[..., b]
    for _ in range(moving.shape[-1] - 1):
        with_robot = with_robot | (chained & with_robot[..., None]).any(-2)
    pushed = (way * with_robot).cumsum(1) > MOVED
    return Touched(pairs.cummax(1).values, pushed)


def groups_of(pairs: Bool[np.ndarray, " pairs"], bodies: int) -> Int[np.ndarray, " bodies"]:
    """Groups that pairs link their bodies to, directly or through others: the label is the first body of each."""
    label = np.arange(bodies)
    for a, b in pairs_of(bodies).T[torch.from_numpy(pairs)].tolist():
        first, second = sorted((label[a], label[b]))
        label[label == second] = first
    return label


def _touching(scenes: SceneBatch, bodies: Float[Tensor, "batch frames bodies 3"]) -> Bool[Tensor, "batch frames pairs"]:
    a, b = pairs_of(bodies.shape[2])
    boxes = _each_frame(scenes.boxes, bodies.shape[1])
    present = (scenes.present[:, a] & scenes.present[:, b])[:, None].expand(-1, bodies.shape[1], -1)
    return _near(_take(boxes, a), bodies[:, :, a], _take(boxes, b), bodies[:, :, b], present)


def _touching_tool(scenes: SceneBatch, seen: Recording) -> Bool[Tensor, "batch frames bodies"]:
    """Whether any part of the tool touches each body."""
    frames, count = seen.bodies.shape[1:3]
    boxes, parts = _each_frame(scenes.boxes, frames), _each_frame(scenes.parts, frames)
    touching = torch.zeros(seen.bodies.shape[:3], dtype=torch.bool)
    for part in range(scenes.part_present.shape[1]):
        here = pose.compose(seen.tool, scenes.pose_tool_from_part[:, None, part].to(seen.tool))
        box = _take(parts, torch.full((count,), part))
        present = (scenes.present & scenes.part_present[:, part, None])[:, None].expand(-1, frames, -1)
        touching |= _near(box, here[:, :, None].expand(seen.bodies.shape), boxes, seen.bodies, present)
    return touching


def _each_frame(boxes: RoundedBox, frames: int) -> RoundedBox:
    return RoundedBox(
        boxes.half_extents[:, None].expand(-1, frames, -1, -1), boxes.radius[:, None].expand(-1, frames, -1)
    )


def _take(boxes: RoundedBox, index: Int[Tensor, " chosen"]) -> RoundedBox:
    return RoundedBox(boxes.half_extents[:, :, index], boxes.radius[:, :, index])


def _near(a: RoundedBox, pose_a: Tensor, b: RoundedBox, pose_b: Tensor, there: Tensor) -> Bool[Tensor, "*batch"]:
    """Whether surfaces touch; only where bounding circles do are the shapes looked at."""
    reach = sum(box.half_extents.norm(dim=-1) + box.radius for box in (a, b))
    near = there & ((pose_a - pose_b)[..., :2].norm(dim=-1) < reach + TOUCHING)
    first, second = (RoundedBox(box.half_extents[near], box.radius[near]) for box in (a, b))
    close = signed_gap(first, second, pose.relative(pose_a[near], pose_b[near]).float()) < TOUCHING
    return near.masked_scatter(near, close)
