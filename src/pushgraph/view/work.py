"""All there is at one moment of trying out, and what of it belongs together."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from pushgraph.belief_history import BeliefHistory, Watching
from pushgraph.errors import PushGraphError, SceneError
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import Plan
from pushgraph.scene import Scene
from pushgraph.simulation.motion import ToolMotion
from pushgraph.track import FRAME, Track
from pushgraph.view.opening import Opened, OpenedPlan

AnyTrack = Track | LeverTrack
MOST_FRAMES = 12_000
"""Longer pushes (ten minutes) are not tried out here: everyone at the page would wait for them."""


@dataclasses.dataclass(frozen=True, eq=False)
class Work:
    """All there is at one moment; every change makes another.

    tracks: by title, those of `scene`; what was opened bears the name of its file. watching: beliefs that are being
    learnt. history: what is believed so far.
    """

    scene: Scene | LeverScene
    tracks: Mapping[str, AnyTrack] = dataclasses.field(default_factory=dict)
    watching: Watching | None = None
    history: BeliefHistory | None = None
    goal: Goal | None = None
    plan: Plan | None = None


def work_on(opened: Opened, title: str) -> Work:
    """What there is when something is opened; title: of a track."""
    if isinstance(opened, Track | LeverTrack):
        return Work(opened.scene, {title: opened})
    if isinstance(opened, BeliefHistory):
        return Work(opened.scene, history=opened)
    return Work(opened.scene if isinstance(opened, OpenedPlan) else opened)


def alike(one: Scene | LeverScene, other: Scene | LeverScene) -> bool:
    """Whether tracks of the two can be shown over each other."""
    return type(one) is type(other) and one.names == other.names


def like(work: Work, track: AnyTrack) -> AnyTrack:
    """The track, if it is of the same bodies; else raises PushGraphError."""
    if not alike(track.scene, work.scene):
        raise PushGraphError(
            f"compare: its bodies are {', '.join(track.scene.names)}, those shown are {', '.join(work.scene.names)}"
        )
    return track


def check_length(scene: Scene | LeverScene) -> int:
    """How many frames its pushes take; raises SceneError if that is too long to be tried out."""
    if isinstance(scene, LeverScene):
        frames = int(scene.duration / FRAME)
    else:
        frames = sum(ToolMotion(push, scene.tool).frames for push in scene.pushes)
    if frames > MOST_FRAMES:
        raise SceneError(
            f"the pushes take {frames * FRAME:.0f} s; at most {MOST_FRAMES * FRAME:.0f} s are tried out here, longer "
            "ones by the commands predict and simulate"
        )
    return frames


def end_of_push(watching: Watching) -> int:
    """The frame after the next push ends, or after the track if no push begins any more."""
    down = watching.frames.down[watching.done :]
    starts = watching.frames.push_start[watching.done :]
    first = int(np.argmax(starts)) if starts.any() else 0
    later = np.flatnonzero(~down[first:])
    return watching.done + first + int(later[0]) if len(later) else watching.end
