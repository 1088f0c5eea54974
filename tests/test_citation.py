"""What the project says of itself says the same everywhere, and the changelog has a form that a release can read."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
CODEMETA = json.loads((ROOT / "codemeta.json").read_text())
CHANGELOG = (ROOT / "CHANGELOG.md").read_text()
HEADINGS = re.findall(r"^## .*$", CHANGELOG, re.MULTILINE)


def test_name_words_and_licence_are_those_of_the_package() -> None:
    assert CITATION["title"] == CODEMETA["name"] == PROJECT["name"]
    assert CITATION["abstract"] == CODEMETA["description"] == PROJECT["description"]
    assert CITATION["keywords"] == CODEMETA["keywords"] == PROJECT["keywords"]
    assert CITATION["license"] == PROJECT["license"] == CODEMETA["license"].rpartition("/")[2]
    assert (ROOT / "LICENSE").read_text().startswith("BSD 3-Clause License")
    authors = [author["name"] for author in PROJECT["authors"]]
    assert [author["name"] for author in CITATION["authors"]] == authors
    assert [author["name"] for author in CODEMETA["author"]] == authors


def test_version_and_date_are_those_of_the_changelogs_newest_section() -> None:
    """The version itself comes from a tag, which no file can know beforehand: this is the release that is meant."""
    version, date = re.fullmatch(r"## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)", HEADINGS[1]).groups()  # type: ignore[union-attr]
    assert CITATION["version"] == CODEMETA["version"] == version
    assert CITATION["date-released"] == CODEMETA["dateModified"] == date
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools_scm"]
    assert settings["fallback_version"] == f"{version}.dev0"


def test_the_changelog_has_sections_and_short_entries() -> None:
    assert HEADINGS[0] == "## [Unreleased]"
    assert all(re.fullmatch(r"## \[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", heading) for heading in HEADINGS[1:])
    kinds = {heading.partition(":")[0] for heading in re.findall(r"^### (.*)$", CHANGELOG, re.MULTILINE)}
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    for entry in re.findall(r"^- .*(?:\n  .*)*", CHANGELOG, re.MULTILINE):
        assert len(entry.splitlines()) <= 2, entry
        assert len(entry) <= 300, entry
        assert entry.endswith("."), entry


@pytest.mark.parametrize(
    "path", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem
)
def test_forms_for_issues_ask_for_a_version_where_something_is_wrong(path: Path) -> None:
    form = yaml.safe_load(path.read_text())
    if path.stem == "config":
        return
    required = {part["id"] for part in form["body"] if part.get("validations", {}).get("required")}
    assert form["name"]
    assert form["description"]
    assert required
    assert path.stem == "feature" or "version" in required
    assert path.stem != "number" or "reference" in required
