"""The paper's tables: configurations are what they are called, answers agree, no process is left, a run writes all."""

import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bench import processes, tables
from bench.processes import Child, Reply, Task
from bench.study import Tick, ignore_tick
from bench.tables import (
    BASELINE,
    DEVICE,
    FULL,
    FULL_SIZE,
    OPENCL,
    OWN_STEPS,
    SEQUENTIAL,
    SMALL,
    TABLE_2,
    TABLE_3,
    Configuration,
    choose_configurations,
)
from vrte.basics.blas import find_blas_libraries
from vrte.basics.errors import AccuracyError, SceneError

from .conftest import call_study
from .helpers import close_to

FILES = {"tables.md", "figure_1.png"}
SIEWERT, GOLD, MUELLER = SMALL
needs_baseline = pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64"}
    or any(library.internal_api != "openblas" for library in find_blas_libraries()),
    reason="baseline SIMD is a setting of OpenBLAS on x86",
)


@pytest.fixture(scope="module")
def both() -> Iterator[dict[str, Child]]:
    """A process of each setting, started where the user has set the baseline."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENBLAS_CORETYPE", "Prescott")
        with processes.start_processes(["baseline", "full"]) as found:
            assert os.environ["OPENBLAS_CORETYPE"] == "Prescott"
            yield found


def pretended(label: str, without_eigenvectors: bool) -> Reply:
    """A solve of 100 ms and more, step by step."""
    seconds = 0.1 + 0.01 * len(label)
    solution = {"doubling": 0.06, "joining": 0.01} if without_eigenvectors else {"homogeneous": 0.06, "boundary": 0.01}
    stages = {"planning": 0.001, "assembly": 0.005, **solution, "reconstruction": 0.004, "fourier sum": 0.002}
    return Reply(seconds, stages, {"doubling" if without_eigenvectors else "modes": 9}, 1.0)


@pytest.fixture
def all_measured() -> tables.Measured:
    """The paper's problems in every configuration, three rounds, by no solver."""
    rows = []
    for problem in FULL_SIZE:
        for each in Configuration:
            reply = pretended(each.label, each.linear_algebra == DEVICE)
            rows.append(tables.Solved(problem, each, reply, tables.Check(1e-13, None, reply.orders_by)))
            rows += 3 * [tables.Solved(problem, each, reply)]
    return tables.Measured(rows)


def measure(
    children: dict[str, Child],
    problems: list[tables.Problem],
    configurations: tuple[Configuration, ...],
    rounds: int,
    tick: Tick = ignore_tick,
) -> tables.Measured:
    """As the study does, on two threads."""
    study = tables.make_study(children, problems, configurations, rounds=rounds)
    return tables.Measured(study.measure_rows(Path(), tick=tick))


def test_six_configurations_are_table_1() -> None:
    numbered = {int(each.label): each for each in Configuration if each.label.isdecimal()}
    pairs = [(kernels, algebra) for kernels in (SEQUENTIAL, OPENCL) for algebra in (BASELINE, FULL, DEVICE)]
    assert [(numbered[n].kernels, numbered[n].linear_algebra) for n in range(1, 7)] == pairs
    assert {n for n, each in numbered.items() if each.algorithm == "modes"} == {1, 2, 4, 5}
    assert {n for n, each in numbered.items() if each.simd == "baseline"} == {1, 4}


@pytest.mark.parametrize(
    ("missing", "able", "reason"),
    [
        ("device", "1, 2, OpenMP baseline, OpenMP full, default", "configuration 6 needs an OpenCL device: none"),
        ("x86", "2, OpenMP full, default", "configuration 1 needs the baseline SIMD of an x86 processor, and this is"),
    ],
)
def test_what_a_machine_cannot_run_is_refused_by_name(
    missing: str, able: str, reason: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tables, "explain_missing_device", lambda: "none")
    monkeypatch.setattr(platform, "machine", lambda: "aarch64" if missing == "x86" else "x86_64")
    found, refused = choose_configurations()
    assert ", ".join(each.label for each in found) == able
    assert len(refused) == len(Configuration) - len(found)
    assert any(text.startswith(reason) for text in refused)
    assert call_study("tables", "--configurations", f"2,{reason.split()[1]}") == 2
    assert reason in capsys.readouterr().err


def test_steps_add_up_to_totals() -> None:
    """The paper's as printed; of our stages no time is lost between the steps."""
    for label in tables.LABELS:
        parts = sum(tables.SECONDS[TABLE_3, step][label] for step in tables.STEPS)
        assert parts == close_to(tables.SECONDS[TABLE_3, tables.TOTAL][label], rtol=0.0, atol=0.11)
    stages = {"planning": 1.0, "homogeneous": 2.0, "fourier sum": 4.0, "a stage to come": 8.0, "assembly": 16.0}
    found = tables.split_into_steps(40.0, stages)
    assert sum(found.values()) == 40.0
    assert (found["reconstruction"], found["assembly"], found[tables.OTHER]) == (4.0, 16.0, 18.0)


