"""Rollouts: motions of many steps in a row, each from where the one before has led."""

import contextlib
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.state import State
from pushgraph.graph.steps import plan_steps
from pushgraph.network.contract import Dynamics
from pushgraph.spread import Spread


class Rollout(NamedTuple):
    """Poses in every frame, the first being where everything starts.

    poses: pose_world_from_body. tool: pose_world_from_tool; as it was asked for, but where a force limit held it back.
    spread: how far off the poses may be, [batch frames bodies]; None if it was not asked for.
    """

    poses: Float[Tensor, "batch frames bodies 3"]
    tool: Float[Tensor, "batch frames 3"]
    spread: Spread | None = None

    def numpy(self) -> tuple[Float[np.ndarray, "batch frames bodies 3"], Float[np.ndarray, "batch frames 3"]]:
        """Poses of the bodies, and of the tool, as arrays of NumPy."""
        return self.poses.detach().cpu().numpy(), self.tool.detach().cpu().numpy()


def rollout(
    dynamics: Dynamics,
    state: State,
    tool: Float[Tensor, "batch frames 3"],
    down: Bool[Tensor, "batch frames"],
    frames_per_step: int = 1,
    longest_step: float | None = None,
    force_limit: Float[Tensor, "batch frames"] | None = None,
) -> Rollout:
    """Predict all frames.

    tool: pose_world_from_tool. down: whether it is down on the table. frames_per_step, longest_step: how many frames
    and how much of the tool's way (m) a step may cover, by default as the dynamics say; see `pushgraph.graph.steps`.
    force_limit: of the tool along its motion (N), infinite where there is none; a tool that it holds back is late from
    then on, until it is lifted. What cannot move is held in place, whatever the dynamics make of it.
    Differentiable in all poses.
    """
    longest = dynamics.LONGEST_STEP if longest_step is None else longest_step
    steps = plan_steps(tool, down, state.scenes.tool_radius, frames_per_step, longest, force_limit)
    limited = force_limit is not None and bool(force_limit.isfinite().any())
    poses, tool_poses = [state.poses], [tool[:, 0]]
    held = state.scenes.immovable[..., None] if bool(state.scenes.immovable.any()) else None
    lag = torch.zeros_like(state.poses[:, 0, 0])
    # Where no gradient is wanted, torch need not keep count of versions and views: a fifth of the time of few scenes.
    with contextlib.nullcontext() if torch.is_grad_enabled() else torch.inference_mode():
        for k, control in enumerate(steps.controls):
            now = steps.late(k, lag) if limited else control
            motion, done = dynamics(state, now)
            poses.append(poses[-1] + (motion if held is None else motion.masked_fill(held, 0.0)))
            state = state.observe(poses[-1], now.frames)
            if limited:
                lag = torch.where(now.down, lag + (1 - done) * now.frames, 0.0)
                tool_poses.append(steps.tool_at(k + 1, lag))
    # Outside of inference mode, so that what was predicted may be learnt from.
    poses_in_frames = steps.at_frames(torch.stack(poses, 1), tool.shape[1])
    if limited:
        tool = steps.at_frames(torch.stack(tool_poses, 1)[:, :, None], tool.shape[1])[:, :, 0]
    return Rollout(poses_in_frames, tool)
