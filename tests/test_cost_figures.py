"""Cost growth: the axes are what they are called, fits find exponents, a run writes what it says."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench import cost, tables
from bench.study import Study
from bench.tables import STEPS, TOTAL

from .conftest import call_study, rows_of
from .helpers import assert_close, close_to

FILES = {f"figure_{number}.png" for number in range(2, 10)} | {"figures.md", "measurements.csv"}
ONCE = {"configuration 2": {"threads": 1}, "OpenMP, 2 threads": {"threads": 2}}


def pretended(point: cost.Point, options: dict[str, Any]) -> dict[str, Any]:
    """Diagnostics of a solver whose eigenproblems cost the cube of the nodes, on any number of threads."""
    seconds = {"homogeneous": 1e-6 * point.nodes**3, "a stage to come": 1e-3 * point.outgoing, "fourier sum": 1e-3}
    stages = {name: {"wall_seconds": value / options["threads"]} for name, value in seconds.items()}
    total = sum(clock["wall_seconds"] for clock in stages.values())
    return {"wall_seconds": total + 1e-3, "orders": 7, "stages": stages}


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch) -> Study[cost.Point, str, cost.Measurement]:
    """Of no solver, nor a device."""
    monkeypatch.setattr(cost.Point, "solve", pretended)
    monkeypatch.setattr(tables, "explain_missing_device", lambda: "a test has none")
    return cost.make_study(cost.list_points(quick=True), ONCE, (3, 15, 0.0))


def test_a_power_law_is_found_where_there_are_points_enough() -> None:
    x = np.array([1.0, 2.0, 5.0, 30.0])
    for exponent in (-1.0, 0.0, 1.0, 2.7):
        fit = cost.fit_exponent(x, 0.02 * x**exponent)
        assert fit is not None
        assert [fit.exponent, fit.factor, fit.error] == close_to([exponent, 0.02, 0.0], rtol=0.0, atol=1e-7)
    for few, seconds in (([1.0, 2.0], [1.0, 2.0]), ([1.0, 2.0, 3.0], [1.0, 0.0, 3.0]), ([4.0] * 3, [1.0, 2.0, 3.0])):
        assert cost.fit_exponent(np.array(few), np.array(seconds)) is None


@pytest.mark.parametrize("quick", [False, True])
def test_the_axes_are_what_the_figures_show(quick: bool) -> None:
    points = cost.list_points(quick)
    for axis, (_, _, varied, *_) in cost.AXES.items():
        along = [point for point in points if point.axis == axis]
        assert (np.diff([point.value for point in along]) > 0.0).all(), axis
        assert len({replace(point, **{varied: 1}) for point in along}) == 1, "one thing varies on an axis"
        assert len(along) >= cost.FEWEST_POINTS
        assert all(point.terms <= 2 * point.nodes for point in along), "the nodes carry every term"
        assert all((point.incident is None) == (axis != "incident") for point in along)
        assert all(cost.find_claims(axis)[step] for step in (TOTAL, *STEPS))


@pytest.mark.parametrize("incident", [None, 3])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_solve_is_timed_step_by_step(incident: int | None, threads: int, tmp_path: Path) -> None:
    point = cost.Point(radius_um=0.2, nodes=9, outgoing=2, incident=incident)
    reported = dict([list(cost.list_configurations(threads).items())[-1]])
    point.solve(*reported.values())  # the first solve of a process loads modules
    (found,) = cost.make_study([point], reported, (1, 1, 0.0)).measure_rows(tmp_path)
    assert {TOTAL, *STEPS, cost.REST} <= set(found.steps)
    assert sum(found.steps.values()) == close_to(2.0 * found.seconds, rtol=1e-6, atol=0.0)
    assert 0 < found.orders_solved <= point.terms


def test_configurations_take_turns_and_medians_are_theirs(
    study: Study[cost.Point, str, cost.Measurement], tmp_path: Path
) -> None:
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
def test_the_quick_run_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert call_study("cost", "--quick", "--threads", "1", "-o", folder) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert {path.name for path in folder.iterdir()} == FILES
    assert all(f"wrote {folder / name}" in reported.out for name in FILES)
    rows = rows_of(folder / "measurements.csv")
    assert {row["axis"] for row in rows} == {"nodes", "outgoing", "orders", "incident"}
    assert all(float(row["total_s"]) >= float(row["homogeneous_s"]) > 0.0 for row in rows)
    text = (folder / "figures.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\((\S+\.png)\)", text)) == {name for name in FILES if name.endswith(".png")}
    assert "quick, configuration 2" in text
    chosen = [row for row in rows if (row["axis"], row["value"]) == ("nodes", "12")]
    totals = [float(row["total_s"]) for row in chosen if row["configuration"] == "configuration 2"]
    assert re.search(rf"^\| 12 \| \d+ \| {re.escape(f'{1e3 * np.median(totals):.1f}')} \|", text, re.MULTILINE)
