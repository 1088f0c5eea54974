"""The tables of methods and of the rules of method="auto" in docs/methods.md, made from the registry and the rules."""

from pathlib import Path

from vrte.formats.atomic import atomic_write
from vrte.methods import method_of
from vrte.methods.auto.rules import RULES, Rule
from vrte.methods.parts.method import Method
from vrte.request.request import EXACT, METHODS
from vrte.studies.pages import markdown_table

BEGIN, END = "<!-- begin: python -m vrte.studies.methods docs/methods.md -->", "<!-- end -->"
BEGIN_RULES = "<!-- begin, too: python -m vrte.studies.methods docs/methods.md -->"
HEADER_RULES = ("rule", "where", "method", "nodes", "why")
HEADER = ("method", "source", "conserves", "for", "does not take", "settings (default)")
ABILITIES = {
    "polarization": "polarization",
    "layers": "several layers",
    "base": "a base",
    "depths": "depths inside",
    "transmission": "light below the top",
    "endless": "a layer without end",
}
OF_EXACT = (
    f"`{EXACT}`",
    "(1:12)-(1:66), (2:5)-(2:15)",
    "energy, to rounding",
    "everything, to the accuracy asked for",
    "-",
    "none: `nodes`, `accuracy`, `algorithm`, `truncation`",
)


def registry_table() -> str:
    """Markdown, a row a method, in the registry's order; the exact one first."""
    rows = [OF_EXACT, *(row_of(method_of(name)) for name in METHODS if name != EXACT)]
    return markdown_table(HEADER, rows)


def row_of(method: Method) -> tuple[str, ...]:
    """What a method says of itself."""
    lacking = ", ".join(words for name, words in ABILITIES.items() if not getattr(method, name))
    settings = "; ".join(
        f"`{name}` ({setting.default!r}): {setting.meaning}" for name, setting in method.settings.items()
    )
    return f"`{method.name}`", method.source, method.conserves, method.purpose, lacking or "-", settings or "-"


def rules_table() -> str:
    """Markdown, a row a rule of method="auto"."""
    return markdown_table(HEADER_RULES, (row_of_rule(place, rule) for place, rule in enumerate(RULES, 1)))


def row_of_rule(place: int, rule: Rule) -> tuple[str, ...]:
    """Its limits in words, and what it takes."""
    limits = [f"{name} <= {most:g}" if most else f"no {name}" for name, most in rule.at_most.items()]
    limits += [f"{name} >= {least:g}" for name, least in rule.at_least.items()]
    nodes = (
        f"estimated for the accuracy over {rule.margin:g}, not checked" if rule.margin else "as the method finds them"
    )
    return f"{place} ({rule.name})", ", ".join(limits) or "everywhere", f"`{rule.method}`", nodes, rule.why


def refreshed(text: str) -> str:
    """A page with its tables as they are now. Raises ValueError where the page has no place for one."""
    for mark, table in ((BEGIN, registry_table()), (BEGIN_RULES, rules_table())):
        before, begin, rest = text.partition(mark)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise ValueError(f"no line {mark!r} with {END!r} after it")
        text = f"{before}{mark}\n{table}{END}{after}"
    return text


def main(path: str) -> int:
    """Rewrites the tables of a page."""
    text = refreshed(Path(path).read_text(encoding="utf-8"))
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return 0
