"""Physics prediction: roll out what planned pushes do."""

import contextlib
import functools
import os
import warnings
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float, Int
from safetensors.torch import save

from pushgraph.array_input import Values, checked
from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.dataset.engines import single_threaded
from pushgraph.device import device_of, place_of
from pushgraph.errors import AssumptionWarning, CheckpointError, PredictionError, SceneError
from pushgraph.graph.scene_batch import batch_scenes, map_tensors
from pushgraph.graph.state import State, start
from pushgraph.joint_doubt import Beliefs, joint_doubt
from pushgraph.network.alike import OnceWhileAlike
from pushgraph.network.contract import Dynamics
from pushgraph.network.dynamics import DYNAMICS, ContactDynamics
from pushgraph.plausibility import PREDICTED_OVERLAP, assumed_values, refusal, start_fault
from pushgraph.precision import PRECISIONS, fastest_precision
from pushgraph.push_batch import PushPredictions, pushes_of
from pushgraph.rollout import Rollout, rollout
from pushgraph.scene import OVERLAP, Scene
from pushgraph.scene_parts import SceneInParts, in_parts
from pushgraph.scene_range import warn_of_range
from pushgraph.simulation.motion import plan_tool
from pushgraph.spread_model import SpreadModel
from pushgraph.storage import cache_folder, replacing
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track

MODELS = ("contact", "propnet", "image")
"""The shipped predictors: ours, and the paper's."""
FEW = 64
"""So few scenes are predicted on one thread: several would wait for each other more than they work."""


