"""The viewer's Measurement tab: what it reads, draws beside the form's scene, fits, and puts into the form."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form.content import START, Content
from vrte.app.form.numbers import list_free_numbers, put_values
from vrte.app.page.free_numbers import choose_free, find_places
from vrte.app.page.measurement_panel import list_answers
from vrte.app.solving import measuring
from vrte.app.solving.measuring import Comparer, describe_measured, fit_scene, is_measurement, list_shown
from vrte.app.solving.tab_session import TabSession
from vrte.app.solving.worker import Fitted, Refused, Step, Task
from vrte.fit.curves import COLOURS, NUMBERS, name_bars, split_curves
from vrte.pictures.fit import measurement

from .helpers import assert_close, wait_until
from .viewer_server import ask, get_process, work

HAZE: Content = {
    "nodes": 4,
    "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 0.7}],
    "base": {"kind": "lambertian", "albedo": 0.3},
}
THICKNESS = "layer[1].thickness"
FREE = {THICKNESS: {"start": 0.4, "low": 0.01, "high": 5.0}}
NO_ANGLE = np.nan, np.nan
ROWS = vrte.Measurement(
    ["f00"] * 4 + ["total_reflectance"] * 2,
    0.0,
    0.001,
    theta_i_deg=[30.0] * 4 + [0.0, 60.0],
    theta_o_deg=[-60.0, 0.0, 40.0, 60.0, *NO_ANGLE],
    phi_deg=[0.0] * 4 + [*NO_ANGLE],
)


def change(**layer: Any) -> Content:
    return {**HAZE, "layer": [{**HAZE["layer"][0], **layer}]}


def test_answers_to_questions_can_be_clicked(tmp_path: Path) -> None:
    """Each answer that a question names, given back, is understood."""
    (tmp_path / "two.txt").write_text("nm;A;B\n500;60;70\n600;65;70\n")
    with pytest.raises(vrte.SceneError) as asked:
        vrte.read_measurement(tmp_path / "two.txt")
    answers = list_answers(str(asked.value))
    geometries = [f"geometry='{name}'" for name in ("8:di", "8:de", "45:0")]
    assert answers == ["sample='A'", "base={'A': 0.0, 'B': 0.8}", *geometries]
    for sample in answers[:2]:
        for geometry in geometries:
            read = measuring.read_limited((tmp_path / "two.txt").read_bytes(), ".txt", f"{sample}, {geometry}")
            assert len(read) == (4 if sample.startswith("base") else 2)
    assert list_answers("line 2: value must be a number, not 'bright'") == []


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A measurement of HAZE without noise, as a file."""
    path = tmp_path_factory.mktemp("panel") / "panel.csv"
    ROWS.measure(ROWS.predict(HAZE)).save(path, "a panel")
    return path.read_bytes()


def answer(content: Content | None, data: bytes, comparer: Comparer | None = None) -> list[Any]:
    return work((comparer or Comparer()).answer, content, data=data, suffix=".csv")


def test_a_measurement_is_reported_first_and_then_what_the_scene_shows(data: bytes) -> None:
    comparer, thin = Comparer(), change(thickness=0.2)
    first, second = answer(thin, data, comparer)
    assert (first.follows, first.predicted, second.follows, second.message) == (True, None, False, "")
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.2)], vrte.Lambertian(0.3))
    mu_i, mu_o = np.cos(np.radians([30.0])), np.cos(np.radians([0.0, 40.0, 60.0]))
    f00 = vrte.brdf(scene, mu_i, mu_o, [0.0, 180.0], nodes=4).mueller[0, :, :, 0, 0]
    assert_close(second.predicted[:4], [f00[2, 1], f00[0, 0], f00[1, 0], f00[2, 0]], rtol=1e-9, atol=0.0)
    assert_close(second.predicted[5], vrte.brdf(scene, 0.5, 1.0, nodes=4).reflectance[0], rtol=1e-9, atol=0.0)
    fine, values = second.fine
    (curve,) = split_curves(fine, "f00")[1]
    assert_close(np.interp([-60, 0, 40, 60], curve.x, values[curve.rows]), second.predicted[:4], rtol=1e-9, atol=0.0)
    assert curve.x.size > 60
    (again,) = answer(HAZE, data, comparer)  # not read again
    assert_close(again.predicted, again.measured.value, rtol=1e-9, atol=0.0)


