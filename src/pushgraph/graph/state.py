"""Where everything is in a frame, and what the robot does next."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.scene_batch import Relations, SceneBatch, double, map_tensors, remember

ADJACENT = 0.02
"""Pairs nearer than this (m) are adjacent: they may be joined."""


STILL = 1e-6
"""What moves less than this in a frame (m) is at rest."""


class State(NamedTuple):
    """Scenes in one frame.

    poses: pose_world_from_body. motions: how each body's pose changed in a frame of the last step, zero if not known.
    relations: those of the scenes, with what has been seen of unknown pairs so far. still: a body whose pose changed by
    less than this (m) is at rest, unless something reaches it; poses that a camera measured change by their noise.
    """

    scenes: SceneBatch
    poses: Float[Tensor, "batch bodies 3"]
    motions: Float[Tensor, "batch bodies 3"]
    relations: Relations
    still: float = STILL

    def double(self) -> "State":
        """The same in float64."""
        if self.poses.dtype == self.scenes.mass.dtype == torch.float64:
            return self
        return double(self)

    def take(self, index: Int[Tensor, " scenes"]) -> "State":
        """Some of the scenes, in the order of `index`."""
        return map_tensors(lambda values: values[index], self)

    def observe(self, poses: Float[Tensor, "batch bodies 3"], frames: Float[Tensor, " batch"] | float = 1.0) -> "State":
        """The state after so many frames more, bodies being at `poses`."""
        motions = poses - self.poses
        if isinstance(frames, Tensor):
            motions = motions / frames.to(motions.dtype).clamp(min=1e-9)[:, None, None]
        relations = remember(self.scenes, self.relations, poses.detach(), ADJACENT, motions)
        return State(self.scenes, poses, motions, relations, self.still)


class Control(NamedTuple):
    """What the tool does in one step.

    pose: pose_world_from_tool at its start. motion: how it changes until its end. last_motion: how it changed in a
    frame of the step before. down: whether the tool is down on the table from start to end. frames: how long the step
    is, in frames. last_frames: how long the one before was. force_limit: of the tool along its motion (N).
    """

    pose: Float[Tensor, "batch 3"]
    motion: Float[Tensor, "batch 3"]
    last_motion: Float[Tensor, "batch 3"]
    down: Bool[Tensor, " batch"]
    frames: Float[Tensor, " batch"] | float = 1.0
    last_frames: Float[Tensor, " batch"] | float = 1.0
    force_limit: Float[Tensor, " batch"] | float = math.inf

    def double(self) -> "Control":
        """The same in float64."""
        if self.pose.dtype == torch.float64:
            return self
        return double(self)

    def take(self, index: Int[Tensor, " scenes"]) -> "Control":
        """Those of some scenes, in the order of `index`."""
        return map_tensors(lambda values: values[index], self)


def start(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"]) -> State:
    """The state of scenes at rest, first seen at `poses`."""
    return State(scenes, poses, torch.zeros_like(poses), remember(scenes, scenes.relations, poses, ADJACENT))


def controls(
    tool: Float[Tensor, "batch knots 3"],
    down: Bool[Tensor, "batch knots"],
    frames: Float[Tensor, "batch steps"] | None = None,
    force_limit: Float[Tensor, "batch steps"] | None = None,
) -> list[Control]:
    """What the tool does in each step, given its poses where steps begin and end. frames: how long they are, one each
    by default; a step of none is none. force_limit: none by default (N)."""
    frames = torch.ones_like(tool[:, 1:, 0]) if frames is None else frames.to(tool.dtype)
    stays_down = down[:, 1:] & down[:, :-1]
    motion = torch.where(stays_down[..., None], tool.diff(dim=1), 0.0)
    pace = motion / frames.clamp(min=1e-9)[..., None]
    last = torch.cat((torch.zeros_like(pace[:, :1]), pace[:, :-1]), 1)
    limits: Sequence[Tensor | float] = [math.inf] * motion.shape[1] if force_limit is None else force_limit.unbind(1)
    return [
        Control(tool[:, k], motion[:, k], last[:, k], stays_down[:, k], frames[:, k], frames[:, max(k - 1, 0)], limit)
        for k, limit in enumerate(limits)
    ]
