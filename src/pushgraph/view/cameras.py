"""Who looks from where: names are placed so that they do not hide each other from there."""

import threading
from typing import Any

import numpy as np

from pushgraph.view.session import Session

PAUSE = 0.3
"""Names follow a camera so often (s)."""


def follow_cameras(session: Session) -> None:
    """Place names for the browser that is open for longest, as its camera turns; all browsers see the same names."""
    waiting = threading.Event()

    def place() -> None:
        waiting.clear()
        clients = session.server.get_clients()
        if clients:
            camera = clients[min(clients)].camera
            session.drawing.look_from(np.array(camera.position), np.array(camera.look_at))

    def turned(camera: Any) -> None:
        if not waiting.is_set():
            waiting.set()
            later = threading.Timer(PAUSE, session.do_latest, ("names", place))
            later.daemon = True
            later.start()

    @session.server.on_client_connect
    def _(client: Any) -> None:
        client.camera.on_update(turned)
