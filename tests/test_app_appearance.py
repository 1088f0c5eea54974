"""The viewer's Appearance tab: the warm process that answers its sliders, and the sliders themselves."""

import copy
import csv
import io
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.test_app_solving import is_there, until
from vrte.app import figures
from vrte.app.form.content import START, get_value, put
from vrte.app.form.sliders import STEPS, explain_missing, list_sliders
from vrte.app.page.gallery import list_paint_starts
from vrte.app.server.serve import leave_bench
from vrte.app.solving import live as module
from vrte.app.solving.appearance import Appeared, Question, Refused, Reply, Studio, Viewing
from vrte.app.solving.bench import Benches
from vrte.app.solving.downloads import make_colours_download
from vrte.app.solving.live import Live
from vrte.app.solving.live_worker import Inbox
from vrte.appearance.colours import find_colour, find_difference
from vrte.appearance.gloss import find_glosses
from vrte.appearance.hiding import find_hiding
from vrte.appearance.panel import make_panel
from vrte.formats.toml_table import read_share

from .helpers import assert_close, close_to

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


def change(content: dict[str, Any], *place: Any, to: Any) -> dict[str, Any]:
    found = copy.deepcopy(content)
    put(found, place, to)
    return found


def thicken(length_um: float) -> dict[str, Any]:
    return change(DUST, "layer", 1, "thickness_um", to=length_um)


def answered(live: Live) -> Reply:
    until(lambda: not live.waits)
    assert live.answer is not None
    return live.answer


def appeared(live: Live) -> Appeared:
    found = answered(live)
    assert isinstance(found, Appeared), found
    return found


@pytest.fixture(scope="module")
def shared() -> Iterator[Live]:
    live = Live()
    yield live
    live.close()


@pytest.mark.slow
def test_the_numbers_are_those_of_the_library(shared: Live) -> None:
    viewing = Viewing(illuminant="A", observer=2, white=0.9)
    shared.ask(DUST, Path(), viewing)
    found = appeared(shared)
    panel = make_panel(DUST, accuracy=1e-6)
    white = panel.put_over(vrte.Lambertian(0.9))
    solved = [one.solve(np.cos(np.radians([45.0, 8.0]))) for one in (panel.put_over(None), white)]
    seen = [np.pi * one.mueller[:, 0, 0, 0, 0, 0] for one in solved]
    assert_close(found.shares.over_black, seen[0], rtol=0.0, atol=1e-4)
    assert_close(found.shares.over_white, seen[1], rtol=0.0, atol=1e-4)
    assert found.shares.wavelength_um.size == 16
    shares = found.shares
    colours = [find_colour(shares.wavelength_um, one, "A", 2) for one in (shares.over_black, shares.over_white)]
    assert (found.black.hex, found.white.hex) == (colours[0].hex, colours[1].hex)
    assert found.white.numbers["b"] == close_to(colours[1].b, rtol=1e-9, atol=0.0)
    assert found.contrast == close_to(colours[0].Y / colours[1].Y, rtol=1e-9, atol=0.0)
    assert found.apart == close_to(find_difference(*colours), rtol=1e-9, atol=0.0)
    assert 0.1 < found.contrast < 0.9

    shared.ask(DUST, Path(), Viewing("A", 2, "8:di", 0.9), found.shares)
    other = appeared(shared)
    assert_close(other.shares.over_white, solved[1].total_reflectance[:, 1], rtol=0.0, atol=1e-4)
    assert other.changed is not None
    now = find_colour(other.shares.wavelength_um, other.shares.over_white, "A", 2)
    assert other.changed[1] == close_to(find_difference(now, colours[1]), rtol=1e-9, atol=0.0)
    assert other.before == (found.black, found.white)


def test_a_coarse_answer_comes_first_where_particles_are_new() -> None:
    told: list[Reply] = []
    studio = Studio()
    studio.pace = 1.0  # seconds a wavelength: as on a slow machine
    studio.answer(Question(1, DUST, Path()), told.append, lambda: False)
    coarse, colours, final = (one for one in told if isinstance(one, Appeared))
    assert len(told) == 3
    assert [(one.coarse, one.follows) for one in (coarse, colours, final)] == [
        (True, True),
        (False, True),
        (False, False),
    ]
    assert (colours.shares, colours.black, colours.readings) == (final.shares, final.black, ())
    assert find_difference_of(coarse, final) < 1.0
    assert not np.array_equal(coarse.shares.over_black, final.shares.over_black)
    told.clear()
    studio.pace = 0.0
    studio.answer(Question(2, thicken(1.1), Path()), told.append, lambda: False)
    assert [one.number for one in told if isinstance(one, Appeared) and not one.follows] == [2]
    assert len(studio.kinds) == 16  # at so many wavelengths, once


