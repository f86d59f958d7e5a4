"""One self-contained page that replays without Python and without network."""

import os

from pushgraph.belief_history import BeliefHistory
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.scene import Scene
from pushgraph.track import Track


def save_page(
    path: str | os.PathLike,
    shown: Scene | LeverScene | Track | LeverTrack | BeliefHistory,
    *,
    compare: Track | LeverTrack | None = None,
    beliefs: BeliefHistory | None = None,
    trajectory: JointTrajectory | None = None,
    dark: bool = False,
) -> None:
    """Write `shown` as a page with a time line.

    compare: a second track, as ghosts. beliefs: links and plot beside a track. trajectory: of the scene's arm.
    """
    raise NotImplementedError
