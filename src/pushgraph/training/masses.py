"""What evidence about masses is worth, learnt from tracks whose masses are known.

Tracks are watched with masses assumed that are off by a known amount, as those that a belief holds are; the loss is how
surprising the true ones are, given the evidence and how far off they may be.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pushgraph.dataset.sequences import SequenceBatch
from pushgraph.graph.mass_evidence import linearize
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes
from pushgraph.graph.state import State
from pushgraph.graph.watching import first_look, look
from pushgraph.mass_memory import VARIED, Tracked, camera_of, of_frame, rested, seen_in, surprises, track
from pushgraph.network.compiled.in_reach import bodies_in_reach
from pushgraph.network.mass_noise import Evidence, MassNoise
from pushgraph.training.examples import mirror, mirror_scenes
from pushgraph.training.watching import BLIND, CLEAN, NOISE

OFF = (0.1, 1.0)
"""Assumed masses are off by this much, a standard deviation of logarithms, drawn for each track."""
ASKED_EVERY = 15
"""Frames after which the loss asks again."""
MEASURED = 0.5
"""Share of tracks in which forces are measured."""
SENSOR = (0.3, 0.3, 0.01)
"""Standard deviations of a force sensor (N, N, N m)."""


class Weighed(NamedTuple):
    """Tracks to learn from. assumed: logarithms of masses, and last of the table's friction. off: how far, as a standard
    deviation. true: the true ones."""

    scenes: SceneBatch
    poses: Float[Tensor, "batch frames bodies 3"]
    tool: Float[Tensor, "batch frames 3"]
    down: Bool[Tensor, "batch frames"]
    wrench: Float[Tensor, "batch frames 3"]
    assumed: Float[Tensor, "batch variables"]
    off: Float[Tensor, " batch"]
    true: Float[Tensor, "batch variables"]


def weighed(sequences: SequenceBatch, generator: torch.Generator) -> Weighed:
    """Sequences seen in a mirror or not, with noise and unknown yaws, with assumed masses and measured forces."""
    scenes = batch_scenes(sequences.scenes)
    poses, wrench = torch.from_numpy(sequences.poses).double(), torch.from_numpy(sequences.wrench).double()
    batch = len(poses)
    sign = 1.0 - 2.0 * torch.randint(2, (batch,), generator=generator)
    scenes, poses = mirror_scenes(scenes, sign), mirror(poses, sign)
    wrench = wrench * torch.stack((torch.ones_like(sign), sign, sign), -1)[:, None]

    def share(of: float) -> Tensor:
        return torch.rand(batch, generator=generator) < of

    no_yaw = share(BLIND)[:, None] & scenes.is_cylinder
    size = (torch.rand(batch, generator=generator) * ~share(CLEAN))[:, None, None, None]
    bodies = poses[:, :, 1:]
    bodies = bodies + size * torch.randn(bodies.shape, generator=generator) * bodies.new_tensor([NOISE[0], *NOISE])
    wrench = wrench + torch.randn(wrench.shape, generator=generator) * wrench.new_tensor(SENSOR)
    wrench = torch.where(share(MEASURED)[:, None, None], wrench, torch.nan)
    true = torch.cat((scenes.mass, scenes.table_friction[:, None]), 1).double().log()
    off = OFF[0] + (OFF[1] - OFF[0]) * torch.rand(batch, generator=generator)
    apart = torch.randn(true.shape, generator=generator) * off[:, None]
    apart[:, -1] = 0.0
    scenes = scenes._replace(yaw_known=scenes.yaw_known & ~no_yaw)
    down = torch.from_numpy(sequences.down)
    return Weighed(scenes, bodies, poses[:, :, 0], down, wrench, true + apart, off.double(), true)


def mass_loss(network: MassNoise, dynamics: nn.Module, tracks: Weighed) -> Float[Tensor, ""]:
    """How surprising the true masses are, on average over bodies and over moments of the tracks (nats)."""
    scenes = tracks.scenes
    everything = scenes.present
    view, frame = first_look(scenes, tracks.poses[:, 0], tracks.tool[:, 0], tracks.down[:, 0], everything)
    variables = tracks.assumed.shape[1]
    poses = tracks.poses[:, 0]
    tracked = Tracked(
        poses, torch.zeros_like(poses), poses.new_zeros(*poses.shape, variables), torch.zeros_like(poses)
    )
    spread = tracks.off[:, None].expand_as(tracks.assumed).clamp(*VARIED)
    information = poses.new_zeros(len(poses), variables, variables)
    pull = poses.new_zeros(len(poses), variables)
    losses = []
    for k in range(1, tracks.poses.shape[1]):
        columns = (values[:, k] for values in (tracks.poses, tracks.tool, tracks.down))
        view, frame = look(view, *columns, everything, bodies_in_reach)
        control = of_frame(frame.control)
        telling = control.down & (control.motion != 0).any(-1)
        if telling.any():
            with torch.no_grad():
                state = State(scenes, tracked.poses, tracked.motions, view.state.relations, frame.before.still)
                linearized = linearize(dynamics, state, control, tracks.assumed, spread, tracked.sensitivity)
            seen = seen_in(view, tracks.wrench[:, k])
            step = control.motion[:, :2].norm(dim=-1)
            surprise, expected, observed = surprises(network, linearized, tracked, seen.poses, step, camera_of(frame))
            evidence = network.evidence(linearized, surprise, expected + observed, tracks.assumed)
            force = network.wrench_evidence(linearized, seen.wrench, tracks.assumed)
            evidence = Evidence(*(one + other for one, other in zip(evidence, force, strict=True)))
            there = telling.to(poses.dtype)
            information = information + there[:, None, None] * evidence.information
            pull = pull + there[:, None] * evidence.pull
            now = track(tracked, linearized, surprise, expected, observed)
        else:
            now = tracked
        tracked = rested(now, view, frame, ~telling[:, None].expand_as(everything))
        if k % ASKED_EVERY == 0:
            losses.append(_surprise(Evidence(information, pull), tracks))
    return torch.stack(losses).mean()


def _surprise(evidence: Evidence, tracks: Weighed) -> Float[Tensor, ""]:
    """Of the true masses, under the evidence and what was known before."""
    bodies = tracks.true.shape[1] - 1
    information = evidence.information[:, :bodies, :bodies]
    before = tracks.off**-2
    whole = information + before[:, None, None] * torch.eye(bodies, dtype=information.dtype)
    # About the assumed masses; the friction is known here.
    pull = (evidence.pull - (evidence.information @ tracks.assumed[..., None])[..., 0])[:, :bodies]
    apart = (tracks.true - tracks.assumed)[:, :bodies] - torch.linalg.solve(whole, pull)
    squared = (apart[:, None] @ whole @ apart[..., None])[:, 0, 0]
    gained = torch.logdet(whole) - bodies * before.log()
    # A far-off track teaches no more than that it is far off.
    return ((bodies + 4) / 2 * (squared / 4).log1p() - gained / 2).mean() / bodies
