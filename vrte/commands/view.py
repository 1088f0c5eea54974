"""`vrte view`: a local web page to describe a scene, solve it and look at it."""

import argparse
import sys
from pathlib import Path
from signal import SIGTERM
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import Parser, check_extra, make_whole_number_reader

PORT = 8765
OPEN = "--open-to-network"
MEANING = (
    "vrte view: other machines can reach this page: whoever has its address may use it, see what it holds and keep the "
    "machine's processors and memory busy; nothing is encrypted, so whoever listens on the way has the address, too"
)


def add(command: Parser) -> None:
    """The arguments of `vrte view`."""
    command.add_argument("file", metavar="FILE", type=Path, nargs="?", help="a scene (.toml) or a result (.nc, .csv)")
    command.add_argument("--host", default="127.0.0.1", help="where to listen; default: 127.0.0.1, this machine alone")
    command.add_argument(
        OPEN, action="store_true", help="with a --host that other machines reach: whoever has the address may come in"
    )
    command.add_argument(
        "--port", type=make_whole_number_reader(0, 65535), default=PORT, help=f"0: a free one; default: {PORT}"
    )
    command.add_argument("--no-browser", action="store_true", help="opens none, only prints the address")


def run(options: argparse.Namespace) -> None:
    check_extra("vrte view", "app", ("nicegui", "plotly"))
    from vrte.app.server.guard import is_loopback
    from vrte.app.server.serve import serve

    if not is_loopback(options.host):
        if not options.open_to_network:
            raise SceneError(
                f"--host {options.host} lets other machines reach the viewer: say that too, {OPEN}", "view"
            )
        print(MEANING, flush=True)
    sessions = make_first_sessions(options.file)
    signal = serve(sessions, options.host, options.port, not options.no_browser, lambda text: print(text, flush=True))
    if signal == SIGTERM:
        sys.exit(128 + SIGTERM)


def make_first_sessions(path: Path | None) -> Any:
    """What a page begins with: the start scene, a scene file or a result."""
    from vrte.app.form.files import adopt_with_notes
    from vrte.app.solving.solve import make_outcome
    from vrte.app.solving.tab_session import TabSessions
    from vrte.formats import load
    from vrte.formats.named import find_named_tables
    from vrte.formats.scene_file import read_content

    if path is None:
        return TabSessions()
    try:
        if path.suffix.lower() == ".toml":
            content = read_content(path)
            content, told = adopt_with_notes(content, path.parent, frozenset(find_named_tables(content).values()))
            for text in told:
                print(f"vrte view: {text}", file=sys.stderr)
            return TabSessions(content, path.parent)
        outcome = make_outcome(load(path))
        return TabSessions(outcome.content, outcome=outcome)
    except SceneError as error:
        raise (error if str(error).startswith(str(path)) else error.behind(path)) from error
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror or error}") from error
