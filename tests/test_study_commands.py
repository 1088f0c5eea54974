"""The studies of vrte itself: what is wrong is said in one line before anything is measured or written."""

import sys
from pathlib import Path

import pytest

from .conftest import call_study


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("cost --threads 0 -o new", 2, "--threads: must be a whole number"),
        ("tables --configurations 2,7 -o new", 2, "there is no configuration '7'; there are 1, 2,"),
        ("methods --scenes nothing* -o new", 2, "--scenes must fit one of"),
        ("stability --cases nothing* -o new", 2, "matches no scene"),
        ("stability --algorithm guessing -o new", 2, "invalid choice"),
        ("stability --threads 0 -o new", 2, "whole number from 1"),
        ("stability --colour -o new", 2, "unrecognized arguments"),
        ("methods --quick -o file", 2, "must be a folder"),
        ("tables --quick -o new", 1, "needs the extra 'plot'"),
        ("cost -o new", 1, "needs the extra 'plot'"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_measured(
    line: str,
    code: int,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    if code == 1:
        monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert call_study(*line.split()) == code
    (complaint,) = capsys.readouterr().err.splitlines()
    assert complaint.startswith("vrte: error: ")
    assert message in complaint
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
