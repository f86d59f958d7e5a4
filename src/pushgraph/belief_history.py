"""Beliefs over time, as `pushgraph observe` writes them and `pushgraph predict --beliefs` reads them."""

import copy
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.belief import BeliefModel
from pushgraph.belief_file import BeliefFile
from pushgraph.believed_joint import BelievedJoint
from pushgraph.believed_mass import BelievedMass, Interval
from pushgraph.body import Joint
from pushgraph.errors import BeliefError
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.json_file import check_seal, parse_object, read_text, save_sealed, validated
from pushgraph.mass_history import DIGITS, MassHistory, with_masses
from pushgraph.regulator import BeliefRegulator, room_left
from pushgraph.scene import Scene
from pushgraph.track import Track

FORMAT = "pushgraph.beliefs"
VERSION = 3
FRAMES_PER_WEIGHING = 10
"""What is believed of masses is asked for so seldom: the answer takes longer than a frame's evidence."""


@dataclass(frozen=True, eq=False)
class BeliefHistory:
    """What was believed of every pair after every observed frame, and of masses at some of them.

    times: seconds. probabilities: columns in the order of JOINT_CODES. lost: for every node that was lost, when (first
    and last time, s). joints: those believed in the end, and where they sit. scene: as it was believed to be in the
    end, ready for prediction; see `BeliefRegulator.scene`. mass_history: None if no mass was learnt.
    """

    pairs: Sequence[tuple[str, str]]
    times: Float[np.ndarray, " frames"]
    probabilities: Float[np.ndarray, "frames pairs joints"]
    lost: Mapping[str, Sequence[tuple[float, float]]]
    joints: Sequence[BelievedJoint]
    scene: Scene
    mass_history: MassHistory | None = None

    @classmethod
    def watch(
        cls,
        scene: Scene,
        track: Track,
        model: BeliefModel | str = "belief",
        given: bool = False,
        weigh: bool = False,
        progress: Callable[[int, BeliefRegulator], None] = lambda frame, regulator: None,
    ) -> "BeliefHistory":
        """Watch a whole track, brought to frames of 0.05 s; `progress` is called after every frame.

        given, weigh: see `BeliefRegulator`. What the track's force sensor read is taken into account.
        """
        watching = Watching(scene, track, model, given, weigh)
        watching.until(watching.end, progress)
        return watching.history()

    @property
    def likeliest(self) -> dict[tuple[str, str], str]:
        """The likeliest joint of every pair in the end."""
        kinds = list(JOINT_CODES)
        return {pair: kinds[row.argmax()] for pair, row in zip(self.pairs, self.probabilities[-1], strict=True)}

    @property
    def masses(self) -> Sequence[BelievedMass]:
        """What was believed in the end of the masses that were learnt."""
        return () if self.mass_history is None else self.mass_history.believed

    def apply_to(self, scene: Scene) -> Scene:
        """Another moment of the scene with the joints that are believed in the end; see `joined_as`."""
        return joined_as(self.scene, scene)

    def apply_masses(self, scene: Scene) -> Scene:
        """Another moment of the scene with the medians of the masses that are believed in the end.

        Raises BeliefError if the two have other bodies, or no mass was learnt.
        """
        _check_same_bodies(self.scene, scene)
        if not self.masses:
            raise BeliefError(
                "these beliefs hold no masses: all were given; pushgraph observe --masses unknown learns them"
            )
        return with_masses(scene, self.masses)

    def save(self, path: str | os.PathLike) -> None:
        """Write JSON."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "joints": list(JOINT_CODES),
            "pairs": [list(pair) for pair in self.pairs],
            "times": np.round(self.times, DIGITS).tolist(),
            "probabilities": np.round(self.probabilities, DIGITS).tolist(),
            "lost": {name: [list(stretch) for stretch in stretches] for name, stretches in self.lost.items()},
            "believed_joints": [joint.to_json() for joint in self.joints],
            "masses": None if self.mass_history is None else self.mass_history.to_json(),
            "scene": json.loads(self.scene.to_json()),
        }
        save_sealed(path, content)

    @classmethod
    def load(cls, path: str | os.PathLike) -> "BeliefHistory":
        """Read JSON; raises BeliefError if it is not what `save` writes."""
        text = read_text(path, "file of beliefs", BeliefError)
        content = parse_object(text, str(path), "file of beliefs", BeliefError)
        if content.get("format") != FORMAT:
            raise BeliefError(f'{path}: not beliefs: "format" must be "{FORMAT}"; pushgraph observe writes them')
        if content.get("version") != VERSION:
            raise BeliefError(f"{path}: version {content.get('version')} of beliefs; this pushgraph reads {VERSION}")
        check_seal(content, str(path), BeliefError)
        file = validated(BeliefFile, text, f"{path}: these beliefs are damaged", BeliefError)
        shape = len(file.times), len(file.pairs), len(JOINT_CODES)
        return cls(
            file.pairs,
            np.array(file.times),
            np.array(file.probabilities, dtype=float).reshape(shape),
            file.lost,
            file.joints_believed(),
            file.scene,
            file.mass_history(f"{path}: masses"),
        )


class Watching:
    """A track that is watched bit by bit, brought to frames of 0.05 s; see `BeliefHistory.watch`.

    frames: the track. end: how many frames it has. done: how many were watched.
    """

    def __init__(
        self,
        scene: Scene,
        track: Track,
        model: BeliefModel | str = "belief",
        given: bool = False,
        weigh: bool = False,
    ) -> None:
        self.frames = track.at_frames()
        self.end = len(self.frames.times)
        self.done = 0
        self.regulator = BeliefRegulator(scene, model, given, weigh)
        self._probabilities: tuple[Float[np.ndarray, "pairs joints"], ...] = ()
        self._weighings: Mapping[float, list[BelievedMass]] = {}
        self._frictions: tuple[Interval | None, ...] = ()

    def copied(self) -> "Watching":
        """The same as it is now; what is watched further leaves the original as it is."""
        other = copy.copy(self)
        other.regulator = copy.copy(self.regulator)
        return other

    def until(
        self, end: int, progress: Callable[[int, BeliefRegulator], None] = lambda frame, regulator: None
    ) -> None:
        """Watch the frames from where it stopped up to this one, which it leaves out."""
        track, end = self.frames, min(end, self.end)
        probabilities, weighings, frictions = [*self._probabilities], dict(self._weighings), [*self._frictions]
        for frame in range(self.done, end):
            poses = np.where(track.seen[frame, :, None], track.poses[frame], np.nan)
            wrench = None if track.wrench is None else track.wrench[frame]
            probabilities.append(self.regulator.observe(poses, bool(track.down[frame]), wrench))
            if frame % FRAMES_PER_WEIGHING == 0 or frame == end - 1:
                weighings[float(track.times[frame])] = self.regulator.masses()
                frictions.append(self.regulator.table_friction())
            progress(frame, self.regulator)
        self.done = max(self.done, end)
        self._probabilities, self._weighings, self._frictions = tuple(probabilities), weighings, tuple(frictions)

    def correct(self, pair: tuple[str, str], kind: str | None) -> None:
        """See `BeliefRegulator.correct`; the last frame that was watched says so, too."""
        self.regulator.correct(pair, kind)
        self._probabilities = (*self._probabilities[:-1], self.regulator.probabilities)

    def history(self) -> BeliefHistory:
        """What was believed so far."""
        times = self.frames.times[: self.done]
        lost = {
            name: [(first, min(last, float(times[-1]))) for first, last in stretches if first <= times[-1]]
            for name, stretches in self.frames.gaps.items()
        }
        return BeliefHistory(
            self.regulator.pairs,
            times,
            np.stack(self._probabilities),
            {name: stretches for name, stretches in lost.items() if stretches},
            self.regulator.joints(),
            self.regulator.scene(),
            MassHistory.of(self._weighings, self._frictions),
        )


def joined_as(believed: Scene, scene: Scene) -> Scene:
    """The scene with the joints of another moment of it, and no others; joints keep their place in their parent.

    Raises BeliefError if the two have other bodies.
    """
    _check_same_bodies(believed, scene)
    old, new = believed.poses_world_from_body, scene.poses_world_from_body
    joints = tuple(_carried(joint, scene.names, old, new) for joint in believed.joints)
    return scene.replace(joints=joints, unknown_pairs=())


def _check_same_bodies(believed: Scene, scene: Scene) -> None:
    if scene.names != believed.names:
        raise BeliefError(
            f"these beliefs are about {', '.join(believed.names)}; the scene has {', '.join(scene.names)}"
        )


def _carried(joint: Joint, names: Sequence[str], old: np.ndarray, new: np.ndarray) -> Joint:
    """The joint where its parent is now; its limits count from how the two stand now."""
    parent, child = names.index(joint.parent), names.index(joint.child)
    anchor = pose.transform(new[parent], pose.transform(pose.inverse(old[parent]), np.array(joint.anchor)))
    turned = new[parent, 2] - old[parent, 2]
    axis = None if joint.axis is None else pose.rotate(np.array(joint.axis), turned)
    limits = joint.limits
    if joint.kind == "revolute":
        used = math.remainder((new[child, 2] - new[parent, 2]) - (old[child, 2] - old[parent, 2]), math.tau)
    elif joint.kind == "prismatic":
        apart = [pose.relative(poses[parent], poses[child])[:2] for poses in (old, new)]
        used = float(pose.rotate(apart[1] - apart[0], new[parent, 2]) @ axis)
    if limits is not None:
        limits = room_left(limits, float(used))
    return joint.replace(
        anchor=tuple(anchor.tolist()), axis=None if axis is None else tuple(axis.tolist()), limits=limits
    )
