"""The command view."""

import contextlib
import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pushgraph.cli.output import console, say_files
from pushgraph.cli.scenes import warn


def view(
    shown: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|TRACK|BELIEFS|PLAN",
            help="A file that pushgraph wrote, or the name of a shipped scene: demo, lever-up.",
        ),
    ] = "demo",
    compare: Annotated[
        Path | None, typer.Option(help="Another track (HDF5) of the same bodies, shown as ghosts.")
    ] = None,
    scene: Annotated[Path | None, typer.Option(help="The scene of a track in CSV.")] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write one page (.html) that replays without Python and network, and end.")
    ] = None,
    folder: Annotated[
        Path, typer.Option(help="The only folder that the page reads from and writes to.", show_default="this one")
    ] = Path("."),
    forces: Annotated[
        bool, typer.Option("--forces", help="Show the forces at all contacts, of a predicted or simulated track.")
    ] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen on: others than the default let other machines in, with no password.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="The first free one from this on is taken.")] = 8080,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """See and try out pushes in the browser: drag them, predict, simulate, plan, watch beliefs, edit the scene.

    Ctrl-C ends it. Needs the extra [viewer].

    Examples:

    `pushgraph view`

    `pushgraph view scene.json`

    `pushgraph view predicted/track.h5 --compare result/track.h5`

    `pushgraph view predicted/track.h5 --save page.html`
    """
    from pushgraph.view import check_installed

    check_installed()
    from pushgraph.view.page import Page, known_forces, open_shown, open_track, with_prediction

    opened = open_shown(shown, scene)
    other = None if compare is None else open_track(compare)
    if save is not None:
        from pushgraph.view.saved_page import save_page

        shown_there = with_prediction(opened)
        save_page(save, shown_there, compare=other, forces=known_forces(shown_there) if forces else None)
        say_files([save])
        return
    with console.status("Opening the page; the first prediction on a machine compiles for some 20 s"):
        page = Page(opened, other, folder, host, port, Path(shown).name, forces)
        page.ready()
    with contextlib.suppress(KeyboardInterrupt):
        console.print(f"The page is at {page.url}; Ctrl-C ends it.", highlight=False, markup=False)
        warn(page.said)
        if browser and _has_desktop():
            webbrowser.open(page.url)
        page.wait()
    page.stop()


def _has_desktop() -> bool:
    """Whether a browser would open in a window of its own, not in this terminal."""
    return sys.platform in ("win32", "darwin") or bool({"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ))
