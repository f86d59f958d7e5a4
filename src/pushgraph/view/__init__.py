"""Scenes, tracks and beliefs in a browser, drawn with viser; what makes pictures and animations is in `viewer`."""

import os
from typing import TYPE_CHECKING

from pushgraph.extras import extra

if TYPE_CHECKING:
    from pushgraph.lever_track import LeverTrack
    from pushgraph.track import Track
    from pushgraph.view.opening import Opened
    from pushgraph.view.page import Page

LOCAL = "127.0.0.1"
PORT = 8080


def view(
    shown: "Opened | str | os.PathLike" = "demo",
    compare: "Track | LeverTrack | None" = None,
    folder: str | os.PathLike = ".",
    host: str = LOCAL,
    port: int = PORT,
    wait: bool | None = None,
) -> "Page":
    """Show a scene, a track, beliefs or a plan in the browser, to try out pushes on it.

    shown: also a file of these, or the name of a shipped scene. compare: another track of the same bodies, shown as
    ghosts. folder: the only one that the page reads from and writes to. host, port: where it is served, the port being
    the first free one from this on. wait: whether to serve until Ctrl-C before returning; by default in scripts, which
    would else end at once, and not in notebooks and consoles, where the page that is returned shows itself.
    Raises MissingExtraError if viser (extra [viewer]) is missing.
    """
    check_installed()
    from pushgraph.view.page import open_page

    return open_page(shown, compare, folder, host, port, wait)


def check_installed() -> None:
    """Raise MissingExtraError if viser is missing."""
    with extra("viewer", "the browser viewer"):
        import viser  # noqa: F401