def test_gloss_and_hiding_follow_the_colours_and_are_the_librarys() -> None:
    told: list[Reply] = []
    studio = Studio()
    studio.answer(Question(1, DUST, Path(), Viewing(white=0.9)), told.append, lambda: False)
    final = told[-1]
    assert isinstance(final, Appeared)
    assert final.why_none == ()
    found = {(one.quantity, one.geometry): one.value for one in final.readings}
    panel = make_panel({key: DUST[key] for key in ("host_index", "particles", "layer")}, accuracy=1e-4)
    for angle, gloss in find_glosses(panel).items():
        assert found["gloss", f"{angle:g}:{angle:g}"] == close_to(gloss, rtol=3e-3, atol=0.0)
    hiding = find_hiding(panel, white=0.9)
    assert found["hiding thickness", "45:0"] == close_to(hiding.hiding_length_um, rtol=5e-3, atol=0.0)
    assert found["spreading rate", "45:0"] == close_to(hiding.spreading_rate, rtol=5e-3, atol=0.0)
    begun = len(told)
    studio.answer(Question(2, DUST, Path(), Viewing(white=0.9)), told.append, lambda: False)
    (again,) = told[begun:]  # all is remembered
    assert isinstance(again, Appeared)
    assert again.readings == final.readings


def test_what_cannot_be_read_off_says_why() -> None:
    told: list[Reply] = []
    bare = change(DUST, "layer", to=[{"particles": "dust", "thickness": math.inf}])
    Studio().answer(Question(1, bare, Path()), told.append, lambda: False)
    final = told[-1]
    assert isinstance(final, Appeared)
    assert final.readings == ()
    assert [text.partition(":")[0] for text in final.why_none] == ["no gloss", "no hiding thickness"]
    assert "needs a surface" in final.why_none[0]


def test_a_newer_question_ends_the_readings() -> None:
    told: list[Reply] = []
    studio = Studio()
    studio.answer(Question(1, DUST, Path()), told.append, lambda: len(told) > 0)
    assert [isinstance(one, Appeared) and one.follows for one in told] == [True]


def test_colours_are_downloaded_once_they_are_of_the_forms_scene(shared: Live) -> None:
    shared.ask(DUST, Path(), Viewing())
    found = appeared(shared)
    assert shared.answered is shared.asked
    name, data = make_colours_download(shared, DUST)
    assert name == "colours.csv"
    rows = list(csv.DictReader(io.StringIO(data.decode())))
    values = {(row["quantity"], row["wavelength_um"]): float(row["value"]) for row in rows}
    assert values["L over white", ""] == found.white.numbers["L"]
    assert values["contrast ratio", ""] == found.contrast
    assert (
        values["reflectance factor over black", repr(float(found.shares.wavelength_um[3]))]
        == found.shares.over_black[3]
    )
    assert sum(row["quantity"] == "gloss" for row in rows) == 3
    with pytest.raises(vrte.SceneError, match="there are no colours of this scene yet"):
        make_colours_download(shared, thicken(2.0))
    with pytest.raises(vrte.SceneError, match="there are no colours"):
        make_colours_download(Live(), DUST)


def find_difference_of(one: Appeared, other: Appeared) -> float:
    """How far the colours over white are apart in L*, a*, b*."""
    return math.dist(*([each.white.numbers[name] for name in "Lab"] for each in (one, other)))


def test_an_old_question_is_given_up_after_its_coarse_answer() -> None:
    told: list[Reply] = []
    studio = Studio()
    studio.pace = 1.0
    studio.answer(Question(1, DUST, Path()), told.append, lambda: True)
    assert [isinstance(one, Appeared) and one.coarse for one in told] == [True]
    assert studio.found == {}


def test_the_newest_question_is_taken() -> None:
    inbox = Inbox()
    for number in (1, 2, 3):
        inbox.put(Question(number, {}, Path()))
    assert inbox.take().number == 3
    assert not inbox.has_newer()


@pytest.mark.slow
def test_the_newest_position_of_a_slider_wins(shared: Live) -> None:
    shared.ask(thicken(2.0), Path(), Viewing())
    appeared(shared)
    numbers = set()
    for step in range(60):
        shared.ask(thicken(3.0 + 0.1 * step), Path(), Viewing())
        numbers.add(shared.answer.number if shared.answer else 0)
    last = appeared(shared)
    assert shared.asked is not None
    assert last.number == shared.asked.number
    assert len(numbers) < 30  # the others were passed over
    shared.ask(thicken(8.9), Path(), Viewing())
    assert not shared.waits  # nothing has changed
    expected = make_panel(thicken(8.9), accuracy=1e-6).put_over(None).solve(np.cos(np.radians([45.0, 8.0])))
    assert_close(
        last.shares.over_black, np.pi * expected.mueller[:, 0, 0, 0, 0, 0], rtol=0.0, atol=1e-4
    )  # 1e-3 is promised


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (change(DUST, "particles", "dust", "index", to="unobtainium"), "unobtainium"),
        (change(DUST, "layer", 1, "particles", to="gold"), "gold"),
        ({"layer": "none"}, "layer"),
        (change(DUST, "particles", "dust", "index", to="main/../../../etc/passwd/x"), "index"),
    ],
)
def test_bad_content_is_a_sentence_and_the_process_lives_on(content: dict[str, Any], words: str, shared: Live) -> None:
    shared.ask(content, Path(), Viewing())
    found = answered(shared)
    assert isinstance(found, Refused)
    assert words in found.message
    assert "Traceback" not in found.message
    process = get_process(shared)
    shared.ask(DUST, Path(), Viewing())
    appeared(shared)
    assert get_process(shared) is process


