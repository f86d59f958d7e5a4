"""What is remembered of masses while scenes are watched, in constant memory.

Every frame is evidence about masses: how far bodies are from where they were expected, given how that depends on
masses. Evidence counts about the masses assumed when it was computed, so the most telling frames are kept and
looked at again, one in each frame, with what is believed meanwhile; the others' evidence stays as it was.

Poses of a camera are noisy, so bodies are tracked: each starts from a mean of where it was expected and where it was
seen (a Kalman filter), and what masses have to do with that is carried along.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.mass_evidence import Linearized, linearize
from pushgraph.graph.scene_batch import Relations, SceneBatch, concatenate, map_tensors
from pushgraph.graph.state import Control, State
from pushgraph.graph.watching import Frame, View
from pushgraph.mass_chains import MassChains
from pushgraph.network.mass_noise import Evidence, MassNoise
from pushgraph.pose import wrap_angle

KEPT = 16
"""Frames that are looked at again."""
TELLING = 1e-2
"""Frames with less information on masses than this are not kept."""
PRIOR_SPREAD = 1.4
"""Standard deviation of a logarithm of mass before anything is seen."""
VARIED = (0.2, 1.2)
"""Masses are varied by as much as they are uncertain, in logarithms, but at least and at most this."""
MEASURED = 1e-12
"""Poses are not measured more exactly than with this variance (m^2)."""


class Tracked(NamedTuple):
    """Poses and motions of bodies in a frame, and what is done next.

    sensitivity: of the poses to logarithms of masses (m, turns at LEVER). variance: of the poses (m^2).
    """

    poses: Float[Tensor, "batch bodies 3"]
    motions: Float[Tensor, "batch bodies 3"]
    sensitivity: Float[Tensor, "batch bodies 3 variables"]
    variance: Float[Tensor, "batch bodies 3"]


class Seen(NamedTuple):
    """What a frame showed. poses: NaN where nothing was seen. wrench: on the tool; NaN where it was not measured."""

    poses: Float[Tensor, "batch bodies 3"]
    wrench: Float[Tensor, "batch 3"]


class Kept(NamedTuple):
    """Frames that are looked at again, KEPT of each scene, one scene after the other. worth: zero of empty places."""

    tracked: Tracked
    control: Control
    seen: Seen
    evidence: Evidence
    worth: Float[Tensor, " places"]


class MassMemory(NamedTuple):
    """What is remembered of the masses of scenes.

    log_mass: logarithms of masses, and last of the table's friction, as assumed. settled: evidence that is not looked
    at again. frames: observed so far.
    """

    log_mass: Float[Tensor, "batch variables"]
    tracked: Tracked
    kept: Kept
    settled: Evidence
    chains: MassChains
    frames: int

    def evidence(self) -> Evidence:
        """All of it."""
        batch = len(self.log_mass)
        of_kept = (values.unflatten(0, (batch, KEPT)).sum(1) for values in self.kept.evidence)
        return Evidence(*(old + new for old, new in zip(self.settled, of_kept, strict=True)))


def begin(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"], chains: MassChains) -> MassMemory:
    """Nothing was seen yet but where bodies are."""
    poses = poses.double()
    batch, bodies = poses.shape[:2]
    variables = bodies + 1
    sensitivity, still = poses.new_zeros(batch, bodies, 3, variables), torch.zeros_like(poses)
    tracked = Tracked(poses, still, sensitivity, torch.zeros_like(poses))
    nothing = poses.new_zeros(batch)
    control = Control(still[:, 0], still[:, 0], still[:, 0], nothing > 0, nothing + 1, nothing + 1, nothing + torch.inf)
    empty = Evidence(poses.new_zeros(batch, variables, variables), poses.new_zeros(batch, variables))
    one = Kept(tracked, control, Seen(poses, torch.full_like(still[:, 0], torch.nan)), empty, nothing)
    kept = map_tensors(lambda values: values.repeat_interleave(KEPT, 0), one)
    return MassMemory(chains.mean(), tracked, kept, empty, chains, 0)


def observe(
    memory: MassMemory,
    network: MassNoise,
    dynamics: nn.Module,
    frame: Frame,
    view: View,
    relations: Relations,
    wrench: Float[Tensor, "batch 3"],
) -> MassMemory:
    """Learn from a frame. relations: joints as they are believed. view: of the frame."""
    control = of_frame(frame.control)
    telling = control.down & (control.motion != 0).any(-1)
    seen = seen_in(view, wrench)
    if not telling.any():
        tracked = rested(memory.tracked, view, frame, torch.ones_like(view.seen))
        return memory._replace(tracked=tracked, frames=memory.frames + 1)

    batch = len(memory.log_mass)
    scenes, still = frame.before.scenes, frame.before.still
    state = State(scenes, memory.tracked.poses, memory.tracked.motions, relations, still)
    again = _next_kept(memory, telling)
    scene = again // KEPT
    old = map_tensors(lambda values: values[again], memory.kept)
    then = map_tensors(lambda values: values[scene], state)._replace(poses=old.tracked.poses, motions=old.tracked.motions)
    rows = torch.cat((torch.arange(batch), scene))
    log_mass = memory.log_mass[rows]
    linearized = linearize(
        dynamics,
        concatenate((state, then)),
        concatenate((control, old.control)),
        log_mass,
        _spread(memory.evidence())[rows],
        torch.cat((memory.tracked.sensitivity, old.tracked.sensitivity)),
    )
    tracked = concatenate((memory.tracked, old.tracked))
    both_seen = concatenate((seen, old.seen))
    step = torch.cat((control.motion, old.control.motion))[:, :2].norm(dim=-1)
    surprise, expected, observed = surprises(network, linearized, tracked, both_seen.poses, step, camera_of(frame)[rows])
    evidence = network.evidence(linearized, surprise, expected + observed, log_mass)
    force = network.wrench_evidence(linearized, both_seen.wrench, log_mass)
    evidence = Evidence(*((one + other).detach() for one, other in zip(evidence, force, strict=True)))

    kept = memory.kept._replace(
        evidence=Evidence(
            *(values.index_copy(0, again, new[batch:]) for values, new in zip(memory.kept.evidence, evidence, strict=True))
        ),
        worth=memory.kept.worth.index_copy(0, again, worth_of(evidence)[batch:].clamp(min=1e-9)),
    )
    newest = Kept(memory.tracked, control, seen, Evidence(*(values[:batch] for values in evidence)), memory.kept.worth[:0])
    kept, settled = _keep(kept, memory.settled, newest, telling)
    memory = memory._replace(kept=kept, settled=settled, frames=memory.frames + 1)

    first = map_tensors(lambda values: values[:batch], linearized)
    now = track(memory.tracked, first, surprise[:batch], expected[:batch], observed[:batch])
    changed = telling.clone()
    changed[scene] = True
    chains = memory.chains.sweep(memory.evidence(), changed, memory.frames)
    log_mass = torch.where(changed[:, None], chains.mean(), memory.log_mass)
    now = now._replace(poses=now.poses + shift(now.sensitivity, log_mass - memory.log_mass))
    return memory._replace(log_mass=log_mass, tracked=rested(now, view, frame, ~telling[:, None]), chains=chains)


def of_frame(control: Control) -> Control:
    """The same with one number a scene in every field, in float64."""
    one = torch.ones_like(control.pose[:, 0], dtype=torch.float64)
    return control.double()._replace(frames=one, last_frames=one, force_limit=one * torch.inf)


def seen_in(view: View, wrench: Float[Tensor, "batch 3"]) -> Seen:
    """What the frame of a view showed."""
    scenes = view.state.scenes
    poses = torch.where((view.seen & scenes.present)[..., None], view.state.poses.double(), torch.nan)
    yaw = torch.where(scenes.yaw_known, poses[..., 2], torch.nan)
    return Seen(torch.cat((poses[..., :2], yaw[..., None]), -1), wrench.double())


def surprises(
    network: MassNoise,
    linearized: Linearized,
    tracked: Tracked,
    seen: Float[Tensor, "batch bodies 3"],
    step: Float[Tensor, " batch"],
    camera: Float[Tensor, "batch 2"],
) -> tuple[Float[Tensor, "batch bodies 3"], ...]:
    """How far bodies were from where they were expected (turns at LEVER, m); variances of what was expected, and of
    what was seen (m^2)."""
    off = seen - tracked.poses - linearized.motion
    surprise = torch.cat((off[..., :2], wrap_angle(off[..., 2:]) * LEVER), -1)
    noise = network.noise(step, linearized, tracked.variance[..., 0], camera)
    expected = tracked.variance + torch.cat((noise[..., :1].expand(*noise.shape[:-1], 2), noise[..., 1:]), -1)
    of_camera = camera.square()[:, None, [0, 0, 1]] + MEASURED
    return surprise, expected, of_camera.expand_as(surprise)


def track(
    tracked: Tracked,
    linearized: Linearized,
    surprise: Float[Tensor, "batch bodies 3"],
    expected: Float[Tensor, "batch bodies 3"],
    observed: Float[Tensor, "batch bodies 3"],
) -> Tracked:
    """Where bodies are, from where they were expected and where they were seen."""
    expected = expected.detach()
    gain = torch.where(surprise.isfinite(), expected / (expected + observed), 0.0)
    off = torch.nan_to_num(surprise) * gain / surprise.new_tensor([1.0, 1.0, LEVER])
    motions = linearized.motion + off
    left = (1 - gain)[..., None] * linearized.sensitivity
    return Tracked(tracked.poses + motions, motions, left, (1 - gain) * expected)


def rested(tracked: Tracked, view: View, frame: Frame, at_rest: Bool[Tensor, "batch bodies"]) -> Tracked:
    """The same where the tool does not reach: there a camera's mean is as good as anything, and masses do nothing."""
    at_rest = at_rest & view.seen & (view.rested > 1)
    variance = (camera_of(frame).square()[:, None, [0, 0, 1]] + MEASURED) / view.rested.double()[..., None]
    return Tracked(
        torch.where(at_rest[..., None], view.state.poses.double(), tracked.poses),
        torch.where(at_rest[..., None], 0.0, tracked.motions),
        torch.where(at_rest[..., None, None], 0.0, tracked.sensitivity),
        torch.where(at_rest[..., None], variance, tracked.variance),
    )


