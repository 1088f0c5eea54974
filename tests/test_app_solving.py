"""The processes that solve for the viewer: their numbers, their end, and what they cannot do to the server."""

import copy
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.files import adopt_with_notes, write_link
from vrte.app.solving import page_files as downloads
from vrte.app.solving.messages import Adopt, Adopted, Outcome, Progress, Read, Solve
from vrte.app.solving.solve import make_outcome, solve
from vrte.app.solving.tab_session import MOST_TABS, TabSessions
from vrte.app.solving.worker import Exchange
from vrte.app.solving.worker_process import Job, WorkerProcess, explain_end
from vrte.formats.scene_writer import write_toml

from .helpers import assert_close, close_to

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
ENOUGH = 4e9  # bytes


def until(happened: Callable[[], Any], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.01)


def get_process(worker: WorkerProcess | None) -> "subprocess.Popen[bytes]":
    """Once there is one."""
    assert worker is not None
    until(lambda: worker.process is not None)
    assert worker.process is not None
    return worker.process


def ended(job: Job) -> Job:
    until(lambda: job.ended)
    return job


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    shares = []
    job = Job(Solve(copy.deepcopy(SMALL), Path()))
    while not job.ended:
        shares.append(job.fraction)
        time.sleep(0.001)
    assert job.message == ""
    assert isinstance(job.outcome, Outcome)
    assert shares == sorted(shares)  # the bar never goes back
    assert len(set(shares)) > 2
    return job.outcome


def test_the_numbers_are_those_of_the_library(outcome: Outcome) -> None:
    for place, wavelength in enumerate(SMALL["wavelength_um"]):
        dust = vrte.spheres((1.5, 0.01), radius_um=0.05, wavelength_um=wavelength)
        layers = [vrte.Layer.of(dust, 1.0), vrte.Layer(vrte.rayleigh(), 0.9, 0.5)]
        scene = vrte.Scene(layers, vrte.Lambertian(0.3))
        expected = vrte.brdf(scene, [0.4, 0.8], [0.3, 0.7, 1.0], [0, 90, 180, 270], nodes=6)
        assert_close(outcome.brdfs[place].mueller, expected.mueller, rtol=1e-12, atol=1e-16)
        tau = [1.5 * step / 4 for step in range(5)]
        field = vrte.radiance(scene, 0.6, mu=[0.5, -0.5], phi=[0, 180], tau=tau, nodes=6)
        assert_close(outcome.fields[place].stokes, field.stokes, rtol=1e-12, atol=1e-16)
        np.testing.assert_array_equal(
            outcome.inside[place].phase_matrices[0].coefficients, dust.phase_matrix.coefficients
        )
    assert outcome.inside[0].names == ("layer 1: dust", "layer 2: rayleigh")
    assert outcome.plan is not None
    assert any("transmission: not asked for" in line for line in outcome.plan.left_out)


@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_what_is_downloaded_opens_again_with_its_scene(outcome: Outcome, suffix: str, tmp_path: Path) -> None:
    name, data = downloads.make_result_download("brdf", outcome, suffix)
    (tmp_path / name).write_bytes(data)
    found = vrte.load(tmp_path / name)
    assert isinstance(found, vrte.Spectrum)
    np.testing.assert_array_equal(found.mueller, np.stack([one.mueller for one in outcome.brdfs]))
    again = make_outcome(found)
    assert again.wavelength_um == (0.5, 0.6)
    assert again.content == adopt_with_notes(SMALL)[0]
    name, data = downloads.make_result_download("field", outcome, suffix, 1)
    (tmp_path / name).write_bytes(data)
    np.testing.assert_array_equal(vrte.load(tmp_path / name).stokes, outcome.fields[1].stokes)


def test_a_result_file_is_read_in_a_process_of_its_own(outcome: Outcome) -> None:
    job = ended(Job(Read(downloads.make_result_download("field", outcome, ".nc", 0)[1], ".nc")))
    assert isinstance(job.outcome, Outcome)
    np.testing.assert_array_equal(job.outcome.fields[0].stokes, outcome.fields[0].stokes)
    job = ended(Job(Read(b"\x89HDF\r\n\x1a\n" + bytes(1000), ".nc")))
    assert job.outcome is None
    assert job.message.startswith("the file is not a NetCDF file")