def test_a_scene_that_shows_nothing_leaves_the_measurement(data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [one.message for one in answer(None, data)] == ["", ""]
    _, found = answer(change(albedo=2.0), data)
    assert "albedo" in found.message
    assert found.predicted is None
    _, found = answer({**HAZE, "wavelength_um": [0.5, 0.6]}, data)
    assert found.notes == ("the measurement names no wavelength: the first of the form, 0.5 µm, is taken",)
    monkeypatch.setattr(measuring, "MOST_POINTS", 5)
    assert "at most 5 numbers, not 6" in answer(HAZE, data)[-1].message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("mu_i,mu_o\n0.5,0.5\n", "no column is known as a wavelength, an angle or a colour; there are 'mu_i', 'mu_o'"),
        ("quantity,value,theta_i_deg\ntotal_reflectance,high,8\n", "line 2: value must be a number"),
    ],
)
def test_a_bad_file_is_one_sentence(text: str, words: str) -> None:
    (found,) = answer(HAZE, text.encode())
    assert isinstance(found, Refused)
    assert words in found.message
    assert "\n" not in found.message
    assert "vrte-view-" not in found.message  # where it lies is nobody's business


def test_what_a_file_leaves_open_is_answered_as_its_errors_write_it() -> None:
    given: dict[str, Any] = {"data": b"nm;black;white\n500;60;65\n", "suffix": ".txt"}
    comparer = Comparer()
    for keywords, words in (
        ("", "geometry='8:di' (sphere"),
        ("geometry='8:de'", "sample='black' takes one, base={'black': 0.0, 'white': 0.8} takes"),
        ("geometry=8", "geometry must be a text"),
        ("sampel='a'", "must be written as geometry='8:di', sample='White', with geometry, illuminant"),
        ("'8:di'", "must be written as"),
        ("x) or open('y'", "must be written as"),
        ("geometry=open('y')", "must be written as"),
        ("(" * 5000, "must be written as"),
    ):
        (found,) = work(comparer.answer, HAZE, **given, keywords=keywords)
        assert isinstance(found, Refused)
        assert words in found.message
    answered = "geometry='8:de', base={'black': 0.0, 'white': 0.8}"
    first, second = work(comparer.answer, HAZE, **given, keywords=answered)
    assert (first.measured.base.tolist(), second.predicted.size) == ([0.0, 0.8], 2)
    assert "reflectance of 'black' in per cent: by their size, up to 65" in first.measured.understood


def test_which_files_are_measurements_and_what_was_read(data: bytes) -> None:
    for one, suffix, unasked, asked in (
        (data, ".csv", True, True),
        (b"# vrte result, format 1\n# \nmu_i,mu_o\n", ".csv", False, False),
        (b"nm;R\n400;0.5\n", ".csv", True, True),
        (b"nm R", ".txt", True, True),
        (b"", ".toml", False, False),
        (b"", ".nc", False, True),
    ):
        assert [is_measurement(one, suffix, wanted=wanted) for wanted in (False, True)] == [unasked, asked]
    assert list(describe_measured(ROWS)) == [
        ("f00", "4", "30°", "-60 to 60° (4)", "0°", "–", "–", "yes"),
        ("total_reflectance", "2", "0 to 60° (2)", "–", "–", "–", "–", "yes"),
    ]