@needs_baseline
def test_each_process_has_its_own_simd(both: dict[str, Child]) -> None:
    """Whatever the user's own setting is: the fixture sets it to the baseline."""
    assert set(both["baseline"].hello.cores) <= set(processes.BASELINE_NAMES)
    assert not set(both["full"].hello.cores) & set(processes.BASELINE_NAMES)
    assert "Katmai" in processes.describe_processes(both, [])[0]


@needs_baseline
@pytest.mark.parametrize(
    "problem",
    [pytest.param(one, marks=pytest.mark.slow) for one in (SIEWERT, GOLD, MUELLER)],
    ids=lambda problem: problem.name,
)
def test_every_configuration_gives_the_default_answer(problem: tables.Problem, both: dict[str, Child]) -> None:
    found = measure(both, [problem], choose_configurations()[0], 0)
    tables.require_right_answers(found.rows)
    assert len(found.rows) == len(choose_configurations()[0])
    assert all((row.check.published is not None) == (problem is SIEWERT) for row in found.rows if row.check)


def test_wrong_answers_do_not_count(all_measured: tables.Measured) -> None:
    tables.require_right_answers(all_measured.rows)
    wrong = replace(all_measured.select("table 3", Configuration.FIVE)[0], check=tables.Check(2e-9, None, {}))
    with pytest.raises(AccuracyError, match=r"table 3 in configuration 5 \(off by 2\.0e-09\)$"):
        tables.require_right_answers([*all_measured.rows, wrong])
    assert not tables.Check(0.0, 2e-5, {}).passed


def test_configurations_take_turns(both: dict[str, Child]) -> None:
    ticks: list[tuple[int, int, str]] = []
    pair = (Configuration.TWO, Configuration.OPENMP_FULL)
    found = measure(both, [GOLD], pair, 2, lambda *told: ticks.append(told))
    assert [tick[:2] for tick in ticks] == [(done, 6) for done in range(7)]
    assert [tick[2] for tick in ticks[:-1]] == ["table 3, configuration 2", "table 3, OpenMP full"] * 3
    assert [row.check is None for row in found.rows] == [False] * 2 + [True] * 4, "the first, checked, is not timed"
    assert all(row.reply.seconds >= sum(row.reply.stages.values()) > 0.0 for row in found.rows)


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


@needs_baseline
def test_a_setting_that_does_not_take_is_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "choose_environment", lambda simd: {})
    with (
        pytest.raises(SceneError, match="where baseline SIMD was asked for: nothing is measured"),
        processes.start_processes(["baseline"]),
    ):
        pass


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
    child = int(parent.stdout.readline())
    time.sleep(0.2)  # in the middle of a solve
    parent.send_signal(number)
    parent.wait(10)
    parent.stdout.close()
    end = time.monotonic() + 5.0
    while is_there(child) and time.monotonic() < end:
        time.sleep(0.02)
    assert not is_there(child)


def is_there(pid: int) -> bool:
    """Whether the process runs; one that has ended but was not waited for does not."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@needs_baseline
def test_the_quick_run_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = tmp_path / "new"
    assert call_study("tables", "--quick", "--configurations", "1,2", "-o", folder) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert {path.name for path in folder.iterdir()} == FILES
    assert all(f"wrote {folder / name}" in reported.out for name in FILES)
    text = (folder / "tables.md").read_text(encoding="utf-8")
    assert "quick, 2 rounds" in text
    assert "baseline SIMD: openblas" in text


def test_the_page_sets_the_papers_numbers_beside_ours(all_measured: tables.Measured, tmp_path: Path) -> None:
    written = tables.write_page(all_measured, tmp_path, "a test", ["a fact", "not measured: configuration 9"])
    assert {path.name for path in written} == FILES
    text = (tmp_path / "tables.md").read_text(encoding="utf-8")
    assert "- a fact\n- not measured: configuration 9\n" in text
    for label, seconds in tables.SECONDS[TABLE_2, tables.TOTAL].items():
        ratios = f"{seconds / 2.74:#.3g} | {seconds / 0.11:#.3g}"
        assert f"| {label} | 110.0 (110.0 to 110.0) | 1.00 | {seconds:g} | {ratios} |" in text
    assert "| homogeneous | 60.00 | 60.00 | 60.00 \\* | 60.00 | 60.00 | 60.00 \\* | 60.00 | 60.00 | 60.00 |" in text
    assert "| homogeneous | 108 | 102 | - | 101 | 95.8 | - |" in text
    assert "| total | 263 | 258 | 286 | 80.7 | 77.8 | 102 |" in text
    assert "| reconstruction | 22.1 | 22 | 22.1 | 2.52 | 2.51 | 2.53 |" in text
    theirs, ours = tables.make_printed_bars(), tables.make_measured_bars(all_measured)
    assert list(theirs) == list(tables.LABELS)
    assert [sum(ours[each.label].values()) for each in Configuration] == close_to(
        [0.1 + 0.01 * len(each.label) for each in Configuration], rtol=1e-7, atol=0.0
    )
    left, right = tables.draw_step_costs(all_measured).axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("seconds", "milliseconds")
    assert len(right.patches) == len(Configuration) * len(OWN_STEPS)
