"""What measures vrte itself: the paper's tables and how cost grows, in processes of two SIMD settings; command lines,
the comparison of benchmark runs, examples in docstrings."""

import doctest
import importlib
import json
import os
import pkgutil
import platform
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import bench
from bench import compare, cost, processes, tables
from bench.processes import Child, Reply, Task
from bench.study import Study
from bench.tables import SMALL, STEPS, TOTAL, Configuration
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import find_blas_libraries

from .helpers import assert_close, call_study, close_to, rows_of, wait_until

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
    line: str, code: int, message: str, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
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


@pytest.fixture(scope="module")
def both() -> Iterator[dict[str, Child]]:
    """A process of each setting, started where the user has set the baseline."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENBLAS_CORETYPE", "Prescott")
        with processes.start_processes(["baseline", "full"]) as found:
            assert os.environ["OPENBLAS_CORETYPE"] == "Prescott"
            yield found


@pytest.mark.parametrize(
    ("missing", "able", "reason"),
    [
        ("device", "1, 2, OpenMP baseline, OpenMP full, default", "configuration 6 needs an OpenCL device: none"),
        ("x86", "2, OpenMP full, default", "configuration 1 needs the baseline SIMD of an x86 processor, and this is"),
    ],
)
def test_what_a_machine_cannot_run_is_refused_by_name(
    missing: str, able: str, reason: str, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(tables, "explain_missing_device", lambda: "none")
    monkeypatch.setattr(platform, "machine", lambda: "aarch64" if missing == "x86" else "x86_64")
    found, refused = tables.choose_configurations()
    assert ", ".join(each.label for each in found) == able
    assert len(refused) == len(Configuration) - len(found)
    assert any(text.startswith(reason) for text in refused)
    assert call_study("tables", "--configurations", f"2,{reason.split()[1]}") == 2
    assert reason in capsys.readouterr().err


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


def test_what_the_solver_raises_is_raised_here(both: dict[str, Child]) -> None:
    with pytest.raises(SceneError, match=r"^algorithm must be"):
        both["full"].solve(Task(GOLD, {"algorithm": "guess"}))
    with pytest.raises(ChildProcessError, match=r"^TypeError: .*'colour'"):
        both["full"].solve(Task(GOLD, {"colour": 3}))
    assert both["full"].solve(Task(GOLD, {})).answer is None, "it goes on after that"
    with processes.start_processes(["full"]) as found:
        found["full"].process.kill()
        with pytest.raises(ChildProcessError, match="for full SIMD has died with code -9"):
            found["full"].solve(Task(GOLD, {}))


PARENT = """
from bench.tables import FULL_SIZE
from bench.processes import Task, start_processes
if __name__ == "__main__":
  with start_processes(["full"]) as found:
    print(found["full"].process.pid, flush=True)
    while True:
        found["full"].solve(Task(FULL_SIZE[2], {"threads": 1, "algorithm": "doubling"}))
"""


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.slow
def test_no_process_is_left_when_its_parent_is_gone(number: int) -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert parent.stdout is not None
    child = psutil.Process(int(parent.stdout.readline()))
    time.sleep(0.2)  # in the middle of a solve
    parent.send_signal(number)
    parent.wait(10)
    parent.stdout.close()
    wait_until(lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE, 5.0)


def test_a_power_law_is_found_where_there_are_points_enough() -> None:
    x = np.array([1.0, 2.0, 5.0, 30.0])
    for exponent in (-1.0, 0.0, 1.0, 2.7):
        fit = cost.fit_exponent(x, 0.02 * x**exponent)
        assert fit is not None
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
