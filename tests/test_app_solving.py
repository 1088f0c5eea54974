"""The processes that solve for the viewer: their numbers, their end, and what they cannot do to the server."""

import copy
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.checks import adopt_with_notes, write_link
from vrte.app.solving import tab_session as downloads
from vrte.app.solving.solve import adopt, make_outcome, read, solve
from vrte.app.solving.tab_session import MOST_TABS, TabSessions
from vrte.app.solving.worker import EMPTY, Adopted, Outcome, Query, Refused, Task, explain_end, take_newest
from vrte.exports.polarized import USUAL_UM
from vrte.formats.toml_table import write_toml

from .helpers import assert_close, close_to, is_alive, wait_until
from .viewer_server import ROOT, ask, get_process, work

SMALL: form.Content = {
    "wavelength_um": [0.5, 0.6],
    "nodes": 6,
    "particles": {"dust": {"index": [1.5, 0.01], "radius_um": 0.05}},
    "layer": [{"particles": "dust", "thickness": 1.0}, {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}],
    "base": {"kind": "lambertian", "albedo": 0.3},
    "brdf": {"mu_i": [0.4, 0.8], "mu_o": [0.3, 0.7, 1.0], "phi_deg": [0, 90, 180, 270]},
    "field": {"mu0": 0.6, "mu": [0.5, -0.5], "phi_deg": [0, 180]},
}
LONG: form.Content = {
    "nodes": 300,
    "layer": [{"phase": {"henyey_greenstein": 0.97}, "albedo": 0.999, "thickness": 50.0}],
    "brdf": {"mu_i": {"start": 0.1, "stop": 1.0, "count": 40}, "mu_o": 0.5},
}


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    found = ask(Query(), "solve.solve", SMALL)
    assert isinstance(found, Outcome), found
    return found


def test_the_numbers_are_those_of_the_library(outcome: Outcome) -> None:
    assert_close(np.stack([one.mueller for one in outcome.brdfs]), vrte.spectrum(SMALL).mueller, rtol=1e-12, atol=1e-16)
    dust = vrte.spheres((1.5, 0.01), radius_um=0.05, wavelength_um=0.6)
    scene = vrte.Scene([vrte.Layer.of(dust, 1.0), vrte.Layer(vrte.rayleigh(), 0.9, 0.5)], vrte.Lambertian(0.3))
    tau = [1.5 * step / 4 for step in range(5)]
    field = vrte.radiance(scene, 0.6, mu=[0.5, -0.5], phi=[0, 180], tau=tau, nodes=6)
    assert_close(outcome.fields[1].stokes, field.stokes, rtol=1e-12, atol=1e-16)
    inside = outcome.inside[1]
    assert [*inside] == ["layer 1: dust", "layer 2: rayleigh"]
    np.testing.assert_array_equal(inside["layer 1: dust"].coefficients, dust.phase_matrix.coefficients)
    assert any("transmission: not asked for" in line for line in outcome.plan.left_out)