def get_process(live: Live) -> "subprocess.Popen[bytes]":
    """Once there is one."""
    until(lambda: live._warm is not None and live._warm.process is not None)
    assert live._warm is not None
    assert live._warm.process is not None
    return live._warm.process


def test_the_process_has_a_limit_of_memory(shared: Live) -> None:
    shared.ask(DUST, Path(), Viewing())
    appeared(shared)
    limits = Path(f"/proc/{get_process(shared).pid}/limits").read_text().splitlines()
    (line,) = [line for line in limits if line.startswith("Max address space")]
    assert int(line.split()[3]) < 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def test_a_process_that_dies_is_a_sentence_and_the_next_question_starts_another() -> None:
    live = Live()
    live.ask(DUST, Path(), Viewing())
    first = get_process(live)
    os.kill(first.pid, signal.SIGKILL)
    found = answered(live)
    assert isinstance(found, Refused)
    assert "ended by the system" in found.message
    live.ask(thicken(3.0), Path(), Viewing())
    assert live.waits
    assert get_process(live).pid != first.pid
    live.close()


def test_a_question_that_does_not_end_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STUCK", 0.2)
    live = Live()
    size = {"lognormal": {"median_um": 40.0, "sigma": 1.6}}
    large = change(change(DUST, "particles", "dust", "radius_um", to=None), "particles", "dust", "size", to=size)
    live.ask(large, Path(), Viewing())
    first = get_process(live)
    live.ask(DUST, Path(), Viewing())

    def is_first_gone() -> bool:
        live.refresh()
        return first.poll() is not None

    until(is_first_gone)
    assert live.waits
    assert get_process(live) is not first
    live.close()


def test_processes_end_with_their_tab_and_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_WARM", 1)
    benches = Benches()
    one, other = benches.of("one"), benches.of("other")
    one.live.ask(DUST, Path(), Viewing())
    first = get_process(one.live)
    other.live.ask(DUST, Path(), Viewing())  # in place of the one not asked for longest
    second = get_process(other.live)
    until(lambda: first.poll() is not None)
    assert not one.live.waits
    other.pages = 1
    leave_bench(other)
    until(lambda: second.poll() is not None)
    one.live.ask(DUST, Path(), Viewing())  # the one that was left open
    third = get_process(one.live)
    benches.close()
    until(lambda: third.poll() is not None)


@pytest.mark.slow
def test_no_process_is_left_when_the_server_is_killed() -> None:
    code = (
        "import sys, time; sys.path[:] = {path!r}\n"
        "from tests.test_app_appearance import *\n"
        "live = Live(); live.ask(DUST, Path(), Viewing())\n"
        "print(get_process(live).pid, flush=True); time.sleep(60)"
    )
    path = [*sys.path, str(Path(__file__).parents[1])]
    server = subprocess.Popen([sys.executable, "-c", code.format(path=path)], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        child = int(server.stdout.readline())
        assert is_there(child)
    finally:
        server.kill()
        server.wait()
        server.stdout.close()
    until(lambda: not is_there(child), 10.0)


@pytest.mark.parametrize("title", list_paint_starts())
def test_every_paint_to_begin_with_has_sliders_and_an_appearance(title: str) -> None:
    content, told = list_paint_starts()[title]()
    assert explain_missing(content) == ""
    assert told
    sliders = list_sliders(content)
    assert any(one.place[-1] == "thickness_um" for one in sliders)
    assert any(one.place[0] == "particles" for one in sliders)
    for slider in sliders:
        value = read_share(get_value(content, slider.place))
        assert value is not None
        assert slider.reaches(value)
        assert 0 <= slider.find_step(value) <= STEPS
        assert slider.find_value(slider.find_step(value)) == close_to(value, rtol=0.03, atol=0.0)
        assert (slider.find_value(0), slider.find_value(STEPS)) == close_to(
            (slider.low, slider.high), rtol=5e-3, atol=0.0
        )


def test_what_is_missing_is_said() -> None:
    assert "optical thickness" in explain_missing(START)
    assert "No layer here holds particles" in explain_missing({"layer": [{"phase": "rayleigh", "thickness": 1.0}]})
    assert explain_missing({"particles": {}, "layer": [{"particles": "gold", "thickness": math.inf}]}) == ""


def test_spectra_are_drawn_with_those_before(shared: Live) -> None:
    shared.ask(DUST, Path(), Viewing())
    found = appeared(shared)
    figure = figures.spectra(found.shares, found.shares, "45:0")
    names = [trace.name for trace in figure.data]
    assert names == ["over black", "over white", "over black, before", "over white, before"]
    assert_close(figure.data[0].y, found.shares.over_black, rtol=1e-6, atol=0.0)
    assert_close(figure.data[0].x, found.shares.wavelength_um, rtol=1e-6, atol=0.0)
