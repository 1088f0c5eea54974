"""Who may ask the viewer's server, and for how much: whoever has the address that it printed, from its own page."""

import asyncio
import ipaddress
import re
import secrets
import socket
from typing import Any
from urllib.parse import parse_qsl, urlencode

LARGEST_UPLOAD = 300_000_000  # bytes of a file
TOKEN = "token"  # its name in the address
LOOPBACK = ("localhost", "127.0.0.1", "::1")
AROUND_A_FILE = 100_000  # bytes of an upload that are not the file's
LARGEST_MESSAGE = 2_000_000  # bytes of anything else
HOST = re.compile(r"([a-z0-9_.-]+|\[[0-9a-f:.]+\])(?::([0-9]{1,5}))?")  # a name or a number, and a port: nothing else
UPLOAD = re.compile(r"/_nicegui/client/[0-9a-f-]{1,64}/upload/[0-9]{1,12}")
PATIENCE = 30.0  # seconds without a byte of what a request has announced
HEADERS = [
    (  # for the browser: whatever a page tries to load, it comes from here or not at all
        b"content-security-policy",
        b"default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
        b"frame-ancestors 'none'; form-action 'self'; base-uri 'self'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]
STRANGER = (
    "This viewer answers to the address alone that `vrte view` has printed where it was started: open that one. If "
    "somebody sent you this address and it goes on with #scene=, start `vrte view` on your own machine, open the "
    "address that it prints, and put everything from # on behind it."
)
ELSEWHERE = "This viewer answers to its own page alone, not to another site or program."
TOO_LARGE = f"Too large: at most {LARGEST_UPLOAD / 1e6:g} MB are taken."
TOO_SLOW = "What the request announced has not come."


class RefusedError(Exception):
    """A request that is not answered: the code of HTTP, and why."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


class Guard:
    """Stands before the page at ``host``; its address carries the ``token``, for which a browser gets a cookie."""

    def __init__(self, app: Any, host: str, port: int) -> None:
        self.app, self.port = app, port
        self.token, self._cookie = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._name = f"vrte-{port}"  # of the cookie: a browser brings those of every port
        self._names = {*LOOPBACK, host.lower(), socket.gethostname().lower()}
        self._open = not is_loopback(host)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        try:
            await self._answer(scope, receive, send)
        except RefusedError as refused:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})  # HTTP's 403, as it is not accepted yet
            else:
                await answer(send, refused.code, str(refused))

    async def _answer(self, scope: Any, receive: Any, send: Any) -> None:
        headers = [(name, value.decode("latin-1")) for name, value in scope["headers"]]
        self._check_names(scope, headers)
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True, max_num_fields=None)
        right = [secrets.compare_digest(value.encode(), self.token.encode()) for name, value in query if name == TOKEN]
        if scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/" and any(right):
            # to the same address without the token, with a cookie for the browser to bring from now on
            rest = urlencode([(name, value) for name, value in query if name != TOKEN])
            cookie = f"{self._name}={self._cookie}; Path=/; HttpOnly; SameSite=Lax"
            whither = (b"location", f"/?{rest}".rstrip("?").encode())
            await answer(send, 303, "", [whither, (b"set-cookie", cookie.encode())])
            return
        if not self._known(headers):
            raise RefusedError(403, STRANGER)
        # headers of proxies are private, and pages would repeat them
        scope = {**scope, "headers": [one for one in scope["headers"] if not one[0].startswith(b"x-forwarded")]}
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._bounded(scope, headers, receive, send)

    def _check_names(self, scope: Any, headers: list[tuple[bytes, str]]) -> None:
        """Whether a request uses a name of this server and comes from its own page or none: others may lead here."""
        hosts = [value for name, value in headers if name == b"host"]
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            raise RefusedError(400, ELSEWHERE)
        origins = [value for name, value in headers if name == b"origin"]
        needed = scope["type"] == "websocket"  # every browser sends it then
        if (origins or needed) and origins != [f"http://{hosts[0]}"]:
            raise RefusedError(403, ELSEWHERE)
        given = dict(headers)
        if given.get(b"sec-fetch-site") in ("cross-site", "same-site"):  # the latter: another port of this machine
            followed = given.get(b"sec-fetch-mode") == "navigate" and given.get(b"sec-fetch-dest") == "document"
            if not followed or scope.get("method") != "GET":
                raise RefusedError(403, ELSEWHERE)

    def _is_own(self, host: str) -> bool:
        found = HOST.fullmatch(host.lower())
        if found is None or int(found[2] or 80) != self.port:
            return False
        name = found[1].strip("[]")
        return name in self._names or (self._open and is_address(name))

    def _known(self, headers: list[tuple[bytes, str]]) -> bool:
        """Whether a request brings the cookie."""
        pairs = [pair.strip() for name, value in headers if name == b"cookie" for pair in value.split(";")]
        wanted = f"{self._name}={self._cookie}".encode()
        return any([secrets.compare_digest(pair.encode("latin-1"), wanted) for pair in pairs])

    async def _bounded(self, scope: Any, headers: list[tuple[bytes, str]], receive: Any, send: Any) -> None:
        """Answers a request of so many bytes; one that announces more is not received."""
        if scope["method"] not in ("GET", "HEAD", "POST"):
            raise RefusedError(405, ELSEWHERE)
        most = LARGEST_UPLOAD + AROUND_A_FILE if UPLOAD.fullmatch(scope["path"]) else LARGEST_MESSAGE
        announced = dict(headers).get(b"content-length", "0")
        if not announced.isdecimal() or int(announced) > most:
            raise RefusedError(413, TOO_LARGE)
        size, whole, begun = 0, False, False
        refused: RefusedError | None = None

        async def counted() -> Any:
            nonlocal size, whole, refused
            if whole:
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), PATIENCE)
            except TimeoutError:
                refused = refused or RefusedError(408, TOO_SLOW)
            else:
                size += len(message.get("body", b""))
                whole = not message.get("more_body", False)
                if size > most:
                    refused = RefusedError(413, TOO_LARGE)
            return {"type": "http.disconnect"} if refused else message

        async def with_headers(message: Any) -> None:
            nonlocal begun
            if refused and not begun:
                return
            if message["type"] == "http.response.start":
                begun, message = True, {**message, "headers": [*message.get("headers", []), *HEADERS]}
            await send(message)

        try:
            await self.app(scope, counted, with_headers)
        except Exception:
            if refused is None:
                raise
        if refused is not None and not begun:
            raise refused


async def answer(send: Any, code: int, text: str, headers: list[tuple[bytes, bytes]] | None = None) -> None:
    """A short answer, the last one of its connection: what else comes there is not read."""
    body = text.encode()
    about = {"content-type": "text/plain; charset=utf-8", "connection": "close", "cache-control": "no-store"}
    about["content-length"] = str(len(body))
    encoded = [(name.encode(), value.encode()) for name, value in about.items()]
    await send({"type": "http.response.start", "status": code, "headers": [*encoded, *HEADERS, *(headers or [])]})
    await send({"type": "http.response.body", "body": body})


def is_address(name: str) -> bool:
    """Whether a host is named by its number, which no other site can claim."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches what listens there."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return False
    return all(ipaddress.ip_address(str(one[4][0]).partition("%")[0]).is_loopback for one in found)
