"""Measurements: what is read, what is refused, and what a scene shows in their rows."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.fit.measurement import COLUMNS
from vrte.formats import netcdf

from .helpers import assert_close, close_to

SURFACE, FILM = {"interface": {"above": 1.0, "below": 1.5}}, {"phase": "rayleigh", "albedo": 0.9, "thickness": 2.0}
NAN = np.nan


def cosine(*degrees: float) -> np.ndarray:
    return np.cos(np.radians(degrees))


def test_rows_of_directions_show_what_the_brdf_has_there() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.7)], vrte.Lambertian(0.2))
    names = ["f00", "f10", "degree_of_linear_polarization", "minus_q_over_i", "t00", "normalized_t33"]
    theta_o, phi = [50.0, -50.0, 50.0, 50.0, 30.0, 30.0], [0.0, 90.0, 45.0, 0.0, 20.0, 20.0]
    rows = vrte.Measurement(names, 0.0, theta_i_deg=40.0, theta_o_deg=theta_o, phi_deg=phi)
    found = vrte.brdf(scene, cosine(40.0), cosine(50.0, 30.0), [0.0, 270.0, 45.0, 20.0], nodes=4, transmission=True)
    f, t = found.mueller[0, 0], found.transmission[0, 1, 3]
    degree = np.hypot(f[2, 1, 0], f[2, 2, 0]) / f[2, 0, 0]
    expected = [f[0, 0, 0], f[1, 1, 0], degree, -f[0, 1, 0] / f[0, 0, 0], t[0, 0], t[3, 3] / t[0, 0]]
    assert_close(rows.predict(scene, nodes=4), expected, rtol=1e-12, atol=0.0)
    assert expected[3] > 0.0  # Rayleigh scatters what swings across the plane


def test_light_of_a_slab_that_absorbs_nothing_is_all_there() -> None:
    slab = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 0.7), vrte.Interface(1.5, 1.0)])
    names = ["diffuse_reflectance", "specular_reflectance", "diffuse_transmittance", "direct_transmittance"]
    rows = vrte.Measurement([*names, "total_reflectance", "total_transmittance"], 0.0, theta_i_deg=50.0)
    found = rows.predict(slab, nodes=6)
    assert found[:4].sum() == close_to(1.0, rtol=0.0, atol=1e-9)
    assert found[4:] == close_to([found[0] + found[1], found[2] + found[3]], rtol=1e-6, atol=0.0)
    solved = vrte.brdf(slab, cosine(50.0), 1.0, nodes=6)
    expected = [solved.total_reflectance.item(), solved.direct_transmittance.item()]
    assert found[[4, 3]] == close_to(expected, rtol=1e-6, atol=0.0)


def test_instruments_and_colours_are_those_of_appearance() -> None:
    content = {"nodes": 4, "layer": [SURFACE, FILM], "base": {"kind": "lambertian", "albedo": 0.2}}
    geometries, wavelengths = ["8:di", "8:de", "45:as15", "di:di"], np.linspace(0.4, 0.7, 9)
    look = vrte.appearance(content, [0.45, 0.55, 0.65], geometries=geometries)
    rows = vrte.Measurement("reflectance", 0.0, geometry=geometries, wavelength_um=0.55)
    assert_close(rows.predict(content), [look.reflectance(one)[1] for one in geometries], rtol=1e-9, atol=0.0)
    rough = content | {"layer": [{"interface": SURFACE["interface"] | {"roughness": 0.1}}, FILM]}
    port = vrte.appearance(rough, [0.55], geometries=["8:de"]).reflectance("8:de")
    assert_close(rows.pick([1]).predict(rough), port, rtol=1e-9, atol=0.0)
    look = vrte.appearance(content, wavelengths, geometries=["8:di"], illuminant="A", observer=2)
    rows = vrte.Measurement(list("XYZLab"), 0.0, geometry="8:di", illuminant="A", observer=2)
    expected = [getattr(look.colour("8:di"), name) for name in "XYZLab"]
    assert_close(rows.predict(content, wavelengths_um=wavelengths), expected, rtol=0.0, atol=2e-4)


def test_rows_over_black_and_over_white_are_one_measurement() -> None:
    """Each row has the base of its own, by the algebra of bases; the others keep that of the scene."""
    film = {"layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 0.7}]}
    given = film | {"base": {"kind": "lambertian", "albedo": 0.3}}
    rows = vrte.Measurement("total_reflectance", 0.0, theta_i_deg=8.0, base=[0.0, 0.8, NAN])
    expected = [
        vrte.Measurement("total_reflectance", 0.0, theta_i_deg=8.0).predict(
            film | {"base": {"kind": "lambertian", "albedo": albedo}}, nodes=6
        )
        for albedo in (0.0, 0.8, 0.3)
    ]
    assert_close(rows.predict(given, nodes=6), np.concatenate(expected), rtol=1e-13, atol=0.0)
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.7)], vrte.Lambertian(0.3))
    assert_close(rows.predict(scene, nodes=6), np.concatenate(expected), rtol=1e-13, atol=0.0)
    colours = vrte.Measurement(["L", "L"], 0.0, geometry="8:di", base=[0.0, 0.8])
    dark, light = colours.predict(given, nodes=4)
    assert light == close_to(colours.pick([1]).predict(given, nodes=4)[0], rtol=1e-13, atol=0.0)
    assert dark + 10.0 < light
    free = ["layer[1].thickness", "layer[1].albedo"]  # over one base alone they cannot be told apart
    measured = rows.pick([0, 1]).measure(expected[0].tolist() + expected[1].tolist(), 1e-3)
    found = vrte.fit(measured, film | {"layer": [film["layer"][0] | {"thickness": 0.4, "albedo": 0.8}]}, free, nodes=6)
    assert_close(found.values, [0.7, 0.9], rtol=1e-6, atol=0.0)
    with pytest.raises(vrte.SceneError, match=r"base\.albedo is a number of the base, and rows .* have bases of their"):
        vrte.fit(rows, given, ["base.albedo"], nodes=6)
    with pytest.raises(vrte.SceneError, match="row 1: base must be the albedo of a Lambertian base"):
        vrte.Measurement("total_reflectance", 0.5, theta_i_deg=8.0, base=1.5)


def test_a_paint_lies_over_the_base_of_a_row() -> None:
    paint = {"paint": {"pigment": "rutile", "volume_fraction": 0.1, "binder": "alkyd", "thickness_um": 20.0}}
    rows = vrte.Measurement("reflectance", 0.0, geometry="8:di", wavelength_um=0.55, base=[0.0, 0.8])
    black, white = rows.predict(paint, nodes=6)
    own = rows.pick([0]).measure(0.0)
    grey = {"paint": paint["paint"] | {"substrate": {"kind": "lambertian", "albedo": 0.8}}}
    plain = vrte.Measurement("reflectance", 0.0, geometry="8:di", wavelength_um=0.55)
    assert_close(plain.predict(grey, nodes=6), white, rtol=1e-13, atol=0.0)
    assert_close(own.predict(grey, nodes=6), black, rtol=1e-13, atol=0.0)
    assert black + 0.03 < white


def test_a_table_that_is_written_reads_back(tmp_path: Path) -> None:
    angles = {"theta_i_deg": [10.0, NAN, NAN], "theta_o_deg": [-20.0, NAN, NAN], "wavelength_um": [0.5, 0.6, NAN]}
    names, values, geometry = ["f00", "reflectance", "L"], [0.1, 1 / 3, 55.0], ["", "8:di", "45:0"]
    rows = vrte.Measurement(names, values, [0.01, 0.02, 0.5], **angles, geometry=geometry, base=[NAN, 0.0, 0.8])
    rows.save(tmp_path / "rows.csv", "two lines\nof a comment")
    back = vrte.read_measurement(tmp_path / "rows.csv")
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(rows, name), getattr(back, name), err_msg=name)
    assert not list(tmp_path.glob(".vrte*"))


def test_netcdf_holds_columns_or_quantities_over_angles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read in this process: tests/test_foreign_files.py has the one of its own, which takes a second to start."""
    xarray = pytest.importorskip("xarray")
    monkeypatch.setattr(netcdf, "read_foreign", netcdf.read_stored)
    both, beam, values = ("theta_i_deg", "theta_o_deg"), ("theta_i_deg",), np.array([[0.0, 1.0, 2.0], [3.0, NAN, 5.0]])
    grid: Any = {"f00": (both, values), "f00_sigma": (both, values * 0.0 + 0.1)}
    grid |= {"total_reflectance": (beam, [0.4, 0.5]), "total_reflectance_sigma": (beam, [0.01, 0.01])}
    angles = {"theta_i_deg": [0.0, 30.0], "theta_o_deg": [10.0, 20.0, 40.0]}
    xarray.Dataset(grid, angles).to_netcdf(tmp_path / "grid.nc", engine="h5netcdf")
    found = vrte.read_measurement(tmp_path / "grid.nc")
    assert found.names == ("f00", "total_reflectance")
    assert found.value.tolist() == [0.0, 1.0, 2.0, 3.0, 5.0, 0.4, 0.5]
    assert found.theta_o_deg[:5].tolist() == [10.0, 20.0, 40.0, 10.0, 40.0]
    assert (found.theta_i_deg[5:].tolist(), found.sigma[-1]) == ([0.0, 30.0], 0.01)
    table: Any = {"quantity": ("row", ["total_reflectance"]), "value": ("row", [0.5]), "theta_i_deg": ("row", [8.0])}
    xarray.Dataset(table).to_netcdf(tmp_path / "rows.nc", engine="h5netcdf")
    found = vrte.read_measurement(tmp_path / "rows.nc")
    assert (found.value.tolist(), found.theta_i_deg.tolist()) == ([0.5], [8.0])
    for variables, coords, words in (
        ({"L": ("illuminant", [50.0, 51.0])}, {"illuminant": ["D65", "A"]}, "geometry is missing"),
        (table | {"colour": ("row", [1.0])}, {}, "the column 'colour' is unknown"),
        (table | {"value": ("row", ["a"])}, {}, "its value must be an array of numbers"),
        ({"f00": ("time", [1.0])}, {"time": [0.0]}, "the coordinate 'time' is unknown"),
        ({}, {"theta_i_deg": [0.0]}, "there is no quantity"),
        ({"f00_sigma": ((), 0.1)}, {}, "f00_sigma belongs to no quantity of the file"),
    ):
        xarray.Dataset(variables, coords).to_netcdf(tmp_path / "rows.nc", engine="h5netcdf")
        with pytest.raises(vrte.SceneError, match=words):
            vrte.read_measurement(tmp_path / "rows.nc")


