"""The report on methods: errors are what they are called, runs are taken up again, the page needs no network."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench import methods, methods_page, other_codes
from bench.methods import MEASURED, REFUSED, Row
from bench.study import Records
from docs.scripts import methods_tables, radiance_factor
from vrte.basics.errors import SceneError
from vrte.methods import find_method
from vrte.request.how import METHODS

from .helpers import assert_close, close_to

ROOT = Path(__file__).parents[1]
CURVE = methods.Curve("modes", "discrete-ordinates", methods.vary_nodes((2, 8), algorithm="modes"))
ONCE = methods.Pace(seconds=0.0, fewest=1, most=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `python -m bench.report --quick` wrote."""
    made = tmp_path_factory.mktemp("report")
    assert methods.main(["--quick", "-o", str(made)]) == 0
    return made


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[Row]:
    return list(Records(Row, folder / methods.CSV).read().values())


def run(folder: Path, curve: methods.Curve = CURVE, **how: bool) -> list[Row]:
    """One small scene by one curve."""
    return methods.make_study([*methods.SMALL][:1], [curve], folder, ONCE).measure_rows(folder, **how)


@pytest.mark.slow
def test_every_method_and_scene_has_its_rows(rows: list[Row], folder: Path) -> None:
    assert {row.method for row in rows} == set(METHODS) | {peer.name for peer in other_codes.list_installed()}
    assert {row.scene for row in rows} == set(tuple(methods.SMALL))
    assert all(row.status.startswith((MEASURED, REFUSED)) for row in rows), [row.status for row in rows]
    with open(folder / methods.CSV, encoding="utf-8", newline="") as file:
        assert (
            len(list(csv.DictReader(file)))
            == len(rows)
            == len(tuple(methods.SMALL)) * sum(len(each.settings) for each in methods.list_curves(True))
        )


@pytest.mark.slow
def test_rows_of_auto_say_what_it_took(rows: list[Row], folder: Path) -> None:
    found = [row for row in rows if row.curve == "auto"]
    assert len(found) == 3 * len(tuple(methods.SMALL))
    for row in found:
        assert row.method == "discrete-ordinates"
        assert row.worst <= float(row.setting.split()[1])
    assert 'How well method="auto" chose' in (folder / methods_page.PAGE).read_text(encoding="utf-8")


@pytest.mark.slow
def test_more_nodes_are_closer(rows: list[Row]) -> None:
    for name in ("modes", "doubling"):
        for scene in tuple(methods.SMALL):
            few, many = (row for row in rows if (row.curve, row.scene) == (f"discrete-ordinates, {name}", scene))
            assert many.worst < few.worst / 20.0
            assert many.reference_within < 1e-7


@pytest.mark.slow
def test_the_exact_method_keeps_what_is_asked_for_and_loses_no_energy(rows: list[Row]) -> None:
    for row in rows:
        if row.curve == "discrete-ordinates, accuracy":
            assert row.worst <= float(row.setting.split()[1])
        if row.scene == "Rayleigh, small" and row.method == "discrete-ordinates":
            assert row.energy < 1e-12


@pytest.mark.slow
def test_the_page_opens_without_a_network(folder: Path) -> None:
    text = (folder / methods_page.PAGE).read_text(encoding="utf-8")
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=", text)
    for name in tuple(methods.SMALL):
        assert f'id="{methods.make_file_stem(name)}"' in text
        assert (folder / f"{methods.make_file_stem(name)}.png").stat().st_size > 1000
    assert "For 1e-03 take" in text


def test_one_colour_a_method_and_the_answer_on_top() -> None:
    known = list(Records(Row, ROOT / "docs" / "explanation" / "methods" / "methods.csv").read().values())
    curves = {row.curve: row for row in known if not row.is_peer}
    colours = {methods_page.find_curve_method(row): methods_page.choose_colour([row]) for row in curves.values()}
    assert {methods_page.choose_colour([row]) for row in known if not row.is_peer} == set(colours.values())
    assert len(set(colours.values())) == len(colours) == len(METHODS) + 1
    looks = {
        (methods_page.choose_colour([row]), methods_page.assign_markers(known)[curve]) for curve, row in curves.items()
    }
    assert len(looks) == len(curves) > len(colours)
    text = methods_page.make_html(known, [])
    assert -1 < text.find("good enough in 45 of 45") < text.index("<table>")


def test_what_is_done_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = run(tmp_path)
    monkeypatch.setattr(methods, "time_solve", lambda *_: pytest.fail("measured again"))
    monkeypatch.setattr(methods, "get_reference", lambda *_: pytest.fail("solved again"))
    assert run(tmp_path) == first


def test_a_torn_line_is_measured_again_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, path = run(tmp_path), tmp_path / methods.CSV
    text = path.read_text()
    path.write_text(text[: text.rindex(",") + 4])
    measured, timed = [], methods.time_solve
    monkeypatch.setattr(methods, "time_solve", lambda *given: measured.append(given) or timed(*given))
    again = run(tmp_path)
    assert len(measured) == 1
    assert again[0] == first[0]
    assert again[1].i_max == first[1].i_max


