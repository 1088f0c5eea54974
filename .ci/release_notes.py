"""Prints the section of CHANGELOG.md about a tag: python3 .ci/release_notes.py v1.2.3; exit code 1 without one."""

import re
import sys
from pathlib import Path

HEADING = re.compile(r"^## \[(.+?)\].*\n", re.MULTILINE)


def read_sections(text: str) -> dict[str, str]:
    """What stands below each heading of a changelog, by its version.

    >>> read_sections("# Changelog\\n## [Unreleased]\\n\\n## [1.2.3] - 2026-01-02\\n- News.\\n")
    {'Unreleased': '', '1.2.3': '- News.'}
    """
    parts = HEADING.split(text)
    return {version: below.strip() for version, below in zip(parts[1::2], parts[2::2], strict=True)}


def find_notes(tag: str, text: str) -> str:
    """The notes of a release, or SystemExit where the changelog is not ready for it."""
    sections = read_sections(text)
    notes = sections.get(tag.removeprefix("v"), "")
    if not notes:
        sys.exit(f"CHANGELOG.md says nothing of {tag}: it has {', '.join(sections)}")
    if sections.get("Unreleased"):
        sys.exit(f"CHANGELOG.md has entries under Unreleased: move them below the heading of {tag}")
    return notes


if __name__ == "__main__":
    print(find_notes(sys.argv[1], Path(__file__).parents[1].joinpath("CHANGELOG.md").read_text("utf-8")))