def shift(
    sensitivity: Float[Tensor, "batch bodies 3 variables"], change: Float[Tensor, "batch variables"]
) -> Float[Tensor, "batch bodies 3"]:
    """How far poses move with a change of the masses assumed (m, rad)."""
    moved = (sensitivity @ change[:, None, :, None])[..., 0]
    return moved / moved.new_tensor([1.0, 1.0, LEVER])


def worth_of(evidence: Evidence) -> Float[Tensor, " batch"]:
    """How much a frame tells about masses."""
    return evidence.information.diagonal(dim1=-2, dim2=-1)[..., :-1].sum(-1)


def camera_of(frame: Frame) -> Float[Tensor, "batch 2"]:
    """Standard deviations of positions, and of yaws at LEVER (m)."""
    return frame.noise.spread.double() * frame.noise.spread.new_tensor([1.0, LEVER]).double()


def _spread(evidence: Evidence) -> Float[Tensor, "batch variables"]:
    """How uncertain each variable is, given all others."""
    known = evidence.information.diagonal(dim1=-2, dim2=-1)
    return (known + PRIOR_SPREAD**-2).rsqrt().clamp(*VARIED)


def _next_kept(memory: MassMemory, telling: Bool[Tensor, " batch"]) -> Tensor:
    """Places of the kept frames whose turn it is, one of each scene that shows something."""
    filled = memory.kept.worth.unflatten(0, (-1, KEPT)) > 0
    place = torch.remainder(memory.frames, filled.sum(1).clamp(min=1))
    places = place + KEPT * torch.arange(len(filled))
    return places[telling & filled.any(1)]


def _keep(kept: Kept, settled: Evidence, newest: Kept, telling: Bool[Tensor, " batch"]) -> tuple[Kept, Evidence]:
    """Keep the newest frame in the place of the least telling; what tells least is settled."""
    batch = len(telling)
    worth = worth_of(newest.evidence)
    least, place = kept.worth.unflatten(0, (batch, KEPT)).min(1)
    places = place + KEPT * torch.arange(batch)
    enters = telling & (worth > TELLING) & (worth > least)
    chosen = places[enters]
    leaving = Evidence(*(values[places] for values in kept.evidence))
    stays = telling & ~enters
    settled = Evidence(
        *(
            old + torch.where(_like(enters, old), left, 0.0) + torch.where(_like(stays, old), new, 0.0)
            for old, left, new in zip(settled, leaving, newest.evidence, strict=True)
        )
    )
    newest = newest._replace(worth=worth)
    kept = map_tensors(lambda old, new: old.index_copy(0, chosen, new[enters].to(old.dtype)), kept, newest)
    return kept, settled


def _like(chosen: Bool[Tensor, " batch"], values: Tensor) -> Tensor:
    return chosen.view(-1, *[1] * (values.dim() - 1))
