"""make bench-compare fails when it should, and keeps nothing that tells whose machine it was."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench import compare


def run_file(folder: Path, **ratios: float) -> Path:
    """What pytest-benchmark would have written of cases with these ratios to the floor."""
    cases: list[dict[str, Any]] = [
        {
            "name": name,
            "stats": {"median": 0.0123456, "data": [0.1, 0.2]},
            "extra_info": {
                "ratio_to_floor": 1.1 * ratio,
                "least_ratio_to_floor": ratio,
                "floor_seconds": 0.1,
                "stage_seconds": {"homogeneous": 0.01},
                "versions": ["it 1.0"],
            },
        }
        for name, ratio in ratios.items()
    ]
    cases.append({"name": "without a floor", "stats": {"median": 1.0}, "extra_info": {}})
    path = folder / "run.json"
    path.write_text(json.dumps({"machine_info": {"node": "a host"}, "benchmarks": cases}))
    return path


def call(what: str, path: Path, folder: Path) -> int:
    return compare.main([what, str(path), "--history", str(folder / "history")])


@pytest.mark.parametrize(("now", "code"), [(0.5, 0), (0.64, 0), (0.66, 1), (float("nan"), 1)])
def test_it_fails_above_1_3(now: float, code: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert call("save", run_file(tmp_path, one=0.5, two=2.0), tmp_path) == 0
    assert call("check", run_file(tmp_path, one=now, two=1.0, new=9.0), tmp_path) == code
    told = capsys.readouterr()
    assert ("one takes" in told.err) == (code == 1)
    assert "| two | 2.000 | 1.000 | 0.50 |" in told.out
    assert "| new | - | 9.000 | not in both |" in told.out


def test_the_last_run_saved_is_the_one_that_counts(tmp_path: Path) -> None:
    for ratio in (9.0, 0.5):
        assert call("save", run_file(tmp_path, one=ratio), tmp_path) == 0
    assert call("check", run_file(tmp_path, one=1.0), tmp_path) == 1
    assert sorted(path.name[:5] for path in (tmp_path / "history").iterdir()) == ["0001_", "0002_"]


def test_of_two_runs_the_best_counts(tmp_path: Path) -> None:
    assert call("save", run_file(tmp_path, one=0.5, two=0.5), tmp_path) == 0
    first = run_file(tmp_path, one=0.9, two=0.5)
    second = first.rename(tmp_path / "first.json"), run_file(tmp_path, one=0.5, two=0.9)
    assert call("check", second[0], tmp_path) == 1
    assert compare.main(["check", *map(str, second), "--history", str(tmp_path / "history")]) == 0


def test_what_is_saved_is_small_and_names_no_machine(tmp_path: Path) -> None:
    call("save", run_file(tmp_path, one=0.123456), tmp_path)
    (path,) = (tmp_path / "history").iterdir()
    text = path.read_text()
    assert "a host" not in text
    kept = json.loads(text)
    assert kept["versions"] == ["it 1.0"]
    assert kept["cases"] == {
        "one": {
            "median_seconds": 0.01235,
            "ratio_to_floor": 0.1358,
            "least_ratio_to_floor": 0.1235,
            "floor_seconds": 0.1,
            "stage_seconds": {"homogeneous": 0.01},
        }
    }


def test_nothing_to_compare_is_said(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert call("check", run_file(tmp_path, one=1.0), tmp_path) == 2
    assert "make bench-save" in capsys.readouterr().err
    assert call("save", run_file(tmp_path), tmp_path) == 2
    assert "no case with a ratio to the floor" in capsys.readouterr().err
