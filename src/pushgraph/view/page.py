"""A page in the browser: opened by a command, a script or a notebook."""

import contextlib
import os
import sys
import threading
import warnings
from importlib.resources import files
from pathlib import Path
from types import TracebackType

from pushgraph.belief_history import BeliefHistory
from pushgraph.errors import PredictionError, SceneError, TrackError
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.scene import Scene
from pushgraph.track import Track
from pushgraph.view import LOCAL, PORT
from pushgraph.view.cameras import follow_cameras
from pushgraph.view.folder import Folder
from pushgraph.view.handles import Handles
from pushgraph.view.keyboard import add_keys
from pushgraph.view.known_forces import KnownForces
from pushgraph.view.opening import Opened, open_file
from pushgraph.view.panel import add_panel
from pushgraph.view.server import is_local, start_server
from pushgraph.view.session import Session
from pushgraph.view.workbench import PREDICTED, Workbench

SHIPPED_SCENES = Path(str(files("pushgraph"))) / "scenes"


class Page:
    """A page that is being served. In a notebook it shows itself.

    url: where it is. said: what whoever opened it should know, a sentence each. session: what is shown.
    """

    def __init__(
        self,
        shown: Opened,
        compare: Track | LeverTrack | None = None,
        folder: str | os.PathLike = ".",
        host: str = LOCAL,
        port: int = PORT,
        title: str = "Opened",
        forces: bool = False,
    ) -> None:
        workbench = Workbench(shown, Folder(folder), title, compare)
        server = start_server(host, port)
        self.said: list[str] = []
        if server.get_port() != port:
            self.said.append(f"port {port} is in use, so the page is on port {server.get_port()}")
        if not is_local(host):
            self.said.append(
                f"whoever reaches {host}:{server.get_port()} can change what is shown, and read and write scenes, "
                f"tracks, beliefs and plans in {workbench.folder.path}; there is no password"
            )
        name = f"[{host}]" if ":" in host else "localhost" if host == "0.0.0.0" else host
        self.url = f"http://{name}:{server.get_port()}"
        self.session = Session(server, workbench)
        self.session.forces = forces
        self.controls = add_panel(self.session)
        self.handles = Handles(self.session)
        add_keys(self.session)
        follow_cameras(self.session)
        self._stopped = threading.Event()
        self._drawn = self.session.do(lambda: None)

    def ready(self) -> None:
        """Wait until everything is drawn and predicted."""
        self._drawn.result()

    def wait(self) -> None:
        """Serve until `stop`, or Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            self._stopped.wait()
        self.stop()

    def stop(self) -> None:
        """Serve no more."""
        if not self._stopped.is_set():
            self._stopped.set()
            self.session.stop()

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="640" style="border:0"></iframe>'


def open_page(
    shown: Opened | str | os.PathLike,
    compare: Track | LeverTrack | None,
    folder: str | os.PathLike,
    host: str,
    port: int,
    wait: bool | None,
) -> Page:
    """See `pushgraph.view.view`."""
    if isinstance(shown, str | os.PathLike):
        page = Page(open_shown(os.fspath(shown)), compare, folder, host, port, Path(shown).name)
    else:
        page = Page(shown, compare, folder, host, port)
    waiting = not _interactive() if wait is None else wait
    if waiting:
        print(f"The page is at {page.url}; Ctrl-C ends it.", flush=True)
    for said in page.said:
        warnings.warn(said, stacklevel=2)
    if waiting:
        page.wait()
    return page


def open_shown(name: str, scene: str | os.PathLike | None = None) -> Opened:
    """What a file holds, or the shipped scene of this name; scene: the file of that of a track in CSV."""
    shipped = SHIPPED_SCENES / f"{name}.json"
    path = shipped if shipped in SHIPPED_SCENES.glob("*.json") and not Path(name).is_file() else Path(name)
    try:
        return open_file(path, None if scene is None else Scene.load(scene))
    except SceneError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            names = ", ".join(sorted(shipped.stem for shipped in SHIPPED_SCENES.glob("*.json")))
            raise SceneError(f"{error}; shipped scenes: {names}") from None
        raise


def open_track(path: str | os.PathLike) -> Track | LeverTrack:
    """The track in a file; raises TrackError if it holds something else."""
    opened = open_file(Path(path))
    if not isinstance(opened, Track | LeverTrack):
        raise TrackError(f"{path}: holds no track")
    return opened


def with_prediction(opened: Opened) -> Scene | LeverScene | Track | LeverTrack | BeliefHistory:
    """What is worth to be saved as a page: of a scene or a plan, what its pushes are predicted to do."""
    workbench = Workbench(opened, Folder("."))
    work = workbench.work
    if work.tracks or work.history is not None or not getattr(work.scene, "pushes", True):
        return work.history or next(iter(work.tracks.values()), work.scene)
    workbench.predict()
    return workbench.work.tracks[PREDICTED]


def known_forces(shown: Opened) -> KnownForces:
    """The forces at the contacts of a track; raises PredictionError if it is none, or they are not known."""
    if not isinstance(shown, Track):
        raise PredictionError("contact forces: known of tracks of scenes on a table alone")
    return Workbench(shown, Folder(".")).forces(shown)


def _interactive() -> bool:
    """Whether this is a notebook or a console, where what is returned is still there afterwards."""
    return hasattr(sys, "ps1") or "IPython" in sys.modules
