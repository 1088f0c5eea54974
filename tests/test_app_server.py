"""The viewer's server: what it answers, and how it begins and ends."""

import http.client
import logging
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.viewer_server import viewer
from vrte import cli
from vrte.app.server import guard
from vrte.app.server import serve as connections
from vrte.app.server.guard import LARGEST_UPLOAD
from vrte.app.server.serve import bind_socket, make_opening_page

UPLOAD = "/_nicegui/client/12345678-1234-1234-1234-123456789abc/upload/7"
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=10)


class Viewer:
    """A running one, and what its owner's browser knows of it."""

    def __init__(self, address: str) -> None:
        place, _, self.token = address.partition("/?token=")
        self.port = int(place.rpartition(":")[2])
        self.host = f"127.0.0.1:{self.port}"
        code, headers, _ = self.ask(f"/?scene=x&token={self.token}", cookie=None)
        assert (code, headers["location"]) == (303, "/?scene=x")
        assert headers["set-cookie"].endswith("; Path=/; HttpOnly; SameSite=Lax")
        self.cookie = headers["set-cookie"].split(";")[0]

    def ask(
        self, target: str, cookie: str | None = "", method: str = "GET", body: bytes = b"", **headers: str
    ) -> tuple[int, Any, bytes]:
        """Code, headers and body of an answer; as the owner's browser asks, unless told otherwise."""
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)) as connection:
            sent = {"Host": self.host} | ({} if cookie is None else {"Cookie": cookie or self.cookie}) | headers
            connection.putrequest(method, target, skip_host=True)
            for name, value in sent.items():
                connection.putheader(name.replace("_", "-"), value)
            connection.endheaders(body or None)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()

    def code(self, target: str = "/", cookie: str | None = "", method: str = "GET", **headers: str) -> int:
        """The code of an answer alone."""
        return self.ask(target, cookie, method, b"x" * (method == "POST"), **headers)[0]

    def raw(self, content: bytes) -> bytes:
        """What comes back for these bytes, until the server closes."""
        with connected(self.port) as connection:
            connection.sendall(content)
            return b"".join(iter(lambda: connection.recv(1 << 16), b""))

    def socket_to(self, cookie: str | None = "", **headers: str) -> int:
        """The code that the page's web socket is answered with: 101 where it is opened."""
        reported = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
        reported |= {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", **headers}
        return self.ask(f"{SOCKET}websocket", cookie, **reported)[0]


@pytest.fixture(scope="module")
def page() -> Iterator[Viewer]:
    """One for all attacks; in the end it must have said nothing on the terminal."""
    with viewer() as address:
        yield Viewer(address)


def test_the_page_comes_from_here_alone(page: Viewer) -> None:
    code, headers, content = page.ask("/")
    assert code == 200
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"
    assert "server" not in headers
    assert "://" not in content.decode().replace("http://www.w3.org/2000/svg", "").replace(f"http://{page.host}", "")


def test_who_has_not_the_address_gets_nothing(page: Viewer) -> None:
    """Any other account of the machine reaches the port."""
    tokens = ("", "x", page.token[:-1], page.token + "x", page.token.swapcase(), "%00", "\u00e9".encode().hex())
    targets = ["/", "/favicon.ico", f"{SOCKET}polling", "/docs", "/x", f"/x?token={page.token}"]
    for target in (*targets, *(f"/?token={token}" for token in tokens)):
        assert page.code(target, cookie=None) == 403
    for target in ("/_nicegui/client/0/upload/1", f"/?token={page.token}"):
        assert page.code(target, cookie=None, method="POST") == 403
    assert b"put everything from # on behind it" in page.ask("/", cookie=None)[2]  # whoever was sent a link
    assert page.socket_to(cookie=None, Origin=f"http://{page.host}") == 403
    name, _, value = page.cookie.partition("=")
    for cookie in (name, f"{name}=", f"{name}={page.token}", f"{name}={value[:-1]}", f"vrte-1={value}", "\xe9=\xff"):
        assert page.code(cookie=cookie) == 403
    assert page.code(cookie=f"{name}=planted; other=1; {page.cookie}") == 200


def test_names_of_others_that_lead_here_are_refused(page: Viewer) -> None:
    """A page of another site whose name is made to point to this machine (DNS rebinding)."""
    own, port = page.host, page.port
    hosts = ["elsewhere.example", f"elsewhere.example:{port}", "127.0.0.1", "127.0.0.1:1", "", "[", "0:x"]
    hosts += [f"evil@{own}", f"evil:x@{own}", f"{own}/x", f"{own}?x", f"{own}#x", f"{own},x", f"[{own}", "\xb2"]
    for host in (*hosts, f"192.0.2.1:{port}"):  # the last: this one is bound to the loopback
        assert page.code(Host=host) == 400, host
    twice = f"GET / HTTP/1.1\r\nHost: {own}\r\nHost: elsewhere.example\r\nCookie: {page.cookie}\r\n\r\n"
    for request in (twice, f"GET / HTTP/1.0\r\nCookie: {page.cookie}\r\n\r\n"):
        assert page.raw(request.encode()).startswith(b"HTTP/1.1 400")
    for host in (f"LocalHost:{port}", f"[::1]:{port}", f"localhost:{port}"):
        assert page.code(Host=host) == 200


def test_pages_of_others_reach_neither_page_nor_socket(page: Viewer) -> None:
    """Also one on another port of this machine, to which browsers send the cookie."""
    own = f"http://{page.host}"
    assert page.socket_to(Origin=own) == 101
    for origin in ("http://elsewhere.example", "http://127.0.0.1:1", "null", own.replace("http", "https"), own + "/"):
        codes = page.socket_to(Origin=origin), page.code(Origin=origin), page.code(f"{SOCKET}polling", Origin=origin)
        assert codes == (403, 403, 403)
    assert page.socket_to() == 403
    for site in ("cross-site", "same-site"):
        for mode, destination, method, code in (
            ("no-cors", "script", "GET", 403),
            ("cors", "empty", "GET", 403),
            ("navigate", "iframe", "GET", 403),
            ("navigate", "document", "GET", 200),  # a link
            ("navigate", "document", "POST", 403),
        ):
            fetched = {"Sec_Fetch_Site": site, "Sec_Fetch_Mode": mode, "Sec_Fetch_Dest": destination}
            assert page.code(method=method, **fetched) == code
    assert b"alert(1)" not in page.ask("/", X_Forwarded_Prefix="/'><script>alert(1)</script>")[2]


def test_what_is_too_large_or_means_nothing_is_refused_in_silence(page: Viewer) -> None:
    for target, size in ((UPLOAD, LARGEST_UPLOAD + 200_000), ("/", 3_000_000), ("/", 10**18)):
        head = f"POST {target} HTTP/1.1\r\nHost: {page.host}\r\nCookie: {page.cookie}\r\nContent-Length: {size}\r\n\r\n"
        assert page.raw(head.encode()).startswith(b"HTTP/1.1 413")  # before it is received
    for method in ("PUT", "DELETE", "OPTIONS", "TRACE"):
        assert page.code(method=method) == 405
    for content in (b"\x1b[2J\x1b]0;owned\x07\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\x16\x03\x01" + bytes(300)):
        assert page.raw(content).startswith(b"HTTP/1.1 400")
    assert page.code("/%1b%5b2J%0avrte:%20error:%20all%20is%20lost") == 404
    assert page.code() == 200


@pytest.fixture
def small_server() -> Iterator[int]:
    """The port of a server whose page takes what it is sent, and says how much that was."""

    async def echo(scope: Any, receive: Any, send: Any) -> None:
        size = 0
        while (message := await receive())["type"] == "http.request":
            size += len(message.get("body", b""))
            if not message.get("more_body"):
                await guard.answer(send, 200, str(size))
                return

    begun = threading.Event()
    with bind_socket("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        guarded = guard.Guard(echo, "127.0.0.1", port)
        guarded._known = lambda headers: True  # type: ignore[method-assign]
        server = connections.Server(guarded, begun.set)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        assert begun.wait(10)
        yield port
        server.should_exit = True
        thread.join(10)
        assert not thread.is_alive()


def test_more_than_announced_is_refused_on_the_way(small_server: int) -> None:
    head = f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{small_server}\r\nTransfer-Encoding: chunked\r\n\r\n"
    full = b"186a0\r\n" + b"x" * 100_000 + b"\r\n"
    for chunks, answer in ((20 * full + b"0\r\n\r\n", b"HTTP/1.1 200"), (20 * full + b"1\r\nx\r\n", b"HTTP/1.1 413")):
        with connected(small_server) as connection:
            connection.sendall(head.encode() + chunks)
            assert connection.recv(12) == answer
    with connected(small_server) as connection:
        connection.sendall(head.encode())
        with suppress(ConnectionError):  # 1 GB is not waited for
            for _ in range(10_000):
                connection.sendall(full)
                if select.select([connection], [], [], 0.0)[0]:
                    return
            raise AssertionError("all of it was taken")


def test_connections_without_a_request_are_closed(small_server: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "PATIENCE", 0.4)
    monkeypatch.setattr(guard, "PATIENCE", 0.4)
    host = f"Host: 127.0.0.1:{small_server}\r\n"
    for begin, answer in (
        ("", b""),
        ("GET / HTTP/1.1\r\nX: ", b""),
        (f"POST / HTTP/1.1\r\n{host}Content-Length: 9\r\n\r\nabc", b"HTTP/1.1 408"),
    ):
        began = time.monotonic()
        with connected(small_server) as connection:
            connection.sendall(begin.encode())
            assert connection.recv(12) == answer
        assert time.monotonic() - began < 3.0
    began = time.monotonic()
    with connected(small_server) as connection, suppress(ConnectionError):  # a byte at a time
        while time.monotonic() - began < 5.0:
            connection.sendall(b"x")
            time.sleep(0.05)
    assert time.monotonic() - began < 3.0


def test_not_more_connections_than_a_page_needs(small_server: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MOST", 3)
    with ExitStack() as stack:
        held = [stack.enter_context(connected(small_server)) for _ in range(8)]
        time.sleep(0.2)
        refused = 0
        for one in held:
            one.setblocking(False)
            with suppress(BlockingIOError):
                try:
                    refused += one.recv(1) == b""
                except ConnectionError:
                    refused += 1
        assert refused == 5


def test_what_is_logged_is_one_printable_line(capsys: pytest.CaptureFixture[str]) -> None:
    server = connections.Server(None, lambda: None)
    with connections.shorten_log(server):
        try:
            raise ValueError("\x1b]0;owned\x07\nvrte: done")
        except ValueError as error:
            logging.getLogger("nicegui").exception(error)
        logging.getLogger("nicegui").warning("a page that is not there")
    assert capsys.readouterr().err == "vrte view: ?]0;owned? vrte: done (ValueError: ?]0;owned? vrte: done)\n"


@pytest.mark.slow
def test_what_it_means_to_let_others_in_is_printed() -> None:
    with viewer("--host", "0.0.0.0", "--open-to-network", warning="nothing is encrypted") as address:
        page = Viewer(address)
        # by which number it is reached, it cannot know
        codes = [page.code(Host=f"{host}:{page.port}") for host in ("192.0.2.1", "elsewhere.example")]
        assert (*codes, page.code(cookie=None)) == (200, 400, 403)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_an_impatient_second_signal_leaves_no_trace(number: signal.Signals, code: int) -> None:
    with ExitStack() as stack, viewer(ended_by=number, code=code) as address:
        stack.enter_context(connected(Viewer(address).port))  # something to wait for


@pytest.mark.slow
def test_where_the_address_cannot_be_told_it_ends_in_one_line() -> None:
    command = f"{sys.executable} -m vrte.cli view --no-browser --port 0 >/dev/full"
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stderr) == (1, "vrte: error: [Errno 28] No space left on device\n")


def test_the_address_is_on_no_command_line() -> None:
    """Other accounts see what a browser is called with."""
    address = "http://127.0.0.1:1/?token=a&b"
    with make_opening_page(address) as page:
        assert page.stat().st_mode & 0o777 == 0o600
        assert page.parent.stat().st_mode & 0o777 == 0o700
        assert "url=http://127.0.0.1:1/?token=a&amp;b" in page.read_text()
    assert not page.parent.exists()


@pytest.mark.parametrize(
    ("arguments", "text", "words"),
    [
        ("gone.toml", "", "No such file"),
        ("bad.toml", "layer = 3\n[brdf]\nmu_i = 1\nmu_o = 1", "layer = 3: must be tables"),
        ("bad.nc", "text", "is not a NetCDF file"),
        ("bad.csv", "text", "bad.csv"),
        ("--host 192.0.2.1 --open-to-network", "", "cannot listen on port 8765 of 192.0.2.1"),
        ("--port TAKEN", "", "vrte: error: the viewer cannot listen on port TAKEN of 127.0.0.1 ("),
        *((f"--host {one}", "", f"{one} lets other machines reach the viewer: say that") for one in ("0.0.0.0", "::")),
    ],
)
def test_what_cannot_be_served_is_one_sentence(
    arguments: str, text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    if text:
        Path(arguments).write_text(text)
    with bind_socket("127.0.0.1", 0) as taken:
        port = str(taken.getsockname()[1])
        assert cli.main(["view", "--no-browser", *arguments.replace("TAKEN", port).split()]) == 2
    reported = capfd.readouterr().err
    assert reported.count("\n") == 1
    assert words.replace("TAKEN", port) in reported