EMPTY = {"value": 0.5, "theta_i_deg": NAN, "theta_o_deg": NAN}
REFUSED: list[tuple[dict[str, Any] | str, str]] = [
    ({"quantity": "f0"}, "row 1: there is no quantity 'f0'; did you mean"),
    ({"value": [0.1, NAN]}, "row 2: value must be a finite number"),
    ({"sigma": [0.1, 0.0]}, "row 2: sigma must be above 0"),
    ({"sigma": [0.1, NAN]}, "row 2: sigma is missing"),
    ({"theta_o_deg": 90.0}, "the horizon"),
    ({"theta_i_deg": [0.0, 100.0]}, "row 2: theta_i_deg must be degrees"),
    ({"theta_o_deg": NAN}, "row 1: theta_o_deg is missing: f00 needs it"),
    ({"quantity": "total_reflectance"}, "theta_o_deg must be empty: total_reflectance has none"),
    ({"value": -0.1, "sigma": 0.01}, "below 0, which f00 cannot be, by more than 5 sigma"),
    ({"wavelength_um": -1.0}, "wavelength_um must be a wavelength"),
    ({"value": [0.1] * 3, "theta_i_deg": [0.0] * 2}, "must be one for all, or one a row, 3"),
    (EMPTY | {"quantity": "reflectance", "geometry": "8", "wavelength_um": 0.5}, "geometry must be"),
    (EMPTY | {"quantity": "L", "geometry": "8:di", "illuminant": "sun"}, "illuminant must be"),
    (EMPTY | {"quantity": "L", "geometry": "8:di", "observer": 5}, "observer must be 2 or 10"),
    ("quantity,value\n", "rows.csv: the table is empty"),
    ("quantity,value,colour\nf00,1,2\n", "rows.csv: the column 'colour' is unknown"),
    ("value,theta_i_deg\n1,2\n", "rows.csv: the column quantity is missing"),
    ("quantity,value\nf00,a\n", "rows.csv: line 2: value must be a number, not 'a'"),
    ("# no\nquantity,value\nf00\n", "rows.csv: line 3: 2 values are needed"),
    ("quantity,value,value\nf00,1,1\n", "rows.csv: two columns have the same name"),
    ("quantity;value\nf00;1,5;2\n", "rows.csv: line 2: 2 values are needed"),
]


@pytest.mark.parametrize(("given", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_what_is_no_measurement_is_refused_in_one_sentence(given: Any, words: str, tmp_path: Path) -> None:
    """Columns, or the text of a table, whose line is told."""
    (tmp_path / "rows.csv").write_text(given if isinstance(given, str) else "")
    columns = {"quantity": "f00", "value": 0.1, "theta_i_deg": 0.0, "theta_o_deg": 10.0}
    with pytest.raises(vrte.SceneError, match=re.escape(words)) as caught:
        vrte.Measurement(**columns | given) if isinstance(given, dict) else vrte.read_measurement(tmp_path / "rows.csv")
    assert "\n" not in str(caught.value)
