"""The server of the viewer: one page, its own files, nothing from elsewhere."""

import asyncio
import socket
from collections.abc import Callable
from typing import Any

from vrte.app.state import Benches
from vrte.errors import SceneError

RECONNECT = 60.0  # seconds that a page without a connection is kept
HINT = "Ctrl-C ends it"
STOPPING = 2  # seconds that open connections get at the end
POLICY = "; ".join(  # for the browser: whatever a page tries to load, it comes from here or not at all
    (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:",
        "connect-src 'self' data: blob:",
        "frame-ancestors 'none'",
        "form-action 'self'",
        "base-uri 'self'",
    )
)
ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' rx='6' fill='#16324f'/>"
    "<path d='M4 24h24' stroke='#b8c9da' stroke-width='2'/><path d='M16 24C6 20 8 8 16 8s10 12 0 16z' fill='#f0a030'/>"
    "</svg>"
)


def serve(benches: Benches, host: str, port: int, browser: bool, say: Callable[[str], None] = print) -> None:
    """Runs until it is interrupted; ``port`` 0 takes a free one; ``browser``: opens the page.

    Raises SceneError where host and port cannot be listened on.
    """
    from nicegui import app, ui

    port = free_port(host, port)
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}"
    protect(app, host)
    tasks: list[asyncio.Task[None]] = []  # a task that nobody holds may be forgotten
    app.on_startup(lambda: tasks.append(asyncio.create_task(announce(lambda: say(f"vrte view: {address} ({HINT})")))))
    app.on_shutdown(benches.close)

    @ui.page("/")
    async def index() -> None:
        await build(benches)

    ui.run(
        host=host,
        port=port,
        title="vrte",
        favicon=ICON,
        reload=False,
        show=browser,
        show_welcome_message=False,
        reconnect_timeout=RECONNECT,
        uvicorn_logging_level="error",
        timeout_graceful_shutdown=STOPPING,
    )


async def announce(say: Callable[[], None]) -> None:
    """Says so once the server listens: whoever reads the address may go there at once."""
    from nicegui.server import Server

    while not Server.instance.started:
        await asyncio.sleep(0.02)
    say()


async def build(benches: Benches) -> None:
    """The page of a tab: which one it is, the browser says once it is connected."""
    from nicegui import ui

    from vrte.app.page import Page

    client = ui.context.client
    await client.connected()
    tab = client.tab_id
    if tab is None:  # gone again
        return
    bench = benches.of(tab)
    bench.pages += 1
    client.on_delete(lambda: left(bench))
    Page(bench, lambda: benches.of(tab))


def left(bench: Any) -> None:
    """A page has gone for good: nobody waits for what it solves, unless its tab has another."""
    bench.pages -= 1
    if bench.pages == 0:
        bench.cancel()


def free_port(host: str, port: int) -> int:
    """The port, or a free one for 0. Raises SceneError where it cannot be listened on."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as found:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind((host, port))
            return int(found.getsockname()[1])
    except (OSError, UnicodeError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SceneError(
            f"the viewer cannot listen on port {port} of {host} ({reason}): end what does, or give another --port"
        ) from error


def protect(app: Any, host: str) -> None:
    """Answers to its own names alone, so that no other site's name leads here, and loads from itself alone."""
    from starlette.middleware.trustedhost import TrustedHostMiddleware

    everywhere = host in ("0.0.0.0", "::") or ":" in host
    names = ["*"] if everywhere else list(dict.fromkeys([host, "127.0.0.1", "localhost"]))
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=names)
    app.add_middleware(PolicyMiddleware)


class PolicyMiddleware:
    """Adds POLICY to every answer."""

    def __init__(self, app: Any) -> None:
        self.app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        async def with_policy(message: Any) -> None:
            if message["type"] == "http.response.start":
                more = [(b"content-security-policy", POLICY.encode()), (b"x-content-type-options", b"nosniff")]
                message = {**message, "headers": [*message.get("headers", []), *more]}
            await send(message)

        await self.app(scope, receive, with_policy if scope["type"] == "http" else send)
