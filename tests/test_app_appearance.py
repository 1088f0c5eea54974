"""The viewer's Appearance tab: the warm process that answers its sliders, and the sliders themselves."""

import copy
import csv
import io
import math
import os
import signal
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form.checks import begin_with_material, list_films
from vrte.app.form.content import START, put
from vrte.app.form.fields import get_value
from vrte.app.form.numbers import STEPS, explain_missing, list_sliders
from vrte.app.solving import appearance, worker
from vrte.app.solving.appearance import AppearanceAnswerer, Appeared
from vrte.app.solving.tab_session import TabSessions, make_colours_download
from vrte.app.solving.worker import Query, Refused, Task
from vrte.appearance.colours import find_colour, find_difference
from vrte.appearance.gloss import find_glosses
from vrte.appearance.hiding import Conditions, find_hiding
from vrte.appearance.panel import make_panel
from vrte.formats.toml_table import read_fraction
from vrte.pictures import results as figures

from .helpers import assert_close, close_to, wait_until
from .samples import slow_but
from .viewer_server import ask, get_process, work

pytestmark = pytest.mark.skipif(find_spec("colour") is None, reason="colours take the extra appearance")
DUST: dict[str, Any] = {
    "host_index": 1.5,
    "particles": {"dust": {"index": [2.6, 0.001], "radius_um": 0.1}},
    "layer": [
        {"interface": {"above": 1.0, "below": 1.5}},
        {"particles": "dust", "volume_fraction": "10 %", "thickness_um": 1.0},
    ],
    "base": {"kind": "lambertian", "albedo": 0.3},
    "brdf": START["brdf"],
}
MU_I = np.cos(np.radians([45.0, 8.0]))


def change(content: dict[str, Any], *index: Any, to: Any) -> dict[str, Any]:
    found = copy.deepcopy(content)
    put(found, index, to)
    return found


SEMI_INFINITE = change(DUST, "layer", to=[{"particles": "dust", "thickness": math.inf}])


def thicken(length_um: float) -> dict[str, Any]:
    return change(DUST, "layer", 1, "thickness_um", to=length_um)


def make_task(content: dict[str, Any], viewing: Conditions = Conditions(), before: Any = None) -> Task:  # noqa: B008
    return Task("appearance.AppearanceAnswerer", content, Path(), {"viewing": viewing, "before": before})


def look(live: Query, content: dict[str, Any]) -> Any:
    """The last answer of a process to what a scene looks like."""
    task = make_task(content)
    return ask(live, task.call, content, **task.more)


def answer(by: AppearanceAnswerer, task: Task, newer: int = 9) -> list[Any]:
    """What is reported of a scene in this process; there is a newer question after so many answers."""
    return work(by.answer, task.content, newer, **task.more)


@pytest.fixture(scope="module")
def shared() -> Iterator[Query]:
    live = Query(stays=True)
    yield live
    live.close()


AT = np.linspace(0.41, 0.69, 8).round(3)  # half of the usual wavelengths
TASK = make_task(DUST, Conditions(white=0.9))


