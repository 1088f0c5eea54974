"""The stability table: its scenes cover what they say, its checks find errors, a run resumes and says what it found."""

import math
import re
import warnings
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench import stability, stability_cases
from bench.cases import Slab, find_phase_matrix
from bench.stability_cases import AXES, SURFACE_AXES, Case
from bench.study import Records

from .helpers import call_study, close_to, rows_of

SMALL = Case("small", 4, (Slab("rayleigh", 1.0, 1.0),), sun=0.6)
PATTERN = "thickness 0*"  # three cases


def checked(case: Case, **options: Any) -> dict[str, stability.Check]:
    """The checks of a case by name."""
    return {check.name: check for check in stability.examine_case(case, "none", stability.Options(**options))["checks"]}


def find_uncovered(rows: list[tuple[int, ...]], axes: dict[str, tuple[Any, ...]], strength: int) -> set[Any]:
    """Combinations of so many values of different axes that occur in no row."""
    values = [[(axis, value) for value in range(len(each))] for axis, each in enumerate(axes.values())]
    every = {cell for some in combinations(values, strength) for cell in product(*some)}
    return every.difference(*(combinations(tuple(enumerate(row)), strength) for row in rows))


@pytest.mark.parametrize(("name", "axes", "scenes"), [("plain", AXES, 300), ("under surfaces", SURFACE_AXES, 90)])
def test_the_covering_arrays_cover_every_pair_of_values(name: str, axes: Any, scenes: int) -> None:
    rows = stability_cases.read_covering_rows(name)
    assert len(rows) == len(set(rows)) == scenes
    assert not find_uncovered(rows, axes, 2)
    if name == "plain":
        assert len(find_uncovered(rows, axes, 3)) < 0.45 * len(find_uncovered([], axes, 3))


def test_haze_l_is_the_published_one() -> None:
    """Garcia and Siewert (1986): a1[1] = 2.41260 and a1[2] = 3.23047, for water spheres of this distribution."""
    assert find_phase_matrix("haze-L").a1[1:3] == close_to([2.41260, 3.23047], rtol=0.0, atol=2e-5)


def test_a_case_is_examined_in_full() -> None:
    found = checked(SMALL)
    assert {"energy", "reciprocity", "mirror symmetry", "layer cut otherwise", "both algorithms"} <= set(found)
    assert all(check.holds for check in found.values())
    white = checked(replace(SMALL, base_kind="white"))
    assert white["reflectance of 1"].value < 1e-13


def damage(how: str, field: vrte.Field) -> vrte.Field:
    """The field with something wrong in it."""
    stokes, up = field.stokes.copy(), field.flux_up.copy()
    if how == "nan":
        stokes[0, 0, 0, 0] = math.nan
    elif how == "absorbed":
        up[0] *= 1.0 - 1e-9
    elif how == "polarized":
        stokes[..., 1] = 1.1 * stokes[..., 0]
    elif how == "scaled":
        stokes[0] *= 1.0 + 1e-8
    elif how == "refused":
        raise vrte.AccuracyError("no")
    elif how == "divided":
        np.log(np.zeros(1))
    else:
        warnings.warn("negative", vrte.AccuracyWarning, stacklevel=1)
        warnings.warn("this will take long", vrte.LongSolveWarning, stacklevel=1)
    return replace(field, stokes=stokes, flux_up=up)