def test_the_bar_goes_on_and_is_not_full_while_something_is_solved() -> None:
    """Also over the other base, whose reflectance stands beside the scene's."""
    *reported, _ = work(solve, SMALL | {"wavelength_um": 0.5})
    stages = list(dict.fromkeys(one.stage.partition(":")[0] for one in reported))
    assert stages == ["particles", "BRDF", "BRDF over another base", "field inside"]
    fractions = [one.fraction for one in reported]
    assert fractions == sorted(fractions)
    assert max(fractions) < 0.99
    ends = [one.fraction for one in reported if one.stage.endswith("adding up")]
    assert ends == close_to([(index + 0.9) / 4.0 for index in (1, 2, 3)], rtol=0.0, atol=1e-12)
    counted = [(one, re.fullmatch(r"BRDF: Fourier orders, (\d) of 7", one.stage)) for one in reported]
    done = {int(found[1]): one.fraction for one, found in counted if found}  # small orders are solved together
    assert done
    assert [*done.values()] == close_to([0.25 + 0.9 / 4 * each / 7 for each in done], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_what_is_downloaded_opens_again_with_its_scene(outcome: Outcome, suffix: str, tmp_path: Path) -> None:
    for kind in ("brdf", "field"):
        name, data = downloads.make_result_download(kind, outcome, suffix, 1)
        (tmp_path / name).write_bytes(data)
    found = vrte.load(tmp_path / f"brdf{suffix}")
    np.testing.assert_array_equal(found.mueller, np.stack([one.mueller for one in outcome.brdfs]))
    again = make_outcome(found)
    assert (again.wavelength_um, again.content) == ((0.5, 0.6), adopt_with_notes(SMALL)[0])
    np.testing.assert_array_equal(vrte.load(tmp_path / f"field{suffix}").stokes, outcome.fields[1].stokes)


def test_strangers_files_are_read_in_a_process_of_its_own(outcome: Outcome, monkeypatch: pytest.MonkeyPatch) -> None:
    names: dict[str, Any] = {"names": frozenset()}
    scene, link, field = write_toml(SMALL).encode(), write_link(SMALL), ("field", outcome, ".nc", 0)
    expected = Adopted(adopt_with_notes(SMALL)[0], ())
    assert work(adopt, link, **names) == [expected]
    for call, given, more, words in (
        (adopt, scene[:50], names, "not valid TOML"),
        (adopt, link[:50], names, "the link is cut short"),
        (read, b"\x89HDF\r\n\x1a\n" + bytes(1000), {"suffix": ".nc"}, "the file: it is not a NetCDF file"),
        (solve, SMALL | {"field": SMALL["field"] | {"tau": [9.0]}}, {}, "field.tau must lie between 0 and"),  # its key
    ):
        refused = work(call, given, **more)[-1]
        assert isinstance(refused, Refused)
        assert words in refused.message
    monkeypatch.setattr("vrte.app.form.checks.parse_toml", lambda text: pytest.fail("the server has parsed it"))
    assert ask(Query(), "solve.adopt", scene, **names) == expected
    found = ask(Query(), "solve.read", downloads.make_result_download(*field)[1], suffix=".nc")
    np.testing.assert_array_equal(found.fields[0].stokes, outcome.fields[0].stokes)


def test_a_scene_that_takes_too_long_to_read_is_given_up() -> None:
    """Whatever it is that does so: the process has a limit of time."""
    code = (
        f"import sys; sys.path[:] = {sys.path!r}\n"
        "from vrte.app.solving import solve, worker\n"
        "def parse(data):\n"
        "    while True: pass\n"
        "solve.parse_content = parse\n"
        "worker.main()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE) as process:
        pickle.dump((1e9, 0.5), process.stdin)
        pickle.dump((1, Task("solve.adopt", b"", Path(), {"names": frozenset()})), process.stdin)
        process.stdin.flush()
        assert process.wait(60) == -signal.SIGXCPU
    with tempfile.TemporaryFile() as reported:
        assert explain_end(-signal.SIGXCPU, reported) == "the process of this task has taken too long, and was ended"


def test_an_upload_cannot_bring_back_another_file(outcome: Outcome, tmp_path: Path) -> None:
    """Whose BRDF would be the bytes of somebody's letters, to be downloaded as CSV."""
    h5py = pytest.importorskip("h5py")
    secret, upload = tmp_path / "letters", tmp_path / "upload.nc"
    secret.write_bytes(bytes(range(256)))
    upload.write_bytes(downloads.make_result_download("brdf", Outcome(None, brdfs=outcome.brdfs[:1]), ".nc")[1])
    with h5py.File(upload, "r+") as file:
        shape = file["mueller"].shape
        del file["mueller"]
        file.create_dataset("mueller", shape, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
    (found,) = work(read, upload.read_bytes(), suffix=".nc")
    assert found.message.startswith("the file: its mueller lies in another file (external storage)")


def test_a_tensor_is_solved_at_five_wavelengths_and_what_cannot_be_downloaded_is_a_sentence() -> None:
    for given, taken in (
        (0.64, USUAL_UM),
        (None, USUAL_UM),
        ([0.4, 0.5, 0.6, 0.8], (0.4, 0.5, 0.6, 0.7, 0.8)),
        ([0.41, 0.5, 0.55, 0.6, 0.65], (0.41, 0.5, 0.55, 0.6, 0.65)),
        ({"start": 0.43, "stop": 0.7, "count": 7}, (0.43, 0.498, 0.565, 0.632, 0.7)),
    ):
        chosen = downloads.choose_tensor_wavelengths({"wavelength_um": given})
        assert chosen == close_to(taken, rtol=0.0, atol=1e-12)
    with pytest.raises(vrte.SceneError, match="wavelength_um: Mitsuba's measured_polarized takes wavelengths of whole"):
        downloads.choose_tensor_wavelengths({"wavelength_um": [0.45, 0.5, 0.55, 0.6, 0.65005]})
    for kind in ("BRDF", "field"):
        with pytest.raises(vrte.SceneError, match=f"there is no {kind}"):
            downloads.make_result_download(kind.lower(), EMPTY, ".nc")


def test_a_solve_is_cancelled_at_once_and_one_that_dies_is_a_sentence() -> None:
    def begin() -> Query:
        query = Query()
        query.ask(Task("solve.solve", LONG))
        return query

    query = begin()
    wait_until(lambda: "Fourier" in query.progress.stage or not query.waits)
    assert query.take() is None  # not yet
    start, worker = time.monotonic(), query.worker
    query.close()
    query._hear(worker, 1, Refused("too late"))  # type: ignore[arg-type]
    assert (query.take(), query.take()) == (Refused("cancelled"), None)
    assert time.monotonic() - start < 2.0
    query = begin()
    query.stop()  # before it has begun
    assert query.take() == Refused("cancelled")
    query = begin()
    os.kill(get_process(query).pid, signal.SIGKILL)
    wait_until(lambda: not query.waits)
    assert "ended by the system" in query.answer.message
    assert "memory" in ask(Query(), "solve.solve", SMALL | {"nodes": 800}, memory=3e8).message


@pytest.mark.slow
def test_no_process_is_left_when_the_server_is_killed() -> None:
    code = (
        f"import sys, time; sys.path[:] = {[*sys.path, str(ROOT)]!r}\n"
        "from tests.test_app_solving import *\n"
        "query = Query()\n"
        "query.ask(Task('solve.solve', LONG))\n"
        "wait_until(lambda: 'Fourier' in query.progress.stage)\n"
        "print(get_process(query).pid, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as server:
        try:
            child = int(server.stdout.readline())
            assert is_alive(child)
        finally:
            server.kill()
    wait_until(lambda: not is_alive(child))


def test_tabs_keep_their_own_until_they_are_too_many() -> None:
    sessions = TabSessions()
    one, other = sessions.of("one"), sessions.of("other")
    one.content["nodes"] = 5
    one.content["layer"][0]["thickness"] = 7.0
    one.view["place"] = 3
    assert (other.content, other.view) == (form.START, {})
    assert form.START["layer"][0]["thickness"] == 100.0
    for k in range(MOST_TABS - 2):
        sessions.of(f"new {k}")
    assert sessions.of("one") is one  # a reload
    sessions.of("one more")  # the other was not used for longest
    assert (sessions.of("one") is one, sessions.of("other") is other) == (True, False)
    assert len(sessions._sessions) == MOST_TABS


def test_nobody_waits_for_what_a_closed_page_solves() -> None:
    session = TabSessions().of("tab")
    session.content, session.pages = copy.deepcopy(LONG), 2
    session.start()
    session.leave()
    assert session.solves.waits
    session.leave()
    assert session.solves.take() == Refused("cancelled")


def test_the_newest_task_is_taken() -> None:
    inbox: SimpleQueue[Any] = SimpleQueue()
    for number in (1, 2, 3):
        inbox.put(number)
    assert (take_newest(inbox), inbox.empty()) == (3, True)
