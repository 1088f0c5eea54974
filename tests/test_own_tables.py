"""Tables of one's own beside a scene file: indices over wavelength, sizes, coefficients; in files, spectra, sweeps, the
form."""

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.checks import check_tables
from vrte.basics.errors import SceneError
from vrte.formats.columns import read_coefficients
from vrte.formats.scene_file import make_scene_file
from vrte.formats.toml_table import write_toml
from vrte.sweep.store import make_file_name
from vrte.sweep.template import read_sweep

from .helpers import close_to, run

CLAY = "wavelength_nm,n,k\n400,1.6,0.02\n700,1.5,0.0\n"
SIZES = "radius_um,density\n0.1,0\n0.2,5\n0.5,0\n"
OWN = {"index": "clay.csv", "size": {"table": "sizes.csv"}}


def written(folder: Path, text: str, name: str = "clay.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def make_scene(**kind: Any) -> dict[str, Any]:
    light = {"wavelength_um": 0.55, "nodes": 4, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
    return {**light, "particles": {"one": kind}, "layer": [{"particles": "one", "thickness": 1.0}]}


def test_nanometres_and_micrometres_are_the_same_table(tmp_path: Path) -> None:
    commas = "wavelength_nm;n;k\n400;1,6;0,02\n700;1,5;0\n"  # as programs write it where the comma is decimal
    assert vrte.read_index(written(tmp_path, "wavelength_um,n\n0.4,1.6\n0.7,1.5\n")).at(0.7) == 1.5  # k = 0
    um = vrte.read_index(written(tmp_path, "# measured\nwavelength_um,n,k\n0.4,1.6,0.02\n0.7,1.5,0.0\n"))
    assert vrte.read_index(written(tmp_path, commas)) == vrte.read_index(written(tmp_path, CLAY)) == um
    assert um.at(0.55) == close_to(1.55 + 0.01j, rtol=1e-15, atol=0.0)
    by_table = vrte.spheres(um, radius_um=0.3, wavelength_um=0.55)
    assert by_table.albedo == vrte.spheres(um.at(0.55), radius_um=0.3, wavelength_um=0.55).albedo < 1.0
    assert "the table clay.csv" in by_table.description
    with pytest.warns(vrte.UnitsWarning, match=r"wavelength_um = 550 is far infrared: did you mean 0\.55\?"):
        vrte.refractive_index(1.5, 550.0)
    one, other = (vrte.Tabulated([0.1, 0.2, 0.3], [0, unit, 0]).quadrature(65) for unit in (1.0, 1e12))
    assert one[1] == close_to(other[1], rtol=1e-14, atol=0.0)  # densities count by their ratios alone


INDEX, SIZE, COEFFICIENTS = "wavelength_um,n,k\n", "radius_um,density\n", "l,a1,a2,a3,a4,b1,b2\n"
WRONG = [  # a file's reader and text, and why it is refused: by columns, then by what its numbers mean
    (vrte.read_index, "wavelength,n,k\n0.4,1.6,0\n", "the first line must be wavelength_um,n,k"),
    (vrte.read_index, INDEX, "at least 1 row below the header, not 0"),
    (vrte.read_index, INDEX + "0.5,1.6,0\n0.4,1.6,0\n", "line 3: wavelength_um must ascend, and 0.4 follows 0.5"),
    (vrte.read_index, INDEX + "0.5,1.6,-1\n", "line 2: k must be >= 0, not -1"),
    (vrte.read_sizes, "", "the first line must be radius_um,density or diameter_um,density"),
    (vrte.read_sizes, SIZE + "0.1,1\n", "at least 2 rows below the header, not 1"),
    (vrte.read_sizes, SIZE + "0.1,1\n0.2\n", "line 3: 2 values are needed"),
    (vrte.read_sizes, SIZE + "0.1,1\n0.2,nan\n", "line 3: density must be a finite number"),
    (vrte.read_sizes, SIZE + "0.1,1\n# a gap\n0.1,2\n", "line 4: radius_um must ascend, and 0.1 follows 0.1"),
    (vrte.read_sizes, "diameter_um,density\n0,1\n0.1,2\n", "line 2: diameter_um must be above 0, not 0"),
    (vrte.read_sizes, SIZE + "0.1,1\n0.2,-1\n", "line 3: density must be >= 0, not -1"),
    (vrte.read_sizes, SIZE + "0.1,0\n0.2,0\n", "density must be >= 0 everywhere and not zero everywhere"),
    (vrte.read_sizes, SIZE + "0.1,0\n0.2e9,1\n", "radius_um must be a length"),
    (read_coefficients, "l,a1,a2\n0,1,0\n", "the first line must be l,a1,a2,a3,a4,b1,b2"),
    (read_coefficients, COEFFICIENTS + "0,1,0,0,x,0,0\n", "line 2: a4 must be a number, not 'x'"),
    (read_coefficients, COEFFICIENTS + "1,1,0,0,0,0,0\n", "line 2: l must count 0, 1, 2, ...: 0 is next, not 1"),
    (read_coefficients, COEFFICIENTS + "0,2,0,0,0,0,0\n", "a1"),
]


@pytest.mark.parametrize(("read", "text", "words"), WRONG)
def test_a_wrong_table_is_refused_by_its_line_and_by_the_key_that_names_it(
    read: Any, text: str, words: str, tmp_path: Path
) -> None:
    written(tmp_path, text)
    with pytest.raises(SceneError, match=re.escape(words)):
        read(tmp_path / "clay.csv")
    key, content = {
        vrte.read_index: ("particles.one.index", make_scene(index="clay.csv", radius_um=0.3)),
        vrte.read_sizes: ("particles.one.size.table", make_scene(index=1.5, size={"table": "clay.csv"})),
        read_coefficients: (
            "layer[1].phase",
            {"layer": [{"phase": "clay.csv", "albedo": 0.9, "thickness": 1.0}], "brdf": {"mu_i": 0.5, "mu_o": 0.5}},
        ),
    }[read]
    with pytest.raises(SceneError, match=rf'^{re.escape(key)} = "clay\.csv": .*{re.escape(words)}'):
        make_scene_file(content, folder=tmp_path)


def test_commands_spectra_and_sweeps_go_by_what_is_in_the_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path, CLAY)
    written(tmp_path, SIZES, "sizes.csv")
    assert run("material", table, "--wavelength-um", "0.7") == 0
    reported = capsys.readouterr().out
    assert "n = 1.5, k = 0\n" in reported
    assert "from the table clay.csv" in reported
    content = make_scene(**OWN)
    path = written(tmp_path, write_toml(content), "scene.toml")
    assert len(vrte.spectrum(path, [0.45, 0.6])) == 2
    with pytest.raises(SceneError, match=r"from 0\.4 to 0\.7 um; a wavelength of 0\.8 um is outside$"):
        make_scene_file(content | {"wavelength_um": 0.8}, folder=tmp_path)
    read = partial(read_sweep, content | {"axes": {"layer[1].thickness": [1.0, 2.0]}}, tmp_path)
    assert {*read().tables()} == {"clay.csv", "sizes.csv"}
    prints = [read().fingerprint()]
    for name, text in (("clay.csv", CLAY.replace("0.02", "0.03")), ("sizes.csv", f"{SIZES}0.6,0\n")):
        written(tmp_path, text, name)
        prints.append(read().fingerprint())
    assert len({*prints}) == 3


def test_kept_optics_distinguish_tables_sizes_and_shells_by_all_digits() -> None:
    values, ones = np.linspace(0.1, 0.9, 5000), np.ones(5000)
    peak = np.where(np.arange(5000) == 2500, 2.0, 1.0)
    sizes = [(values, ones), (np.nextafter(values, 1.0), ones), (values, peak), (values.tolist(), ones.tolist())]
    names = [make_file_name("spheres", {"index": 1.5, "size": vrte.Tabulated(*one)}) for one in sizes]
    assert (len({*names}), names[0]) == (3, names[3])
    shapes = ({"shell_um": 0.05}, {"core_ratio": 0.75}, {"core_radius_um": 0.15}, {"shell_um": np.nextafter(0.05, 1)})
    given = {"core": 1.0, "shell": 1.59, "radius_um": 0.2}
    assert len({make_file_name("coated-spheres", given | shape) for shape in shapes}) == 4
    kinds = [
        (kind, {"index": 1.5, "aspect_ratio": k, "radius_um": 0.05})
        for kind in ("spheroids", "cylinders")
        for k in (1, 2)
    ]
    assert len({make_file_name(*kind) for kind in kinds}) == 4
    tables = [vrte.IndexTable(tuple(values), tuple(n), tuple(0.0 * ones)) for n in (ones, peak)]
    assert len({make_file_name("spheres", {"index": index, "radius_um": 0.5}) for index in tables}) == 2


def test_a_page_reads_only_the_tables_that_it_was_given() -> None:
    content = make_scene(**OWN)
    assert form.get_size_mode(content["particles"]["one"]) == "table"
    check_tables(content, frozenset({"clay.csv", "sizes.csv"}))
    for missing, words in (("clay.csv", r'one\.index = "clay\.csv"'), ("sizes.csv", r'size\.table = "sizes\.csv"')):
        with pytest.raises(SceneError, match=rf"{words}: a page reads no files"):
            check_tables(content, frozenset({"clay.csv", "sizes.csv"}) - {missing})
