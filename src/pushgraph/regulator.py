"""Watch one scene frame by frame, and say what is joined to what, and what weighs how much."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import get_args

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.adaptation.online import PoseLike, PushLearner
from pushgraph.adaptation.unknowns import Estimate
from pushgraph.belief import BeliefModel, Watch
from pushgraph.believed_joint import BelievedJoint
from pushgraph.believed_mass import BelievedMass, Interval
from pushgraph.body import ROBOT, Joint, JointKind
from pushgraph.dataset.engines import single_threaded
from pushgraph.errors import BeliefError, TrackError
from pushgraph.graph.believed import believe, joint_places
from pushgraph.graph.scene_batch import JOINT_CODES, Relations, batch_scenes, pairs_of
from pushgraph.mass_chains import LEVELS, MassPosterior
from pushgraph.parting import parted
from pushgraph.physics import PhysicsPredictor
from pushgraph.pose import wrap_angle
from pushgraph.scene import Scene
from pushgraph.shape import Polygon
from pushgraph.tool import Push
from pushgraph.track import FRAME
from pushgraph.wrench import check_measured

LONGEST_JUMP = 0.2
"""A body that moves farther than this in a frame (m) was mistaken for another; a tool that does was lifted."""
LEAST_ROOM = 1e-3
"""A joint at its limit still has this room (m or rad): what was seen beyond the limit is noise."""


class BeliefRegulator:
    """Learns the joint of every pair of bodies, and masses, from poses, one frame at a time, in constant memory.

    regulator = BeliefRegulator(scene)
    for poses, down in track.frames():
        probabilities = regulator.observe(poses, down)

    Every pair is taken as unknown unless a rigid group holds both, or `given` says that the scene's joints (and what
    it knows to be apart) hold. Masses are learnt where the scene does not tell them, or of all bodies if `weigh` says
    so; what they may be, `scene.mass_classes` tells. Frictions are taken as the scene tells them. prior: how likely
    each joint is of a pair of neighbours beforehand, those not named cannot be: {"none": 1.0, "fixed": 1.0} where parts
    are glued or not; by default as in the training data. camera_error: how far poses are off beside noise, which is
    found by itself (m): 0.0005 where a lens bends much; by default 1.5 times the noise, up to 0.0003.
    """

    def __init__(
        self,
        scene: Scene,
        model: BeliefModel | str = "belief",
        given: bool = False,
        weigh: bool = False,
        prior: Mapping[str, float] | None = None,
        camera_error: float | None = None,
    ) -> None:
        polygons = [body.name for body in scene.bodies if isinstance(body.shape, Polygon)]
        if polygons:
            raise BeliefError(
                f"body {polygons[0]!r}: a polygon; joints are learnt of cylinders and cuboids only, so give a rigid "
                f"group of these instead"
            )
        self.original = scene
        self.model = model if isinstance(model, BeliefModel) else BeliefModel.load(model)
        if prior is not None:
            self.model = self.model.expecting(prior)
        if camera_error is not None:
            self.model = self.model.seen_by(camera_error)
        self.pairs: list[tuple[str, str]] = list(combinations(scene.names, 2))
        """Names of the pairs, in the order of the probabilities."""
        self.frames = 0
        """Frames observed so far."""
        watched = scene if given else scene.replace(joints=(), unknown_pairs="unlisted")
        if weigh:
            bodies = tuple(body if body.fixed else body.replace(mass=None) for body in scene.bodies)
            watched = watched.replace(bodies=bodies)
        self._classes = [scene.classes_of_mass]
        self._scenes = batch_scenes([watched])
        self._poses = np.concatenate((np.full((1, 3), np.nan), scene.poses_world_from_body))
        self._unseen = np.zeros(len(self._poses), dtype=np.int64)
        self._ever_seen = np.zeros(len(self._poses), dtype=bool)
        self._yaw_known = np.array([True, *(body.yaw_known for body in scene.bodies)])
        self._watch: Watch | None = None
        self._corrected: Mapping[int, int] = {}
        self._pushes: PushLearner | None = None
        self._weighed: tuple[Watch, MassPosterior] | None = None

    def observe(
        self,
        poses: Float[np.ndarray, "nodes 3"],
        down: bool = True,
        wrench: Float[np.ndarray, "3"] | None = None,
    ) -> Float[np.ndarray, "pairs joints"]:
        """Learn from one frame, 0.05 s after the last: pose_world_from_tool, then pose_world_from_body in order.

        A body that was not seen has NaN for x and y; a yaw that cannot be known may be NaN. `down`: whether the tool
        is down on the table; a tool that jumps was lifted meanwhile. `pushgraph.Track.frames` yields both. `wrench`:
        what the bodies exert on the tool, if a sensor measures it: force (N, world frame) and moment about the tool's
        origin (N m), on average since the last frame; NaN where it said nothing. Returns probabilities; columns in the
        order of JOINT_CODES: none, fixed, prismatic, revolute. Raises BeliefError, and learns nothing, if a pose is not
        finite, a body jumped, or no sensor gives such a wrench.
        """
        if wrench is not None:
            wrench = np.asarray(wrench, dtype=float)
            try:
                check_measured(wrench[None], np.array([self.frames * FRAME]))
            except TrackError as error:
                raise BeliefError(str(error)) from None
        poses, seen = self._checked(np.array(poses, dtype=float))
        lifted = np.hypot(*(poses[0] - self._poses[0])[:2]) > LONGEST_JUMP
        room = self._scenes.mass.shape[1]
        bodies, in_sight = np.zeros((1, room, 3)), np.zeros((1, room), dtype=bool)
        bodies[0, : len(poses) - 1], in_sight[0, : len(poses) - 1] = poses[1:], seen[1:]
        places, tool, is_down, visible = (
            torch.from_numpy(array) for array in (bodies, poses[None, 0], np.array([down]), in_sight)
        )
        with single_threaded():
            if self._watch is None:
                self._watch = self.model.begin(self._scenes, places, tool, is_down, visible, self._classes)
            else:
                view = self._watch.view
                before = self._watch._replace(view=view._replace(down=view.down & (not lifted)))
                felt = None if wrench is None else torch.from_numpy(wrench)[None]
                self._watch = self.model.observe(before, places, tool, is_down, visible, felt)
        self._poses = poses
        self._unseen = np.where(seen, 0, self._unseen + 1)
        self._ever_seen = self._ever_seen | seen
        self.frames += 1
        return self.probabilities

    def observe_push(self, start: PoseLike, end: PoseLike, probe: Push, body: str | None = None) -> Estimate:
        """Learn side friction and pressure from a push that moved one body alone; `scene` then has them.

        start, end: pose_world_from_body before and after. probe: what the tool did. body: its name, where the scene has
        several. Returns what is believed of its unknowns now.
        """
        names = self.original.names
        name = names[0] if body is None and len(names) == 1 else body
        if name not in names:
            raise BeliefError(f"body: no body {name!r} was pushed; valid: {', '.join(names)}")
        if self._pushes is None:
            self._pushes = PushLearner(PhysicsPredictor.load().dynamics)
        return self._pushes.observe(self.original, name, start, end, probe)

    def correct(self, pair: tuple[str, str], kind: str | None) -> None:
        """From now on a pair is known to be joined so: none, fixed, prismatic or revolute; None: as it is seen to be.

        Where the joint sits is still learnt by watching. Raises BeliefError if there is no such pair or joint, or the
        two were never near each other, so that nothing says where a joint would sit.
        """
        row = next((k for k, both in enumerate(self.pairs) if set(both) == set(pair)), None)
        if row is None:
            names = ", ".join(self.original.names)
            raise BeliefError(f"{pair[0]!r} and {pair[1]!r}: no pair of bodies; valid: {names}")
        if kind is not None and kind not in JOINT_CODES:
            raise BeliefError(f"{pair[0]!r} and {pair[1]!r}: no joint {kind!r}; valid: {', '.join(JOINT_CODES)}")
        relations = self._watched.view.state.relations
        if bool(relations.known[0, row]):
            raise BeliefError(f"{pair[0]!r} and {pair[1]!r}: the scene says what joins them")
        if kind not in (None, "none") and not relations.remembered[0, row]:
            raise BeliefError(
                f"{pair[0]!r} and {pair[1]!r} were never near each other: nothing says where a joint would sit"
            )
        others = {other: code for other, code in self._corrected.items() if other != row}
        self._corrected = others if kind is None else others | {row: JOINT_CODES[kind]}

    @property
    def probabilities(self) -> Float[np.ndarray, "pairs joints"]:
        """Of every joint of every pair, as it is believed now."""
        with single_threaded():
            everything = self.model.probabilities(self._watched)[0].double().cpu().numpy().copy()
        for row, code in self._corrected.items():
            everything[row] = np.arange(len(JOINT_CODES)) == code
        return everything[: len(self.pairs)]

    def scene(self) -> Scene:
        """The scene as it is now, with the likeliest joint of every pair, ready for prediction; it has no pushes.

        Bodies that noise has pressed into each other are moved apart, by as much as that takes. Masses that are learnt
        stand at their medians.
        """
        view = self._watched.view
        state = view.state
        relations = believe(state, self._kinds(), view.fits).relations
        masses = {mass.body: mass.mass[0] for mass in self.masses()}
        poses = parted(self.original, state.poses[0, : len(self.original.bodies)].cpu().numpy())
        bodies = tuple(
            body.replace(pose_world_from_body=tuple(place), mass=masses.get(body.name, body.mass))
            for body, place in zip(self.original.bodies, poses.tolist(), strict=True)
        )
        scene = self.original.replace(
            bodies=bodies, joints=tuple(self._joints(relations, poses)), unknown_pairs=(), pushes=()
        )
        return scene if self._pushes is None else self._pushes.apply_to(scene)

    def joints(self) -> list[BelievedJoint]:
        """Where the joints sit that are believed now, the likeliest that can all hold at once; of pairs not given."""
        view, probabilities = self._watched.view, self.probabilities
        places = joint_places(view.state, view.fits)
        relations, poses = view.state.relations, view.state.poses[0].cpu().numpy()
        unknown = (relations.remembered & ~relations.known)[0, : len(self.pairs)].cpu().numpy()
        kinds = list(JOINT_CODES)
        parents = pairs_of(self._scenes.mass.shape[1])[0].tolist()
        return [
            BelievedJoint.of(
                self.pairs[row], kinds[code], float(probabilities[row, code]), places, row, poses[parents[row]]
            )
            for row, code in enumerate(self._kinds()[0, : len(self.pairs)].tolist())
            if code and unknown[row]
        ]

    def _kinds(self) -> Int[Tensor, "1 pairs"]:
        """JOINT_CODES of all pairs, as they are believed now and corrected."""
        with single_threaded():
            kind = self.model.joints(self._watched).clone()
        for row, code in self._corrected.items():
            kind[0, row] = code
        return kind

    def masses(self) -> list[BelievedMass]:
        """What is believed of the masses of bodies that the scene does not tell (or of all, if they are weighed)."""
        watch = self._watched
        if watch.masses is None:
            return []
        answer = self._answer(watch)
        with single_threaded():
            group = watch.masses.chains.groups(watch.masses.evidence)[0]
        names, classes = self.original.names, [one.name for one in self._classes[0]]
        free = watch.masses.chains.priors.free[0]
        weights = answer.samples[0].exp().numpy()

        def with_ends(median: Tensor, low: Tensor, high: Tensor, body: int) -> Interval:
            return float(median[0, body]), float(low[0, body]), float(high[0, body])

        believed = []
        for body in np.flatnonzero(free[: len(names)]).tolist():
            others = np.flatnonzero((group[: len(names)] == group[body]) & (np.arange(len(names)) != body)).tolist()
            ratios = {names[k]: np.quantile(weights[:, body] / weights[:, k], LEVELS) for k in others}
            believed.append(
                BelievedMass(
                    names[body],
                    dict(zip(classes, answer.probabilities[0, body].tolist(), strict=False)),
                    with_ends(answer.median, answer.low, answer.high, body),
                    with_ends(answer.slide_median, answer.slide_low, answer.slide_high, body),
                    {name: (float(mid), float(low), float(high)) for name, (mid, low, high) in ratios.items()},
                )
            )
        return believed

    def table_friction(self) -> Interval | None:
        """What is believed of the table's friction; None if the scene tells it, or no mass is learnt."""
        watch = self._watched
        if watch.masses is None or not watch.masses.chains.priors.free[0, -1]:
            return None
        median, low, high = self._answer(watch).friction[0].tolist()
        return median, low, high

    def _answer(self, watch: Watch) -> MassPosterior:
        """What is believed of masses now, computed once for the same evidence."""
        if self._weighed is None or self._weighed[0] is not watch:
            with single_threaded():
                self._weighed = watch, self.model.masses(watch)
        return self._weighed[1]

    @property
    def _watched(self) -> Watch:
        if self._watch is None:
            raise BeliefError("nothing was observed yet; call observe first")
        return self._watch

    def _checked(self, poses: np.ndarray) -> tuple[np.ndarray, Bool[np.ndarray, " nodes"]]:
        """Poses of all nodes, where they were last if they were not seen, yaws without leaps; and which were seen."""
        names = (ROBOT, *self.original.names)
        if poses.shape != (len(names), 3):
            raise BeliefError(f"poses: shape must be ({len(names)}, 3): {', '.join(names)}; got {poses.shape}")
        seen = ~np.isnan(poses[:, :2]).any(-1)
        last = self._poses
        blind = ~self._yaw_known
        poses[blind, 2] = last[blind, 2]
        broken = seen & ~np.isfinite(poses).all(-1)
        if broken.any():
            node = int(np.argmax(broken))
            raise BeliefError(
                f"pose of {names[node]!r} in frame {self.frames} is {poses[node].tolist()}: it must be finite"
            )
        if not seen[0]:
            raise BeliefError(f"{ROBOT!r} is missing in frame {self.frames}: its pose is always needed")
        leap = np.hypot(*(poses - last)[:, :2].T)
        too_far = seen & self._ever_seen & (leap > LONGEST_JUMP * (self._unseen + 1))
        too_far[0] = False
        if too_far.any():
            node = int(np.argmax(too_far))
            raise BeliefError(
                f"{names[node]!r} jumps by {leap[node]:.2f} m in frame {self.frames}; at most {LONGEST_JUMP:g} m a "
                "frame are valid: was it mistaken for another, or are frames missing?"
            )
        poses = np.where(seen[:, None], poses, last)
        known = self._ever_seen & seen
        poses[known, 2] = last[known, 2] + wrap_angle(poses[known, 2] - last[known, 2])
        return poses, seen

    def _joints(self, relations: Relations, poses: Float[np.ndarray, "bodies 3"]) -> list[Joint]:
        """Joints of the relations, told in the world frame with the bodies at `poses`."""
        names = self.original.names
        kinds: dict[int, JointKind] = {JOINT_CODES[kind]: kind for kind in get_args(JointKind)}
        room = self._scenes.mass.shape[1]
        still = self.original.immovable
        joints = []
        for pair in relations.kind[0].nonzero().squeeze(-1).tolist():
            a, b = pairs_of(room)[:, pair].tolist()
            if still[a] and still[b]:  # nothing shows whether they are joined, and a scene refuses that they are
                continue
            kind = kinds[int(relations.kind[0, pair])]
            anchor_a, anchor_b, axis_a, limits = (
                values[0, pair].double().cpu().numpy()
                for values in (relations.anchor_a, relations.anchor_b, relations.axis, relations.limits)
            )
            anchor, axis = pose.transform(poses[a], anchor_a), pose.rotate(axis_a, poses[a, 2])
            if kind == "revolute":
                turned = poses[b, 2] - poses[a, 2] - float(relations.yaw_offset[0, pair])
                used = math.remainder(turned, math.tau)
            else:
                used = float((pose.transform(poses[b], anchor_b) - anchor) @ axis)
            joints.append(
                Joint(
                    kind=kind,
                    parent=names[a],
                    child=names[b],
                    anchor=tuple(anchor.tolist()),
                    axis=tuple(axis.tolist()) if kind == "prismatic" else None,
                    limits=room_left(limits.tolist(), used) if kind != "fixed" else None,
                )
            )
        return joints


def room_left(limits: Sequence[float], used: float) -> tuple[float, float]:
    """Limits of a joint, counted from where it has moved by `used` (m or rad)."""
    return min(limits[0] - used, -LEAST_ROOM), max(limits[1] - used, LEAST_ROOM)
