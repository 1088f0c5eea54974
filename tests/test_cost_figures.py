"""Cost growth: the axes are what they are called, fits find exponents, a run writes what it says."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cost import measuring, page
from bench.cost.axes import PHI, Point, list_axes
from bench.tables import configurations
from bench.tables.paper import STEPS, TOTAL

from .conftest import call_study, rows_of
from .helpers import assert_close, close_to

ROOT = Path(__file__).parents[1]
POINT = Point(radius_um=0.2, nodes=9, outgoing=2)
POINT_12 = ("nodes", "12", "configuration 2")
FILES = {f"figure_{number}.png" for number in range(2, 10)} | {"figures.md", "measurements.csv"}


def pretended(point: Point, configuration: measuring.Configuration) -> dict[str, Any]:
    """Diagnostics of a solver whose eigenproblems cost the cube of the nodes, on any number of threads."""
    seconds = {"homogeneous": 1e-6 * point.nodes**3, "a stage to come": 1e-3 * point.outgoing, "fourier sum": 1e-3}
    stages = {name: {"wall_seconds": value / configuration.options["threads"]} for name, value in seconds.items()}
    total = sum(clock["wall_seconds"] for clock in stages.values())
    return {"wall_seconds": total + 1e-3, "orders": 7, "stages": stages}


@pytest.fixture
def no_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor a device: configuration 2, and OpenMP."""
    monkeypatch.setattr(measuring, "solve", pretended)
    monkeypatch.setattr(configurations, "explain_missing_device", lambda: "a test has none")


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1.0, 2.7])
def test_a_power_law_is_found(exponent: float) -> None:
    x = np.array([1.0, 2.0, 5.0, 30.0])
    fit = measuring.fit_exponent(x, 0.02 * x**exponent)
    assert fit is not None
    assert (fit.lowest, fit.highest, fit.points) == (1.0, 30.0, 4)
    assert_close([fit.exponent, fit.factor], [exponent, 0.02], rtol=0.0, atol=1e-12)
    assert fit.error < 1e-7
    assert_close(fit.at(x), 0.02 * x**exponent, rtol=1e-7, atol=0.0)


def test_the_error_is_the_scatter_of_the_exponent() -> None:
    random, x = np.random.default_rng(5), np.geomspace(1.0, 100.0, 8)
    fits = [measuring.fit_exponent(x, x**2 * np.exp(0.1 * random.standard_normal(8))) for _ in range(400)]
    exponents, errors = np.array([(fit.exponent, fit.error) for fit in fits if fit is not None]).T
    assert abs(exponents.mean() - 2.0) < 4.0 * exponents.std() / 20.0
    assert np.sqrt((errors**2).mean()) == close_to(exponents.std(), rtol=0.1, atol=0.0)


@pytest.mark.parametrize(("x", "seconds"), [([1, 2], [1, 2]), ([1, 2, 3], [1, 0, 3]), ([4, 4, 4], [1, 2, 3])])
def test_too_few_points_have_no_exponent(x: list[float], seconds: list[float]) -> None:
    assert measuring.fit_exponent(x, seconds) is None


def test_the_upper_half_sees_less_of_a_constant() -> None:
    x = 2.0 ** np.arange(11)
    upper = measuring.mark_upper_half(x)
    assert x[upper].tolist() == [32.0, 64.0, 128.0, 256.0, 512.0, 1024.0]
    seconds = 20.0 + x
    whole, half = measuring.fit_exponent(x, seconds), measuring.fit_exponent(x[upper], seconds[upper])
    assert whole is not None
    assert half is not None
    assert whole.exponent < half.exponent < 1.0


@pytest.mark.parametrize("quick", [False, True])
def test_the_axes_are_what_the_figures_show(quick: bool) -> None:
    each = list_axes(quick)
    assert [number for axis in each for number in axis.figures] == list(range(2, 10))
    for axis, varied in zip(each, ("nodes", "outgoing", "radius_um", "incident"), strict=True):
        assert (np.diff(axis.values) > 0.0).all(), axis.name
        assert len({replace(point, **{varied: 1}) for point in axis.points}) == 1, "one thing varies on an axis"
        assert axis.values.size >= measuring.FEWEST_POINTS
        assert all(point.terms <= 2 * point.nodes for point in axis.points), "the nodes carry every term"
        assert all((point.incident is None) == (axis.name != "incident") for point in axis.points)


def test_the_orders_of_expansion_are_those_of_the_paper() -> None:
    orders = list_axes()[2]
    radii = [point.radius_um for point in orders.points]
    assert (radii[0], radii[-1]) == (0.2, 0.7)
    assert radii == sorted(radii)
    assert orders.values.tolist() == sorted(point.scene.layers[0].phase_matrix.terms for point in orders.points)
    layer = Point().scene.layers[0]
    assert (layer.thickness, Point().nodes, Point().outgoing, PHI.size) == (100.0, 40, 11, 19)
    assert np.array_equal(layer.phase_matrix.a1, vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4).phase_matrix.a1)


def test_the_paper_says_something_of_each_of_its_steps() -> None:
    for axis in list_axes(quick=True):
        assert all(axis.claims[step] for step in (TOTAL, *STEPS))


@pytest.mark.parametrize("incident", [None, 3])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_solve_is_timed_step_by_step(incident: int | None, threads: int) -> None:
    (axis, *_), point = list_axes(quick=True), replace(POINT, incident=incident)
    configuration = measuring.list_configurations(threads)[-1]
    measuring.solve(point, configuration)  # the first of a process loads modules, as `measure` knows
    found = measuring.measure_point(axis, point, configuration, 0)
    steps = found.steps
    assert {TOTAL, *STEPS, measuring.REST} <= set(steps)
    assert sum(steps.values()) == close_to(2.0 * found.seconds, rtol=1e-6, atol=0.0)
    assert 0 < found.orders_solved <= point.terms


