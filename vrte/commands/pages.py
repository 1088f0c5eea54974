"""The table of all commands, commands.toml, and the page of the documents that says more: of a command, of a key of a
scene file, of an error."""

import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError

_TABLES = tomllib.loads(Path(__file__).with_name("commands.toml").read_text("utf-8"))
COMMANDS: dict[str, dict[str, Any]] = _TABLES["commands"]
STARTERS: dict[str, tuple[str, str]] = _TABLES["starters"]  # by kind: the command that solves it, and what it is of
OF_KEYS: dict[str, str] = {key: page for page, keys in _TABLES["pages"].items() for key in keys}
OF_ERRORS: dict[type[BaseException], str] = {
    AccuracyError: "reference/stability.md",
    DeviceError: "how_to/opencl.md",
    MissingExtraError: "how_to/install.md",
    SweepError: "how_to/sweeps.md",
}


def find_page(error: BaseException) -> str | None:
    """The page that says more about what is wrong, as it is named to a user; None where none would help.

    >>> find_page(SceneError("layer[1].interface.roughness must be ...", "layer", 0, "interface", "roughness"))
    'docs/how_to/rough_surfaces.md'
    """
    if isinstance(error, SceneError):
        page = next((OF_KEYS[step] for step in reversed(error.place) if step in OF_KEYS), None)
    else:
        page = OF_ERRORS.get(type(error))
    return page and locate_page(page)


def locate_page(page: str) -> str:
    """Where a page is read: on the site that the package's metadata name as Documentation, or in the source tree.

    >>> locate_page("how_to/sweeps.md")
    'docs/how_to/sweeps.md'
    """
    site = find_site()
    return f"{site}/{page.replace('README', 'index').removesuffix('.md')}.html" if site else f"docs/{page}"


@cache
def find_site() -> str:
    """The address of the documents on the web, "" where the package has none."""
    try:
        urls = metadata.metadata("vrte").get_all("Project-URL") or []
    except metadata.PackageNotFoundError:  # built in place and never installed
        return ""
    named = dict(url.split(", ", 1) for url in urls)
    return named.get("Documentation", "").rstrip("/")
