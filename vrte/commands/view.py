"""`vrte view`: a local web page to describe a scene, solve it and look at it."""

import argparse
import sys
from pathlib import Path
from typing import Any

from vrte.commands.common import check_extra, whole_number
from vrte.errors import SceneError

PORT = 8765


def add(commands: Any) -> None:
    """`vrte view`."""
    command = commands.add_parser(
        "view",
        help="a local web page: describe a scene, solve it, look at it",
        description="Opens a web page on this machine: a scene as a form, its BRDF as a lobe to turn around.",
    )
    command.add_argument("file", metavar="FILE", type=Path, nargs="?", help="a scene (.toml) or a result (.nc, .csv)")
    command.add_argument("--host", default="127.0.0.1", help="where to listen; default: 127.0.0.1, this machine alone")
    command.add_argument("--port", type=whole_number(0, 65535), default=PORT, help=f"0: a free one; default: {PORT}")
    command.add_argument("--no-browser", action="store_true", help="opens none, only prints the address")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_extra("vrte view", "app", ("nicegui", "plotly"))
    from vrte.app.server import serve

    benches = first_benches(options.file)
    try:
        serve(benches, options.host, options.port, not options.no_browser, lambda text: print(text, flush=True))
    except KeyboardInterrupt:
        pass  # not raised where whoever started this process has it ignore Ctrl-C: the server ends all the same
    finally:
        benches.close()
    print("vrte view: ended")


def first_benches(path: Path | None) -> Any:
    """What a page begins with: the start scene, a scene file or a result."""
    from vrte.app.form import adopted_and_told, tables_of
    from vrte.app.state import Benches
    from vrte.app.worker import outcome_of
    from vrte.formats import load
    from vrte.formats.scene_file import read_content

    if path is None:
        return Benches()
    try:
        if path.suffix.lower() == ".toml":
            content = read_content(path)
            content, told = adopted_and_told(content, path.parent, tables_of(content))
            for text in told:
                print(f"vrte view: {text}", file=sys.stderr)
            return Benches(content, path.parent)
        outcome = outcome_of(load(path))
        return Benches(outcome.content, outcome=outcome)
    except SceneError as error:
        message = str(error)
        raise SceneError(message if message.startswith(str(path)) else f"{path}: {message}") from error
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror or error}") from error
