"""What measures vrte itself: the paper's tables and how cost grows, in processes of two SIMD settings; command lines,
the comparison of benchmark runs, examples in docstrings."""

import doctest
import importlib
import json
import os
import pkgutil
import platform
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bench
from bench import compare, cost, processes, tables
from bench.processes import Child, Reply
from bench.study import Study
from bench.tables import SMALL, STEPS, TOTAL, Configuration
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import find_blas_libraries

from .helpers import assert_close, call_study, close_to, rows_of

GOLD = SMALL[1]
PAGES = {
    "tables": {"tables.md", "figure_1.png"},
    "cost": {f"figure_{number}.png" for number in range(2, 10)} | {"figures.md", "measurements.csv"},
}
ONCE = {"configuration 2": {"threads": 1}, "OpenMP, 2 threads": {"threads": 2}}
needs_baseline = pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64"}
    or any(library.internal_api != "openblas" for library in find_blas_libraries()),
    reason="baseline SIMD is a setting of OpenBLAS on x86",
)


def test_examples_of_bench_hold() -> None:
    names = [found.name for found in pkgutil.walk_packages(bench.__path__, "bench.")]
    modules = [name for name in names if not name.rpartition(".")[-1].startswith(("test_", "conftest", "__main__"))]
    assert len(modules) > 15
    for name in modules:
        assert doctest.testmod(importlib.import_module(name)).failed == 0, name


@pytest.fixture(scope="module")
def both() -> Iterator[dict[str, Child]]:
    """A process of each setting, started where the user has set the baseline."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENBLAS_CORETYPE", "Prescott")
        with processes.start_processes(["baseline", "full"]) as found:
            assert os.environ["OPENBLAS_CORETYPE"] == "Prescott"
            yield found


@needs_baseline
def test_each_process_has_its_own_simd(both: dict[str, Child], monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the user's own setting is: the fixture sets it to the baseline; a setting that does not take is not
    measured."""
    assert set(both["baseline"].hello.cores) <= set(processes.BASELINE_NAMES)
    assert not set(both["full"].hello.cores) & set(processes.BASELINE_NAMES)
    assert "Katmai" in processes.describe_processes(both, [])[0]
    monkeypatch.setattr(processes, "choose_environment", lambda simd: {})
    asked_for = processes.start_processes(["baseline"])
    with pytest.raises(SceneError, match="where baseline SIMD was asked for: nothing is measured"), asked_for:
        pass


def test_wrong_answers_do_not_count() -> None:
    right = tables.Solved(GOLD, Configuration.FIVE, Reply(0.1, {}, {}), tables.Check(1e-13, None, {}))
    tables.require_right_answers([right])
    wrong = replace(right, check=tables.Check(2e-9, None, {}))
    with pytest.raises(AccuracyError, match=rf"{GOLD.name} in configuration 5 \(off by 2\.0e-09\)$"):
        tables.require_right_answers([right, wrong])
    assert not tables.Check(0.0, 2e-5, {}).passed


def test_the_first_solve_is_checked_and_not_timed(both: dict[str, Child]) -> None:
    pair = (Configuration.TWO, Configuration.OPENMP_FULL)
    rows = tables.make_study(both, [GOLD], pair, rounds=2).measure_rows(Path())
    assert [row.configuration for row in rows] == [*pair] * 3
    assert [row.check is None for row in rows] == [False] * 2 + [True] * 4
    assert all(row.reply.seconds >= sum(row.reply.stages.values()) > 0.0 for row in rows)


def test_a_power_law_is_found_where_there_are_points_enough() -> None:
    x = np.array([1.0, 2.0, 5.0, 30.0])
    for exponent in (-1.0, 0.0, 1.0, 2.7):
        fit = cost.fit_exponent(x, 0.02 * x**exponent)
        assert [fit.exponent, fit.factor, fit.error] == close_to([exponent, 0.02, 0.0], rtol=0.0, atol=1e-7)
    for few, seconds in (([1.0, 2.0], [1.0, 2.0]), ([1.0, 2.0, 3.0], [1.0, 0.0, 3.0]), ([4.0] * 3, [1.0, 2.0, 3.0])):
        assert cost.fit_exponent(np.array(few), np.array(seconds)) is None


@pytest.mark.parametrize(("incident", "threads"), [(None, 1), (3, 2)])
def test_a_solve_is_timed_step_by_step(incident: int | None, threads: int, tmp_path: Path) -> None:
    point = cost.Point(radius_um=0.2, nodes=9, outgoing=2, incident=incident)
    reported = dict([list(cost.list_configurations(threads).items())[0 if threads == 1 else -1]])
    point.solve(*reported.values())  # the first solve of a process loads modules
    (found,) = cost.make_study([point], reported, (1, 1, 0.0)).measure_rows(tmp_path)
    assert {TOTAL, *STEPS, cost.REST} <= set(found.steps)
    assert sum(found.steps.values()) == close_to(2.0 * found.seconds, rtol=1e-6, atol=0.0)
    assert 0 < found.orders_solved <= point.terms


