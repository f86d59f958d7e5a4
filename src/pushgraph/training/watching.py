"""Training examples for belief: sequences as a camera sees them, with what is truly joined."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.dataset.sequences import SequenceBatch
from pushgraph.graph.joint_truth import true_joints, unaware
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes, map_tensors
from pushgraph.training.examples import mirror, mirror_scenes

NOISE = (0.001, np.radians(0.5))
"""Largest standard deviations of the noise on positions (m), in x and in y, and on yaws (rad)."""
CLEAN = 0.25
"""Share of sequences without noise."""
MASSES_KNOWN, BLIND, LOSSY = 0.2, 0.15, 0.2
"""Shares of sequences whose masses are known, whose cylinders show no yaw, and in which tags are lost."""
LOST, LOST_FRAMES = 0.3, (3, 30)
"""Share of bodies that are lost once then, and for how long."""


class Watched(NamedTuple):
    """A batch of sequences. joint: JOINT_CODES of every pair, fixed for all within a rigid piece."""

    scenes: SceneBatch
    poses: Float[Tensor, "batch frames bodies 3"]
    tool: Float[Tensor, "batch frames 3"]
    down: Bool[Tensor, "batch frames"]
    seen: Bool[Tensor, "batch frames bodies"]
    lasts: Bool[Tensor, "batch frames"]
    joint: Int[Tensor, "batch pairs"]

    def to(self, device: torch.device) -> "Watched":
        """The same on another device."""
        return map_tensors(lambda values: values.to(device), self)


def watched(sequences: SequenceBatch, generator: torch.Generator) -> Watched:
    """Sequences seen in a mirror or not, with noise, lost tags and unknown yaws."""
    scenes = batch_scenes(sequences.scenes)
    poses = torch.from_numpy(sequences.poses)
    batch, frames = poses.shape[:2]
    sign = 1.0 - 2.0 * torch.randint(2, (batch,), generator=generator)
    scenes, poses = mirror_scenes(scenes, sign), mirror(poses, sign)
    tool, bodies = poses[:, :, 0], poses[:, :, 1:]
    joint = true_joints(scenes)
    blind = unaware(scenes)

    def share(of: float, *shape: int) -> Tensor:
        return torch.rand(batch, *shape, generator=generator) < of

    masses = share(MASSES_KNOWN)[:, None]
    no_yaw = share(BLIND)[:, None] & scenes.is_cylinder
    blind = blind._replace(
        mass=torch.where(masses, scenes.mass, blind.mass),
        mass_known=torch.where(masses, scenes.mass_known, blind.mass_known),
        yaw_known=scenes.yaw_known & ~no_yaw,
    )
    bodies = torch.cat((bodies[..., :2], torch.where(no_yaw[:, None], 0.0, bodies[..., 2])[..., None]), -1)
    size = torch.rand(batch, generator=generator).sqrt() * ~share(CLEAN)  # much noise is what is hard
    noise = torch.randn(bodies.shape, generator=generator) * bodies.new_tensor([NOISE[0], NOISE[0], NOISE[1]])
    noise[..., 2] *= ~no_yaw[:, None]
    bodies = bodies + noise * size[:, None, None, None]
    count = bodies.shape[2]
    lost = share(LOSSY)[:, None] & share(LOST, count)
    begun = torch.randint(1, frames, (batch, count), generator=generator)
    ended = begun + torch.randint(*LOST_FRAMES, (batch, count), generator=generator)
    time = torch.arange(frames)[None, :, None]
    seen = ~(lost[:, None] & (time >= begun[:, None]) & (time < ended[:, None]))
    down = torch.from_numpy(sequences.down)
    return Watched(blind, bodies, tool, down, seen, torch.from_numpy(sequences.lasts), joint)
