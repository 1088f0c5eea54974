"""What the API reference makes of a docstring: what only the running package knows is filled in, names are links."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import Any

from griffe import Class, Docstring, Extension, Object

PAGES = Path(__file__).parent / "reference/api"
LISTED = {name for page in PAGES.glob("*.md") for name in re.findall(r"^::: (\S+)", page.read_text("utf-8"), re.M)}
OTHER_PAGE = re.compile(r"docs/((?:tutorials|how_to|reference|explanation)/(\w+))\.md")


class Docstrings(Extension):
    """Griffe reads the sources alone: options that a decorator writes into a docstring, and all of the compiled core's,
    are not there."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.is_function and (obj.docstring is None or "{options}" in obj.docstring.value):
            words = inspect.getdoc(getattr(import_module(obj.module.path), obj.name, None)) or ""
            if obj.module.path == "vrte._core" or obj.docstring is not None:
                obj.docstring = Docstring(words, parent=obj, parser="numpy")
        if obj.docstring is not None:
            lines = obj.docstring.value.split("\n")
            obj.docstring.value = "\n".join(
                line if line.startswith((">>>", "...")) else link(line, obj) for line in lines
            )


def link(line: str, obj: Object) -> str:
    """Names in single backticks as links to where they are documented, names of pages as links to these."""
    if not line.startswith(" "):  # types that would be read as Python, and printed as other than they stand here
        line = re.sub(r"^([\w*, ]+ : )\{(.*)\}", r"\1one of \2", line)
        line = re.sub(r"^([\w*, ]+ : .*,.*) or ", "\\1\u00a0or ", line)
        line = re.sub(r"((?:^| : )(?:nd)?array\w*(?: of \w+)?) \(", "\\1\u00a0(", line)
    line = OTHER_PAGE.sub(lambda found: f"[{found[2].replace('_', ' ')}](../../{found[1]}.html)", line)
    return re.sub(r"(?<!`)`([\w.]+)`(?!`)", lambda found: refer(found[1], obj), line)


def refer(name: str, obj: Object) -> str:
    """A link to the first that a name may mean in a docstring: a member of its class, one of its module, or of vrte."""
    owner = obj if isinstance(obj, Class) else obj.parent
    if isinstance(owner, Class) and name in owner.all_members:
        return f"[`{name}`][{owner.all_members[name].path}]"
    for place in (f"{obj.module.path}.{name}", name, f"vrte.{name}"):
        if place in LISTED or place.rpartition(".")[0] in LISTED:
            return f"[`{name}`][{place}]"
    return f"`{name}`"