def pretend_solve(point: cost.Point, options: dict[str, Any]) -> dict[str, Any]:
    """Diagnostics of a solver whose eigenproblems cost the cube of the nodes, on any number of threads."""
    seconds = {"homogeneous": 1e-6 * point.nodes**3, "a stage to come": 1e-3 * point.outgoing, "fourier sum": 1e-3}
    stages = {name: {"wall_seconds": value / options["threads"]} for name, value in seconds.items()}
    total = sum(clock["wall_seconds"] for clock in stages.values())
    return {"wall_seconds": total + 1e-3, "orders": 7, "stages": stages}


def test_configurations_take_turns_and_medians_are_theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost.Point, "solve", pretend_solve)
    monkeypatch.setattr(tables, "explain_missing_device", lambda: "a test has none")
    study: Study[Any, Any, Any] = cost.make_study(cost.list_points(quick=True), ONCE, (3, 15, 0.0))
    ticks: list[tuple[int, int, str]] = []
    found = study.measure_rows(tmp_path, tick=lambda *told: ticks.append(told))
    solves = 3 * 2 * len(study.cases)
    assert [tick[:2] for tick in ticks] == [(done, solves) for done in range(solves + 1)]
    assert [each.round for each in found] == sorted(each.round for each in found), "one round after another"
    assert [each.configuration for each in found[:4]] == ["configuration 2", "OpenMP, 2 threads"] * 2
    lines = cost.collect_series(found, "nodes")["OpenMP, 2 threads"]
    assert list(lines) == ["total", "homogeneous", "a stage to come", "reconstruction", cost.REST]
    assert_close(lines["homogeneous"].seconds, 0.5e-6 * lines["total"].x ** 3, rtol=1e-7, atol=0.0)
    text = cost.describe_exponents(found)
    assert re.search(r"homogeneous +3 \(3\.A\) +3\.00 ± 0\.00", text)
    assert re.search(r"a stage to come +- +1\.00 ± 0\.00", text)
    assert "not measured: configuration 5 needs an OpenCL device: a test has none" in text
    assert len({cost.choose_colours(list(lines))[step] for step in list(lines)[1:]}) == len(lines) - 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"), [pytest.param("tables", [], marks=needs_baseline), ("cost", ["--threads", "1"])]
)
def test_the_quick_run_writes_what_it_says(name: str, more: list[str], tmp_path: Path, capsys: Any) -> None:
    """It ends in an error where an answer of a configuration is not the default's."""
    folder = tmp_path / "new"
    assert call_study(name, "--quick", *more, "-o", folder) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert {path.name for path in folder.iterdir()} == PAGES[name]
    assert all(f"wrote {folder / each}" in reported.out for each in PAGES[name])
    if name == "tables":
        assert "quick, 2 rounds" in (folder / "tables.md").read_text(encoding="utf-8")
        return
    rows = rows_of(folder / "measurements.csv")
    assert {row["axis"] for row in rows} == {"nodes", "outgoing", "orders", "incident"}
    assert all(float(row["total_s"]) >= float(row["homogeneous_s"]) > 0.0 for row in rows)
    text = (folder / "figures.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\((\S+\.png)\)", text)) == {each for each in PAGES[name] if each.endswith(".png")}
    chosen = [row for row in rows if (row["axis"], row["value"]) == ("nodes", "12")]
    totals = [float(row["total_s"]) for row in chosen if row["configuration"] == "configuration 2"]
    assert re.search(rf"^\| 12 \| \d+ \| {re.escape(f'{1e3 * np.median(totals):.1f}')} \|", text, re.MULTILINE)


def write_run(folder: Path, name: str = "run.json", **ratios: float) -> Path:
    """What pytest-benchmark would have written of cases with these ratios to the floor."""
    known = {"floor_seconds": 0.1, "stage_seconds": {"homogeneous": 0.01}, "versions": ["it 1.0"]}
    cases: list[dict[str, Any]] = [{"name": "without a floor", "stats": {"median": 1.0}, "extra_info": {}}]
    for case, ratio in ratios.items():
        extra = known | {"ratio_to_floor": 1.1 * ratio, "least_ratio_to_floor": ratio}
        cases.append({"name": case, "stats": {"median": 0.0123456, "data": [0.1, 0.2]}, "extra_info": extra})
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
    ratios = {"ratio_to_floor": 9.9, "least_ratio_to_floor": 9.0, "floor_seconds": 0.1}
    assert kept["cases"]["one"] == {"median_seconds": 0.01235, **ratios, "stage_seconds": {"homogeneous": 0.01}}
