"""The page docs/reference/commands.md, of all commands with their options and examples, printed from their parsers."""

import argparse
import os
from typing import Any

from bench.study import make_markdown_table
from vrte.commands.common import STARTERS, Parser, make_parser

HERE, THIS = "reference", "reference/commands.md"
INTRODUCTION = """# The command line

Made from the commands' own parsers by `python -m docs.scripts.commands`. Every command answers `--help` with its
options, two examples and the page that says more.

"""
AFTER_TOUR = """
Every command says on standard output what it did, and in the last lines what it wrote. Files are written whole or not
at all: a run that fails, or that is stopped, leaves them as they were.

"""
CODES = (
    ("0", "done"),
    ("1", "a failure: an accuracy that was not reached, an extra or a device that is missing, a full disk"),
    ("2", "bad input: an option, a file or a key of it"),
    ("130, 143", "stopped by Ctrl-C, by SIGTERM"),
)
EXIT = """## Exit codes

{codes}
Where the code is not 0, one line on standard error says what is wrong, what was given and what is allowed. About a key
of a scene file, the line ends with the page that says more:

```text
vrte: error: scene.toml: base.albdo = 0.3: unknown key; did you mean 'albedo'? Allowed: ... (docs/how_to/bases.md)
```

## Bug reports

`vrte --version` is one line. With `--verbose` beside it come Python and the platform, the processor with its cores and
instructions, the compiled core with its compiler, and every BLAS of the process. The edition of the refractive index
database, OpenCL devices, and versions of what is installed follow. So do names of extras' packages that are not
installed, and environment variables that set threads or devices. The home folder is written as ~.
`vrte.show_versions()` prints the same.

## Completion

Shells complete commands, options, their choices, file names by suffix and names of materials. They do so from a
script that is printed once and kept in a file: nothing of vrte runs while one types. It needs the extra
`completion`: `pip install 'vrte[completion]'`.

```sh
# bash (with the package bash-completion)
mkdir -p ~/.local/share/bash-completion/completions
vrte completion bash > ~/.local/share/bash-completion/completions/vrte
# zsh, where ~/.zfunc stands in fpath before compinit is called
vrte completion zsh > ~/.zfunc/_vrte
# tcsh
vrte completion tcsh > ~/.vrte.tcsh; echo "source ~/.vrte.tcsh" >> ~/.tcshrc
# fish
vrte completion fish > ~/.config/fish/completions/vrte.fish
```

Materials whose names have spaces are completed with underscores, `rutile_in_alkyd`, which vrte takes as well.
"""
SOLVING = """`--verify` solves by both exact algorithms (eigenmodes, and impedance doubling, which needs no
eigenproblem) and reports how far they agree; `--algorithm modes` or `doubling` takes one of them, `auto`, the default,
the better one by a measured rule (a third, `invariance`, where only the top of something very thick is seen).
`--nodes`, `--accuracy`, `--truncation`, `--method` and `--illuminate` win over the same keys of the scene file.
`--method auto --accuracy 1e-3` takes the method and the nodes that are good enough, by rules written from the report
([methods](../explanation/methods.md))."""
LIST_OF_STARTERS = "\n".join(f"- `{kind}`: {told}" for kind, (_, told) in STARTERS.items())
NOTES = {  # what options alone do not say
    "init": f"""The kinds are

{LIST_OF_STARTERS}

Every line of the file says in which unit a number is and what else could stand there. The last two lines that the
command prints are commands to type next.""",
    "brdf": SOLVING,
    "field": "Algorithms and methods are those of [vrte brdf](#vrte-brdf).",
    "sweep": "On threads, a Dask cluster or an OpenCL device.",
    "devices": 'The device that is taken is that of `backend="opencl"`.',
}


def show_argument(action: argparse.Action) -> str:
    """An argument as it is typed."""
    metavar = str(action.metavar or "") or ("" if action.nargs == 0 else action.dest.upper())
    names = ", ".join(f"`{one}`" for one in action.option_strings)
    return f"{names} `{metavar}`" if names and metavar else names or f"`{metavar}`"


def explain_argument(action: argparse.Action) -> str:
    """What an argument is, and its choices."""
    choices = f"one of {', '.join(f'`{one}`' for one in action.choices)}" if action.choices else ""
    needed = "needed" if action.required and action.option_strings else ""
    several = "any number of them" if action.nargs == "+" else ""
    left_out = "may be left out" if action.nargs == "?" else ""
    return "; ".join(part for part in (action.help, choices, several, left_out, needed) if part)


def describe_command(name: str, command: Parser) -> str:
    """The section of a command: what it does, its arguments, its examples, where to read on."""
    actions: list[Any] = [action for action in command._actions if action.dest != "help"]
    rows = [(show_argument(action), explain_argument(action)) for action in actions]
    parts = [f"## vrte {name}", str(command.description)]
    parts += [NOTES[name]] if name in NOTES else []
    parts += [make_markdown_table(("argument", "what it is"), rows).rstrip("\n")]
    parts += [f"```sh\n{write_examples(command)}```"]
    page = command.page
    parts += [f"More: [{page}]({os.path.relpath(page, HERE)})."] if page != THIS else []
    return "\n\n".join(parts) + "\n"


def write_examples(command: Parser) -> str:
    """Command lines, each under what it does."""
    return "".join(f"# {told}\n{line}\n" for line, told in command.examples)


def write_page() -> str:
    """The page of all commands with options and examples, in Markdown."""
    parser = make_parser()
    choices = next(action.choices for action in parser._actions if isinstance(action.choices, dict))
    listed = make_markdown_table(
        ("command", "what comes of it"),
        [(f"[{name}](#vrte-{name})", str(command.description)) for name, command in choices.items()],
    )
    exit_codes = EXIT.format(codes=make_markdown_table(("code", "meaning"), CODES))
    start = f"{INTRODUCTION}```sh\n{write_examples(parser)}```\n{AFTER_TOUR}{listed}\n{exit_codes}"
    return "\n".join([start, *(describe_command(name, command) for name, command in choices.items())])


if __name__ == "__main__":
    print(write_page(), end="")