def test_points_have_error_bars_over_the_curve_and_residuals_below() -> None:
    predicted = np.linspace(0.1, 0.6, 6)
    points, line, left = measurement(ROWS.measure(predicted + 0.002), "f00", predicted).data
    assert points.x.tolist() == [-60.0, 0.0, 40.0, 60.0]
    for drawn, right in ((points.error_y.array, 0.001), (line.y, predicted[:4]), (left.y, 2.0)):
        assert_close(drawn, right, rtol=1e-6, atol=0.0)
    assert left.yaxis == "y2"
    spectrum = vrte.Measurement("total_reflectance", [0.2, 0.3], wavelength_um=[0.6, 0.5], theta_i_deg=8.0)
    (only,) = measurement(spectrum, "total_reflectance").data
    assert (np.round(np.asarray(only.x, float), 6).tolist(), only.error_y.array) == ([0.5, 0.6], None)
    alone = vrte.Measurement(["total_reflectance", "total_transmittance"], [0.4, 0.5], theta_i_deg=8.0)
    assert (list_shown(alone), name_bars("L"), name_bars("reflectance")) == ([NUMBERS], COLOURS, NUMBERS)
    figure = measurement(alone, NUMBERS, np.array([0.3, 0.5]))
    assert [one.type for one in figure.data] == ["bar", "bar", "scatter"]
    assert list(figure.layout.xaxis.ticktext) == ["total reflectance", "total transmittance"]
    both = vrte.Measurement(
        "f00", 0.1, theta_i_deg=[0, 0, 0, 40, 40, 40], theta_o_deg=[10, 20, 30] * 2, phi_deg=[0, 180, 0, 90, 270, 90]
    )
    axis, (first, second) = split_curves(both, "f00")
    assert (axis, first.name, first.x.tolist()) == ("theta_o_deg", "φ = 0°, θᵢ = 0°", [-20.0, 10.0, 30.0])
    assert (second.name, second.rows.tolist()) == ("φ = 90°, θᵢ = 40°", [4, 3, 5])