class PhysicsPredictor:
    """A trained network that predicts what pushes do, for any number of bodies and scenes.

    record: how it was trained. hash: of its checkpoint. spread: shipped name or file of the checkpoint that states how
    far off it may be; read when it is first asked for.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        record: Mapping[str, Any] | None = None,
        hash: str | None = None,
        spread: str | os.PathLike = "spread",
    ) -> None:
        self.dynamics, self.record, self.hash = dynamics, dict(record or {}), hash
        self._spread = spread
        self._warned = False

    @property
    def solves(self) -> bool:
        """Whether motions are solved from the laws of contact."""
        return isinstance(self.dynamics, ContactDynamics)

    @classmethod
    def load(
        cls,
        model: str | os.PathLike = "contact",
        device: str = "cpu",
        precision: str = "float32",
        spread: str | os.PathLike = "spread",
    ) -> "PhysicsPredictor":
        """Load a shipped predictor by name, or the checkpoint in a file.

        device: cpu, cuda or cuda:N; inputs are moved there. precision: what the network computes in: "float32",
        "bfloat16", or "auto" for what is faster on this machine.
        What is solved, as by `contact`, is solved in float64 whatever this says.
        spread: the checkpoint that states how far off predictions may be, by name or file.
        Raises CheckpointError if there is no such file, or any part of it is not what it should be, DeviceError if
        there is no such device, and PredictionError if there is no such precision.
        """
        if precision not in (*PRECISIONS, "auto"):
            raise PredictionError(f"no precision {precision!r}; valid: {', '.join(PRECISIONS)}, auto")
        place = device_of(device)
        precision = fastest_precision(device) if precision == "auto" else precision
        path = shipped(str(model)) if str(model) in MODELS and not Path(model).is_file() else Path(model)
        checkpoint = load_checkpoint(path)
        if checkpoint.kind not in DYNAMICS:
            raise CheckpointError(f"{path}: holds {checkpoint.kind!r}, no predictor; valid: {', '.join(DYNAMICS)}")
        network = checkpoint.network.to(place, PRECISIONS[precision]).requires_grad_(False)
        return cls(cast(Dynamics, network), checkpoint.record, checkpoint.hash, spread)

    @property
    def device(self) -> torch.device:
        """What is computed on; inputs may be anywhere."""
        return place_of(self.dynamics)

    @functools.cached_property
    def spread_model(self) -> SpreadModel:
        """What states the spread of these weights; raises CheckpointError if its checkpoint is of others."""
        return SpreadModel.load(self._spread, self.hash, self.device)

    @property
    def states_spread(self) -> bool:
        """Whether the checkpoint of spreads is of these weights."""
        try:
            return self.spread_model is not None
        except CheckpointError:
            return False

    def start(self, scenes: Sequence[Scene]) -> State:
        """The state of scenes at rest, at the poses they give; bodies whose yaw is not known count as not turned.

        Polygons stand in it as the rigid groups of their parts: see `pushgraph.scene_parts`.
        """
        return self._start([in_parts(scene) for scene in scenes])

    def _start(self, taken_apart: Sequence[SceneInParts]) -> State:
        scenes = [apart.scene for apart in taken_apart]
        batch = batch_scenes(scenes, [apart.patches for apart in taken_apart])
        poses = torch.zeros(*batch.mass.shape, 3, dtype=torch.float64)
        for k, scene in enumerate(scenes):
            poses[k, : len(scene.bodies)] = torch.from_numpy(scene.poses_world_from_body)
        return map_tensors(lambda values: values.to(self.device), start(batch, poses).double())

    def rollout(
        self,
        states: State,
        tool: Values,
        down: Values,
        frames_per_step: int = 1,
        longest_step: float | None = None,
        force_limit: Values | None = None,
        spread: bool = False,
        doubt: Values | None = None,
        alike: Sequence[Hashable] | None = None,
    ) -> Rollout:
        """Predict all frames; see `pushgraph.rollout.rollout`. Differentiable in the states' and the tool's poses.

        tool: pose_world_from_tool, [batch frames 3]. down: [batch frames]. force_limit: N, [batch frames]. doubt:
        [batch pairs]. All of NumPy or torch; for the answer in NumPy see `Rollout.numpy`.
        spread: whether to state how far off that may be. doubt: probability of every pair that what `states` take for
        its joint is wrong, see `pushgraph.graph.track_features.doubt_of`; none by default, but about unknown pairs.
        alike: scenes for which it is equal start alike: see `pushgraph.network.alike`.
        Raises PredictionError if a shape or a dtype is another, and CheckpointError if the checkpoint of spreads is of
        other weights.
        """
        if doubt is not None and not spread:
            raise PredictionError("doubt: widens the spread alone, so it needs spread=True")
        states = map_tensors(lambda values: values.to(self.device), states)
        like, batch = states.poses, len(states.poses)
        tool = checked("tool", tool, (batch, "frames", 3), "real", like)
        frames = tool.shape[1]
        down = checked("down", down, (batch, frames), "bool", like)
        if frames == 0:
            raise PredictionError("tool: needs one frame at least")
        if force_limit is not None:
            force_limit = checked("force_limit", force_limit, (batch, frames), "real", like)
        if doubt is not None:
            doubt = checked("doubt", doubt, (batch, states.relations.kind.shape[1]), "real", like)
        model = self.spread_model if spread else None
        dynamics = self.dynamics if alike is None else OnceWhileAlike(self.dynamics, alike)
        predicted = rollout(dynamics, states, tool, down, frames_per_step, longest_step, force_limit)
        if model is None:
            return predicted
        return predicted._replace(spread=model.spread(states, predicted.poses, predicted.tool, down, doubt))

    def predict(
        self,
        scene: Scene,
        pushes: Sequence[Push] | None = None,
        spread: bool = False,
        beliefs: Beliefs | None = None,
    ) -> Track:
        """Predict the scene's pushes, or these instead, frame by frame as `simulate` would record them.

        spread: whether the track shall say how far off it may be (`track.spread`). beliefs: what is believed of the
        joints of pairs, which widens the spread; see `Beliefs`.
        Raises PredictionError if a later push comes down on a body. For what else is doubtful about it see
        `pushgraph.plausibility`.
        """
        scene = scene if pushes is None else scene.replace(pushes=tuple(pushes))
        _warn_of_assumptions(scene)
        track = self.predict_many([scene], spread=spread, beliefs=None if beliefs is None else [beliefs])[0]
        if fault := refusal(track, PREDICTED_OVERLAP):
            raise PredictionError(fault)
        return track

    def predict_pushes(
        self, scene: Scene, pushes: Sequence[Push] | np.ndarray, speed: float | None = None, spread: bool = False
    ) -> PushPredictions:
        """Predict what each of many pushes does to the scene, all by themselves, side by side.

        pushes: Push objects, or an array [pushes points 2 or 3] of way-points x, y (m) and yaw (rad), the start first:
        `np.stack((starts, ends), 1)` of starts and ends [pushes 2]. speed: of an array's pushes (m/s). spread: see
        `predict`. Pushes whose tool comes down on a body are refused, the others predicted.
        Raises PredictionError if they are no pushes, or a shape or dtype is another.
        """
        made = pushes_of(pushes, speed)
        _warn_of_assumptions(scene)
        refused = _refused(scene, made)
        there = [index for index in range(len(made)) if index not in refused]
        _check_pushes(scene, {index: made[index] for index in there})
        scenes = [scene.model_copy(update={"pushes": (made[index],)}) for index in there]
        tracks: list[Track | None] = [None] * len(made)
        poses = np.full((len(made), len(scene.bodies), 3), np.nan)
        for index, track in zip(there, self.predict_many(scenes, spread=spread) if scenes else [], strict=True):
            tracks[index], poses[index] = track, track.poses[-1, 1:]
        return PushPredictions(scene, made, poses, tuple(tracks), refused)

    def predict_many(
        self,
        scenes: Sequence[Scene],
        frames: int | None = None,
        frames_per_step: int = 1,
        longest_step: float | None = None,
        spread: bool = False,
        beliefs: Sequence[Beliefs] | None = None,
        share: bool = False,
    ) -> list[Track]:
        """Predict many scenes side by side; with `frames`, only so many frames of each.

        frames_per_step, longest_step: how many frames and how much of the tool's way (m) a step may cover, see
        `pushgraph.graph.steps`. spread, beliefs: see `predict`; one for each scene. share: whether scenes that start
        alike are predicted once as long as their tools move alike, too: plans that begin with the same pushes.

        Warns, once, of what is unlike the scenes that the predictor was checked on.
        Later pushes may come down on bodies: see `pushgraph.plausibility.refusal`. Raises PredictionError if a pose is
        not finite; what caused it is saved.
        """
        self._warned = self._warned or warn_of_range(scenes, self.record.get("range", {}))
        plans = [plan_tool(scene.pushes, scene.tool, frames) for scene in scenes]
        longest = max(len(push) for _, push in plans)
        tool = np.stack([np.concatenate((poses, np.repeat(poses[-1:], longest - len(poses), 0))) for poses, _ in plans])
        down = np.stack([np.pad(push != LIFTED, (0, longest - len(push))) for _, push in plans])
        each = [_force_limits(scene.pushes, push) for scene, (_, push) in zip(scenes, plans, strict=True)]
        limits = np.stack([np.pad(limit, (0, longest - len(limit)), constant_values=np.inf) for limit in each])
        taken_apart = [in_parts(scene) for scene in scenes]
        few = single_threaded() if len(scenes) < FEW else contextlib.nullcontext()
        with torch.no_grad(), few:
            states = self._start(taken_apart)
            predicted = self.rollout(
                states,
                torch.from_numpy(tool),
                torch.from_numpy(down),
                frames_per_step,
                longest_step,
                torch.from_numpy(limits),
                spread,
                None if beliefs is None else joint_doubt(states, scenes, beliefs),
                [scene.model_copy(update={"pushes": ()}) for scene in scenes] if share else None,
            )
        predicted_poses, predicted_tool = predicted.numpy()
        self._check_finite(predicted_poses, tool)
        stated = None if predicted.spread is None else predicted.spread.numpy()
        tracks = []
        for k, (scene, (_, push)) in enumerate(zip(scenes, plans, strict=True)):
            tool_poses = predicted_tool[k, : len(push)]
            bodies = taken_apart[k].body_poses(predicted_poses[k, : len(push)])
            tracks.append(
                Track(
                    scene=scene,
                    times=np.arange(len(push)) * FRAME,
                    poses=np.concatenate((tool_poses[:, None], bodies), 1),
                    push=push,
                    seen=np.ones((len(push), 1 + len(scene.bodies)), dtype=bool),
                    # A polygon is as far off as its first part.
                    spread=stated and stated.take((k, slice(len(push)))).take((slice(None), taken_apart[k].first)),
                )
            )
        return tracks

    def _check_finite(self, poses: np.ndarray, tool: np.ndarray) -> None:
        bad = np.argwhere(~np.isfinite(poses).all(-1))
        if not len(bad):
            return
        scene, frame, body = bad[bad[:, 1].argmin()].tolist()
        path = cache_folder() / "failures" / "rollout.safetensors"
        with replacing(path) as temporary:
            state = {
                "poses": torch.from_numpy(poses[scene, : frame + 1]),
                "tool": torch.from_numpy(tool[scene, : frame + 1]),
            }
            temporary.write_bytes(save(state))
        raise PredictionError(
            f"scene {scene}: the predicted pose of body {body} is not finite at frame {frame}; poses up to there "
            f"are in {path}"
        )


load = PhysicsPredictor.load


def _refused(scene: Scene, pushes: Sequence[Push]) -> dict[int, str]:
    """Which pushes come down on a body of the scene, and where."""
    start = scene.poses_world_from_body
    if not pushes:
        return {}
    gaps = scene.tool_gaps(np.stack([push.waypoints[0] for push in pushes]), np.repeat(start[None], len(pushes), 0))
    deep = np.flatnonzero(gaps.min(1) < -OVERLAP).tolist()
    faults = {index: start_fault(scene, index, pushes[index].waypoints[0], start) for index in deep}
    return {index: fault for index, fault in faults.items() if fault}


def _check_pushes(scene: Scene, pushes: Mapping[int, Push]) -> None:
    """Raise PredictionError if the scene cannot have one of the pushes, by number: one that is too long or too fast."""
    try:
        scene.replace(pushes=tuple(pushes.values()))
    except SceneError:
        for index, push in pushes.items():
            try:
                scene.replace(pushes=(push,))
            except SceneError as error:
                raise PredictionError(str(error).replace("pushes[0]", f"pushes[{index}]")) from None
        raise


def _warn_of_assumptions(scene: Scene) -> None:
    if said := assumed_values(scene):
        warnings.warn("; ".join(said), AssumptionWarning, 3)


def _force_limits(pushes: Sequence[Push], under_way: Int[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """Of the push that is under way in each frame (N)."""
    limits = [np.inf if push.force_limit is None else push.force_limit for push in pushes]
    return np.array([*limits, np.inf])[under_way]  # LIFTED counts from the end