@pytest.mark.parametrize("change", ["version", "setting", "fresh"])
def test_what_has_changed_is_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    run(tmp_path)
    curve, measured, timed = CURVE, [], methods.time_solve
    if change == "version":
        monkeypatch.setattr("bench.study.identify_setup", lambda: "another version")
    if change == "setting":
        curve = replace(CURVE, settings=methods.vary_nodes((2, 8), algorithm="doubling"))
    monkeypatch.setattr(methods, "time_solve", lambda *given: measured.append(given) or timed(*given))
    assert len(run(tmp_path, curve, fresh=change == "fresh")) == len(measured) == 2
    study = methods.make_study([*methods.SMALL][:1], [curve], tmp_path, ONCE)
    study.page(study.measure_rows(tmp_path), tmp_path, "a test")
    assert len(Records(Row, tmp_path / methods.CSV).read()) == 2


def test_a_slow_curve_ends_early(tmp_path: Path) -> None:
    first, second = methods.make_study(
        [*methods.SMALL][:1], [CURVE], tmp_path, replace(ONCE, longest=0.0)
    ).measure_rows(tmp_path)
    assert first.is_measured
    assert second.status.startswith("left out: 2 nodes took")


def test_errors_are_relative_to_the_largest_intensity_of_their_depth() -> None:
    one = methods.find_case("Rayleigh, small")
    field = methods.solve_case(one, nodes=8)
    right = methods.Reference.of(one, field)
    assert max(methods.measure_run_errors(one, field, right).values()) < 1e-14
    wrong = field.stokes.copy()
    wrong[1, :, :, 2] += 0.01 * np.abs(field.stokes[1, field.mu < 0.0, :, 0]).max()
    found = methods.measure_run_errors(one, replace(field, stokes=wrong), right)
    assert found["u_max"] == close_to(0.01, rtol=1e-6, atol=0.0)
    assert found["u_rms"] == close_to(0.01, rtol=1e-6, atol=0.0)
    assert found["i_max"] == 0.0


def test_advice_says_what_is_quickest_and_what_cannot_be_told() -> None:
    slow = Row("s", "c", "m", "8 nodes", MEASURED, 2.0, i_max=1e-7, q_max=0, u_max=0, v_max=0, reference_within=1e-9)
    quick = replace(slow, setting="2 nodes", seconds=1.0, q_max=1e-4)
    text = methods_page.advise_on_scene([slow, quick])
    assert text.startswith("For 1e-03 take c with 2 nodes (1 s, error 1e-04), for 1e-06 take c with 8 nodes")
    assert text.endswith("for 1e-10 nothing can be told (the reference is known to 1e-09).")
    assert "take none of these" in methods_page.advise_on_target([quick], 1e-6)


def test_scenes() -> None:
    assert len(methods.CASES) >= 12
    with pytest.raises(SceneError, match="--scenes must fit one of"):
        methods.find_matching_scenes("no such scene")


@pytest.mark.slow
def test_no_two_scenes_are_the_same() -> None:
    assert len({methods.find_case(name).fingerprint for name in methods.CASES}) == len(methods.CASES)


def test_the_table_of_knobs_names_settings_that_are_there() -> None:
    for method, each in methods.KNOBS.items():
        named = {name for _, some in each for setting in some for name in setting.options.get("settings", {})}
        assert named <= set(find_method(method).settings)


def test_the_table_of_methods_is_that_of_the_registry() -> None:
    text = (ROOT / "docs" / "explanation" / "methods.md").read_text(encoding="utf-8")
    assert methods_tables.refresh_tables(text) == text, (
        "run `python -m docs.scripts.methods_tables docs/explanation/methods.md`"
    )
    for name in METHODS:
        assert f"\n| `{name}` |" in text


def test_figure_2_agrees_near_the_beam_and_where_it_is_thin() -> None:
    lobes = radiance_factor.solve_below(0.01)
    exact, once = (lobes[name] for name in ("discrete-ordinates", "single-scattering"))
    near = np.abs(exact.angle - radiance_factor.BEAM) < 10.0
    assert_close(once.radiance[near], exact.radiance[near], rtol=0.02, atol=0.0)


@pytest.mark.slow
def test_figures_of_the_paper(tmp_path: Path) -> None:
    assert radiance_factor.main(["-o", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"radiance_factor_1.png", "radiance_factor_2.png"}


@pytest.mark.slow
def test_inside_a_conservative_slab_light_turns_towards_straight_down() -> None:
    lobes = radiance_factor.solve_inside()
    brightest = [abs(lobe.angle[np.argmax(lobe.radiance)]) for lobe in lobes]
    # at the top the brightest light is that of the long, nearly horizontal ways
    assert np.all(np.diff(brightest[1:]) < 0.0)