@pytest.fixture(scope="module")
def answered() -> Iterator[tuple[AppearanceAnswerer, list[Appeared]]]:
    """One that has answered TASK, and its answers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(appearance, "choose_wavelengths", lambda *_: AT)
        studio = AppearanceAnswerer()
        studio.pace = 1.0  # seconds a wavelength: as on a slow machine
        yield studio, answer(studio, TASK)


def test_the_numbers_are_those_of_the_library(answered: tuple[AppearanceAnswerer, list[Appeared]]) -> None:
    found, _ = answer(answered[0], make_task(DUST, Conditions(illuminant="A", observer=2, white=0.9)), 1)
    panel = make_panel(DUST, AT, accuracy=1e-6)
    solved = [panel.put_over(base).solve(MU_I) for base in (None, vrte.Lambertian(0.9))]
    spectra = found.spectra.over_black, found.spectra.over_white
    for one, values in zip(solved, spectra, strict=True):
        assert_close(values, np.pi * one.mueller[:, 0, 0, 0, 0, 0], rtol=0.0, atol=1e-4)
    black, white = (find_colour(AT, values, "A", 2) for values in spectra)
    assert (found.black.hex, found.white.hex) == (black.hex, white.hex)
    numbers = found.white.numbers["b"], found.contrast, found.apart
    assert numbers == close_to((white.b, black.Y / white.Y, find_difference(black, white)), rtol=1e-9, atol=0.0)
    assert 0.1 < found.contrast < 0.9
    other, _ = answer(answered[0], make_task(DUST, Conditions("8:di", "A", 2, white=0.9), found.spectra), 1)
    assert_close(other.spectra.over_white, solved[1].total_reflectance[:, 1], rtol=0.0, atol=1e-4)
    now = find_colour(AT, other.spectra.over_white, "A", 2)
    assert other.changed[1] == close_to(find_difference(now, white), rtol=1e-9, atol=0.0)
    assert other.before == (found.black, found.white)


@pytest.mark.parametrize("roughness", slow_but((0.1, 0.3, 0.6), 0.3))
def test_a_rough_paint_has_its_colours_within_seconds(roughness: float) -> None:
    """All wavelengths in 1 to 2 s of one core; for a gloss paint of roughness 0.3 the viewer once never came back."""
    begin, at = time.process_time(), []
    task = make_task(change(DUST, "layer", 0, "interface", "roughness", to=roughness))
    exchange = worker.Exchange(lambda _: at.append(time.process_time() - begin), lambda: False)
    found: Any = worker.explain_failure(AppearanceAnswerer().answer, task, exchange)
    assert at[0] < 10.0
    assert len(found.readings) > 3
    assert not found.why_none


def test_a_paint_is_shown_over_the_forms_base_and_over_a_grey_black(
    answered: tuple[AppearanceAnswerer, list[Appeared]],
) -> None:
    """A Lambertian base of 0.3 in place of a white card of 0.3."""
    studio, task = answered[0], make_task(DUST, Conditions(black=0.01, white=0.3))
    card, over_base = (work(studio.answer, task.content, **task.more, over_base=flag)[-1] for flag in (False, True))
    assert (card.sides[1], over_base.sides[1]) == ("over white", "over the base")
    assert_close(over_base.spectra.over_white, card.spectra.over_white, rtol=1e-9, atol=0.0)
    solved = make_panel(DUST, AT, accuracy=1e-6).put_over(vrte.Lambertian(0.01)).solve(MU_I)
    expected = np.pi * solved.mueller[:, 0, 0, 0, 0, 0]
    assert_close(card.spectra.over_black, expected, rtol=0.0, atol=1e-4)


def test_coarse_colours_come_first_and_gloss_and_hiding_last(
    answered: tuple[AppearanceAnswerer, list[Appeared]],
) -> None:
    studio, (coarse, colours, final) = answered
    flags = [(one.coarse, one.follows) for one in (coarse, colours, final)]
    assert flags == [(True, True), (False, True), (False, False)]
    assert (colours.spectra, colours.black, colours.readings) == (final.spectra, final.black, ())
    assert math.dist(*([one.white.numbers[name] for name in "Lab"] for one in (coarse, final))) < 1.0
    assert not np.array_equal(coarse.spectra.over_black, final.spectra.over_black)
    assert final.why_none == ()
    found = {(one.quantity, one.geometry): one.value for one in final.readings}
    panel = make_panel({key: DUST[key] for key in ("host_index", "particles", "layer")}, AT, accuracy=1e-4)
    for angle, gloss in find_glosses(panel).items():
        assert found["gloss", f"{angle:g}:{angle:g}"] == close_to(gloss, rtol=3e-3, atol=0.0)
    hiding = find_hiding(panel, Conditions(white=0.9))
    pair = found["hiding thickness", "45:0"], found["spreading rate", "45:0"]
    assert pair == close_to((hiding.hiding_length_um, hiding.spreading_rate), rtol=5e-3, atol=0.0)
    (again,) = answer(studio, TASK)  # all is remembered
    assert again.readings == final.readings
    assert len(studio.kinds) == AT.size  # at each wavelength, once
    for pace, newer, flag in ((1.0, 0, "coarse"), (0.0, 1, "follows")):  # after the coarse answer; without readings
        studio.pace = pace
        given_up = answer(studio, make_task(thicken(1.1)), newer)
        assert [one and getattr(one, flag) for one in given_up] == [True, None]


def test_colours_are_downloaded_and_drawn_once_they_are_of_the_forms_scene(
    answered: tuple[AppearanceAnswerer, list[Appeared]],
) -> None:
    live, found = Query(stays=True), answered[1][-1]
    for change in ({}, {"answer": found}, {"answered": make_task(thicken(2.0))}, {"answered": TASK, "waits": True}):
        vars(live).update(change)
        with pytest.raises(vrte.SceneError, match="there are no colours of this scene yet"):
            make_colours_download(live, DUST)
    live.waits = False
    name, data = make_colours_download(live, DUST)
    assert name == "colours.csv"
    rows = list(csv.DictReader(io.StringIO(data.decode("utf-8-sig"))))
    text = make_colours_download(live, DUST, with_comma=True)[1].decode("utf-8-sig")
    dialect = csv.Sniffer().sniff(text.splitlines()[0])
    again = [
        row | {"value": row["value"].replace(",", ".")} for row in csv.DictReader(io.StringIO(text), dialect=dialect)
    ]
    assert dialect.delimiter == ";"
    assert [row["value"] for row in again] == [row["value"] for row in rows]
    assert all(row["value"].count(",") == 1 for row in csv.DictReader(io.StringIO(text), delimiter=";"))
    values = {(row["quantity"], row["wavelength_um"]): float(row["value"]) for row in rows}
    assert values["L over white", ""] == found.white.numbers["L"]
    assert values["contrast ratio", ""] == found.contrast
    assert values["reflectance factor over black", "0.53"] == found.spectra.over_black[3]
    assert sum(row["quantity"] == "gloss" for row in rows) == 3
    figure = figures.spectra(found.spectra, found.spectra, "45:0")
    names = [trace.name for trace in figure.data]
    assert names == ["over black", "over white", "over black, before", "over white, before"]
    assert_close(figure.data[0].y, found.spectra.over_black, rtol=1e-6, atol=0.0)
    assert_close(figure.data[0].x, AT, rtol=1e-6, atol=0.0)


def test_bad_content_is_a_sentence_and_the_process_lives_on_within_its_memory(shared: Query) -> None:
    assert isinstance(look(shared, SEMI_INFINITE), Appeared)
    before = shared.worker
    for content, words in (
        (change(DUST, "particles", "dust", "index", to="main/../../../etc/passwd/x"), "index"),
        (change(DUST, "layer", 1, "particles", to="gold"), "gold"),
        ({"layer": "none"}, "layer"),
    ):
        found = look(shared, content)
        assert isinstance(found, Refused)
        assert words in found.message
        assert "Traceback" not in found.message
    assert isinstance(look(shared, SEMI_INFINITE), Appeared)
    assert shared.worker is before
    limits = Path(f"/proc/{get_process(shared).pid}/limits").read_text().splitlines()
    (line,) = [line for line in limits if line.startswith("Max address space")]
    assert int(line.split()[3]) < 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def test_processes_die_make_room_and_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that dies is a sentence, and the next question starts another; one that is stuck makes room; one more than
    there may be ends that of another tab."""
    monkeypatch.setattr(worker, "STUCK", 0.2)
    monkeypatch.setattr(worker, "MOST_LIVE", 1)
    sessions = TabSessions()
    one, other = sessions.of("one"), sessions.of("other")
    size = {"lognormal": {"median_um": 40.0, "sigma": 1.6}}
    large = change(change(DUST, "particles", "dust", "radius_um", to=None), "particles", "dust", "size", to=size)

    def begin(live: Query, content: dict[str, Any]) -> Any:
        live.ask(make_task(content))
        return get_process(live)

    first = begin(one.live, large)
    os.kill(first.pid, signal.SIGKILL)
    wait_until(lambda: not one.live.waits)
    assert "ended by the system" in one.live.answer.message
    second = begin(one.live, change(large, "host_index", to=1.4))
    one.live.ask(make_task(DUST))

    def is_second_gone() -> bool:
        one.live.refresh()
        return second.poll() is not None

    wait_until(is_second_gone)
    assert one.live.waits
    third = get_process(one.live)
    assert len({first.pid, second.pid, third.pid}) == 3
    fourth = begin(other.live, DUST)  # in place of the one not asked for longest
    wait_until(lambda: third.poll() is not None)
    assert not one.live.waits
    other.pages = 1
    other.leave()
    wait_until(lambda: fourth.poll() is not None)
    fifth = begin(one.live, DUST)  # the one that was left open
    sessions.close()
    wait_until(lambda: fifth.poll() is not None)


