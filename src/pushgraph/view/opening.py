"""Whatever file pushgraph writes, by what it holds."""

from pathlib import Path
from typing import NamedTuple

from pushgraph import belief_history
from pushgraph.belief_history import BeliefHistory
from pushgraph.errors import SceneError, TrackError
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.planning import plan
from pushgraph.scene import Scene
from pushgraph.scene_file import header, read
from pushgraph.track import Track


class OpenedPlan(NamedTuple):
    """What a file of a plan holds. tool: its name. scene: with tool and pushes."""

    tool: str
    scene: Scene


Opened = Scene | LeverScene | Track | LeverTrack | BeliefHistory | OpenedPlan


def open_file(path: Path, scene: Scene | LeverScene | None = None) -> Opened:
    """Read a scene, a track, beliefs or a plan; a CSV track is one of `scene`.

    Raises the error of what the file seems to hold, which names it and what is wrong in it.
    """
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if isinstance(scene, LeverScene):
            raise TrackError(f"{path}: a CSV track is of a scene on a table; this one is in space")
        return Track.load(path, scene)
    if suffix in (".h5", ".hdf5"):
        return _track(path)
    text = read(path)
    said = header(text, str(path)).get("format")
    if said == belief_history.FORMAT:
        return BeliefHistory.load(path)
    if said == plan.FORMAT:
        return OpenedPlan(*plan.load_plan(path))
    if said == LeverScene.format_name():
        return LeverScene.from_json(text, str(path))
    if said != Scene.format_name():
        valid = (Scene.format_name(), LeverScene.format_name(), belief_history.FORMAT, plan.FORMAT)
        raise SceneError(f'{path}: "format" must be one of {", ".join(valid)}, got {said!r}')
    return Scene.from_json(text, str(path))


def _track(path: Path) -> Track | LeverTrack:
    try:
        return Track.load(path)
    except TrackError as error:
        if "not a track" not in str(error):
            raise
    return LeverTrack.load(path)
