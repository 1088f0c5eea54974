"""How the viewer's server holds its connections: not for ever, and not too many; and what it says on the terminal."""

import asyncio
import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from vrte.basics.arrays import put_in_one_line

PATIENCE = 10.0  # seconds for the head of a request, the first one or a later one
MOST = 250  # connections; a browser holds ten
STOPPING = 2  # seconds that open connections get at the end


class Connection(H11Protocol):
    """A connection that is closed where no whole request comes."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if len(self.connections) > MOST:
            transport.abort()
        else:
            self._idle_since = self.loop.time()
            self._look()

    def _look(self) -> None:
        if self.transport.is_closing() or self.transport.get_protocol() is not self:  # a web socket by now
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self._idle_since = self.loop.time()
        elif self.loop.time() - self._idle_since >= PATIENCE:
            self.transport.abort()
            return
        self.loop.call_later(PATIENCE / 10, self._look)


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


@contextmanager
def shorten_log(server: Server) -> Iterator[None]:
    """What libraries log goes to the terminal in one line each, without control characters: it may repeat what a
    request said. Nothing of what breaks off when the server ends."""
    shown = logging.StreamHandler()
    shown.setLevel(logging.ERROR)
    shown.setFormatter(OneLine())
    shown.addFilter(lambda _: not server.should_exit)
    logger = logging.getLogger()
    logger.addHandler(shown)
    try:
        yield
    finally:
        logger.removeHandler(shown)


class OneLine(logging.Formatter):
    """One printable line a message.

    >>> OneLine().format(logging.makeLogRecord({"msg": "no such page: /\\x1b[2J\\nvrte: done"}))
    'vrte view: no such page: /?[2J vrte: done'
    """

    def format(self, record: logging.LogRecord) -> str:
        error = record.exc_info[1] if record.exc_info else None
        why = f" ({type(error).__name__}: {error})" if error else ""
        return f"vrte view: {put_in_one_line(record.getMessage() + why, 300)}"


def run(server: Server, listening: Any, ended: Callable[[], None]) -> None:
    """Until it is ended, and ``ended`` called: also then a signal more does nothing."""
    with server.until_signal():
        with suppress(asyncio.CancelledError, KeyboardInterrupt), shorten_log(server):  # by a second Ctrl-C
            server.run(sockets=[listening])
        ended()
