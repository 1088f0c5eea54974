"""The server of the viewer: one page, its own files, nothing from elsewhere; few connections, and none for ever."""

import asyncio
import logging
import signal
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from vrte.app.solving.tab_session import TabSessions
from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError

PATIENCE = 10.0  # seconds for the head of a request, the first one or a later one
MOST = 250  # connections; a browser holds ten
STOPPING = 2  # seconds that open connections get at the end
RECONNECT = 60.0  # seconds that a page without a connection is kept
ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' rx='6' fill='#16324f'/>"
    "<path d='M4 24h24' stroke='#b8c9da' stroke-width='2'/><path d='M16 24C6 20 8 8 16 8s10 12 0 16z' fill='#f0a030'/>"
    "</svg>"
)


class Connection(H11Protocol):
    """A connection that is closed after PATIENCE seconds without a complete request."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if len(self.connections) > MOST:
            transport.abort()
        else:
            self._idle_since = self.loop.time()
            self._abort_if_idle()

    def _abort_if_idle(self) -> None:
        if self.transport.is_closing() or self.transport.get_protocol() is not self:  # a web socket by now
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self._idle_since = self.loop.time()
        elif self.loop.time() - self._idle_since >= PATIENCE:
            self.transport.abort()
            return
        self.loop.call_later(PATIENCE / 10, self._abort_if_idle)


class Server(uvicorn.Server):
    """A server that calls ``begun`` once it listens, and ends by the first Ctrl-C or TERM, at once by the second."""

    def __init__(self, app: Any, begun: Callable[[], None]) -> None:
        config = uvicorn.Config(
            app,
            http=Connection,
            ws="wsproto" if find_spec("wsproto") else "auto",
            log_config=None,
            log_level="error",
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=STOPPING,
        )
        super().__init__(config)
        self.ended_by = 0
        self._begun = begun

    async def startup(self, sockets: Any = None) -> None:
        await super().startup(sockets)
        if self.started:
            try:
                self._begun()
            except BaseException:
                self.should_exit = True  # and nothing of what breaks off is shown
                raise

    def capture_signals(self) -> Any:
        """Not its own way: `until_signal` also covers what comes after."""
        return nullcontext()

    def handle_exit(self, number: int, frame: Any) -> None:
        self.ended_by = self.ended_by or number
        self.force_exit = self.should_exit
        self.should_exit = True

    @contextmanager
    def until_signal(self) -> Iterator[None]:
        """Ctrl-C and TERM end it, and do nothing else."""
        before = {one: signal.signal(one, self.handle_exit) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for one, handler in before.items():
                signal.signal(one, handler)


def write_line(record: logging.LogRecord) -> str:
    """One printable line a message, without control characters: it may repeat what a request said."""
    error = record.exc_info[1] if record.exc_info else None
    why = f" ({type(error).__name__}: {error})" if error else ""
    return f"vrte view: {put_in_one_line(record.getMessage() + why, 300)}"


@contextmanager
def shorten_log(server: Server) -> Iterator[None]:
    """What libraries log goes to the terminal in one line each, but nothing of what breaks off as the server ends."""
    shown = logging.StreamHandler()
    shown.setLevel(logging.ERROR)
    shown.format = write_line  # type: ignore[method-assign]
    shown.addFilter(lambda _: not server.should_exit)
    logging.getLogger().addHandler(shown)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(shown)


def serve(sessions: TabSessions, host: str, port: int, browser: bool, report: Callable[[str], None] = print) -> int:
    """Runs until Ctrl-C or TERM, and returns the signal's number; ``port`` 0 takes a free one; ``browser``: opens the
    page. Raises SceneError where host and port cannot be listened on."""
    with bind_socket(host, port) as listening:
        from fastapi import FastAPI
        from nicegui import ui

        from vrte.app.server.guard import TOKEN, Guard

        number, port = listening.getsockname()[:2]  # the number: others may answer to the name, on its other addresses
        around = FastAPI(openapi_url=None)
        guard = Guard(around, host, port)
        shown = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(number, number)
        address = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/?{TOKEN}={guard.token}"

        @ui.page("/")
        async def index() -> None:
            """The page of a tab: which one it is, the browser says once it is connected."""
            from vrte.app.page.page import Page

            client = ui.context.client
            await client.connected()
            tab = client.tab_id
            if tab is not None:  # None: gone again
                session = sessions.of(tab)
                session.pages += 1
                client.on_delete(session.leave)
                Page(session, lambda: sessions.of(tab))

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
                report(f"vrte view: {address} (Ctrl-C ends it)")
                if browser:  # where there is one
                    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

            server = Server(guard, begun)
            with server.until_signal():  # also while it closes: one signal more does nothing
                with suppress(asyncio.CancelledError, KeyboardInterrupt), shorten_log(server):  # by a second Ctrl-C
                    server.run(sockets=[listening])
                sessions.close()
                report("vrte view: ended")
    return server.ended_by


@contextmanager
def make_opening_page(address: str) -> Iterator[Path]:
    """A file for the browser to open, readable by this user alone: the address in it holds the token."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        page = Path(folder) / "open.html"
        page.touch(mode=0o600)
        page.write_text(f'<meta http-equiv="refresh" content="0; url={escape(address)}">')
        yield page


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
