"""The web server: viser's, closed to other machines, other pages and the public."""

import contextlib
import http
import io
import ipaddress
import socket
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from pushgraph.errors import ViewerError
from pushgraph.view import LOCAL, PORT, check_installed

if TYPE_CHECKING:
    import viser

PORTS_TRIED = 32
"""So many ports from the wanted one on are tried; then any."""
LARGEST_MESSAGE = 4 * 2**20
"""A browser that sends more bytes at once is disconnected."""
AMBIENT = 1.9
"""Intensity of the light that comes from all sides, beside viser's lamps."""
_LOCAL_NAMES = ("localhost", LOCAL, "::1")


def start_server(host: str = LOCAL, port: int = PORT) -> "viser.ViserServer":
    """A server with an empty page, on the first free port from `port` on.

    Raises MissingExtraError if viser is missing, ViewerError if nothing can listen there.
    """
    check_installed()
    import viser

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Nobody makes this page public: viser would do so for any browser that asks."""
            return None

        def stop(self) -> None:
            """End, and print nothing."""
            with contextlib.redirect_stdout(io.StringIO()):
                super().stop()

    free = _free_port(host, port)
    with _own_pages_only(host), contextlib.redirect_stdout(io.StringIO()):  # viser prints a table of addresses
        server = Server(host, free, label="pushgraph", verbose=False)
    # Light from an image all around takes seconds to prepare where graphics are drawn in software.
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=AMBIENT)
    set_dark(server, False)
    server.gui.main_panel.dock_right()
    return server


def set_dark(server: "viser.ViserServer", dark: bool) -> None:
    """Make the page dark or light."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark)


def is_local(host: str) -> bool:
    """Whether only this machine reaches a host address."""
    if host in _LOCAL_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_foreign(host: str, asked: list[str], origins: list[str]) -> bool:
    """Whether a request is of a page that is not ours: of another site that is open in the same browser.

    host: what is listened on. asked, origins: the headers Host and Origin.
    """
    if len(asked) != 1 or len(origins) > 1:
        return True
    if is_local(host) and urlsplit(f"//{asked[0]}").hostname not in (host, *_LOCAL_NAMES):
        return True  # a name of theirs that was made to mean this machine
    return bool(origins) and urlsplit(origins[0]).netloc != asked[0]


@contextlib.contextmanager
def _own_pages_only(host: str) -> Iterator[None]:
    """Servers begun meanwhile answer our pages alone; viser itself has no such setting."""
    from websockets.asyncio import server

    serve: Callable[..., Any] = server.serve

    def guarded(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            try:
                foreign = is_foreign(host, headers.get_all("Host"), headers.get_all("Origin"))
            except ValueError:
                foreign = True
            if foreign:
                return connection.respond(http.HTTPStatus.FORBIDDEN, "this is not for pages of other sites\n")
            return process_request(connection, request)

        return serve(*arguments, process_request=process, **options | {"max_size": LARGEST_MESSAGE})

    server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[assignment,misc]


def _free_port(host: str, wanted: int) -> int:
    if not 1 <= wanted <= 65535:
        raise ViewerError(f"port: must be from 1 to 65535, got {wanted}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, wanted, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise ViewerError(f"host {host!r}: nothing can listen there: {error.strerror}") from None
    fault = OSError()
    for port in (*range(wanted, min(wanted + PORTS_TRIED, 65536)), 0):
        with socket.socket(family, kind, protocol) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((address[0], port, *address[2:]))
                tried.listen()
                return int(tried.getsockname()[1])
            except OSError as error:
                fault = error
    raise ViewerError(f"host {host!r}: nothing can listen there: {fault.strerror or fault}")
