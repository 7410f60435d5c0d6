"""A viser server for browsers of this machine only.

Pages of other sites reach the ports of a machine through the browsers on it: by their own scripts,
which name their site as Origin, and under a name of their own that leads here (DNS rebinding),
which they name as Host. Both are refused. viser itself would also publish the scene through a
server of its authors when a page asks for it.
"""

import contextlib
from collections.abc import Callable, Iterator
from http import HTTPStatus
from typing import Any

from calibtool.errors import UsageError


def local_server(host: str, port: int, label: str) -> Any:
    """The server (`ViserServer`), listening at host:port. It answers requests that name it, with
    403 all others, and is never shared. UsageError for a version of viser in which this is not
    possible.
    """
    import viser

    class LocalServer(viser.ViserServer):  # type: ignore[misc]  # viser is an extra
        def request_share_url(self, verbose: bool = True) -> None:
            """Refused: what is shown stays on this machine."""

    with _asking(host, port) as asked:
        server = LocalServer(host=host, port=port, label=label, verbose=False)
    if not asked:
        server.stop()
        raise UsageError("this version of viser is not known; run: pip install 'calibtool[view]'")
    server.gui.configure_theme(show_share_button=False)
    return server


def refusal(host: str, port: int, hosts: list[str], origins: list[str], upgrade: bool) -> str:
    """Why a request is refused, from its headers Host and Origin; empty where it is not.

    upgrade: whether it asks for a connection, which browsers never do without an Origin.
    """
    named = [f"{name}:{port}" for name in dict.fromkeys((host, "localhost", "127.0.0.1"))]
    if hosts not in ([name] for name in named):
        return "Host"
    allowed = [[f"http://{name}"] for name in named]
    return "" if origins in allowed or not (origins or upgrade) else "Origin"


@contextlib.contextmanager
def _asking(host: str, port: int) -> Iterator[list[int]]:
    """In this block, websocket servers call `refusal` for every request; yields their ports."""
    import websockets.asyncio.server as library

    serve, asked = library.serve, list[int]()

    def asking(handler: Any, at: str, number: int, **options: Any) -> Any:
        answer: Callable[[Any, Any], Any] = options.pop("process_request")

        def process_request(connection: Any, request: Any) -> Any:
            hosts, origins, upgrades = (
                request.headers.get_all(name) for name in ("Host", "Origin", "Upgrade")
            )
            why = refusal(host, port, hosts, origins, bool(upgrades))
            if why:
                return connection.respond(HTTPStatus.FORBIDDEN, f"another {why}\n")
            return answer(connection, request)

        asked.append(number)
        return serve(handler, at, number, process_request=process_request, **options)

    library.serve = asking
    try:
        yield asked
    finally:
        library.serve = serve
