"""The loss of an unrolled prediction."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.network.contract import PhysicsNetwork
from pushgraph.training.examples import Example

TINY = 1e-9
"""Keeps from dividing by zero where nothing counts, and the loss is zero."""


def unrolled_loss(
    dynamics: PhysicsNetwork,
    example: Example,
    mean: Callable[[Tensor], Tensor] = lambda weight: weight,
    velocity_noise: float | None = None,
) -> Float[Tensor, ""]:
    """Mean distance of predicted from true poses in all frames, in the network's unit of errors, turns at LEVER.

    mean: over the processes that share the batch, of what is divided by. velocity_noise: standard deviation, in that
    unit, of noise on the motions that the network is given; by default its VELOCITY_NOISE.

    Every frame starts from the predicted one, so the network meets its own errors. Gradients reach back through the
    sum of motions, not through the geometry of the frames between: that is half the time, and its normals turn by
    1 / gap beside corners.
    """
    state, poses = example.state, example.state.poses
    steps = torch.stack([control.motion[:, :2].norm(dim=-1) for control in example.controls])
    turns = torch.stack([control.motion[:, 2].abs() for control in example.controls])
    unit = dynamics.error_unit((steps + turns * state.scenes.tool_radius).mean(0))
    if velocity_noise is None:
        velocity_noise = dynamics.VELOCITY_NOISE
    noise = example.noise * velocity_noise * unit[:, None, None, None] * poses.new_tensor([1.0, 1.0, 1 / LEVER])
    total = poses.new_zeros(())
    weight = state.scenes.present * example.counts[:, None]
    total_weight = mean(weight.sum().to(poses.dtype)).clamp(min=TINY)
    for frame, control in enumerate(example.controls, start=1):
        noisy = state._replace(motions=state.motions + noise[:, frame - 1])
        poses = poses + dynamics(noisy, control).motion
        error = (poses - example.poses[:, frame]) * poses.new_tensor([1.0, 1.0, LEVER])
        error = error / unit[:, None, None]
        distance = (error.square().sum(-1) + dynamics.SMALL**2).sqrt() - dynamics.SMALL
        total = total + (distance / (1 + distance / dynamics.CHAOS) * weight).sum() / total_weight
        state = state.observe(poses.detach(), control.frames)
    return total / len(example.controls)
