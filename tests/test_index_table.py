"""Refractive indices of one's own over wavelength: Python, scene files, sweeps, viewer; nanometres for micrometres."""

import re
from pathlib import Path

import pytest

import vrte
from vrte import cli
from vrte.app.form.checks import check_tables
from vrte.basics.errors import SceneError
from vrte.formats.scene_file import read_scene
from vrte.sweep.optics import make_file_name
from vrte.sweep.template import read_sweep

from .helpers import close_to

SCENE = """
wavelength_um = 0.55
[particles.clay]
index = "clay.csv"
radius_um = 0.3
[[layer]]
particles = "clay"
thickness = 2.0
[brdf]
mu_i = 0.6
mu_o = 0.5
"""


def written(folder: Path, text: str, name: str = "clay.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_nanometres_and_micrometres_are_the_same_table(tmp_path: Path) -> None:
    commas = "wavelength_nm;n;k\n400;1,6;0,02\n700;1,5;0\n"  # as programs write it where the comma is decimal
    assert vrte.read_index(written(tmp_path, "wavelength_um,n\n0.4,1.6\n0.7,1.5\n")).at(0.7) == 1.5  # k = 0
    um = vrte.read_index(written(tmp_path, "# measured\nwavelength_um,n,k\n0.4,1.6,0.02\n0.7,1.5,0.0\n"))
    nm = vrte.read_index(written(tmp_path, "wavelength_nm, n, k\n400,1.6,0.02\n700,1.5,0.0\n"))
    assert vrte.read_index(written(tmp_path, commas)) == nm == um
    assert um.at(0.55) == close_to(1.55 + 0.01j, rtol=1e-15, atol=0.0)
    found = vrte.refractive_index(um, 0.55)
    assert found.source == "the table clay.csv"
    by_table = vrte.spheres(um, radius_um=0.3, wavelength_um=0.55)
    assert by_table.albedo == vrte.spheres(um.at(0.55), radius_um=0.3, wavelength_um=0.55).albedo < 1.0
    assert "the table clay.csv" in by_table.description


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the first line must be wavelength_um,n,k"),
        ("wavelength,n,k\n0.4,1.6,0\n", "the first line must be wavelength_um,n,k"),
        ("wavelength_um,n,k\n", "at least 1 row below the header, not 0"),
        ("wavelength_um,n,k\n0.4,1.6\n", "line 2: 3 values are needed"),
        ("wavelength_um,n,k\n0.4,1.6,none\n", "line 2: k must be a number, not 'none'"),
        ("wavelength_um,n,k\n0.5,1.6,0\n0.4,1.6,0\n", "line 3: wavelength_um must ascend, and 0.4 follows 0.5"),
        ("wavelength_um,n,k\n0.5,1.6,-1\n", "line 2: k must be >= 0, not -1"),
        ("wavelength_um,n,k\n0.5,nan,0\n", "line 2: n must be a finite number"),
    ],
)
def test_a_wrong_table_is_refused_by_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)):
        vrte.read_index(written(tmp_path, text))


def test_a_scene_file_names_a_table_beside_it(tmp_path: Path) -> None:
    table = written(tmp_path, "wavelength_nm,n,k\n400,1.6,0.02\n700,1.5,0.0\n")
    scene = written(tmp_path, SCENE, "scene.toml")
    assert read_scene(scene).particles["clay"].albedo == (
        vrte.spheres(vrte.read_index(table), radius_um=0.3, wavelength_um=0.55).albedo
    )
    assert len(vrte.spectrum(scene, [0.45, 0.6])) == 2
    with pytest.raises(SceneError, match=r"from 0\.4 to 0\.7 um; a wavelength of 0\.8 um is outside$"):
        read_scene(scene, wavelength_um=0.8)
    table.unlink()
    with pytest.raises(
        SceneError, match=r'particles\.clay\.index = "clay\.csv": the file cannot be read: No such file'
    ):
        read_scene(scene)


def test_the_command_tells_of_it_and_a_sweep_goes_by_what_is_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path, "wavelength_nm,n,k\n400,1.6,0.02\n700,1.5,0.0\n")
    assert cli.main(["material", str(table), "--wavelength-um", "0.7"]) == 0
    reported = capsys.readouterr().out
    assert "n = 1.5, k = 0\n" in reported
    assert "from the table clay.csv" in reported
    scene = written(tmp_path, SCENE + '[axes]\n"layer[1].thickness" = [1.0, 2.0]\n', "sweep.toml")
    before = read_sweep(scene).fingerprint()
    written(tmp_path, "wavelength_nm,n,k\n400,1.6,0.03\n700,1.5,0.0\n")
    assert read_sweep(scene).fingerprint() != before


def test_long_tables_are_told_apart_by_all_their_rows_and_the_viewer_reads_only_its_own() -> None:
    rows = tuple(0.3 + 1e-4 * row for row in range(5000))
    one = vrte.IndexTable(rows, (1.5,) * 5000, (0.0,) * 5000)
    other = vrte.IndexTable(rows, (1.5,) * 2500 + (1.6,) + (1.5,) * 2499, (0.0,) * 5000)
    assert one != other
    assert make_file_name(one, {"wavelength_um": 0.5}) != make_file_name(other, {"wavelength_um": 0.5})
    content = {"particles": {"clay": {"index": "clay.csv"}}}
    check_tables(content, frozenset({"clay.csv"}))
    with pytest.raises(SceneError, match=r'particles\.clay\.index = "clay\.csv": a page reads no files'):
        check_tables(content, frozenset())


def test_nanometres_are_asked_about() -> None:
    with pytest.warns(vrte.UnitsWarning, match=r"wavelength_um = 550 is far infrared: did you mean 0\.55\?"):
        vrte.refractive_index(1.5, 550.0)
