"""The tables of docs/explanation/methods.md, of methods and of the rules of method="auto", made from the registry.

`python -m docs.scripts.methods_tables docs/explanation/methods.md` brings them up to date.
"""

import sys
from pathlib import Path
from typing import Any

from bench.study import make_markdown_table, write_text
from vrte.methods import find_method
from vrte.methods.parts.auto import RULES, Rule
from vrte.methods.parts.method import Method
from vrte.request.how import METHODS

BEGIN, END = "<!-- begin: python -m docs.scripts.methods_tables docs/explanation/methods.md -->", "<!-- end -->"
BEGIN_TAKEN = "<!-- begin, as well: python -m docs.scripts.methods_tables docs/explanation/methods.md -->"
BEGIN_RULES = "<!-- begin, too: python -m docs.scripts.methods_tables docs/explanation/methods.md -->"
HEADER_RULES = ("rule", "where", "method", "nodes", "why")
HEADER = ("method", "source", "conserves", "for", "settings (default)")
ABILITIES = {
    "polarization": "polarization",
    "base": "base",
    "interfaces": "interfaces, mirrors",
    "depths": "depths inside",
    "semi_infinite": "semi-infinite layer",
}
OPTIONS = ("nodes", "accuracy", "truncation", "algorithm", "verify")
KINDS: dict[Any, str] = {"any": "any", "even": "Lambertian", "smooth": "smooth", "none": "-"}


def make_registry_table() -> str:
    """Markdown, a row a method: what it is; the exact one first."""
    return make_markdown_table(HEADER, (make_registry_row(find_method(name)) for name in METHODS))


def make_registry_row(method: Method) -> tuple[str, ...]:
    """What a method says of itself."""
    settings = "; ".join(
        f"`{name}` ({setting.default!r}): {setting.meaning}" for name, setting in method.settings.items()
    )
    return f"`{method.name}`", method.source, method.conserves, method.purpose, settings or "-"


def make_abilities_table() -> str:
    """Markdown, a row a method: which scenes it takes, which options and backends."""
    header = ("method", *ABILITIES.values(), "devices", *(f"`{name}`" for name in OPTIONS))
    return make_markdown_table(header, (make_abilities_row(find_method(name)) for name in METHODS))


def make_abilities_row(method: Method) -> tuple[str, ...]:
    """Yes or -, of a method."""
    words = KINDS | {True: "yes", False: "-"}
    abilities = (words[getattr(method, name)] for name in (*ABILITIES, "devices"))
    options = (
        "-" if name not in method.options else f"to {method.finest:g}" if name == "accuracy" else "yes"
        for name in OPTIONS
    )
    return f"`{method.name}`", *abilities, *options


def make_rules_table() -> str:
    """Markdown, a row a rule of method="auto"."""
    return make_markdown_table(HEADER_RULES, (make_rules_row(place, rule) for place, rule in enumerate(RULES, 1)))


def make_rules_row(place: int, rule: Rule) -> tuple[str, ...]:
    """Its limits in words, and what it takes."""
    limits = [f"{name} <= {most:g}" if most else f"no {name}" for name, most in rule.at_most.items()]
    nodes = "as the method finds them"
    return f"{place} ({rule.name})", ", ".join(limits) or "everywhere", f"`{rule.method}`", nodes, rule.why


def refresh_tables(text: str) -> str:
    """A page with its tables as they are now. Raises ValueError where the page has no place for one."""
    for mark, table in (
        (BEGIN, make_registry_table()),
        (BEGIN_TAKEN, make_abilities_table()),
        (BEGIN_RULES, make_rules_table()),
    ):
        before, begin, rest = text.partition(mark)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise ValueError(f"no line {mark!r} with {END!r} after it")
        text = f"{before}{mark}\n{table}{END}{after}"
    return text


if __name__ == "__main__":
    page = Path(sys.argv[1])
    write_text(page, refresh_tables(page.read_text(encoding="utf-8")))
