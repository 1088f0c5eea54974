"""The studies of vrte itself: what is wrong is said in one line before anything is measured or written."""

import sys
from pathlib import Path

import pytest

from .conftest import call, call_study

STUDIES = (["tables", "--quick"], ["cost"], ["methods", "--quick"], ["stability", "--quick"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("cost --threads 0", "--threads: must be a whole number"),
        ("tables --configurations 2,7", "there is no configuration '7'; there are 1, 2,"),
        ("methods --scenes nothing*", "--scenes must fit one of"),
        ("stability --cases nothing*", "matches no scene"),
        ("stability --algorithm guessing", "invalid choice"),
        ("stability --threads 0", "whole number from 1"),
        ("stability --colour", "unrecognized arguments"),
    ],
)
def test_bad_options_are_one_line_and_code_2(
    arguments: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call_study(*arguments.split(), "-o", tmp_path / "new") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("vrte: error: ")
    assert message in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("study", STUDIES, ids=" ".join)
def test_a_file_is_no_folder(study: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "here").write_text("")
    assert call_study(*study, "-o", tmp_path / "here") == 2
    assert "must be a folder" in capsys.readouterr().err


@pytest.mark.parametrize("study", STUDIES[:2], ids=" ".join)
def test_what_is_missing_is_said_before_anything_is_measured(
    study: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert call_study(*study, "-o", tmp_path / "new") == 1
    assert "needs the extra 'plot'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["tables", "report", "stability", "benchmarks"])
def test_the_command_says_where_the_study_is(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(name, "--quick") == 2
    assert f"run `make {name}` in its source tree" in capsys.readouterr().err