@pytest.mark.parametrize(
    ("how", "names"),
    [
        ("nan", ["not finite", "BRDF and radiance"]),
        ("absorbed", ["energy"]),
        ("polarized", ["physical light", "BRDF and radiance"]),
        ("scaled", ["BRDF and radiance"]),
        ("refused", ["refused: no"]),
        ("divided", ["divide by zero"]),
        ("warned", ["warnings (negative)"]),
    ],
)
def test_what_is_wrong_falls_short(how: str, names: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Too few nodes for a phase matrix are told and do not count."""
    solve = stability.solve_field
    monkeypatch.setattr(stability, "solve_field", lambda *given: damage(how, solve(*given)))
    short = stability.record_case(SMALL, {}, stability.Options()).shortfalls
    assert all(any(name in each for each in short) for name in names)
    if how == "warned":
        few = stability.record_case(Case("few", 4, (Slab("HG+0.99", 0.9, 1.0),), sun=0.6), {}, stability.Options())
        assert few.shortfalls == []
        assert any(check.name.startswith("warnings (") for check in few.checks)


def oracle_table(case: Case) -> dict[str, np.ndarray]:
    """As the ball-arithmetic oracle stores it, from the solver itself."""
    field = stability.solve_field(case, case.scene, stability.make_azimuths(case), "modes", None)
    table = {f"{case.name}/hash": np.array(case.key)} | stability.store_case(case)
    for m, values in stability.compute_fourier_orders(case, field.stokes, case.orders).items():
        table |= {f"{case.name}/{m}/radiance": values, f"{case.name}/{m}/c": np.array(1e-15)}
    both = {"flux_up": field.flux_up, "flux_down": field.flux_down}
    return table | {f"{case.name}/{name}": np.stack([flux, 0.0 * flux]) for name, flux in both.items()}


def test_an_oracle_is_compared_with() -> None:
    table = oracle_table(SMALL)
    record = stability.record_case(SMALL, table, stability.Options())
    assert (record.oracle, record.shortfalls) == ("yes", [])
    assert record.worst("oracle") < 1e-12
    table["small/1/radiance"] = table["small/1/radiance"] + 1e-6
    table["small/flux_down"] = table["small/flux_down"] * (1.0 + 1e-7)
    short = " ".join(stability.record_case(SMALL, table, stability.Options()).shortfalls)
    for part in ("order 1, up at the top", "order 1, inside", "order 1, down at the bottom", "fluxes", "transmitted"):
        assert part in short
    assert "order 0" not in short


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"sun": 0.7}, "out of date"),
        ({"name": "another"}, "missing"),
        ({"media": (1.0, 1.5, 1.0)}, "surfaces"),
        ({"nodes": 40}, "too many nodes"),
    ],
)
def test_an_oracle_that_does_not_fit_says_so(change: dict[str, Any], why: str) -> None:
    """What the oracle should have answered and has not falls short."""
    table, case = oracle_table(SMALL), replace(SMALL, **change)
    assert stability.find_oracle_answer(case, table) == why
    if why in stability.LEFT_OUT:
        short = stability.record_case(case, table, stability.Options()).shortfalls
        assert short == [f"the oracle's answer is {why}"]
    assert stability.find_oracle_answer(SMALL, {}) == "none"
    assert stability.find_oracle_answer(SMALL, {"small/hash": table["small/hash"]}) == "no stable answer"


def test_the_estimate_of_c_is_of_the_right_size() -> None:
    """T at omega = 1 and thickness 1e6 moves by 1e-4 per unit in the last place (256-bit arithmetic)."""
    thick = replace(SMALL, slabs=(Slab("rayleigh", 1.0, 1e6),))
    assert 3e-5 < stability.estimate_c(thick) < 1e-3
    assert stability.estimate_c(SMALL) < 1e-14


@pytest.mark.slow
def test_the_quick_run_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call_study("stability", "--quick", "-o", tmp_path / "out") == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert re.search(r"^\| all \| .* holds \|$", reported.out, re.MULTILINE)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"stability.md", "stability_cases.csv"}
    text = (tmp_path / "out" / "stability.md").read_text()
    tables = re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)
    assert len(tables) == 4
    for table in tables:
        bars = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(bars) == 1
    assert f"numpy {np.__version__}" in text
    assert "Nothing." in text
    examined = rows_of(tmp_path / "out" / "stability_cases.csv")
    assert [row["name"] for row in examined] == [case.name for case in stability_cases.choose_quick_cases()]


def test_a_run_that_was_killed_is_taken_up_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    examined: list[str] = []
    examine, log, most = stability.examine_case, tmp_path / "stability_cases.csv", [2]

    def counted(case: Case, *rest: Any) -> Any:
        if len(examined) == most[0]:
            raise KeyboardInterrupt
        examined.append(case.name)
        return examine(case, *rest)

    def run(*more: str) -> tuple[int, list[str]]:
        examined.clear()
        return call_study("stability", "--cases", PATTERN, "-o", tmp_path, *more), examined

    monkeypatch.setattr(stability, "examine_case", counted)
    assert run()[0] == 130
    header, first, second = log.read_text().splitlines()
    log.write_text(f"{header}\n{first}\n{second[:-50]}")  # killed while it wrote
    most[0] = 99
    every = [case.name for case in stability_cases.find_matching_cases(PATTERN)]
    for more, expected in (((), every[1:]), ((), []), (("--algorithm", "doubling"), every), (("--fresh",), every)):
        assert run(*more) == (0, expected)
    assert [record.name for record in Records(stability.Record, log).read().values()] == examined
    capsys.readouterr()


@pytest.mark.parametrize("known", [False, True])
def test_a_shortfall_is_exit_code_1_unless_its_reason_is_known(
    known: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stability, "ENERGY", -1.0)
    reasons = ("sun on*", "energy", "nothing is less than nothing"), ("sun on*", "net flux*", "nor this")
    monkeypatch.setattr(stability, "KNOWN", reasons if known else ())
    assert call_study("stability", "--cases", "sun on a node", "-o", tmp_path) == (0 if known else 1)
    reported, page = capsys.readouterr(), (tmp_path / "stability.md").read_text()
    line = r"vrte: error: 1 of 1 scenes fall short, the first: sun on a node: energy [^\n]+\n"
    assert re.fullmatch("" if known else line, reported.err)
    for text in (reported.out, page) if known else (page,):
        assert ("nothing is less than nothing" if known else "- sun on a node: energy") in text
    assert ("1 fall short" in reported.out) is not known
