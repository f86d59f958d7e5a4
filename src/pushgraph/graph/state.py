"""Where everything is in a frame, and what the robot does next."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.scene_batch import Relations, SceneBatch, remember

ADJACENT = 0.02
"""Pairs nearer than this (m) are adjacent: they may be joined."""


class State(NamedTuple):
    """Scenes in one frame.

    poses: pose_world_from_body. motions: how each body's pose changed in the last frame, zero where not known.
    relations: those of the scenes, with what has been seen of unknown pairs so far.
    """

    scenes: SceneBatch
    poses: Float[Tensor, "batch bodies 3"]
    motions: Float[Tensor, "batch bodies 3"]
    relations: Relations

    def observe(self, poses: Float[Tensor, "batch bodies 3"]) -> "State":
        """The next frame's state, bodies being at `poses`."""
        motions = poses - self.poses
        moved = (motions != 0).any(-1)
        return State(
            self.scenes, poses, motions, remember(self.scenes, self.relations, poses.detach(), ADJACENT, moved)
        )


class Control(NamedTuple):
    """What the tool does from one frame to the next.

    pose: pose_world_from_tool. motion: how it changes until the next frame. last_motion: how it changed in the
    frame before. down: whether the tool is down on the table in this and the next frame.
    """

    pose: Float[Tensor, "batch 3"]
    motion: Float[Tensor, "batch 3"]
    last_motion: Float[Tensor, "batch 3"]
    down: Bool[Tensor, " batch"]


def start(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"]) -> State:
    """The state of scenes at rest, first seen at `poses`."""
    return State(scenes, poses, torch.zeros_like(poses), remember(scenes, scenes.relations, poses, ADJACENT))


def controls(tool: Float[Tensor, "batch frames 3"], down: Bool[Tensor, "batch frames"]) -> list[Control]:
    """What the tool does in each frame but the last, given its poses."""
    both = down[:, 1:] & down[:, :-1]
    motion = torch.where(both[..., None], tool[:, 1:] - tool[:, :-1], 0.0)
    last = torch.cat((torch.zeros_like(motion[:, :1]), motion[:, :-1]), 1)
    return [Control(tool[:, k], motion[:, k], last[:, k], both[:, k]) for k in range(motion.shape[1])]
