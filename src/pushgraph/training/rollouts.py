"""Training examples for spreads: rollouts under all that may be known or believed, beside what happened."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.belief import BeliefModel, Watch
from pushgraph.dataset.store import Dataset
from pushgraph.graph.believed import believe
from pushgraph.graph.joint_truth import unaware
from pushgraph.graph.scene_batch import Relations, SceneBatch, batch_scenes, hide_relations
from pushgraph.graph.state import State, start
from pushgraph.graph.track_features import default_doubt, doubt_of
from pushgraph.network.contract import Dynamics
from pushgraph.rollout import rollout
from pushgraph.scene import NOMINAL_MASS, NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION
from pushgraph.track import Track
from pushgraph.training.processes import Processes

BELIEVED, HIDDEN = 0.5, 0.1
"""Shares of the batches whose joints are believed, and of those whose joints are not known at all."""
BELIEVED_KIND = "paper"
"""Joints are believed in scenes of this kind: how probable they are before anything was seen is learnt from these."""
AT_START = 0.5
"""Share of the rollouts that start where their trajectories do; of those with believed joints half as many."""
LONGEST_WATCH = 100
"""Most frames observed before a rollout with believed joints."""
WITHHELD = 0.15
"""Shares of the scenes whose masses, or whose frictions, are withheld."""
LONG, LONG_FRAMES = 0.1, 300
"""Share of the batches with rollouts of so many frames; they hold a quarter of the scenes."""


class Predicted(NamedTuple):
    """Rollouts beside the truth. counts: frames that the trajectories have, the first left out."""

    scenes: SceneBatch
    relations: Relations
    doubt: Float[Tensor, "batch pairs"]
    first_motion: Float[Tensor, "batch bodies 3"]
    tool: Float[Tensor, "batch frames 3"]
    down: Bool[Tensor, "batch frames"]
    poses: Float[Tensor, "batch frames bodies 3"]
    true: Float[Tensor, "batch frames bodies 3"]
    counts: Bool[Tensor, "batch frames"]


class RolloutMaker:
    """Makes batches of rollouts from a dataset; the same numbers and seed give the same batches.

    Scenes of a batch have about equally many bodies.
    """

    def __init__(
        self, dataset: Dataset, dynamics: Dynamics, belief: BeliefModel, rollouts: int, batch: int, seed: int
    ) -> None:
        self._dataset, self._dynamics, self._belief, self._seed = dataset, dynamics, belief, seed
        rng = np.random.default_rng([seed, 3])
        nodes = np.diff(dataset.pose_offset) // np.diff(dataset.frame_offset)
        count = max(1, rollouts // batch)
        self._bodies, self._frames = nodes - 1, np.diff(dataset.frame_offset)
        known = np.arange(len(dataset))
        believed = known[dataset.kind == BELIEVED_KIND]
        self._believed = round(BELIEVED * count) if len(believed) else 0

        def drawn(some: Int[np.ndarray, " trajectories"], batches: int) -> Int[np.ndarray, "batches batch"]:
            chosen = some[rng.integers(max(1, len(some)), size=batches * batch)]
            return chosen[np.argsort(nodes[chosen], kind="stable")].reshape(batches, batch)

        self.trajectories = np.concatenate((drawn(believed, self._believed), drawn(known, count - self._believed)))

    def __len__(self) -> int:
        return len(self.trajectories)

    def __call__(self, number: int, frames: int, processes: Processes) -> Predicted:
        """This process's share of batch `number`, of rollouts over so many frames."""
        rng = np.random.default_rng([self._seed, 4, number])
        chosen = self.trajectories[number]
        if rng.random() < LONG:
            chosen, frames = chosen[: max(processes.count, len(chosen) // 4)], LONG_FRAMES
        share = processes.share(len(chosen))
        tracks = [self._dataset[k] for k in chosen[share].tolist()]
        if number < self._believed:
            first = 0 if rng.random() < AT_START / 2 else int(rng.integers(LONGEST_WATCH + 1))
            withheld = Withheld.drawn(rng, len(chosen), int(self._bodies[chosen].max())).of(share)
            return predicted_as_believed(tracks, first, frames, self._dynamics, self._belief, withheld)
        lengths = self._frames[chosen].tolist()
        firsts = [0 if rng.random() < AT_START else int(rng.integers(max(1, length - 10))) for length in lengths]
        hidden = rng.random() < HIDDEN / (1 - BELIEVED)
        withheld = Withheld.drawn(rng, len(chosen), int(self._bodies[chosen].max())).of(share)
        return predicted_as_known(tracks, firsts[share], frames, self._dynamics, withheld, hidden)


class Withheld(NamedTuple):
    """Which masses and frictions shall not be known."""

    mass: Bool[Tensor, "batch bodies"]
    table: Bool[Tensor, " batch"]
    side: Bool[Tensor, " batch"]

    @classmethod
    def drawn(cls, rng: np.random.Generator, batch: int, bodies: int) -> "Withheld":
        """Of a scene's masses, either all or each with an even chance."""

        def drawn(share: float, *shape: int) -> Tensor:
            return torch.from_numpy(rng.random((batch, *shape)) < share)

        mass = drawn(WITHHELD, 1) & (drawn(0.5, 1) | drawn(0.5, bodies))
        return cls(mass, drawn(WITHHELD), drawn(WITHHELD))

    def of(self, share: slice) -> "Withheld":
        """Those of some scenes."""
        return Withheld(*(values[share] for values in self))


def predicted_as_known(
    tracks: Sequence[Track],
    firsts: Sequence[int],
    frames: int,
    dynamics: Dynamics,
    withheld: Withheld | None = None,
    hidden: bool = False,
) -> Predicted:
    """Rollouts from frame `firsts` of tracks on, with their true joints or, if hidden, with none."""
    scenes = batch_scenes([track.scene for track in tracks])
    if withheld is not None:
        scenes = withhold_values(scenes, withheld)
    if hidden:
        scenes = hide_relations(scenes, torch.ones_like(scenes.relations.known))
    seen = _stretches(tracks, firsts, frames, scenes.mass.shape[1])
    state = start(scenes, seen.bodies[:, 1])
    state = state._replace(motions=seen.bodies[:, 1] - seen.bodies[:, 0])
    return _predicted(state, seen, default_doubt(state.relations), dynamics)


def predicted_as_believed(
    tracks: Sequence[Track],
    first: int,
    frames: int,
    dynamics: Dynamics,
    belief: BeliefModel,
    withheld: Withheld | None = None,
) -> Predicted:
    """Rollouts with the joints that are believed after all frames up to `first` were observed."""
    scenes = batch_scenes([track.scene for track in tracks])
    watched = _watched(belief, unaware(scenes), _stretches(tracks, [0] * len(tracks), first + 1, scenes.mass.shape[1]))
    probabilities = belief.probabilities(watched)
    relations = believe(watched.view.state, belief.joints(watched), watched.view.fits).relations
    if withheld is not None:
        scenes = withhold_values(scenes, withheld)
    seen = _stretches(tracks, [first] * len(tracks), frames, scenes.mass.shape[1])
    state = State(scenes, seen.bodies[:, 1], seen.bodies[:, 1] - seen.bodies[:, 0], relations)
    return _predicted(state, seen, doubt_of(scenes, relations, probabilities), dynamics)


def withhold_values(scenes: SceneBatch, withheld: Withheld) -> SceneBatch:
    """Scenes of which some masses and frictions stand at nominal values, as those do that are not known."""
    no_mass = withheld.mass[:, : scenes.mass.shape[1]] & ~scenes.immovable
    no_table, no_side = withheld.table, withheld.side
    return scenes._replace(
        mass=torch.where(no_mass, NOMINAL_MASS, scenes.mass),
        mass_known=scenes.mass_known & ~no_mass,
        table_friction=torch.where(no_table, NOMINAL_TABLE_FRICTION, scenes.table_friction),
        table_friction_known=scenes.table_friction_known & ~no_table,
        side_friction=torch.where(no_side, NOMINAL_SIDE_FRICTION, scenes.side_friction),
        side_friction_known=scenes.side_friction_known & ~no_side,
    )


class _Stretches(NamedTuple):
    """Stretches of tracks, the frame before the first standing in front; beyond its end a track stays as it is."""

    bodies: Float[Tensor, "batch 1+frames bodies 3"]
    tool: Float[Tensor, "batch 1+frames 3"]
    down: Bool[Tensor, "batch 1+frames"]
    lasts: Bool[Tensor, "batch 1+frames"]


def _stretches(tracks: Sequence[Track], firsts: Sequence[int], frames: int, bodies: int) -> _Stretches:
    poses = np.zeros((len(tracks), 1 + frames, 1 + bodies, 3))
    down, lasts = np.zeros((2, len(tracks), 1 + frames), dtype=bool)
    for k, (track, first) in enumerate(zip(tracks, firsts, strict=True)):
        wanted = np.arange(first - 1, first + frames)
        index = wanted.clip(0, len(track.times) - 1)
        poses[k, :, : track.poses.shape[1]] = track.poses[index]
        lasts[k] = wanted < len(track.times)
        down[k] = track.down[index] & lasts[k]
    nodes = torch.from_numpy(poses)
    return _Stretches(nodes[:, :, 1:], nodes[:, :, 0], torch.from_numpy(down), torch.from_numpy(lasts))


def _watched(belief: BeliefModel, scenes: SceneBatch, seen: _Stretches) -> Watch:
    everything = torch.ones_like(seen.bodies[:, 0, :, 0], dtype=torch.bool)
    watched = belief.begin(scenes, seen.bodies[:, 1], seen.tool[:, 1], seen.down[:, 1], everything)
    for frame in range(2, seen.bodies.shape[1]):
        watched = belief.observe(watched, seen.bodies[:, frame], seen.tool[:, frame], seen.down[:, frame], everything)
    return watched


@torch.no_grad()
def _predicted(state: State, seen: _Stretches, doubt: Tensor, dynamics: Dynamics) -> Predicted:
    tool, down = seen.tool[:, 1:], seen.down[:, 1:]
    poses = rollout(dynamics, state.double(), tool, down).poses
    counts = seen.lasts[:, 1:].clone()
    counts[:, 0] = False
    return Predicted(
        scenes=state.scenes,
        relations=state.relations,
        doubt=doubt.float(),
        first_motion=state.motions.float(),
        tool=tool.float(),
        down=down,
        poses=poses.float(),
        true=seen.bodies[:, 1:].float(),
        counts=counts,
    )
