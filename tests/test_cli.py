"""The command line: one table of command lines with what each prints, writes and returns, as a shell sees it."""

import io
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.commands import common, solve

from .helpers import HANGS, close_to, run

LAYER = '[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n'
ASKED = "[brdf]\nmu_i = [0.6, 1.0]\nmu_o = [0.5, 1.0]\nphi_deg = [0, 60, 120, 180]\n[field]\nmu0 = 0.6\ntau = [0, 1]\n"
SCENE = f"nodes = 4\n{LAYER}{ASKED}"
GOLD = '[particles.gold]\nindex = "gold"\nradius_um = 0.1\n[[layer]]\nparticles = "gold"\nthickness = 1.0\n'
VRTE = [sys.executable, "-m", "vrte.cli"]
HERE = {"scene.toml", "gold.toml", "dust.csv", "folder.nc"}
GOOD = [  # a command line, what it prints, what it writes
    (
        "brdf scene.toml -o out.nc --csv out.csv --plot out.png --threads 1",
        [r"wrote out\.nc \(", r"wrote out\.csv", r"wrote out\.png", r"homogeneous +\d+\.\d{3} +\d+\.\d{3}\n",
         "1 thread", r"by modes \(auto: doubling is predicted to take [\d.]+ times"],
        "out.nc out.csv out.png",
    ),
    ("field scene.toml -o out.nc --csv out.csv --plot out.png", ["field of scene.toml"], "out.nc out.csv out.png"),
    (
        "brdf scene.toml -o out.nc --algorithm doubling --verify",
        [r"by doubling \(asked for\)", r"modes agrees to \d\.\de-1[3-7] in radiance, \d\.\de-1[3-7] in flux"],
        "out.nc",
    ),
    ("brdf scene.toml -o out.nc --method single-scattering", ["  single-scattering, 4 nodes, "], "out.nc"),
    (
        "brdf scene.toml -o out.csv --derivative layer[1].albedo --derivative layer[1].thickness",
        [r"with layer\[1\].albedo: f00 by at most 0.3918 1/sr .* \(algebra\)", r"\].thickness: f00 by .* 0.0623 "],
        "out.csv",
    ),
    ("field scene.toml -o out.csv --derivative layer[1].albedo", [r"I by at most 0.2491 W/m2/sr a unit"], "out.csv"),
    ("field scene.toml -o out.csv --method auto --accuracy 1e-3", [r"auto, rule 2 \(accuracy\)"], "out.csv"),
    ("material", ["zinc oxide"], ""),
    ("material gold --wavelengths-um 0.5,0.6", ["(?s)^(?!.*albedo)"], ""),
    ("--version", [rf"^vrte {re.escape(vrte.__version__)}\n$"], ""),
]  # fmt: skip
REFUSED = [  # a command line, words of the complaint, and of the page that says more
    ("brdf scene.toml", "nothing to write: -o, --csv or --plot names a file"),
    ("brdf scene.toml -o out.txt", "must end in .nc or .csv or .zarr"),
    ("brdf scene.toml -o absent/out.nc", "lies in a folder that does not exist"),
    ("brdf scene.toml -o folder.nc", "it is a folder"),
    ("brdf scene.toml -o out.nc --csv out.nc", "must end in .csv"),
    ("material chalk --scene chalk.toml -o chalk.csv", "--wavelength-um is missing"),
    ("", "COMMAND"),
    ("--verbose", "--verbose goes with --version"),
    ("bdrf", "invalid choice: 'bdrf'"),
    ("brdf", "SCENE.toml"),
    ("field scene.toml -o out.csv --method auto --nodes 8", "method 'auto' takes no nodes"),
    ("brdf scene.toml -o out.csv --derivative layer[1].thicknes", "layer[1].thicknes"),
    ("brdf scene.toml -o out.csv --derivative layer[1].thicknes --wavelengths-um 0.5,0.6", "layer[1].thicknes"),
    ("brdf absent.toml -o out.nc", "error: absent.toml: No such file"),
    ("sweep absent.toml -o out.nc", "error: absent.toml: No such file"),
    ("brdf . -o out.nc", "Is a directory"),
    ("brdf scene.toml -o out.nc --threads 0", "must be a whole number from 1 to 4096, not '0'"),
    ("brdf scene.toml -o out.nc --threads many", "must be a whole number from 1 to 4096, not 'many'"),
    ("brdf scene.toml -o out.nc --accuracy 1", "must be a number between 1e-15 and 0.1, not '1'"),
    ("brdf scene.toml -o out.nc --accuracy fine", "must be a number between 1e-15 and 0.1, not 'fine'"),
    ("brdf scene.toml -o out.nc --time-limit-s 0", "must be seconds above 0, inf for no limit, not '0'"),
    ("brdf scene.toml -o out.nc --time-limit-s never", "must be seconds above 0, inf for no limit, not 'never'"),
    ("brdf scene.toml -o out.nc --truncation sharp", "invalid choice: 'sharp'"),
    ("brdf scene.toml -o out.nc --algorithm guess", "'auto', 'direct', 'modes', 'doubling'"),
    ("brdf scene.toml -o out.nc --colour", "unrecognized arguments: --colour"),
    ("brdf scene.toml -o out.nc --method magic", "invalid choice: 'magic'"),
    ("brdf scene.toml -o out.nc --method single-scattering --set orders=3", "no setting 'orders': there are none"),
    ("brdf scene.toml -o out.nc --set orders", "must be NAME=VALUE, not 'orders'"),
    ("brdf scene.toml -o out.nc --wavelengths-um 0.6,0.5", "must be ascending wavelengths such as 0.45,0.55"),
    (
        "export gold.toml -o out.bsdf --step-deg 5",
        "step_deg is of a .pbsdf alone: leave it out for a .bsdf (docs/how_to/exports.md)",
    ),
    ("export gold.toml -o out.pbsdf --wavelengths-um 0.5,0.6", "takes exactly 5 wavelengths, not 2"),
    ("export gold.toml -o out.gltf", "must end in .nc or .pbsdf or .bsdf or .binary"),
    ("brdf gold.toml -o out.nc --wavelengths-um 0.5,99", "gold.toml: at 99 um: particles.gold.index: "),
    ("brdf gold.toml -o out.nc --wavelengths-um 0.5 --plot a.jpg", "must end in .png or .svg or .pdf"),
    ("material gold", "--wavelength-um is missing"),
    ("material glod --wavelength-um 0.6", "did you mean 'gold'"),
    ("material glod --wavelength-um 0.6", "(docs/how_to/materials.md)"),
    ("material gold --wavelength-um -1", "wavelength_um must be"),
    ("material gold --wavelength-um 600", "did you mean 0.6?"),
    ("material gold --wavelength-um x", "invalid float value: 'x'"),
    ("material gold --range-um 0.7:0.5:3", "must be LOW:HIGH:COUNT, ascending"),
    ("material rutile --range-um 0.3:0.7:5", "rutile goes from 0.36 to 1.53 um; a wavelength of 0.3 um is outside"),
    ("material gold --wavelength-um 0.6 --host-index 1.5", "--host-index says what is around spheres"),
    ("material gold --wavelength-um 0.6 --scene a.toml", "--scene goes with ready materials"),
    ("material chalk --radius-um 1", "--radius-um goes with substances, not with ready materials"),
    ("material chalk --scene a.txt", "must end in .toml"),
    ("material gold --wavelength-um 0.6 --plot a.png", "--plot draws over wavelengths"),
    ("material gold --range-um 0.5:0.7:3 -o a.txt", "must end in .csv"),
    ("material --range-um 0.5:0.7:3", "needs the name of a material before it (docs/how_to/materials.md)"),
    ("phase --normalise", "needs the name of a file before it (docs/how_to/importing.md)"),
    ("phase scene.toml --recognise --plot a.png", "--plot plays no part in it"),
    ("phase dust.csv --convention granada", "dust.csv: angle_deg must reach from 0 to 180 degrees, not from 3"),
    ("phase dust.csv -o out.txt", "must end in .csv"),
    ("materials -o cards.txt", "must end in .png or .svg or .pdf"),
    ("sweep scene.toml -o out.csv", "must end in .zarr or .nc"),
    ("init lava", "invalid choice: 'lava'"),
    ("init --force", "--force needs a kind before it: powder, paint, cloud, snow, sea"),
    ("init -o a.toml", "-o needs a kind"),
    ("init sea -o a.txt", "must end in .toml"),
    ("init sea -o absent/a.toml", "a folder that does not exist"),
    ("init sea -o scene.toml", "scene.toml is there already: -o names another file, --force writes over it"),
    *((f"{study} --quick", f"run `make {study}` in its source tree") for study in ("tables", "report", "stability")),
]
CHANGED = [  # a text of the scene file, what stands in its place, and the end of the complaint
    ("thickness", "thicknes", "layer[1].thicknes = 1.0: unknown key; did you mean 'thickness'"),
    ('"rayleigh"', '"raleigh"', "(docs/how_to/importing.md)\n"),
    ("nodes = 4", "nodes = 0", "(docs/reference/scene_files.md)\n"),
    ("nodes = 4", "nodes = ", "scene.toml: not valid TOML: Invalid value (at line 1, column 9)\n"),
    ("mu_i = [0.6, 1.0]", "mu_i = 1.5", "brdf.mu_i "),
    ("[0, 60, 120, 180]", "[nan]", "brdf.phi_deg"),
    ("[brdf]", "[field2]", "unknown key; did you mean 'field'"),
    ("phi_deg = [0, 60, 120, 180]", "", "3 different phi_deg"),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of now, with scene files, a scattering matrix, and a folder that has the name of a result."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "gold.toml").write_text(GOLD + ASKED)
    (tmp_path / "dust.csv").write_text("angle_deg,F11\n3,1\n90,1\n177,1\n")
    (tmp_path / "folder.nc").mkdir()
    return tmp_path


def list_written(folder: Path) -> set[str]:
    """What is there beside what was there."""
    return {file.name for file in folder.iterdir()} - HERE


def read_complaint(capsys: pytest.CaptureFixture[str]) -> str:
    """What stands on standard error, which must be one line that names the program."""
    reported = capsys.readouterr()
    assert reported.out == ""
    assert re.fullmatch(r"vrte: error: [^\n]+\n", reported.err)
    return reported.err


@pytest.mark.parametrize(("line", "printed", "written"), GOOD, ids=[row[0] for row in GOOD])
def test_what_is_printed_and_written(
    line: str, printed: list[str], written: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*line.split()) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert not [words for words in printed if not re.search(words, reported.out)]
    assert list_written(folder) == {*written.split()}


@pytest.mark.parametrize(("line", "words"), REFUSED)
def test_refused_before_the_work_in_one_line_with_code_2(
    line: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "--set" not in line:  # a method's settings are seen to with the request
        monkeypatch.setattr(solve, "brdf", lambda *_, **__: pytest.fail("worked"))
    assert run(*line.split()) == 2
    assert words in read_complaint(capsys)
    assert list_written(folder) == set()


@pytest.mark.parametrize(("old", "new", "words"), CHANGED)
def test_a_bad_scene_file_is_one_line_and_code_2(
    old: str, new: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("scene.toml").write_text(SCENE.replace(old, new))
    assert run("brdf", "scene.toml", "-o", "out.nc", "--plot", "out.png") == 2
    assert words in (reported := read_complaint(capsys))
    assert reported.startswith("vrte: error: scene.toml: ")
    assert reported.count("docs/") == words.count("docs/") or "docs/" not in words
    assert list_written(folder) == set()


def test_files_hold_what_the_calls_find(folder: Path) -> None:
    """Methods and settings of the file, and options that win over them."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
    asked: Any = (scene, [0.6, 1.0], [0.5, 1.0], [0, 60, 120, 180])
    orders = 'method = "successive-orders"\nsettings = { orders = 2 }\n'
    for above, more, how in (
        ("", (), {}),
        ("", ("--method", "single-scattering"), {"method": "single-scattering"}),
        (orders, (), {"method": "successive-orders", "settings": {"orders": 2}}),
        (orders, ("--set", "orders=3"), {"method": "successive-orders", "settings": {"orders": 3}}),
        (orders, ("--method", "single-scattering"), {"method": "single-scattering"}),
    ):
        Path("scene.toml").write_text(above + SCENE)
        assert run("brdf", "scene.toml", "-o", "out.nc", "--csv", "out.csv", *more) == 0
        expected = vrte.brdf(*asked, nodes=4, **how)
        for name in ("out.nc", "out.csv"):
            np.testing.assert_array_equal(vrte.load(name).mueller, expected.mueller)
    Path("scene.toml").write_text(
        SCENE.replace('"rayleigh"', "{ henyey_greenstein = 0.7 }").replace("4\n", "4\naccuracy = 1e-3\n", 1)
    )
    for more, made in (
        ((), {"nodes": 4, "accuracy": 1e-3, "truncation": "delta-m, small-angle for light going down"}),
        (
            ("--nodes", 6, "--accuracy", "1e-5", "--truncation", "delta-m"),
            {"nodes": 6, "accuracy": 1e-5, "truncation": "delta-m"},
        ),
    ):
        assert run("field", "scene.toml", "-o", "out.nc", *more) == 0
        field = vrte.load("out.nc")
        assert {name: field.diagnostics[name] for name in made} == made
        assert field.stokes.shape == (2, 2 * made["nodes"], 1, 4)  # type: ignore[union-attr]


def test_an_unreached_base_and_doubtful_particles_are_reported(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dense = "wavelength_um = 0.6\n[particles.p]\nindex = [1.5, 0.1]\nradius_um = 0.1\n"
    layer = '[[layer]]\nparticles = "p"\nthickness_um = 1\nvolume_fraction = 0.3\n'
    rest = '[[layer]]\nphase = "isotropic"\nalbedo = 0.5\nthickness = inf\n[base]\nkind = "lambertian"\nalbedo = 1\n'
    Path("scene.toml").write_text("nodes = 4\n" + dense + layer + rest + "[field]\nmu0 = 0.5\n")
    assert run("field", "scene.toml", "-o", "out.nc") == 0
    reported = capsys.readouterr()
    assert re.fullmatch(r"vrte: warning: [^\n]*0\.3[^\n]*\n", reported.err)
    assert "base: Lambertian(albedo=1.0), which no light reaches" in reported.out


@pytest.mark.parametrize("option", ["-o", "--csv"])
def test_a_table_alone_needs_no_extra(folder: Path, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("xarray", "h5netcdf", "h5py", "matplotlib"):
        monkeypatch.setitem(sys.modules, module, None)
    assert run("brdf", "scene.toml", option, "out.csv") == 0
    assert vrte.load("out.csv").mu_i.tolist() == [0.6, 1.0]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (vrte.AccuracyError("the residual is 1"), 1),
        (MemoryError(), 1),
        (OSError(28, "No space left on device"), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_failures(
    error: BaseException, code: int, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    before = warnings.showwarning, signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(solve, "brdf", fail)
    assert run("brdf", "scene.toml", "-o", "out.nc") == code
    read_complaint(capsys)
    assert list_written(folder) == set()
    assert (warnings.showwarning, signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.parametrize(("module", "extra"), [("xarray", "files"), ("h5netcdf", "files"), ("matplotlib", "plot")])
def test_a_missing_extra_is_named_before_the_work(
    module: str, extra: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    find = common.importlib.util.find_spec
    monkeypatch.setattr(common.importlib.util, "find_spec", lambda name: None if name == module else find(name))
    monkeypatch.setattr(solve, "read_scene", lambda *_: pytest.fail("worked"))
    assert run("brdf", "scene.toml", "-o", "out.nc", "--plot", "out.png") == 1
    assert f"pip install 'vrte[{extra}]'" in read_complaint(capsys)


def test_an_output_is_no_pipe_and_not_the_file_that_is_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo("pipe.nc")
    shutil.copy("scene.toml", "scene.csv")
    for line, words in (("scene.toml -o pipe.nc", "a pipe or a device"), ("scene.csv -o scene.csv", "that is read")):
        assert run("brdf", *line.split()) == 2
        assert words in read_complaint(capsys)


def test_material_over_a_range(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = "material gold --range-um 0.5:0.7:3 --radius-um 0.1 --host-index 1.5 -o gold.csv --plot gold.svg"
    assert run(*asked.split()) == 0
    reported = capsys.readouterr().out
    sealed, names, *rows = (line.split(",") for line in Path("gold.csv").read_text().splitlines())
    assert sealed[0].startswith("# vrte sha256 ")
    assert names[:5] == ["wavelength_um", "n", "k", "albedo", "asymmetry"]
    assert [float(row[0]) for row in rows] == [0.5, 0.6, 0.7]
    spheres = vrte.spheres("gold", radius_um=0.1, wavelength_um=0.6, host_index=1.5)
    assert (float(rows[1][3]), float(rows[1][5])) == (spheres.albedo, spheres.extinction_um2)
    assert float(rows[1][5]) == close_to(float(rows[1][6]) + float(rows[1][7]), rtol=1e-6, atol=0.0)
    assert f"{spheres.extinction_um2:16.6g}" in reported
    assert Path("gold.svg").read_bytes().startswith(b"<?xml")
    assert run("material", "gold", "--wavelength-um", "0.64") == 0
    index = vrte.refractive_index("gold", 0.64)
    reported = capsys.readouterr().out
    assert reported == f"gold at 0.64 um: n = {index.n:.6g}, k = {index.k:.6g}\nfrom {index.source}\n"


def test_a_terminal_that_lacks_signs_gets_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "ascii"))
    assert run("init", "paint", "-o", tmp_path / "2µm²_60°_ü_Δ.toml") == 0
    assert b"2um2_60 deg_u_?.toml" in written.getvalue()


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)]
)
def test_a_bar_on_a_terminal_and_a_run_that_is_stopped_leaves_nothing(
    folder: Path, number: signal.Signals, code: int
) -> None:
    """Stopped while it solves: a scene that would take a minute."""
    Path("scene.toml").write_text(
        "nodes = 200\n[[layer]]\nphase = { henyey_greenstein = 0.97 }\nalbedo = 0.99\nthickness = 10\n"
        "[brdf]\nmu_i = { start = 0.1, stop = 1, count = 50 }\nmu_o = { start = 0.1, stop = 1, count = 50 }\n"
    )
    master, terminal = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    # a background shell hands down an ignored SIGINT
    default = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    started = subprocess.Popen(
        [*VRTE, "brdf", "scene.toml", "-o", "out.nc"],
        stdout=subprocess.PIPE, stderr=terminal, env=environment, preexec_fn=default,
    )  # fmt: skip
    os.close(terminal)
    shown = os.read(master, 1 << 16)
    while b"Fourier orders" not in shown:  # the progress bar: the solve has begun
        shown += os.read(master, 1 << 16)
    time.sleep(0.5)
    started.send_signal(number)
    with started.stdout:
        assert started.stdout.read() == b""
    assert started.wait(timeout=HANGS) == code
    with suppress(OSError):  # a terminal whose other end is closed
        while more := os.read(master, 1 << 16):
            shown += more
    os.close(master)
    assert b"Traceback" not in shown
    assert list_written(folder) == set()
