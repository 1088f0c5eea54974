"""What the site has beyond MkDocs: pages made of files outside docs/, formulas as MathML, links checked."""

import ast
import html
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))  # of bench

from bench.methods import Row  # noqa: E402
from bench.methods_page import make_html  # noqa: E402
from bench.study import Records  # noqa: E402

PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
LOBES = ROOT / "out/try/lobes.html"  # the page of docs/try.md
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds the README as home page, the changelog, and the examples with a page that lists them."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=lead_into_site((ROOT / source).read_text("utf-8"))))
    examples = [path for path in sorted((ROOT / "examples").iterdir()) if path.suffix in (".py", ".toml")]
    for path in examples:
        files.append(File.generated(config, f"examples/{path.name}", abs_src_path=str(path)))
    rows = [f"- [{path.name}](examples/{path.name}): {describe_example(path)}" for path in examples]
    files.append(File.generated(config, "CITATION.cff", abs_src_path=str(ROOT / "CITATION.cff")))
    files.append(File.generated(config, "explanation/methods/methods.html", content=draw_methods_report()))
    if not LOBES.is_file():
        raise PluginError(
            f"{LOBES.relative_to(ROOT)} is missing: docs/try/make_page.py writes it, and make docs calls that"
        )
    files.append(File.generated(config, "try/lobes.html", abs_src_path=str(LOBES)))
    text = "# Examples\n\nScripts and scene files to begin with, as they stand in the folder `examples`.\n\n"
    files.append(File.generated(config, "examples.md", content=text + "\n".join(rows) + "\n"))
    return files


def draw_methods_report() -> str:
    """The page of `python -m bench.methods`, with pictures that answer the pointer, of the runs kept in docs/."""
    rows = list(Records(Row, ROOT / "docs/explanation/methods/methods.csv").read().values())
    text = (ROOT / "docs/explanation/methods.md").read_text("utf-8")
    circumstances = text.split("## The last full report\n\n", 1)[1].split(". ", 1)[0].replace("\n", " ")
    return make_html(rows, [circumstances])


def lead_into_site(text: str) -> str:
    """A page of the top level with its links as from within docs/."""
    text = re.sub(r"(\]\(|src=\")docs/", r"\1", text)
    text = re.sub(r"\]\(examples/?\)", "](examples.md)", text)
    return re.sub(r"\]\((CHANGELOG|CONTRIBUTING)\.md", lambda found: f"]({found[1].lower()}.md", text)


def describe_example(path: Path) -> str:
    """First sentence of a script's docstring, or the first comment of a scene file."""
    text = path.read_text("utf-8")
    first = (ast.get_docstring(ast.parse(text)) or "") if path.suffix == ".py" else text.lstrip("# ")
    return first.splitlines()[0].split(" Usage:")[0]


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links that leave docs/ lead to the copies within the site."""
    up = "../" * page.file.src_uri.count("/")
    markdown = re.sub(rf"\]\({up}\.\./examples/?\)", f"]({up}examples.md)", markdown)
    markdown = markdown.replace(f"]({up}../examples/", f"]({up}examples/")
    return re.sub(
        rf"\]\({re.escape(up)}\.\./(CHANGELOG|CONTRIBUTING)\.md", lambda m: f"]({up}{m[1].lower()}.md", markdown
    )


def on_page_content(content: str, **_: Any) -> str:
    """Formulas typeset as MathML, which every browser draws without a script or a network."""

    def typeset(found: re.Match[str]) -> str:
        formula = html.unescape(found[2].strip())
        return convert(formula, display="block" if found[1] == "div" else "inline")

    return FORMULA.sub(typeset, content)


class Links(HTMLParser):
    """What a finished page links to and draws from, and the places in it that can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.fetched: list[str] = []  # what a browser fetches to show the page
        self.places: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.places |= {name for key in ("id", "name") if (name := given.get(key))}
        if tag not in ("base", "meta"):
            self.targets += [target for key in ("href", "src") if (target := given.get(key)) is not None]
        if given.get("src") or given.get("rel") == "stylesheet":
            self.fetched.append(given.get("src") or given.get("href") or "")


def on_post_build(config: Any) -> None:
    """Every link and picture of the finished site leads somewhere within it, and nothing is fetched from elsewhere."""
    site = Path(config.site_dir)
    pages = {path: Links(path.read_text("utf-8")) for path in site.rglob("*.html") if path.name != "404.html"}
    broken = [
        f"{path.relative_to(site)} -> {target}"
        for path, page in pages.items()
        for target in page.targets
        if not leads_somewhere(path, target, pages)
    ]
    broken += [
        f"{path.relative_to(site)} fetches {address} from elsewhere"
        for path, page in pages.items()
        for address in page.fetched
        if urlsplit(address).netloc
    ]
    if broken:
        raise PluginError("links and pictures that lead nowhere:\n" + "\n".join(sorted(set(broken))))


def leads_somewhere(page: Path, target: str, pages: dict[Path, Links]) -> bool:
    """Whether a link of a page leads to a file of the site, and to a place that this has; others are not asked."""
    address = urlsplit(target)
    if address.scheme or address.netloc:
        return address.scheme in ("http", "https", "data", "mailto")
    path = (page.parent / unquote(address.path)).resolve() if address.path else page
    path = path / "index.html" if path.is_dir() else path
    return path.is_file() and (path not in pages or unquote(address.fragment) in pages[path].places)