def test_stages_not_known_here_are_steps_of_their_own() -> None:
    stages = {"fourier sum": 1.0, "reconstruction": 2.0, "a stage to come": 4.0}
    found = measuring.Measurement("nodes", 9.0, POINT, "", 0, 8.0, 1, stages)
    assert found.steps == {"total": 8.0, "reconstruction": 3.0, "a stage to come": 4.0, measuring.REST: 1.0}


@pytest.mark.usefixtures("no_solver")
def test_configurations_take_turns_and_medians_are_theirs() -> None:
    varied, ticks = list_axes(quick=True), []
    found = measuring.measure(varied, measuring.list_configurations(2), 0.0, lambda *told: ticks.append(told))
    points = sum(len(axis.points) for axis in varied)
    solves = points * measuring.FEWEST_ROUNDS
    assert [tick[:2] for tick in ticks] == [(done, solves) for done in range(solves + 1)]
    assert len(found) == 2 * solves
    assert [each.round for each in found] == sorted(each.round for each in found), "one round after another"
    assert [each.configuration for each in found[:4]] == ["configuration 2", "OpenMP, 2 threads"] * 2
    lines = measuring.collect_series(found, "nodes", "OpenMP, 2 threads")
    assert list(lines) == ["total", "homogeneous", "a stage to come", "reconstruction", measuring.REST]
    np.testing.assert_array_equal(lines["homogeneous"].x, varied[0].values)
    assert_close(lines["homogeneous"].seconds, 0.5e-6 * varied[0].values ** 3, rtol=1e-7, atol=0.0)
    text = page.describe_exponents(found, varied, ["configuration 2"])
    assert re.search(r"homogeneous +3 \(3\.A\) +3\.00 ± 0\.00", text)
    assert re.search(r"a stage to come +- +1\.00 ± 0\.00", text)


@pytest.mark.usefixtures("no_solver")
def test_a_configuration_that_cannot_run_is_named() -> None:
    assert [each.name for each in measuring.list_configurations(1)] == ["configuration 2"]
    assert measuring.explain_missing_configurations() == ["configuration 5 needs an OpenCL device: a test has none"]


def test_series_hold_median_and_extremes() -> None:
    found = [
        measuring.Measurement("nodes", 9.0, POINT, "one", number, seconds, 1)
        for number, seconds in enumerate([5, 1, 2])
    ]
    total = measuring.collect_series(found, "nodes", "one")["total"]
    assert [values.tolist() for values in (total.x, total.least, total.seconds, total.greatest)] == [[9], [1], [2], [5]]


@pytest.mark.slow
def test_the_quick_run_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert call_study("cost", "--quick", "--threads", "1", "-o", folder) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert {path.name for path in folder.iterdir()} == FILES
    for name in FILES:
        assert f"wrote {folder / name}" in told.out
    for picture in folder.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert picture.stat().st_size < 80_000
    rows = rows_of(folder / "measurements.csv")
    assert {row["axis"] for row in rows} == {"nodes", "outgoing", "orders", "incident"}
    assert all(float(row["total_s"]) >= float(row["homogeneous_s"]) > 0.0 for row in rows)
    text = (folder / "figures.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\((\S+\.png)\)", text)) == {name for name in FILES if name.endswith(".png")}
    assert "quick, configuration 2" in text
    assert "nodes | orders solved | total [ms], configuration 2" in text
    totals = [float(row["total_s"]) for row in rows if (row["axis"], row["value"], row["configuration"]) == POINT_12]
    assert re.search(rf"^\| 12 \| \d+ \| {re.escape(f'{1e3 * np.median(totals):.1f}')} \|", text, re.MULTILINE)


@pytest.mark.usefixtures("no_solver")
def test_a_stage_that_did_not_run_everywhere_has_gaps(tmp_path: Path) -> None:
    varied, names = list_axes(quick=True)[:1], ["configuration 2"]
    found = measuring.measure(varied, measuring.list_configurations(1), 0.0)
    found = [replace(each, stages={"homogeneous": 1e-3}) if each.value == 12.0 else each for each in found]
    page.write_page(found, varied, names, tmp_path, "a test")
    rows = rows_of(tmp_path / page.CSV)
    assert {row["a_stage_to_come_s"] == "" for row in rows if row["value"] == "12"} == {True}
    assert len(list(tmp_path.glob("*.png"))) == 2


@pytest.mark.usefixtures("no_solver")
def test_what_goes_wrong_leaves_the_last_run_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "figure_2.png").write_text("the last run")

    def fails(*_: Any, **__: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("PIL.Image.Image.save", fails)
    assert call_study("cost", "--quick", "-o", tmp_path) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["figure_2.png"]
    assert (tmp_path / "figure_2.png").read_text() == "the last run"


def test_a_core_without_openmp_is_measured_on_one_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("vrte._core.HAS_OPENMP", False)
    assert call_study("cost", "-o", tmp_path / "new") == 2
    assert "without OpenMP" in capsys.readouterr().err
    assert {configuration.options["threads"] for configuration in measuring.list_configurations(1)} == {1}
    assert not list(tmp_path.iterdir())


def test_steps_of_our_own_have_colours_of_their_own() -> None:
    steps = ["order bounds", "homogeneous", "a stage to come", measuring.REST]
    colours = page.choose_colours(steps)
    assert len({colours[step] for step in steps}) == len(steps)