def test_every_paint_to_begin_with_has_sliders_and_an_appearance() -> None:
    for film in list_films().values():
        content, notes = begin_with_material(film)
        assert explain_missing(content) == ""
        assert notes
        sliders = list_sliders(content)
        assert any(one.place[-1] == "thickness_um" for one in sliders)
        assert any(one.place[0] == "particles" or "flakes" in one.place for one in sliders)
        rough = [layer for layer in content["layer"] if "roughness" in layer.get("interface", {})]
        assert [one.place[-1] for one in sliders].count("roughness") == len(rough)
        for slider in sliders:
            value = read_fraction(get_value(content, slider.place))
            assert slider.reaches(value)
            assert 0 <= slider.find_step(value) <= STEPS
            assert slider.find_value(slider.find_step(value)) == close_to(value, rtol=0.03, atol=0.0)
            ends = slider.find_value(0), slider.find_value(STEPS)
            assert ends == close_to((slider.low, slider.high), rtol=5e-3, atol=0.0)


def test_what_is_missing_is_said() -> None:
    assert "optical thickness" in explain_missing(START)
    assert "No layer here holds particles" in explain_missing({"layer": [{"phase": "rayleigh", "thickness": 1.0}]})
    assert explain_missing(SEMI_INFINITE) == ""
    final = answer(AppearanceAnswerer(), make_task(SEMI_INFINITE))[-1]
    assert not any(one.quantity in ("gloss", "hiding thickness", "spreading rate") for one in final.readings)
    assert [text.partition(":")[0] for text in final.why_none] == ["no gloss", "no hiding thickness"]
    assert "needs a surface" in final.why_none[0]
