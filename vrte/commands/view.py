"""`vrte view`: a local web page to describe a scene, solve it and look at it."""

import argparse
import sys
from pathlib import Path
from signal import SIGTERM
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import check_extra, label_errors

PORT = 8765
OPEN = "--open-to-network"
MEANING = (
    "vrte view: other machines can reach this page: whoever has its address may use it, see what it holds and keep the "
    "machine's processors and memory busy; nothing is encrypted, so whoever listens on the way has the address, too"
)


def check(options: argparse.Namespace) -> None:
    """Whether the viewer is installed, and may be reached as it is asked to. Raises SceneError, MissingExtraError."""
    check_extra("vrte view", "app", ("nicegui", "plotly"))
    from vrte.app.server.guard import is_loopback

    if not is_loopback(options.host):
        if not options.open_to_network:
            words = f"--host {options.host} lets other machines reach the viewer: say that too, {OPEN}"
            raise SceneError(words, "view")
        print(MEANING, flush=True)


def run(options: argparse.Namespace) -> None:
    from vrte.app.server.serve import serve

    with label_errors(options.file, reading=True):
        sessions = make_first_sessions(options.file)
    signal = serve(sessions, options.host, options.port, not options.no_browser, lambda text: print(text, flush=True))
    if signal == SIGTERM:
        sys.exit(128 + SIGTERM)


def make_first_sessions(path: Path | None) -> Any:
    """What a page begins with: the start scene, a scene file or a result. Raises SceneError, OSError."""
    from vrte.app.form.checks import adopt_with_notes
    from vrte.app.solving.solve import make_outcome
    from vrte.app.solving.tab_session import TabSessions
    from vrte.formats import load
    from vrte.formats.scene_file import find_named_tables, read_content

    if path is None:
        return TabSessions()
    if path.suffix.lower() == ".toml":
        content = read_content(path)
        content, notes = adopt_with_notes(content, path.parent, frozenset(find_named_tables(content).values()))
        for text in notes:
            print(f"vrte view: {text}", file=sys.stderr)
        return TabSessions(content, path.parent)
    outcome = make_outcome(load(path))
    return TabSessions(outcome.content, outcome=outcome)
