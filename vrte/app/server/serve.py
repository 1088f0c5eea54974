"""The server of the viewer: one page, its own files, nothing from elsewhere."""

import socket
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path

from vrte.app.solving.tab_session import TabSessions
from vrte.basics.errors import SceneError

RECONNECT = 60.0  # seconds that a page without a connection is kept
ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' rx='6' fill='#16324f'/>"
    "<path d='M4 24h24' stroke='#b8c9da' stroke-width='2'/><path d='M16 24C6 20 8 8 16 8s10 12 0 16z' fill='#f0a030'/>"
    "</svg>"
)


def serve(sessions: TabSessions, host: str, port: int, browser: bool, say: Callable[[str], None] = print) -> int:
    """Runs until Ctrl-C or TERM, and returns the signal's number; ``port`` 0 takes a free one; ``browser``: opens the
    page.

    Raises SceneError where host and port cannot be listened on.
    """
    with bind_socket(host, port) as listening:
        from fastapi import FastAPI
        from nicegui import ui

        from vrte.app.server.connections import Server, run
        from vrte.app.server.guard import TOKEN, Guard

        number, port = listening.getsockname()[:2]  # the number: others may answer to the name, on its other addresses
        around = FastAPI(openapi_url=None)
        guard = Guard(around, host, port)
        shown = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(number, number)
        address = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/?{TOKEN}={guard.token}"

        @ui.page("/")
        async def index() -> None:
            await build(sessions)

        ui.run_with(
            around,
            title="vrte",
            favicon=ICON,
            reconnect_timeout=RECONNECT,
            show_welcome_message=False,
            language="en-US",
        )
        with make_opening_page(address) as page:

            def begun() -> None:
                say(f"vrte view: {address} (Ctrl-C ends it)")
                if browser:  # where there is one
                    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

            def ended() -> None:
                sessions.close()
                say("vrte view: ended")

            server = Server(guard, begun)
            run(server, listening, ended)
    return server.ended_by


@contextmanager
def make_opening_page(address: str) -> Iterator[Path]:
    """A file for the browser to open, which nobody else can read: others see what it was called with, and the address
    holds the token."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        page = Path(folder) / "open.html"
        page.touch(mode=0o600)
        page.write_text(f'<meta http-equiv="refresh" content="0; url={escape(address)}">')
        yield page


async def build(sessions: TabSessions) -> None:
    """The page of a tab: which one it is, the browser says once it is connected."""
    from nicegui import ui

    from vrte.app.page.page import Page

    client = ui.context.client
    await client.connected()
    tab = client.tab_id
    if tab is None:  # gone again
        return
    session = sessions.of(tab)
    session.pages += 1
    client.on_delete(session.leave)
    Page(session, lambda: sessions.of(tab))


@contextmanager
def bind_socket(host: str, port: int) -> Iterator[socket.socket]:
    """A socket that is bound, to a free port for 0. Raises SceneError where it cannot be."""
    try:
        family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.create_server(where[:2], family=family, backlog=128)
    except (OSError, UnicodeError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SceneError(
            f"the viewer cannot listen on port {port} of {host} ({reason}): end what does, or give another --port"
        ) from error
    with bound:
        yield bound
