"""The command line: files, messages and exit codes, as a shell sees them."""

import io
import os
import pty
import re
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
from vrte import cli
from vrte.commands import common, solve

from .helpers import close_to

SCENE = """
nodes = 4
[[layer]]
phase = "rayleigh"
albedo = 0.9
thickness = 1.0
[brdf]
mu_i = [0.6, 1.0]
mu_o = [0.5, 1.0]
phi_deg = [0, 60, 120, 180]
[field]
mu0 = 0.6
tau = [0, 1]
"""
VRTE = [sys.executable, "-m", "vrte.cli"]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def run(*arguments: str | Path) -> int:
    """The exit code of `vrte` with these arguments."""
    try:
        return cli.main([str(argument) for argument in arguments])
    except SystemExit as leaving:
        return leaving.code  # type: ignore[return-value]


def files(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


def test_brdf_writes_what_it_says(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = scene.parent
    outputs = [folder / f"out.{suffix}" for suffix in ("nc", "csv", "png")]
    assert run("brdf", scene, "-o", outputs[0], "--csv", outputs[1], "--plot", outputs[2], "--threads", 1) == 0
    told = capsys.readouterr()
    assert told.err == ""
    for output in outputs:
        assert f"wrote {output}" in told.out
    assert re.search(r"homogeneous +\d+\.\d{3} +\d+\.\d{3}\n", told.out)
    assert "1 thread" in told.out
    assert files(folder) == {"scene.toml", "out.nc", "out.csv", "out.png"}
    layer = vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)
    expected = vrte.brdf(vrte.Scene([layer]), [0.6, 1.0], [0.5, 1.0], [0, 60, 120, 180], nodes=4, threads=1)
    saved = vrte.load(outputs[0])
    assert isinstance(saved, vrte.Brdf)
    np.testing.assert_array_equal(saved.mueller, expected.mueller)
    np.testing.assert_array_equal(vrte.load(outputs[1]).mueller, expected.mueller)
    assert outputs[2].read_bytes().startswith(b"\x89PNG")


def test_field_writes_what_it_says(scene: Path) -> None:
    folder = scene.parent
    assert run("field", scene, "-o", folder / "out.nc", "--csv", folder / "out.csv", "--plot", folder / "out.png") == 0
    saved = vrte.load(folder / "out.nc")
    assert isinstance(saved, vrte.Field)
    assert saved.stokes.shape == (2, 8, 1, 4)
    np.testing.assert_array_equal(vrte.load(folder / "out.csv").stokes, saved.stokes)
    assert files(folder) == {"scene.toml", "out.nc", "out.csv", "out.png"}


def test_the_algorithm_and_its_check_are_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ("brdf", scene, "-o", scene.parent / "out.nc")
    assert run(*command) == 0
    assert re.search(r"by modes \(auto: doubling is predicted to take [\d.]+ times", capsys.readouterr().out)
    assert run(*command, "--algorithm", "doubling", "--verify") == 0
    told = capsys.readouterr().out
    assert "by doubling (asked for)" in told
    assert re.search(r"modes agrees to \d\.\de-1[3-7] in radiance, \d\.\de-1[3-7] in flux", told)
    assert vrte.load(scene.parent / "out.nc").diagnostics["agreement"]["with"] == "modes"


def test_another_method_and_its_settings(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = scene.parent / "out.nc"
    assert run("brdf", scene, "-o", out, "--method", "single-scattering") == 0
    assert "  single-scattering, 4 nodes, " in capsys.readouterr().out
    expected = vrte.brdf(**one_layer(), method="single-scattering")
    np.testing.assert_array_equal(vrte.load(out).mueller, expected.mueller)


def test_a_method_of_the_file(scene: Path) -> None:
    out = scene.parent / "out.nc"
    scene.write_text('method = "successive-orders"\nsettings = { orders = 2 }\n' + SCENE)
    for arguments, orders in (((), 2), (("--set", "orders=3"), 3)):
        assert run("brdf", scene, "-o", out, *arguments) == 0
        expected = vrte.brdf(**one_layer(), method="successive-orders", settings={"orders": orders})
        np.testing.assert_array_equal(vrte.load(out).mueller, expected.mueller)
    assert run("brdf", scene, "-o", out, "--method", "single-scattering") == 0
    assert vrte.load(out).diagnostics["method"] == "single-scattering"


def one_layer() -> dict[str, Any]:
    """The scene and the directions of SCENE."""
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
    return {"scene": vrte.Scene([layer]), "mu_i": [0.6, 1.0], "mu_o": [0.5, 1.0], "phi": [0, 60, 120, 180], "nodes": 4}


def test_options_win_over_the_file(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text(
        SCENE.replace('"rayleigh"', "{ henyey_greenstein = 0.7 }").replace("4\n", "4\naccuracy = 1e-3\n", 1)
    )
    command = ("field", scene, "-o", scene.parent / "out.nc")
    assert run(*command) == 0
    made = vrte.load(scene.parent / "out.nc").diagnostics
    assert (made["nodes"], made["accuracy"]) == (4, 1e-3)
    assert "truncation: delta-m, small-angle for light going down (auto: " in capsys.readouterr().out
    assert run(*command, "--nodes", 6, "--accuracy", "1e-5", "--truncation", "delta-m") == 0
    made = vrte.load(scene.parent / "out.nc").diagnostics
    assert (made["nodes"], made["accuracy"], made["truncation"]) == (6, 1e-5, "delta-m")
    assert "truncation: delta-m (asked for)" in capsys.readouterr().out


def test_an_unreached_base_and_doubtful_particles_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dense = "wavelength_um = 0.6\n[particles.p]\nindex = [1.5, 0.1]\nradius_um = 0.1\n"
    layer = '[[layer]]\nparticles = "p"\nthickness_um = 1\nvolume_fraction = 0.3\n'
    rest = '[[layer]]\nphase = "isotropic"\nalbedo = 0.5\nthickness = inf\n[base]\nkind = "lambertian"\nalbedo = 1\n'
    (tmp_path / "scene.toml").write_text("nodes = 4\n" + dense + layer + rest + "[field]\nmu0 = 0.5\n")
    assert run("field", tmp_path / "scene.toml", "-o", tmp_path / "out.nc") == 0
    told = capsys.readouterr()
    assert re.fullmatch(r"vrte: warning: [^\n]*0\.3[^\n]*\n", told.err)
    assert "base: Lambertian(albedo=1.0), which no light reaches" in told.out


REFUSED: list[tuple[str, str]] = [  # arguments, and words of the complaint
    ("brdf scene.toml", "nothing to write: -o, --csv or --plot names a file"),
    ("brdf scene.toml -o out.txt", "must end in .nc or .csv or .zarr"),
    ("brdf scene.toml -o out", "must end in .nc or .csv or .zarr"),
    ("brdf scene.toml -o absent/out.nc", "lies in a folder that does not exist"),
    ("brdf scene.toml -o folder.nc", "it is a folder"),
    ("brdf scene.toml -o out.nc --csv out.nc", "must end in .csv"),
    ("", "COMMAND"),
    ("bdrf", "invalid choice: 'bdrf'"),
    ("brdf", "SCENE.toml"),
    ("brdf absent.toml -o out.nc", "absent.toml: No such file"),
    ("brdf . -o out.nc", "Is a directory"),
    ("brdf scene.toml -o out.nc --threads 0", "must be a whole number from 1 to 4096, not '0'"),
    ("brdf scene.toml -o out.nc --threads many", "must be a whole number from 1 to 4096, not 'many'"),
    ("brdf scene.toml -o out.nc --nodes 0", "must be a whole number from 1 to 4096, not '0'"),
    ("brdf scene.toml -o out.nc --accuracy 1", "must be a number between 1e-15 and 0.1, not '1'"),
    ("brdf scene.toml -o out.nc --accuracy fine", "must be a number between 1e-15 and 0.1, not 'fine'"),
    ("brdf scene.toml -o out.nc --time-limit-s 0", "must be seconds above 0, inf for no limit, not '0'"),
    ("brdf scene.toml -o out.nc --truncation sharp", "invalid choice: 'sharp'"),
    ("brdf scene.toml -o out.nc --algorithm guess", "'auto', 'direct', 'modes', 'doubling'"),
    ("brdf scene.toml -o out.nc --colour", "unrecognized arguments: --colour"),
    ("brdf scene.toml -o out.nc --method magic", "invalid choice: 'magic'"),
    ("brdf scene.toml -o out.nc --method single-scattering --set orders=3", "no setting 'orders': there are none"),
    ("brdf scene.toml -o out.nc --set orders", "must be NAME=VALUE, not 'orders'"),
    ("material gold", "--wavelength-um is missing"),
    ("material glod --wavelength-um 0.6", "did you mean 'gold'"),
    ("material gold --wavelength-um -1", "wavelength_um must be"),
    ("material gold --wavelength-um 600", "did you mean 0.6?"),
    ("material gold --wavelength-um x", "invalid float value: 'x'"),
    ("material gold --range-um 0.7:0.5:3", "must be LOW:HIGH:COUNT, ascending"),
    ("material rutile --range-um 0.3:0.7:5", "goes from 0.43 to 1.53 um; a wavelength of 0.3 um is outside"),
    ("material gold --wavelength-um 0.6 --host-index 1.5", "--host-index says what is around spheres"),
    ("material gold --wavelength-um 0.6 --plot a.png", "--plot draws over wavelengths"),
    ("material gold --range-um 0.5:0.7:3 -o a.txt", "must end in .csv"),
    ("material --range-um 0.5:0.7:3", "needs the name of a material"),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_refused_before_the_work_in_one_line_with_code_2(
    scene: Path, arguments: str, words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "--set" not in arguments:  # a method's settings are seen to with the request
        monkeypatch.setattr(solve, "brdf", lambda *_, **__: pytest.fail("worked"))
    monkeypatch.chdir(scene.parent)
    (scene.parent / "folder.nc").mkdir()
    assert run(*arguments.split()) == 2
    assert words in one_line(capsys)
    assert files(scene.parent) == {"scene.toml", "folder.nc"}


@pytest.mark.parametrize("option", ["-o", "--csv"])
def test_a_table_alone_needs_no_extra(scene: Path, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("xarray", "h5netcdf", "h5py", "matplotlib"):
        monkeypatch.setitem(sys.modules, module, None)
    assert run("brdf", scene, option, scene.parent / "out.csv") == 0
    assert files(scene.parent) == {"scene.toml", "out.csv"}
    assert vrte.load(scene.parent / "out.csv").mu_i.tolist() == [0.6, 1.0]


def test_too_few_directions_for_a_picture(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text(SCENE.replace("phi_deg = [0, 60, 120, 180]", ""))
    assert run("brdf", scene, "-o", scene.parent / "out.nc", "--plot", scene.parent / "out.png") == 2
    assert "3 different phi_deg" in one_line(capsys)
    assert files(scene.parent) == {"scene.toml"}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("thickness", "thicknes", r"scene\.toml: layer\[1\]\.thicknes = 1\.0: unknown key; did you mean 'thickness'"),
        ("mu_i = [0.6, 1.0]", "mu_i = 1.5", r"brdf\.mu_i .*1\.5"),
        ("[0, 60, 120, 180]", "[nan]", r"brdf\.phi_deg"),
        ("nodes = 4", "nodes = ", r"scene\.toml: not valid TOML: .*line 2"),
        ("[brdf]", "[field2]", r"field2 = .*: unknown key; did you mean 'field'"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    scene: Path, old: str, new: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(SCENE.replace(old, new))
    assert run("brdf", scene, "-o", scene.parent / "out.nc") == 2
    assert re.search(complaint, one_line(capsys))
    assert files(scene.parent) == {"scene.toml"}


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What stands on standard error, which must be one line that names the program."""
    told = capsys.readouterr()
    assert told.out == ""
    assert re.fullmatch(r"vrte: error: [^\n]+\n", told.err)
    return told.err


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
    scene: Path,
    error: BaseException,
    code: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(solve, "brdf", fail)
    assert run("brdf", scene, "-o", scene.parent / "out.nc") == code
    one_line(capsys)
    assert files(scene.parent) == {"scene.toml"}


@pytest.mark.parametrize(("module", "extra"), [("xarray", "files"), ("h5netcdf", "files"), ("matplotlib", "plot")])
def test_a_missing_extra_is_named_before_the_work(
    scene: Path, module: str, extra: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    find = common.importlib.util.find_spec
    monkeypatch.setattr(common.importlib.util, "find_spec", lambda name: None if name == module else find(name))
    monkeypatch.setattr(solve, "read_scene", lambda *_: pytest.fail("worked"))
    assert run("brdf", scene, "-o", scene.parent / "out.nc", "--plot", scene.parent / "out.png") == 1
    assert f"pip install 'vrte[{extra}]'" in one_line(capsys)


def test_material(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("material", "gold", "--wavelength-um", "0.64") == 0
    index = vrte.refractive_index("gold", 0.64)
    told = capsys.readouterr().out
    assert told == f"gold at 0.64 um: n = {index.n:.6g}, k = {index.k:.6g}\nfrom {index.source}\n"
    assert run("material") == 0
    assert "zinc oxide" in capsys.readouterr().out


def test_material_over_a_range(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, picture = tmp_path / "gold.csv", tmp_path / "gold.svg"
    asked = ["material", "gold", "--range-um", "0.5:0.7:3", "--radius-um", "0.1", "--host-index", "1.5"]
    assert run(*asked, "-o", table, "--plot", picture) == 0
    told = capsys.readouterr().out
    sealed, names, *rows = (line.split(",") for line in table.read_text().splitlines())
    assert sealed[0].startswith("# vrte sha256 ")
    assert names[:5] == ["wavelength_um", "n", "k", "albedo", "asymmetry"]
    assert [float(row[0]) for row in rows] == [0.5, 0.6, 0.7]
    spheres = vrte.spheres("gold", radius_um=0.1, wavelength_um=0.6, host_index=1.5)
    assert float(rows[1][3]) == spheres.albedo
    assert (
        float(rows[1][5])
        == spheres.extinction_um2
        == close_to(float(rows[1][6]) + float(rows[1][7]), rtol=1e-6, atol=0.0)
    )
    assert f"{spheres.extinction_um2:16.6g}" in told
    assert picture.read_bytes().startswith(b"<?xml")
    assert run("material", "gold", "--wavelengths-um", "0.5,0.6") == 0
    assert "albedo" not in capsys.readouterr().out


def test_a_terminal_that_lacks_signs_gets_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "ascii"))
    assert run("init", "paint", "-o", tmp_path / "2µm²_60°_ü_Δ.toml") == 0
    assert b"2um2_60 deg_u_?.toml" in written.getvalue()


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--version") == 0
    assert capsys.readouterr().out == f"vrte {vrte.__version__}\n"


def test_warnings_and_signals_are_as_they_were() -> None:
    before = warnings.showwarning, signal.getsignal(signal.SIGTERM)
    run("material")
    assert (warnings.showwarning, signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.slow
def test_a_bar_on_a_terminal_and_none_in_a_pipe(scene: Path) -> None:
    command = [*VRTE, "field", str(scene), "-o", str(scene.parent / "out.nc")]
    assert subprocess.run(command, check=True, capture_output=True, timeout=60).stderr == b""
    master, terminal = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=terminal, env=environment, timeout=60, check=True)
    os.close(terminal)
    shown = os.read(master, 1 << 16).decode()
    os.close(master)
    assert "Fourier orders" in shown
    assert b"wrote" in ended.stdout


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)]
)
def test_a_run_that_is_stopped_leaves_nothing(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """Stopped while it solves: a scene that would take a minute."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "nodes = 200\n[[layer]]\nphase = { henyey_greenstein = 0.97 }\nalbedo = 0.99\nthickness = 10\n"
        "[brdf]\nmu_i = { start = 0.1, stop = 1, count = 50 }\nmu_o = { start = 0.1, stop = 1, count = 50 }\n"
    )
    command = [*VRTE, "brdf", str(scene), "-o", str(tmp_path / "out.nc")]
    master, terminal = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    # a background shell hands down an ignored SIGINT
    default = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    started = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, env=environment, preexec_fn=default)
    os.close(terminal)
    shown = os.read(master, 1 << 16)
    while b"Fourier orders" not in shown:  # the progress bar: the solve has begun
        shown += os.read(master, 1 << 16)
    time.sleep(0.5)
    started.send_signal(number)
    assert started.stdout is not None
    with started.stdout:
        assert started.stdout.read() == b""
    assert started.wait(timeout=60) == code
    with suppress(OSError):  # a terminal whose other end is closed
        while more := os.read(master, 1 << 16):
            shown += more
    os.close(master)
    assert b"Traceback" not in shown
    assert files(tmp_path) == {"scene.toml"}


def test_a_reader_that_leaves_early_is_no_error(scene: Path) -> None:
    listing = subprocess.Popen([*VRTE, "material"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert listing.stdout is not None
    assert listing.stderr is not None
    listing.stdout.close()
    complaint = listing.stderr.read()
    listing.stderr.close()
    assert listing.wait(timeout=60) in (0, 1)
    assert complaint == b""
