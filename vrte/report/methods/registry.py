"""The table of methods in docs/methods.md, made from the registry."""

from pathlib import Path

from vrte.formats.atomic import atomic_write
from vrte.methods import method_of
from vrte.methods.method import Method
from vrte.report.pages import markdown_table
from vrte.request import EXACT, METHODS

BEGIN, END = "<!-- begin: python -m vrte.report.methods docs/methods.md -->", "<!-- end -->"
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


def refreshed(text: str) -> str:
    """A page with its table as the registry has it. Raises ValueError where the page has no place for it."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"no line {BEGIN!r} with {END!r} after it")
    return f"{before}{BEGIN}\n{registry_table()}{END}{after}"


def main(path: str) -> int:
    """Rewrites the table of a page."""
    text = refreshed(Path(path).read_text(encoding="utf-8"))
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return 0