def test_the_form_offers_its_numbers_and_takes_values() -> None:
    film = {"particles": "dust", "thickness_um": 50.0, "volume_fraction": "15 %"}
    content = {
        "particles": {"dust": {"index": [1.5, 0.0], "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}},
        "layer": [{"interface": {"above": 1.0, "below": "alkyd"}}, film],
        "base": {"kind": "lambertian", "albedo": 0.5},
        "brdf": START["brdf"],
        "nodes": 8,
    }
    listed = list_free_numbers(content)
    expected = "layer[1].interface.above layer[2].thickness_um layer[2].volume_fraction particles.dust.index[1]"
    sizes = "particles.dust.index[2] particles.dust.size.lognormal.median_um particles.dust.size.lognormal.sigma"
    assert [one.key for one in listed] == [*expected.split(), *sizes.split(), "base.albedo"]
    assert all(one.low <= one.start <= one.high and one.low < one.high and one.label for one in listed)
    ends = {one.key: (one.label, one.low, one.high) for one in listed}
    assert ends["layer[2].thickness_um"] == ("layer 2: thickness [µm]", 5.0, 500.0)
    assert ends["base.albedo"][1:] == (0.0, 1.0)
    assert vrte.SceneFamily(content, ["layer[2].volume_fraction"]).values.tolist() == [0.15]
    taken = put_values(content, {("particles", "dust", "index", 1): 0.0123456789, ("layer", 1, "volume_fraction"): 0.2})
    assert taken["particles"]["dust"]["index"] == [1.5, 0.0123457]
    assert taken["layer"][1]["volume_fraction"] == 0.2
    assert content["particles"]["dust"]["index"] == [1.5, 0.0]
    with pytest.raises(vrte.SceneError, match=r"no number layer\[3\]\.thickness any more"):
        put_values(content, {("layer", 2, "thickness"): 1.0})


def test_what_may_change_is_checked_before_a_fit() -> None:
    listed = list_free_numbers(HAZE)
    for asked, words in (
        ({}, "tick at least one"),
        ({"free": True, "low": "x"}, "layer 1: optical thickness: from and to must be two numbers"),
        ({"free": True, "low": 3.0, "high": 2.0}, "the first one smaller"),
        ({"free": True, "low": 1.0, "high": 2.0}, "is 0.7 now, which is not between 1 and 2"),
    ):
        with pytest.raises(vrte.SceneError, match=words):
            choose_free(listed, {THICKNESS: asked})
    expected = {THICKNESS: {"start": 0.7, "low": 0.07, "high": 9.0}}
    assert choose_free(listed, {THICKNESS: {"free": True, "high": 9}}) == expected


def test_a_fit_reports_its_steps_and_its_values_go_to_the_form(data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "collect_bytes", lambda *_: b"a page")  # tests/test_fit.py has it; it takes a second
    thin = change(thickness=0.4)
    *reported, found = work(fit_scene, thin, data=data, suffix=".csv", free=FREE)
    steps = [one for one in reported if isinstance(one, Step)]
    assert len(steps) > 2
    assert steps[0].values == [0.4]
    assert steps[-1].chi2 < 1e-3 < steps[0].chi2
    assert_close(found.values, 0.7, rtol=1e-5, atol=0.0)
    assert_close(found.predicted, ROWS.predict(HAZE), rtol=1e-5, atol=0.0)
    assert 0.0 < found.errors[0] < 0.01
    assert found.page == b"a page"
    assert put_values(thin, find_places(thin, found.names, found.values)) == HAZE
    kept = Fitted.of_step(Task("", thin, more={"free": FREE}), steps[1], "it died")
    assert np.isnan(kept.errors).all()
    assert put_values(thin, find_places(thin, kept.names, kept.values))["layer"][0]["thickness"] == float(
        f"{steps[1].values[0]:.6g}"
    )


LONG = {  # some seconds a step
    "nodes": 40,
    "wavelength_um": 0.5,
    "particles": {"dust": {"index": [1.5, 0.001], "size": {"lognormal": {"median_um": 1.0, "sigma": 1.5}}}},
    "layer": [{"particles": "dust", "thickness": 3.0}],
}


@pytest.mark.slow
def test_a_fit_is_stopped_with_the_best_so_far_and_one_that_dies_leaves_its_last_step(data: bytes) -> None:
    free = {"particles.dust.size.lognormal.median_um": {"start": 1.0, "low": 0.3, "high": 3.0}}
    session = TabSession(LONG)
    for stops in (True, False):
        session.start_fit(session.make_task("measuring.fit_scene", data=data, suffix=".csv", free=free))
        wait_until(lambda: session.fits.step is not None)
        (session.fits.stop if stops else session.fits.close)()
        begin = time.monotonic()
        wait_until(lambda: not session.fits.waits)
        assert time.monotonic() - begin < 10.0
        session.take_fit()
        assert bool(np.isfinite(session.fitted.errors).all()) == stops
        assert any(("interrupted" if stops else "without errors") in note for note in session.fitted.notes)
    session.close()


@pytest.mark.slow
def test_a_warm_process_answers_and_goes_with_its_tab(data: bytes) -> None:
    session = TabSession(HAZE, pages=1)
    found = ask(session.beside, "measuring.Comparer", HAZE, data=data, suffix=".csv")
    assert_close(found.predicted, found.measured.value, rtol=1e-9, atol=0.0)
    session.beside.ask(Task("measuring.Comparer", HAZE, Path(), {"data": data, "suffix": ".csv"}))
    assert not session.beside.waits  # nothing has changed
    process = get_process(session.beside)
    free = {THICKNESS: {"start": 3.0, "low": 1.0, "high": 9.0}}
    session.start_fit(session.make_task("measuring.fit_scene", LONG, data=data, suffix=".csv", free=free))
    session.leave()
    wait_until(lambda: process.poll() is not None and not session.fits.waits)
