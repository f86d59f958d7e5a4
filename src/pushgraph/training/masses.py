"""What evidence about masses is worth, learnt from tracks whose masses are known.

Tracks are watched as a belief watches them; the loss is how surprising the true masses are, given all evidence as it
was last computed, and what was known before.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.dataset.sequences import SequenceBatch
from pushgraph.graph.mass_evidence import Dynamics
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes, concatenate, map_tensors
from pushgraph.graph.watching import first_look, look
from pushgraph.mass_chains import MassChains
from pushgraph.mass_memory import PRIOR_SPREAD, Looked, begin, observe
from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.network.compiled.in_reach import bodies_in_reach
from pushgraph.network.mass_noise import Evidence, MassNoise
from pushgraph.simulation.force_sensor import FORCE_NOISE, MOMENT_NOISE
from pushgraph.training.examples import mirror, mirror_scenes
from pushgraph.training.watching import BLIND, CLEAN, NOISE

MEASURED = 0.5
"""Share of tracks in which forces are measured."""
SHORTEST = 0.3
"""Tracks are watched from this share of their frames up to all of them."""
PRIOR_MEAN = 0.4
"""Mean of the logarithm of a mass (kg) before anything is seen; see PRIOR_SPREAD."""
FREEDOM = 4.0
"""Degrees of freedom of the distribution that the loss takes masses to have: one bad track does not count too much."""


class Weighed(NamedTuple):
    """Tracks to learn from, no mass known. true: logarithms of masses, and last of the table's friction."""

    scenes: SceneBatch
    poses: Float[Tensor, "batch frames bodies 3"]
    tool: Float[Tensor, "batch frames 3"]
    down: Bool[Tensor, "batch frames"]
    wrench: Float[Tensor, "batch frames 3"]
    true: Float[Tensor, "batch variables"]


def weighed(sequences: SequenceBatch, generator: torch.Generator) -> Weighed:
    """Sequences seen in a mirror or not, with noise and unknown yaws, and measured forces."""
    scenes = batch_scenes(sequences.scenes)
    poses, wrench = torch.from_numpy(sequences.poses).double(), torch.from_numpy(sequences.wrench).double()
    batch, frames = poses.shape[:2]
    sign = 1.0 - 2.0 * torch.randint(2, (batch,), generator=generator)
    scenes, poses = mirror_scenes(scenes, sign), mirror(poses, sign)
    wrench = wrench * torch.stack((torch.ones_like(sign), sign, sign), -1)[:, None]

    def share(of: float) -> Tensor:
        return torch.rand(batch, generator=generator) < of

    no_yaw = share(BLIND)[:, None] & scenes.is_cylinder
    size = (torch.rand(batch, generator=generator) * ~share(CLEAN))[:, None, None, None]
    bodies = poses[:, :, 1:]
    noise = torch.randn(bodies.shape, generator=generator) * bodies.new_tensor([NOISE[0], *NOISE])
    sensor = wrench.new_tensor([FORCE_NOISE, FORCE_NOISE, MOMENT_NOISE])
    wrench = wrench + torch.randn(wrench.shape, generator=generator) * sensor
    wrench = torch.where(share(MEASURED)[:, None, None], wrench, torch.nan)
    true = torch.cat((scenes.mass, scenes.table_friction[:, None]), 1).double().log()
    scenes = scenes._replace(
        yaw_known=scenes.yaw_known & ~no_yaw, mass_known=torch.zeros_like(scenes.mass_known)
    )
    last = int(frames * (SHORTEST + (1 - SHORTEST) * float(torch.rand((), generator=generator)))) + 1
    down = torch.from_numpy(sequences.down)
    bodies = bodies + size * noise
    return Weighed(scenes, bodies[:, :last], poses[:, :last, 0], down[:, :last], wrench[:, :last], true)


def mass_loss(network: MassNoise, dynamics: Dynamics, tracks: Weighed) -> Float[Tensor, ""]:
    """How surprising the true masses are in the end, on average over bodies (nats)."""
    looked = last_looks(network, dynamics, tracks)
    evidence = looked.evidence(network, looked.surprises(network))
    batch = len(tracks.true)

    def of_scenes(values: Tensor) -> Tensor:
        return values.new_zeros(batch, *values.shape[1:]).index_add(0, looked.scene, values)

    return surprise(map_tensors(of_scenes, evidence), tracks)


@torch.no_grad()
def last_looks(network: MassNoise, dynamics: Dynamics, tracks: Weighed) -> Looked:
    """Watch tracks: every frame as it was looked at for the last time."""
    scenes, seen = tracks.scenes, tracks.scenes.present
    view, _ = first_look(scenes, tracks.poses[:, 0], tracks.tool[:, 0], tracks.down[:, 0], seen)
    chains = MassChains.begin(scenes, [MASS_CLASSES] * len(tracks.true))
    memory = begin(scenes, tracks.poses[:, 0], chains)
    looks: list[Looked] = []
    for k in range(1, tracks.poses.shape[1]):
        view, frame = look(view, tracks.poses[:, k], tracks.tool[:, k], tracks.down[:, k], seen, bodies_in_reach)
        motion = dynamics(frame.before, frame.control).motion
        relations, wrench = view.state.relations, tracks.wrench[:, k]
        memory = observe(memory, network, dynamics, frame, view, motion, relations, wrench, looks.append)
    looked = concatenate(looks)
    place = looked.scene * (memory.frames + 1) + looked.number
    # Of equal places the last one written stays.
    written = torch.arange(len(place), device=place.device)
    last = place.new_full((int(place.max()) + 1,), -1).scatter_reduce(0, place, written, "amax")
    rows = last[last >= 0]
    return map_tensors(lambda values: values[rows], looked)


def surprise(evidence: Evidence, tracks: Weighed) -> Float[Tensor, ""]:
    """Of the true masses, under the evidence and what was known before."""
    bodies = tracks.true.shape[1] - 1
    present = tracks.scenes.present
    information = evidence.information[:, :bodies, :bodies]
    whole = information + PRIOR_SPREAD**-2 * torch.eye(bodies, dtype=information.dtype, device=information.device)
    # The friction is known here; masses are by the prior about their mean.
    true = tracks.true
    mean = torch.full_like(true[:, :bodies], PRIOR_MEAN)
    about = torch.cat((mean, true[:, bodies:]), 1)
    pull = (evidence.pull - (evidence.information @ about[..., None])[..., 0])[:, :bodies]
    apart = torch.where(present, true[:, :bodies] - mean, 0.0) - torch.linalg.solve(whole, pull)
    squared = (apart[:, None] @ whole @ apart[..., None])[:, 0, 0]
    gained = torch.logdet(whole) + bodies * 2 * torch.tensor(PRIOR_SPREAD).log()
    count = present.sum(1)
    return (((count + FREEDOM) / 2 * (squared / FREEDOM).log1p() - gained / 2) / count).mean()
