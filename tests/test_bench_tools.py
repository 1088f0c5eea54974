"""What measures vrte itself: examples in docstrings hold, `make bench-compare` fails when it should."""

import doctest
import importlib
import json
import pkgutil
from pathlib import Path
from typing import Any

import pytest

import bench
from bench import compare

MODULES = [
    found.name
    for found in pkgutil.walk_packages(bench.__path__, "bench.")
    if not found.name.rpartition(".")[-1].startswith(("test_", "conftest", "__main__"))
]


def test_examples_of_bench_hold() -> None:
    assert len(MODULES) > 15
    for name in MODULES:
        assert doctest.testmod(importlib.import_module(name)).failed == 0, name


def write_run(folder: Path, name: str = "run.json", **ratios: float) -> Path:
    """What pytest-benchmark would have written of cases with these ratios to the floor."""
    cases: list[dict[str, Any]] = [
        {
            "name": case,
            "stats": {"median": 0.0123456, "data": [0.1, 0.2]},
            "extra_info": {
                "ratio_to_floor": 1.1 * ratio,
                "least_ratio_to_floor": ratio,
                "floor_seconds": 0.1,
                "stage_seconds": {"homogeneous": 0.01},
                "versions": ["it 1.0"],
            },
        }
        for case, ratio in ratios.items()
    ]
    cases.append({"name": "without a floor", "stats": {"median": 1.0}, "extra_info": {}})
    path = folder / name
    path.write_text(json.dumps({"machine_info": {"node": "a host"}, "benchmarks": cases}))
    return path


def test_a_case_that_takes_1_3_times_the_last_run_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The best of two runs counts; what is kept is small and names no machine."""

    def call(what: str, *runs: Path) -> int:
        return compare.main([what, *map(str, runs), "--history", str(tmp_path / "history")])

    assert call("check", write_run(tmp_path, one=1.0)) == 2
    assert "make bench-save" in capsys.readouterr().err
    assert call("save", write_run(tmp_path)) == 2
    assert "no case with a ratio to the floor" in capsys.readouterr().err
    for ratio in (9.0, 0.5):  # the last one saved is what counts
        assert call("save", write_run(tmp_path, one=ratio, two=2.0)) == 0
    for now, code in ((0.5, 0), (0.64, 0), (0.66, 1), (float("nan"), 1)):
        assert call("check", write_run(tmp_path, one=now, two=1.0, new=9.0)) == code
        reported = capsys.readouterr()
        assert ("one takes" in reported.err) == (code == 1)
        assert "| two | 2.000 | 1.000 | 0.50 |" in reported.out
        assert "| new | - | 9.000 | not in both |" in reported.out
    slow, better = write_run(tmp_path, "slow.json", one=0.9, two=2.0), write_run(tmp_path, one=0.5, two=2.9)
    assert (call("check", better), call("check", slow, better)) == (1, 0)
    paths = sorted((tmp_path / "history").iterdir())
    assert [path.name[:5] for path in paths] == ["0001_", "0002_"]
    kept = json.loads(paths[0].read_text())
    assert "a host" not in paths[0].read_text()
    assert kept["versions"] == ["it 1.0"]
    assert kept["cases"]["one"] == {
        "median_seconds": 0.01235,
        "ratio_to_floor": 9.9,
        "least_ratio_to_floor": 9.0,
        "floor_seconds": 0.1,
        "stage_seconds": {"homogeneous": 0.01},
    }
