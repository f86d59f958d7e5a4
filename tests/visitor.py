"""A browser as the server of the viewer sees it: it sends what a page's controls send, and looks at nothing."""

import contextlib
import queue
import threading
from concurrent.futures import Future
from typing import Any

import msgspec
import viser
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PATIENCE = 120.0


class Visitor:
    """Connected to a page; every click waits until the page has done what was asked for."""

    def __init__(self, page: Any, monkeypatch: Any) -> None:
        self.page = page
        self._asked: queue.Queue[tuple[Any, Future]] = queue.Queue()
        do = page.session.do

        def watched(action: Any, *client: Any) -> Future:
            future = do(action, *client)
            self._asked.put((action, future))
            return future

        monkeypatch.setattr(page.session, "do", watched)
        address = page.url.replace("http://", "ws://")
        protocol = f"viser-v{viser.__version__}"
        self.connection = connect(address, subprotocols=[protocol], max_size=None, origin=page.url)
        threading.Thread(target=self._listen, daemon=True).start()
        self.send(
            _messages.ViewerCameraMessage(
                (1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 1.0), 1.0, 0.1, 10.0, 640, 480, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
            )
        )

    def _listen(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for _ in self.connection:
                pass

    def send(self, message: _messages.Message) -> None:
        """Whatever a page may send."""
        self.connection.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def set(self, control: Any, value: Any) -> None:
        """What is typed into a control, or chosen."""
        self.send(_messages.GuiUpdateMessage(control._impl.uuid, {"value": value}))

    def click(self, controls: Any, option: str) -> str:
        """A button by what stands on it; returns what the page says then."""
        row, wanted = controls.clicks[option]
        self.set(row, option)
        action = None
        while action != wanted:  # what is chosen in a list may do something, too
            action, done = self._asked.get(timeout=PATIENCE)
            done.result(timeout=PATIENCE)
        return self.page.session.message