@pytest.mark.parametrize("given", [write_toml(SMALL).encode(), write_link(SMALL)])
def test_a_strangers_scene_is_read_in_a_process_of_its_own(given: bytes | str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrte.app.form.files.parse_toml", lambda text: pytest.fail("the server has parsed it"))
    job = ended(Job(Adopt(given, Path(), frozenset())))
    assert isinstance(job.outcome, Adopted), job.message
    assert job.outcome.content == adopt_with_notes(SMALL)[0]
    job = ended(Job(Adopt(given[:50], Path(), frozenset())))
    assert job.outcome is None
    assert ("not valid TOML" if isinstance(given, bytes) else "the link is cut short") in job.message


def test_a_scene_that_takes_too_long_to_read_is_given_up(tmp_path: Path) -> None:
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
        assert process.stdin is not None
        pickle.dump((1e9, 0.5), process.stdin)
        pickle.dump((1, Adopt(b"", Path(), frozenset())), process.stdin)
        process.stdin.flush()
        assert process.wait(60) == -signal.SIGXCPU
    with tempfile.TemporaryFile() as said:
        assert explain_end(-signal.SIGXCPU, said) == "the process of this task has taken too long, and was ended"


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
    job = ended(Job(Read(upload.read_bytes(), ".nc")))
    assert job.outcome is None
    assert job.message.startswith("the file is refused: its mueller lies in another file (external storage)")


@pytest.mark.parametrize(
    ("given", "taken"),
    [
        (0.64, downloads.TENSOR_UM),
        (None, downloads.TENSOR_UM),
        ([0.4, 0.5, 0.6, 0.8], (0.4, 0.5, 0.6, 0.7, 0.8)),
        ([0.41, 0.5, 0.55, 0.6, 0.65], (0.41, 0.5, 0.55, 0.6, 0.65)),
        ({"start": 0.43, "stop": 0.7, "count": 7}, (0.43, 0.498, 0.565, 0.632, 0.7)),
    ],
)
def test_a_tensor_is_solved_at_five_wavelengths(given: Any, taken: tuple[float, ...]) -> None:
    assert downloads.choose_tensor_wavelengths({"wavelength_um": given}) == close_to(taken, rtol=0.0, atol=1e-12)


def test_what_cannot_be_downloaded_is_a_sentence() -> None:
    for kind in ("brdf", "field"):
        with pytest.raises(vrte.SceneError, match="there is no"):
            downloads.make_result_download(kind, None, ".nc")
    with pytest.raises(vrte.SceneError, match="wavelength_um: Mitsuba's measured_polarized takes wavelengths of whole"):
        downloads.choose_tensor_wavelengths({"wavelength_um": [0.45, 0.5, 0.55, 0.6, 0.65005]})


def test_the_bar_is_not_full_while_something_is_solved() -> None:
    """Also over the other base, whose reflectance stands beside the scene's."""
    told: list[Progress] = []
    scene = SMALL | {"wavelength_um": 0.5}
    solve(Solve(scene, Path()), Exchange(told.append))
    stages = list(dict.fromkeys(one.stage.partition(":")[0] for one in told))
    assert stages == ["particles", "BRDF", "BRDF over another base", "field inside"]
    shares = [one.fraction for one in told]
    assert shares == sorted(shares)
    assert max(shares) < 0.99
    ends = [one.fraction for one in told if one.stage.endswith("adding up")]
    assert ends == close_to([(place + 0.9) / 4.0 for place in (1, 2, 3)], rtol=0.0, atol=1e-12)
    assert "BRDF: Fourier orders, 1 of 7" in [one.stage for one in told]


def test_a_cancelled_solve_ends_at_once() -> None:
    job = Job(Solve(LONG, Path()))
    until(lambda: "Fourier" in job.stage or job.ended)
    assert not job.ended, job.message
    start = time.monotonic()
    job.cancel()
    ended(job)
    assert time.monotonic() - start < 2.0
    assert (job.outcome, job.message) == (None, "cancelled")


def test_a_process_that_dies_is_a_sentence() -> None:
    job = Job(Solve(LONG, Path()))
    os.kill(get_process(job.worker).pid, signal.SIGKILL)
    assert "ended by the system" in ended(job).message


@pytest.mark.parametrize(
    ("change", "memory", "words"),
    [
        ({"nodes": 800}, 3e8, "memory"),
        ({"field": SMALL["field"] | {"tau": [9.0]}}, ENOUGH, "field.tau must lie between 0 and"),  # by its key
    ],
)
def test_what_shows_only_in_the_solve_is_a_sentence(change: form.Content, memory: float, words: str) -> None:
    job = ended(Job(Solve(SMALL | {"wavelength_um": 0.5} | change, Path()), memory))
    assert job.outcome is None
    assert words in job.message


@pytest.mark.slow
def test_no_process_is_left_when_the_server_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys, time; sys.path[:] = {path!r}\n"
        "from tests.test_app_solving import *\n"
        "job = Job(Solve(LONG, Path()))\n"
        "until(lambda: 'Fourier' in job.stage)\n"
        "print(get_process(job.worker).pid, flush=True); time.sleep(60)"
    )
    root = Path(__file__).parents[1]
    server = subprocess.Popen(
        [sys.executable, "-c", code.format(path=[*sys.path, str(root)])], stdout=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        child = int(server.stdout.readline())
        assert is_there(child)
    finally:
        server.kill()
        server.wait()
        server.stdout.close()
    until(lambda: not is_there(child), 10.0)


def is_there(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_tabs_keep_their_own_until_they_are_too_many() -> None:
    sessions = TabSessions()
    one, other = sessions.of("one"), sessions.of("other")
    one.content["nodes"] = 5
    one.content["layer"][0]["thickness"] = 7.0
    one.view["place"] = 3
    assert "nodes" not in other.content
    assert other.content["layer"][0]["thickness"] == 100.0
    assert other.view == {}
    assert sessions.of("one") is one  # a reload
    assert "nodes" not in form.START
    for k in range(MOST_TABS - 2):
        sessions.of(f"new {k}")
    assert sessions.of("one") is one
    sessions.of("one more")  # the other was not used for longest
    assert (sessions.of("one") is one, sessions.of("other") is other) == (True, False)
    assert len(sessions._sessions) == MOST_TABS


def test_nobody_waits_for_what_a_closed_page_solves() -> None:
    session = TabSessions().of("tab")
    session.content = copy.deepcopy(LONG)
    session.pages = 2
    session.start()
    session.leave()
    assert session.busy
    session.leave()
    assert session.job is not None
    assert ended(session.job).message == "cancelled"
