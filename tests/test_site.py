"""The documentation site: every page has a place in it, and its checks find what they are for."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
MADE = {"index.md", "changelog.md", "contributing.md", "examples.md"}  # by docs/hooks.py


@pytest.fixture
def hooks() -> ModuleType:
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    pytest.importorskip("latex2mathml", reason="the extra docs is not installed")
    spec = importlib.util.spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_page_has_its_place_in_the_contents() -> None:
    contents = (ROOT / "mkdocs.yml").read_text().split("\nnav:\n")[1]
    named = set(re.findall(r"[\w/]+\.md", contents))
    pages = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    notebooks = {f"notebooks/{path.stem}.md" for path in (ROOT / "docs" / "notebooks").glob("*.py")}
    assert named == pages | notebooks | MADE
    assert len(pages) > 30


def test_a_formula_becomes_mathml_and_other_text_stays(hooks: ModuleType) -> None:
    content = r'<p>a &lt; b <span class="arithmatex">\(\mu &lt; 1\)</span></p>'
    typeset = hooks.on_page_content(content)
    assert typeset.startswith("<p>a &lt; b <math")
    assert "<mi>&#x003BC;</mi>" in typeset
    assert "<mo>&#x0003C;</mo>" in typeset
    assert 'display="block"' in hooks.on_page_content(r'<div class="arithmatex">\[x\]</div>')


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ('<a href="b.html#here">there is such a place</a><img src="pictures/c.png">', ""),
        ('<a href="https://example.org/x">elsewhere is not asked</a>', ""),
        ('<a href="nothing.html">x</a>', "a.html -> nothing.html"),
        ('<a href="b.html#nowhere">x</a>', "a.html -> b.html#nowhere"),
        ('<img src="pictures/d.png">', "a.html -> pictures/d.png"),
        ('<script src="https://example.org/x.js"></script>', "a.html fetches https://example.org/x.js from elsewhere"),
        ('<link rel="stylesheet" href="https://example.org/x.css">', "a.html fetches https://example.org/x.css"),
    ],
)
def test_links_that_lead_nowhere_are_found(hooks: ModuleType, tmp_path: Path, line: str, fault: str) -> None:
    from mkdocs.exceptions import PluginError

    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "c.png").write_bytes(b"")
    (tmp_path / "a.html").write_text(f"<html><body>{line}</body></html>")
    (tmp_path / "b.html").write_text('<html><body><h2 id="here">x</h2></body></html>')
    config = type("Config", (), {"site_dir": str(tmp_path)})()
    if not fault:
        hooks.on_post_build(config)
        return
    with pytest.raises(PluginError, match=re.escape(fault)):
        hooks.on_post_build(config)


def test_pages_of_the_top_level_lead_into_the_site(hooks: ModuleType) -> None:
    text = "![x](docs/images/x.png) [y](docs/how_to/y.md#z) [e](examples/) [p](examples/p.toml) [c](CONTRIBUTING.md)"
    assert hooks.lead_into_site(text) == (
        "![x](images/x.png) [y](how_to/y.md#z) [e](examples.md) [p](examples/p.toml) [c](contributing.md)"
    )
