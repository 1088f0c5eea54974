"""`vrte completion`: a script by which a shell completes commands, options and file names of `vrte`."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vrte.basics.errors import import_extra
from vrte.formats.materials import list_materials
from vrte.optics.refractive_index import MATERIALS

SHELLS = ("bash", "zsh", "tcsh", "fish")


def run(options: argparse.Namespace) -> None:
    shtab = import_extra("shtab", "vrte completion", "completion")
    from vrte.commands.common import make_parser

    parser = make_parser()
    for action in list_actions(parser):
        if action.type is Path:  # files by the suffix of their metavar
            suffix = Path(action.metavar or "").suffix
            action.complete = make_patterns(suffix) if suffix else shtab.FILE
        elif action.dest == "name" and not action.option_strings:  # names of materials, with _ for their spaces
            action.choices = [name.replace(" ", "_") for name in (*MATERIALS, *list_materials())]
    print(shtab.complete(parser, options.shell))


def list_actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """All arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from list_actions(command)


def make_patterns(suffix: str) -> dict[str, Any]:
    """Files with a suffix, and folders on the way to them, as each shell is asked for them."""
    function = f"_vrte_files_{suffix[1:]}"
    lines = (f"{function}() {{", '  compgen -d -- "$1"', f"  compgen -f -X '!*{suffix}' -- \"$1\"", "}")
    return {
        "bash": function,
        "zsh": f"_files -g '*{suffix}'",
        "tcsh": f"f:*{suffix}",
        "fish": f"(__fish_complete_suffix {suffix})",
        "preamble": {"bash": "\n".join(lines)},
    }
