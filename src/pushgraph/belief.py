"""Belief regulation: what is joined to what, learnt by watching, corrected as more is seen."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.array_input import Values, checked
from pushgraph.checkpoint import Checkpoint, load_checkpoint, shipped
from pushgraph.device import device_of, place_of
from pushgraph.errors import BeliefError, CheckpointError
from pushgraph.graph.believed import believe
from pushgraph.graph.camera_noise import FINEST
from pushgraph.graph.scene_batch import JOINT_CODES, SceneBatch, batch_scenes, concatenate, map_tensors
from pushgraph.graph.watching import Frame, View, first_look, look
from pushgraph.joint_answers import JointAnswers, answer_together
from pushgraph.mass_chains import MassChains, MassPosterior
from pushgraph.mass_memory import MassMemory
from pushgraph.mass_memory import begin as begin_masses
from pushgraph.mass_memory import observe as observe_masses
from pushgraph.mass_prior import MASS_CLASSES, MassClass
from pushgraph.network.belief_network import BELIEFS, BeliefRecipe, Evidence, Memory, Rows
from pushgraph.network.compiled.in_reach import bodies_in_reach
from pushgraph.network.contract import Foreseeing, Foresight
from pushgraph.scene import Scene

CHUNK = 256
"""Scene-frames whose evidence is computed together."""
TRAINING_PRIOR = {"none": 0.54, "fixed": 0.14, "prismatic": 0.15, "revolute": 0.17}
"""Shares of the joints of neighbours in the training data, the setup `jointed`."""
LARGEST_CAMERA_ERROR = 0.005
"""A camera that is farther off than this (m), though it does not jitter, must be calibrated."""


class Watch(NamedTuple):
    """Scenes being watched, with what is believed of them.

    begun: pairs whose memory has begun. masses: what is remembered of masses; None where all are known. answers: about
    joints, if they were asked for. as_numpy: whether poses came as NumPy's, and answers shall.
    """

    view: View
    relations: Float[Tensor, "batch pairs 2 state"]
    objects: Float[Tensor, "bodies state"]
    begun: Bool[Tensor, "batch pairs"]
    masses: MassMemory | None
    answers: JointAnswers | None = None
    as_numpy: bool = False


class BeliefModel:
    """A trained belief network with the frozen physics network that it stands on.

    What it is given may be of NumPy or torch; to poses of NumPy it answers in NumPy.

    record: how it was trained. prior: how likely each joint is of a pair of neighbours before anything is seen.
    camera_error: errors of poses that do not show as noise (m), of turns at LEVER; see `CameraNoise.variance`.
    """

    def __init__(
        self,
        network: BeliefRecipe,
        dynamics: Foreseeing,
        record: Mapping[str, Any] | None = None,
        prior: Mapping[str, float] = TRAINING_PRIOR,
        camera_error: float = FINEST,
    ) -> None:
        self.network, self.dynamics, self.record = network, dynamics, dict(record or {})
        self.prior, self.camera_error = dict(prior), camera_error

    @classmethod
    def load(
        cls, model: str | os.PathLike = "belief", device: str = "cpu", physics: str | os.PathLike | None = None
    ) -> "BeliefModel":
        """Load a shipped belief by name, or the checkpoint in a file, with the physics weights below it.

        physics: their checkpoint; the shipped one by default. Raises CheckpointError if any part is not what it should
        be, and DeviceError if there is no such device.
        """
        place = device_of(device)
        path = shipped(str(model)) if str(model) in BELIEFS and not Path(model).is_file() else Path(model)
        checkpoint = load_checkpoint(path)
        if checkpoint.kind not in BELIEFS:
            raise CheckpointError(f"{path}: holds {checkpoint.kind!r}, no belief; valid: {', '.join(BELIEFS)}")
        below = load_physics(BELIEFS[checkpoint.kind].PHYSICS, physics)
        if checkpoint.physics != below.hash:
            raise CheckpointError(
                f"{path}: trained on other weights of {below.kind} than {physics or 'those shipped'}; name those it "
                "was trained on, or train it anew"
            )
        network, dynamics = (part.network.to(place).requires_grad_(False) for part in (checkpoint, below))
        return cls(cast(BeliefRecipe, network), cast(Foreseeing, dynamics), checkpoint.record)

    def expecting(self, prior: Mapping[str, float]) -> "BeliefModel":
        """The same, where neighbours have other joints than in the training data.

        prior: how likely each joint is of a pair of neighbours before anything is seen, up to a common factor; those
        not named cannot be. Raises BeliefError if there is no such joint, or it is no prior.
        """
        for kind, share in prior.items():
            if kind not in JOINT_CODES:
                raise BeliefError(f"prior: no joint {kind!r}; valid: {', '.join(JOINT_CODES)}")
            if not (math.isfinite(share) and share >= 0):
                raise BeliefError(f"prior: {kind}: must be a number from 0 on, got {share}")
        possible = [kind for kind, share in prior.items() if share > 0]
        if "none" not in possible or len(possible) < 2:
            raise BeliefError(f"prior: none and another joint must be possible; got {', '.join(possible) or 'nothing'}")
        return BeliefModel(self.network, self.dynamics, self.record, prior, self.camera_error)

    def seen_by(self, camera_error: float) -> "BeliefModel":
        """The same, where poses are off by more than noise shows, and by more than is expected of a noisy camera.

        camera_error: how far, in the standard deviation (m): a lens that bends, a scale that is not quite right. Noise
        is found by itself. It counts for joints, as `belief` tells them: `paper_recipe` and masses know no such error.
        Raises BeliefError unless it is from FINEST to LARGEST_CAMERA_ERROR.
        """
        if not FINEST <= camera_error <= LARGEST_CAMERA_ERROR:
            valid = f"from {FINEST:g} to {LARGEST_CAMERA_ERROR:g} m"
            raise BeliefError(f"camera_error: must be {valid}, got {camera_error:g}")
        return BeliefModel(self.network, self.dynamics, self.record, self.prior, camera_error)

    @torch.inference_mode()
    def begin(
        self,
        scenes: SceneBatch | Sequence[Scene],
        poses: Values,
        tool: Values,
        down: Values,
        seen: Values,
        classes: Sequence[Sequence[MassClass]] | None = None,
    ) -> Watch:
        """Watch scenes from their first frame on; what is known of their joints and masses is taken as given.

        poses: pose_world_from_body, [batch bodies 3]. tool: pose_world_from_tool, [batch 3]. down: whether it is down
        on the table, [batch]. seen: whether each body is seen, [batch bodies]. classes: what bodies of unknown mass may
        weigh, of each scene; MASS_CLASSES by default. Raises BeliefError if a shape or a dtype is another.
        """
        as_numpy = isinstance(poses, np.ndarray)
        scenes = (scenes if isinstance(scenes, SceneBatch) else batch_scenes(scenes)).to(self.device)
        poses, tool, down, seen = _checked(scenes, poses, tool, down, seen)
        view, frame = first_look(scenes, poses, tool, down, seen, self.camera_error)
        batch, pairs = frame.in_sight.shape
        watch = Watch(
            view,
            poses.new_zeros(batch, pairs, 2, self.network.width, dtype=torch.float32),
            poses.new_zeros(batch * poses.shape[1], self.network.hidden, dtype=torch.float32),
            torch.zeros_like(frame.in_sight),
            self._begin_masses(scenes, poses, classes or [MASS_CLASSES] * batch),
            as_numpy=as_numpy,
        )
        return self._learn(watch, view, frame, None)

    @torch.inference_mode()
    def observe(
        self,
        watch: Watch,
        poses: Values,
        tool: Values,
        down: Values,
        seen: Values,
        wrench: Values | None = None,
    ) -> Watch:
        """One frame more, see `begin`. wrench: of the bodies on the tool (N, N m), [batch 3], NaN where it was not
        measured."""
        scenes = watch.view.state.scenes
        poses, tool, down, seen = _checked(scenes, poses, tool, down, seen)
        if wrench is not None:
            shape = (len(poses), 3)
            wrench = checked("wrench", wrench, shape, "real", scenes.mass, BeliefError, may_lack=True)
        return self._learn(watch, *look(watch.view, poses, tool, down, seen, bodies_in_reach), wrench)

    @property
    def device(self) -> torch.device:
        """What is computed on; inputs may be anywhere, masses are weighed on the processor."""
        return place_of(self.network)

    def _begin_masses(
        self, scenes: SceneBatch, poses: Tensor, classes: Sequence[Sequence[MassClass]]
    ) -> MassMemory | None:
        """None where the network says nothing of masses, or there is nothing to say."""
        if self.network.mass_noise is None:
            return None
        chains = MassChains.begin(scenes, classes)
        return begin_masses(scenes, poses, chains) if chains.priors.free[:, :-1].any() else None

    def _learn(self, watch: Watch, view: View, frame: Frame, wrench: Tensor | None) -> Watch:
        foresight = self.dynamics.foresee(frame.before, frame.control)
        evidence = evidence_of(self.network, frame, foresight)
        rows = Rows.of(evidence.active, frame.first.shape[1])
        memory = Memory(watch.relations[rows.scene, rows.pair], watch.objects)
        encoded = self.network.encode(evidence.features[rows.scene, rows.pair])
        moved = evidence.moved[rows.scene, rows.pair]
        memory = self.network.step(memory, rows, encoded, torch.ones_like(moved), moved)
        relations = watch.relations.index_put((rows.scene, rows.pair), memory.relations)
        watch = Watch(
            view, relations, memory.objects, watch.begun | evidence.active, watch.masses, as_numpy=watch.as_numpy
        )
        return watch if watch.masses is None else self._weigh(watch, frame, foresight.motion, wrench)

    def _weigh(self, watch: Watch, frame: Frame, motion: Tensor, wrench: Tensor | None) -> Watch:
        """Learn about masses from a frame, bodies being joined as is likeliest."""
        view, answers = watch.view, self.answers(watch)
        relations = view.state.relations
        if (answers.kind != relations.kind).any():
            relations = believe(view.state, answers.kind, view.fits).relations
        wrench = torch.full_like(view.tool, torch.nan) if wrench is None else wrench
        memory, network = watch.masses, self.network.mass_noise
        assert memory is not None
        assert network is not None
        masses = observe_masses(memory, network, self.dynamics, frame, view, motion, relations, wrench)
        return watch._replace(masses=masses, answers=answers)

    @torch.inference_mode()
    def masses(self, watch: Watch) -> MassPosterior:
        """What is believed of masses; raises BeliefError if this belief says nothing of them."""
        if watch.masses is None:
            raise BeliefError("no mass is unknown, or this belief says nothing of masses")
        posterior = watch.masses.chains.answer(watch.masses.evidence, watch.view.state.scenes)
        return MassPosterior(*(values.cpu().numpy() for values in posterior)) if watch.as_numpy else posterior

    @torch.inference_mode()
    def probabilities(self, watch: Watch) -> Float[Any, "batch pairs joints"]:
        """Of every joint, in the order of JOINT_CODES; bodies in one rigid piece count as fixed."""
        return _as_given(self.answers(watch).probabilities, watch)

    @torch.inference_mode()
    def joints(self, watch: Watch) -> Int[Any, "batch pairs"]:
        """JOINT_CODES of all pairs: the likeliest that can all hold at once."""
        return _as_given(self.answers(watch).kind, watch)

    @torch.inference_mode()
    def answers(self, watch: Watch) -> JointAnswers:
        """About the joints of all pairs, as tensors."""
        if watch.answers is not None:
            return watch.answers
        bodies = watch.view.first.shape[1]
        rows = Rows.of(watch.begun, bodies)
        memory = Memory(watch.relations[rows.scene, rows.pair], watch.objects)
        answers = self.network.answer(memory, rows)
        shares = [self.prior.get(kind, 0.0) / TRAINING_PRIOR[kind] for kind in JOINT_CODES]
        weights = answers.new_tensor(shares)
        return answer_together(watch.view.state.scenes, (answers + weights.log()).softmax(-1), rows, weights > 0)


def _as_given(answers: Tensor, watch: Watch) -> Any:
    """In NumPy, if poses came so."""
    return answers.cpu().numpy() if watch.as_numpy else answers


def _checked(
    scenes: SceneBatch, poses: Values, tool: Values, down: Values, seen: Values
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    batch, bodies = scenes.mass.shape
    return (
        checked("poses", poses, (batch, bodies, 3), "real", scenes.mass, BeliefError),
        checked("tool", tool, (batch, 3), "real", scenes.mass, BeliefError),
        checked("down", down, (batch,), "bool", scenes.mass, BeliefError),
        checked("seen", seen, (batch, bodies), "bool", scenes.mass, BeliefError),
    )


def load_physics(kind: str, physics: str | os.PathLike | None = None) -> Checkpoint:
    """The physics of this kind that a belief stands on: of a file, or the shipped one.

    Raises CheckpointError if the file holds another kind.
    """
    checkpoint = load_checkpoint(physics or shipped(kind))
    if checkpoint.kind != kind:
        raise CheckpointError(f"{physics}: holds {checkpoint.kind!r}; this belief stands on {kind!r}")
    return checkpoint


def evidence_of(network: BeliefRecipe, frame: Frame, foresight: Foresight) -> Evidence:
    """What a frame tells a belief network about every pair, given what was foreseen."""
    motion = torch.where(frame.continuous[..., None], foresight.motion, 0.0)
    evidence = network.evidence(frame, foresight._replace(motion=motion))
    return evidence._replace(active=evidence.active & frame.in_sight)


def watch_windows(
    network: BeliefRecipe,
    dynamics: Foreseeing,
    scenes: SceneBatch,
    poses: Float[Tensor, "batch frames bodies 3"],
    tool: Float[Tensor, "batch frames 3"],
    down: Bool[Tensor, "batch frames"],
    seen: Bool[Tensor, "batch frames bodies"],
) -> tuple[Rows, Bool[Tensor, "frames rows"], list[Memory]]:
    """Watch whole windows: the pairs that ever had memory, when it went on, and the memory after every frame.

    The numbers are those of `BeliefModel.observe`, frame by frame; the evidence of many frames is computed together.
    Differentiable in the belief network's weights.
    """
    frames = poses.shape[1]
    view, frame = first_look(scenes, poses[:, 0], tool[:, 0], down[:, 0], seen[:, 0])
    looks = [frame]
    for k in range(1, frames):
        view, frame = look(view, poses[:, k], tool[:, k], down[:, k], seen[:, k], bodies_in_reach)
        looks.append(frame)
    batch, bodies = poses.shape[0], poses.shape[2]

    together = max(1, CHUNK // batch)
    evidences: list[Evidence] = []
    for k in range(0, frames, together):
        frame = concatenate(looks[k : k + together])
        evidence = evidence_of(network, frame, dynamics.foresee(frame.before, frame.control))
        evidences.append(map_tensors(lambda values: values.unflatten(0, (-1, batch)), evidence))
    rows = Rows.of(torch.cat([evidence.active for evidence in evidences]).any(0), bodies)
    features, active, moved = (
        torch.cat([values[:, rows.scene, rows.pair] for values in column]) for column in zip(*evidences, strict=True)
    )
    encoded = network.encode(features)
    memory = Memory(
        encoded.new_zeros(len(rows.scene), 2, network.width), encoded.new_zeros(batch * bodies, network.hidden)
    )
    memories = []
    for k in range(frames):
        memory = network.step(memory, rows, encoded[k], active[k], moved[k])
        memories.append(memory)
    return rows, active, memories
