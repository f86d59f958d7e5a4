"""One scene in the browser, and what moves in it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.belief_history import BeliefHistory
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.planning.goal import Goal
from pushgraph.scene import Scene
from pushgraph.track import Track


class SceneDrawing:
    """Draws into a viser scene (`server.scene`): the scene, and on it what else is shown.

    Every `show_...` replaces what it showed before, and with None removes it. What is drawn already and has not changed
    is neither sent nor computed again, so a moved push costs only its arrow. Not thread-safe: the caller holds a lock.
    """

    def __init__(self, api: Any, root: str = "/view") -> None:
        """api: `viser.ViserServer.scene`. root: name of the node under which everything is drawn."""
        raise NotImplementedError

    def show_scene(self, scene: Scene | LeverScene) -> None:
        """Table, bodies at their poses with names, joints, tool and pushes.

        Track, ghosts, spread and beliefs of a scene with other bodies are removed.
        """
        raise NotImplementedError

    def show_track(self, track: Track | LeverTrack | None) -> None:
        """Move bodies and tool as this track, with trails, forces on the tool and the spread, if it states one.

        Shows the track's scene first if its bodies differ; None: the scene as it starts.
        """
        raise NotImplementedError

    def show_ghost(self, track: Track | LeverTrack | None) -> None:
        """A second track of the same bodies, as translucent copies that move along at the same times (s)."""
        raise NotImplementedError

    def show_outcome(self, track: Track | None) -> None:
        """Where a track ends: translucent copies, trails and ellipses of the spread, whatever the frame.

        What a dragged push is predicted to do is shown with this.
        """
        raise NotImplementedError

    def show_belief(self, history: BeliefHistory | None) -> None:
        """Links between the bodies in the colours of their likeliest joints, and a plot of probabilities over time."""
        raise NotImplementedError

    def show_goal(self, goal: Goal | None) -> None:
        """Where a body is to go."""
        raise NotImplementedError

    def show_arm(self, trajectory: JointTrajectory | None) -> None:
        """The scene's arm, moving as this; None: as the tool would be held without it (no arm)."""
        raise NotImplementedError

    def set_frame(self, frame: int) -> None:
        """Show this frame of the track (of the beliefs, if there is no track), from 0 to `len(times) - 1`."""
        raise NotImplementedError

    @property
    def frame(self) -> int:
        """The frame shown."""
        raise NotImplementedError

    @property
    def times(self) -> Float[np.ndarray, " frames"]:
        """Of the frames (s): those of the track, else of the beliefs, else [0]."""
        raise NotImplementedError

    @property
    def push_times(self) -> Mapping[int, float]:
        """When each push of the track begins (s), by its number from 1 on, as they are drawn."""
        raise NotImplementedError

    @property
    def body_handles(self) -> Mapping[str, Any]:
        """The solid of each body, by name, for `on_click` and `on_drag`; new handles after the bodies were changed."""
        raise NotImplementedError

    def clear(self) -> None:
        """Remove everything."""
        raise NotImplementedError
