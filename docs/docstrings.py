"""What the API reference makes of a docstring: what only the running package knows is filled in, names are links."""

import inspect
import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from griffe import Class, Docstring, Extension, Function, Object

PAGES = Path(__file__).parent / "reference/api"
PLACEHOLDER = re.compile(r"^\s*\{[\w, ]+\}$", re.MULTILINE)  # a line that vrte.request.how completes
ENTRY = re.compile(r"^::: (\S+)(?:\n    options:\n(?:      .*\n)*?      heading: (\S+))?", re.MULTILINE)
LISTED = {
    found[2] or found[1]: found[1] for page in PAGES.glob("*.md") for found in ENTRY.finditer(page.read_text("utf-8"))
}
SHORT = {name.rpartition(".")[2] for name in LISTED}
OTHER_PAGE = re.compile(r"docs/((?:tutorials|how_to|reference|explanation)/(\w+))\.md")


class Docstrings(Extension):
    """Griffe reads the sources alone: options that a decorator writes into a docstring, and all of the compiled core's,
    are not there."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        written = obj.docstring.value if obj.docstring else ""
        if isinstance(obj, Function) and (
            PLACEHOLDER.search(written) or (obj.module.path == "vrte._core" and not written)
        ):
            words = inspect.getdoc(getattr(import_module(obj.module.path), obj.name, None)) or ""
            obj.docstring = Docstring(words, parent=obj, parser="numpy")
        for each in getattr(obj, "parameters", []) if isinstance(obj, Function) else []:
            if (constant := str(each.default)).isidentifier() and constant.isupper():
                with suppress(ImportError):  # of the viewer, which no page is about
                    each.default = repr(getattr(import_module(obj.module.path), constant))
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
    line = OTHER_PAGE.sub(lambda found: f"[{found[2].replace('_', ' ')}](../../{found[1]}.md)", line)
    return re.sub(r"(?<!`)`([\w.]+)`(?!`)", lambda found: refer(found[1], obj), line)


def refer(name: str, obj: Object) -> str:
    """A link to the first that a name may mean in a docstring: a member of its class, one of its module, or of vrte."""
    owner = obj if isinstance(obj, Class) else obj.parent
    if isinstance(owner, Class) and name in owner.all_members and owner.name in SHORT:
        return f"[`{name}`][{owner.all_members[name].path}]"
    for place in (f"{obj.module.path}.{name}", name, f"vrte.{name}"):
        owner, _, member = place.rpartition(".")
        if place in LISTED or owner in LISTED:
            return f"[`{name}`][{LISTED.get(place) or f'{LISTED[owner]}.{member}'}]"
    return f"`{name}`"
