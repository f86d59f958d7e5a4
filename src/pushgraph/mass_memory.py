"""What is remembered of masses while scenes are watched, in constant memory.

Every frame is evidence about masses: how far bodies are from where they were expected, given how that depends on
masses. Evidence counts about the masses assumed when it was computed, so the most telling frames are kept, and looked
at again when other masses are believed meanwhile; the others' evidence stays as it was.

Poses of a camera are noisy, so bodies are tracked: each starts from a mean of where it was expected and where it was
seen (a Kalman filter), and what masses have to do with that is carried along.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.mass_evidence import Dynamics, Linearized, Rows, linearize, moving
from pushgraph.graph.scene_batch import Relations, SceneBatch, concatenate, double, map_tensors
from pushgraph.graph.state import Control, State
from pushgraph.graph.watching import Frame, View
from pushgraph.mass_chains import MassChains
from pushgraph.network.mass_noise import Evidence, MassNoise, usual_noise
from pushgraph.pose import wrap_angle

KEPT = 64
"""Frames that are looked at again."""
AGAIN, STALE = 4, 0.02
"""So many at most are looked at again in a frame: those whose evidence is the farthest from the masses that are assumed
now, in squared standard deviations of what the frame shows, if it is at least so far."""
ANEW = 10
"""In every so many frames chains are drawn anew instead of moved."""
TELLING = 1e-2
"""Frames with less information on masses than this are not kept."""
PRIOR_SPREAD = 1.4
"""Standard deviation of a logarithm of mass before anything is seen."""
VARIED = (0.2, 1.2)
"""Masses are varied by as much as they are uncertain, in logarithms, but at least and at most this."""
MEASURED = 1e-4**2
"""Poses are not taken for more exact than with this variance (m^2): contacts give way, back and forth."""
TRACKED = 0.3
"""Share of the usual variance of predicted motions with which bodies are tracked: errors of prediction cancel in time,
those of a camera do so at once."""


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
    """Frames that are looked at again, KEPT of each scene, one scene after the other.

    log_mass: as assumed when it was looked at last. moves: bodies that took part. number: of the frame. worth: how much
    they tell; zero of empty places.
    """

    tracked: Tracked
    log_mass: Float[Tensor, "places variables"]
    moves: Bool[Tensor, "places bodies"]
    control: Control
    seen: Seen
    number: Int[Tensor, " places"]
    evidence: Evidence
    worth: Float[Tensor, " places"]


class Surprises(NamedTuple):
    """How far bodies were from where they were expected (turns at LEVER, m; NaN where not seen).

    variance: of that (m^2). tracked: variance of what was expected, as tracking has it. observed: of what was seen.
    """

    surprise: Float[Tensor, "batch bodies 3"]
    variance: Float[Tensor, "batch bodies 3"]
    tracked: Float[Tensor, "batch bodies 3"]
    observed: Float[Tensor, "batch bodies 3"]


class Looked(NamedTuple):
    """Frames that were looked at, for the first time or again: all that their evidence is made from.

    scene, number: whose frames, and which. log_mass: as assumed. step: how far the tool moved (m). camera: see
    `camera_of`.
    """

    scene: Int[Tensor, " rows"]
    number: Int[Tensor, " rows"]
    linearized: Linearized
    tracked: Tracked
    seen: Seen
    log_mass: Float[Tensor, "rows variables"]
    step: Float[Tensor, " rows"]
    camera: Float[Tensor, "rows 2"]

    def surprises(self, network: MassNoise) -> Surprises:
        """How far bodies were from where they were expected."""
        tracked, linearized, camera = self.tracked, self.linearized, self.camera
        off = self.seen.poses - tracked.poses - linearized.motion
        surprise = torch.cat((off[..., :2], wrap_angle(off[..., 2:]) * LEVER), -1)
        usual = usual_noise(self.step, linearized)
        noise = of_coordinates(network.noise(self.step, linearized, usual, tracked.variance[..., 0], camera))
        observed = (of_coordinates(camera.square())[:, None] + MEASURED).expand_as(surprise)
        expected = tracked.variance + TRACKED * usual[..., None]
        # Where one body is taken to be off, those that it touches are expected off as well.
        off_together = torch.maximum(tracked.variance, _blur(tracked, linearized.moves)[:, None, None])
        return Surprises(surprise, off_together + noise + observed, expected, observed)

    def evidence(self, network: MassNoise, off: Surprises) -> Evidence:
        """What the frames tell about masses."""
        moved = network.evidence(self.linearized, off.surprise, off.variance, self.log_mass)
        if self.linearized.felt is None:
            return moved
        felt = network.wrench_evidence(self.linearized.felt, self.seen.wrench, self.log_mass, self.camera)
        return map_tensors(lambda one, other: one + other, moved, felt)


class MassMemory(NamedTuple):
    """What is remembered of the masses of scenes.

    scenes: in float64. log_mass: logarithms of masses, and last of the table's friction, as assumed. settled: evidence
    that is not looked at again. evidence: all of it. frames: observed so far.
    """

    scenes: SceneBatch
    log_mass: Float[Tensor, "batch variables"]
    tracked: Tracked
    kept: Kept
    settled: Evidence
    evidence: Evidence
    chains: MassChains
    frames: int


def begin(scenes: SceneBatch, poses: Float[Tensor, "batch bodies 3"], chains: MassChains) -> MassMemory:
    """Nothing was seen yet but where bodies are."""
    poses = poses.double()
    batch, bodies = poses.shape[:2]
    variables = bodies + 1
    sensitivity, still = poses.new_zeros(batch, bodies, 3, variables), torch.zeros_like(poses)
    tracked = Tracked(poses, still, sensitivity, torch.zeros_like(poses))
    nothing = poses.new_zeros(batch)
    nowhere = still[:, 0]
    control = Control(nowhere, nowhere, nowhere, nothing > 0)
    empty = Evidence(poses.new_zeros(batch, variables, variables), poses.new_zeros(batch, variables))
    seen = Seen(poses, torch.full_like(nowhere, torch.nan))
    one = Kept(tracked, empty.pull, poses[..., 0] > torch.inf, control, seen, nothing.long(), empty, nothing)
    kept = map_tensors(lambda values: values.repeat_interleave(KEPT, 0), one)
    return MassMemory(double(scenes), chains.mean().to(poses.device), tracked, kept, empty, empty, chains, 0)


def observe(
    memory: MassMemory,
    network: MassNoise,
    dynamics: Dynamics,
    frame: Frame,
    view: View,
    motion: Float[Tensor, "batch bodies 3"],
    relations: Relations,
    wrench: Float[Tensor, "batch 3"],
    tell: Callable[[Looked], None] = lambda looked: None,
) -> MassMemory:
    """Learn from a frame.

    view: of the frame. motion: about as it was foreseen. relations: joints as they are believed. tell: is called with
    the frames that were looked at.
    """
    control, camera = frame.control.double(), camera_of(frame)
    telling = control.down & (control.motion != 0).any(-1)
    seen = seen_in(view, wrench)
    memory = memory._replace(frames=memory.frames + 1)
    if not telling.any():
        return memory._replace(tracked=rested(memory.tracked, view, camera, torch.ones_like(view.seen)))

    batch = len(memory.log_mass)
    again = _stale(memory, telling)
    scene = torch.cat((torch.arange(batch, device=again.device), again // KEPT))
    old = map_tensors(lambda values: values[again], memory.kept)
    old = old._replace(tracked=about(old.tracked, memory.log_mass[again // KEPT] - old.log_mass))
    moves = torch.cat((moving(motion, memory.tracked.sensitivity), old.moves))
    tracked = concatenate((memory.tracked, old.tracked))
    controls, both = concatenate((control, old.control)), concatenate((seen, old.seen))
    log_mass = memory.log_mass[scene]
    linearized = linearize(
        dynamics,
        State(memory.scenes, tracked.poses, tracked.motions, double(relations), frame.before.still),
        controls,
        Rows(scene, tracked.poses, tracked.motions, tracked.sensitivity, moves, _blur(tracked, moves).sqrt()),
        log_mass,
        _spread(memory.evidence)[scene],
        felt=bool(both.wrench.isfinite().any()),
    )
    number = torch.full((batch,), memory.frames, device=scene.device)
    looked = Looked(
        *(scene, torch.cat((number, old.number)), linearized, tracked, both, log_mass),
        *(controls.motion[:, :2].norm(dim=-1), camera[scene]),
    )
    tell(looked)
    off = looked.surprises(network)
    evidence = map_tensors(Tensor.detach, looked.evidence(network, off))

    newest = map_tensors(lambda values: values[:batch], evidence)
    looked_again = map_tensors(lambda values: values[batch:], evidence)
    old = old._replace(
        log_mass=log_mass[batch:], evidence=looked_again, worth=worth_of(looked_again).clamp(min=TELLING)
    )
    kept, settled = _keep(
        map_tensors(lambda values, new: values.index_copy(0, again, new), memory.kept, old),
        memory.settled,
        Kept(memory.tracked, memory.log_mass, moves[:batch], control, seen, number, newest, worth_of(newest)),
        telling,
    )
    total = map_tensors(lambda old, values: old + values.unflatten(0, (batch, KEPT)).sum(1), settled, kept.evidence)

    first = map_tensors(lambda values: values[:batch], linearized)
    after = track(memory.tracked, first, map_tensors(lambda values: values[:batch], off))
    move = memory.chains.sweep if memory.frames % ANEW else memory.chains.draw_anew
    chains = move(total, telling, memory.frames)
    log_mass = torch.where(telling[:, None], chains.mean().to(telling.device), memory.log_mass)
    after = about(after, log_mass - memory.log_mass)
    if not telling.all():
        after = rested(after, view, camera, ~telling[:, None])
    return MassMemory(memory.scenes, log_mass, after, kept, settled, total, chains, memory.frames)


def seen_in(view: View, wrench: Float[Tensor, "batch 3"]) -> Seen:
    """What the frame of a view showed."""
    scenes = view.state.scenes
    poses = torch.where((view.seen & scenes.present)[..., None], view.state.poses.double(), torch.nan)
    yaw = torch.where(scenes.yaw_known, poses[..., 2], torch.nan)
    return Seen(torch.cat((poses[..., :2], yaw[..., None]), -1), wrench.double())


def track(tracked: Tracked, linearized: Linearized, off: Surprises) -> Tracked:
    """Where bodies are, from where they were expected and where they were seen."""
    gain = torch.where(off.surprise.isfinite(), off.tracked / (off.tracked + off.observed), 0.0)
    motions = linearized.motion + torch.nan_to_num(off.surprise) * gain / gain.new_tensor([1.0, 1.0, LEVER])
    left = (1 - gain)[..., None] * linearized.sensitivity
    return Tracked(tracked.poses + motions, motions, left, (1 - gain) * off.tracked)


def rested(
    tracked: Tracked, view: View, camera: Float[Tensor, "batch 2"], at_rest: Bool[Tensor, "batch bodies"]
) -> Tracked:
    """The same where the tool does not reach: there a camera's mean is as good as anything, and masses do nothing.

    camera: see `camera_of`.
    """
    at_rest = at_rest & view.seen & (view.rested > 1)
    variance = (of_coordinates(camera.square())[:, None] + MEASURED) / view.rested.double()[..., None]
    return Tracked(
        torch.where(at_rest[..., None], view.state.poses.double(), tracked.poses),
        torch.where(at_rest[..., None], 0.0, tracked.motions),
        torch.where(at_rest[..., None, None], 0.0, tracked.sensitivity),
        torch.where(at_rest[..., None], variance, tracked.variance),
    )


def about(tracked: Tracked, change: Float[Tensor, "batch variables"]) -> Tracked:
    """The same after a change of the masses assumed."""
    moved = (tracked.sensitivity @ change[:, None, :, None])[..., 0]
    return tracked._replace(poses=tracked.poses + moved / moved.new_tensor([1.0, 1.0, LEVER]))


def worth_of(evidence: Evidence) -> Float[Tensor, " batch"]:
    """How much a frame tells about masses."""
    return evidence.information.diagonal(dim1=-2, dim2=-1)[..., :-1].sum(-1)


def camera_of(frame: Frame) -> Float[Tensor, "batch 2"]:
    """Standard deviations of positions, and of yaws at LEVER (m)."""
    spread = frame.noise.spread.double()
    return spread * spread.new_tensor([1.0, LEVER])


def of_coordinates(values: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 3"]:
    """Of x, y and yaw, from what there is of positions and of yaws."""
    return torch.cat((values[..., :1], values), -1)


def _blur(tracked: Tracked, moves: Bool[Tensor, "batch bodies"]) -> Float[Tensor, " batch"]:
    """The greatest variance of the position of a body that takes part (m^2)."""
    return torch.where(moves, tracked.variance[..., 0], 0.0).amax(1)


def _spread(evidence: Evidence) -> Float[Tensor, "batch variables"]:
    """How uncertain each variable is, given all others."""
    known = evidence.information.diagonal(dim1=-2, dim2=-1)
    return (known + PRIOR_SPREAD**-2).rsqrt().clamp(*VARIED)


def _stale(memory: MassMemory, telling: Bool[Tensor, " batch"]) -> Tensor:
    """Places of the kept frames that are looked at again, of scenes that show something."""
    change = memory.log_mass.repeat_interleave(KEPT, 0) - memory.kept.log_mass
    away = (change[:, None] @ memory.kept.evidence.information @ change[..., None])[:, 0, 0]
    away = torch.where((memory.kept.worth > 0) & telling.repeat_interleave(KEPT), away, 0.0)
    farthest, place = away.unflatten(0, (-1, KEPT)).topk(AGAIN)
    places = place + KEPT * torch.arange(len(place), device=place.device)[:, None]
    return places[farthest > STALE]


def _keep(kept: Kept, settled: Evidence, newest: Kept, telling: Bool[Tensor, " batch"]) -> tuple[Kept, Evidence]:
    """Keep the newest frame in the place of the least telling; what tells least is settled."""
    batch = len(telling)
    least, place = kept.worth.unflatten(0, (batch, KEPT)).min(1)
    places = place + KEPT * torch.arange(batch, device=place.device)
    enters = telling & (newest.worth > TELLING) & (newest.worth > least)

    def settle(old: Tensor, leaving: Tensor, new: Tensor) -> Tensor:
        goes = torch.where(_like(enters, old), leaving[places], new)
        return old + torch.where(_like(telling, old), goes, 0.0)

    settled = map_tensors(settle, settled, kept.evidence, newest.evidence)
    entering = enters.nonzero().squeeze(-1)
    if not len(entering):
        return kept, settled
    chosen = places[entering]
    return map_tensors(lambda old, new: old.index_copy(0, chosen, new[entering]), kept, newest), settled


def _like(chosen: Bool[Tensor, " batch"], values: Tensor) -> Tensor:
    return chosen.view(-1, *[1] * (values.dim() - 1))
