"""Scattering matrices over angle in files: CSV by column names, NetCDF of libRadtran's and Eradiate's kinds."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

import vrte
from tests.helpers import run
from vrte.basics.errors import SceneError
from vrte.formats import netcdf
from vrte.formats.columns import read_coefficients
from vrte.formats.scattering import read_angle_table
from vrte.formats.scene_file import read_scene
from vrte.optics.convention_card import make_reference_sphere, tabulate_card
from vrte.optics.conventions import CONVENTIONS, ELEMENTS
from vrte.optics.phase_matrix import PhaseMatrix

from .helpers import assert_close, close_to

LETTERS = ("a1", "b1", "a2", "a3", "b2", "a4")


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of its own takes half a second to start, and is tried once."""
    monkeypatch.setattr(netcdf, "read_foreign", netcdf.read_stored)


def written(folder: Path, text: str, name: str = "table.csv") -> Path:
    (folder / name).write_text(text)
    return folder / name


def as_csv(folder: Path, names: Any, columns: Any, name: str = "table.csv") -> Path:
    rows = "\n".join(",".join(repr(float(value)) for value in row) for row in np.transpose(columns))
    return written(folder, f"# of another code\n{','.join(names)}\n{rows}\n", name)


@cache
def powder(wavelength_um: float, radius_um: float = 0.2) -> vrte.Particles:
    return vrte.spheres(1.5 + 0.01j, radius_um=radius_um, wavelength_um=wavelength_um)


def assert_matrix(found: Any, right: PhaseMatrix, atol: float = 1e-10) -> None:
    """The coefficients of a phase matrix are those of another, the missing ones zero."""
    assert isinstance(found, PhaseMatrix)
    terms = max(found.terms, right.terms)
    padded = [np.pad(one.coefficients, ((0, terms - one.terms), (0, 0))) for one in (found, right)]
    assert_close(*padded, rtol=0.0, atol=atol)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_table_in_any_convention_is_read_by_the_names_of_its_columns(name: str, tmp_path: Path) -> None:
    about, sphere = CONVENTIONS[name], make_reference_sphere().phase_matrix
    angles = sphere.to_angles().angle_deg
    order = [0, 3, 1, 5, 4, 2]
    columns = tabulate_card(about, angles)[order]
    path = as_csv(tmp_path, [*np.array(about.columns)[order], "angle_deg"], [*columns, angles])
    assert_matrix(vrte.read_scattering(path, convention=name, normalise=about.mean is None), sphere)


@pytest.mark.parametrize("names", [ELEMENTS, LETTERS, ("P11", "P12", "P22", "P33", "P34", "P44")])
@pytest.mark.parametrize("turned", [False, True])
def test_cosines_and_other_letters_are_the_same(names: Any, turned: bool, tmp_path: Path) -> None:
    matrix = powder(0.5).phase_matrix
    u = np.polynomial.legendre.leggauss(60)[0][:: -1 if turned else 1]
    path = as_csv(tmp_path, ["cosine", *names], [u, *matrix.to_angles(np.degrees(np.arccos(u))).elements])
    assert_matrix(vrte.read_scattering(path), matrix, 1e-8)  # of cosines the first digits of small angles are lost


GOOD = "0,1.5\n90,0.75\n180,1.5\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the first line must name the columns, one of them angle_deg or cosine"),
        ("angle_deg,cosine,F11\n1,1,1\n", "the first line must name the columns, one of them angle_deg or cosine"),
        ("angle_deg,F12\n0,0\n", "the column F11 is missing: it is angle_deg, F12"),
        ("angle_deg,F11,P11\n0,0,0\n", "the column F11 must be there once, not 2 times"),
        ("angle_deg,F11,error\n0,0,0\n", "the column 'error' is not known: there may be angle_deg or cosine"),
        ("angle_deg,F11,-F12/F11\n0,0,0\n", 'the column -F12/F11 is F12 in the convention "vrte"'),
        ("angle_deg,P11,P43\n0,0,0\n", 'the column P43 is F34 in the convention "vrte"'),
        (f"angle_deg,F11\n{GOOD}190,1\n", "line 5: angle_deg must be from 0 to 180, not 190"),
        ("cosine,F11\n1.5,1\n", "line 2: cosine must be from -1 to 1, not 1.5"),
        (f"angle_deg,F11\n{GOOD}30,1\n", "line 5: angle_deg must ascend, and 30 follows 180"),
        ("cosine,F11\n0,1\n1,1\n0.5,1\n", "line 4: cosine must be in one order"),
        ("angle_deg,F11\n0,1.5\n90,-0.75\n180,1.5\n", "line 3: F11 must be >= 0, not -0.75"),
        ("angle_deg,F11\n" + 20_001 * "1,1\n", "the table must have at most 20000 rows, not 20001"),
        (f"angle_deg,F11\n0,{140_000 * '1'}\n", "line 2: no row of a table (field larger than field limit"),
    ],
)
def test_a_wrong_table_ends_in_one_sentence_with_its_line(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=re.escape(said)) as refused:
        vrte.read_scattering(written(tmp_path, text))
    assert str(refused.value).isprintable()


def test_what_names_of_columns_say_must_be_what_the_convention_says(tmp_path: Path) -> None:
    names = ["angle_deg", "P11", "P21/P11", "P43/P11"]
    path = as_csv(tmp_path, names, [[0.0, 90.0, 180.0], [1, 1, 1], [0, 0, 0], [0, 0, 0]])
    table = read_angle_table(path, "ice")
    assert [column is None for column in table.columns] == [False, False, True, True, False, True]
    with pytest.raises(SceneError, match="the column P43/P11 is F34/F11 in the convention"):
        read_angle_table(path, "granada-synthetic")
    with pytest.raises(SceneError, match=r"the column 'P11' is not known.*Pll, Plr, Prr"):
        read_angle_table(path, "chandrasekhar")


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    for name, options, words in (
        ("table.txt", {}, r"the file must end in \.csv, \.nc, \.nc4, \.cdf, not in '\.txt'"),
        ("table.csv", {"wavelength_um": 0.5}, r"wavelength_um must not be given with a \.csv, which holds one table"),
        ("table.nc", {}, "it is not a NetCDF file: it does not begin as one"),
    ):
        with pytest.raises(SceneError, match=words):
            vrte.read_scattering(written(tmp_path, "angle", name), **options)


WAVELENGTHS = (0.45, 0.55, 0.65)
SIGNS = np.array([1.0, 1.0, 1.0, 1.0, -1.0, 1.0])[:, None]  # of F11, F12, F22, F33, F34, F44
RADII = (0.2, 0.3)
MASS = 1e3  # 1/um of a substance of 1 g/cm3 is so many 1/km per g/m3


def libradtran(path: Path, elements: tuple[int, ...] = (0, 1, 3, 4), **other: Any) -> Path:
    """As its Mie tables are: NetCDF-3, angles from 180 to 0, fewer of them at longer wavelengths, P34 = -F34."""
    shape = 3, 2, len(elements), 200
    arrays = {name: np.zeros(shape) for name in ("phase", "theta")} | {
        name: np.zeros((3, 2)) for name in ("ssa", "ext")
    }
    arrays |= {"ntheta": np.zeros(shape[:3], "i4"), "wavelen": np.array(WAVELENGTHS), "reff": np.array(RADII)}
    for row, wavelength in enumerate(WAVELENGTHS):
        for column, radius in enumerate(RADII):
            found = powder(wavelength, radius)
            count = 181 - 30 * row
            table = found.phase_matrix.to_angles(np.linspace(0.0, 180.0, count))
            arrays["ntheta"][row, column] = count
            arrays["theta"][row, column, :, :count] = table.angle_deg[::-1]
            arrays["phase"][row, column, :, :count] = (SIGNS * table.elements)[list(elements), ::-1]
            arrays["ssa"][row, column] = found.albedo
            arrays["ext"][row, column] = MASS * found.extinction_um2 / found.volume_um3
    units = other.pop("units", "micrometer")
    arrays = {name: values for name, values in (arrays | other).items() if values is not None}
    with netcdf_file(path, "w") as file:
        for name, values in arrays.items():
            dims = [f"{name}_{axis}" for axis in range(values.ndim)]
            for dim, size in zip(dims, values.shape, strict=True):
                file.createDimension(dim, size)
            file.createVariable(name, values.dtype, dims)[:] = values
        file.variables["wavelen"].units = units
    return path


@pytest.fixture(scope="module")
def mie_table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return libradtran(tmp_path_factory.mktemp("mie") / "mie.cdf")


def test_a_table_of_libradtran_gives_back_the_spheres(mie_table: Path, tmp_path: Path) -> None:
    expected = powder(0.55, 0.3)
    found = vrte.read_scattering(mie_table, wavelength_um=0.55, effective_radius_um=0.3, density_g_cm3=2.0)
    assert isinstance(found, vrte.Particles)
    assert_matrix(found.phase_matrix, expected.phase_matrix)
    names = ("albedo", "volume_um3", "extinction_um2", "scattering_um2")
    twice = np.array([1.0, 1.0, 2.0, 2.0])  # the mass a volume
    right = twice * [getattr(expected, name) for name in names]
    assert_close([getattr(found, name) for name in names], right, rtol=1e-12, atol=0.0)
    turned: Any = vrte.read_scattering(mie_table, wavelength_um=0.55, effective_radius_um=0.3, convention="vrte")
    for name, sign in (("b1", 1.0), ("b2", -1.0)):  # of V, unless another convention is said
        assert_close(getattr(turned, name), sign * getattr(expected.phase_matrix, name), rtol=1e-9, atol=1e-11)
    six = libradtran(tmp_path / "six.cdf", elements=(0, 1, 3, 4, 2, 5))  # in its order
    assert_matrix(vrte.read_scattering(six, **ASKED | {"wavelength_um": 0.65}), powder(0.65).phase_matrix)


def test_between_wavelengths_matrices_are_mixed_by_what_they_scatter(mie_table: Path) -> None:
    found = vrte.read_scattering(mie_table, wavelength_um=0.5, effective_radius_um=0.2)
    mixed = vrte.mixture([(powder(one), 1.0) for one in WAVELENGTHS[:2]])
    assert_matrix(found, mixed.phase_matrix)
    assert found.expansion.albedo == close_to(mixed.albedo, rtol=1e-12, atol=0.0)
    assert found.expansion.way.endswith("of 0.45 and 0.55 um")


ASKED = {"wavelength_um": 0.55, "effective_radius_um": 0.2}


@pytest.mark.parametrize(
    ("other", "options", "said"),
    [
        ({}, ASKED | {"wavelength_um": 0.7}, "must be from 0.45 to 0.65 um, which the data are for, not 0.7"),
        ({}, ASKED | {"wavelength_um": None}, "wavelength_um is missing: the file has 3, 0.45 to 0.65 um"),
        ({}, {"wavelength_um": 0.5}, "effective_radius_um is missing: the file has 0.2 to 0.3, 2 of them"),
        ({}, ASKED | {"effective_radius_um": 0.24}, "must be one of the file's, 0.2 is nearest, not 0.24"),
        ({}, ASKED | {"humidity_percent": 50}, "humidity_percent must not be given"),
        ({}, {"wavelength_um": -1.0}, "wavelength_um must be a number above 0"),
        ({"phase": np.ones((3, 2, 4))}, ASKED, "its phase and theta must be of one shape"),
        ({"phase": np.full((3, 2, 4, 200), np.nan)}, ASKED, "its phase must be finite numbers at all its angles"),
        ({"theta": np.ones((3, 2, 4, 200))}, ASKED, "its angles must be in one order from 0 to 180 degrees, each once"),
        ({"ntheta": np.ones((3, 2), "i4")}, ASKED, "its ntheta must be of shape (3, 2, 4), not (3, 2)"),
        ({"wavelen": np.array([0.5, 0.4, 0.6])}, ASKED, "its wavelen must be 3 ascending wavelengths"),
        ({"wavelen": np.array([b"a", b"b", b"c"])}, ASKED, "its wavelen must be an array of numbers"),
        ({"units": "inch"}, ASKED, "its wavelen must be in um or nm, not in inch"),
        ({"ssa": np.ones(3)}, ASKED, "its ssa must be of shape (3, 2), not (3,)"),
        ({"reff": np.ones(5)}, ASKED, "effective_radius_um must not be given: the file has one table for all"),
        ({"reff": None}, {"wavelength_um": 0.55}, "its phase is for 2 sizes, and no reff or hum says which"),
        ({"ext": np.full((3, 2), -1.0)}, ASKED, "its extinction must be numbers >= 0"),
        ({"ext": np.zeros((3, 2))}, ASKED, "nothing is scattered at 0.55 um"),
    ],
)
def test_what_is_not_in_the_data_or_damaged_is_refused(
    other: dict[str, Any], options: dict[str, Any], said: str, mie_table: Path, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=re.escape(said)):
        vrte.read_scattering(libradtran(tmp_path / "bad.cdf", **other) if other else mie_table, **options)


def eradiate(path: Path, labels: bool) -> Path:
    """Its first layout, phase (w, mu, i, j); with labels its second, phase (phamat, w, iangle), short of the end."""
    tables = [powder(one).phase_matrix.to_angles(np.linspace(180.0, 0.0, 181)) for one in WAVELENGTHS]
    mu, albedo = np.cos(np.radians(tables[0].angle_deg)), [powder(one).albedo for one in WAVELENGTHS]
    with h5py.File(path, "w") as file:
        file["w"] = 1e3 * np.array(WAVELENGTHS)
        file["w"].attrs["units"] = "nm"
        if labels:
            names = ("11", "12", "33", "34", "22", "44")
            file["phamat"] = np.array(names, dtype=h5py.string_dtype())
            file["phase"] = np.full((6, 3, 190), np.nan)
            file["mu"] = np.full((3, 190), np.nan)
            file["nangles"] = np.full(3, 181, "i4")
            file["mu"][:, :181] = mu
            for row, table in enumerate(tables):
                file["phase"][:, row, :181] = [getattr(table, f"F{name}") for name in names]
            file["ssa"], file["ext"] = albedo, np.ones(3)
        else:
            matrices = [powder(one).phase_matrix.scattering_matrix(tables[0].angle_deg) for one in WAVELENGTHS]
            file["phase"], file["mu"] = np.stack(matrices), mu
            file["albedo"], file["sigma_t"] = albedo, np.ones(3)
    return path


@pytest.mark.parametrize("labels", [False, True])
def test_tables_of_eradiate_are_read(labels: bool, tmp_path: Path) -> None:
    path = eradiate(tmp_path / "aerosol.nc", labels)
    found = vrte.read_scattering(path, wavelength_um=0.65)
    assert_matrix(found, powder(0.65).phase_matrix)
    assert found.expansion.albedo == close_to(powder(0.65).albedo, rtol=1e-12, atol=0.0)
    with pytest.raises(SceneError, match="density_g_cm3 needs an albedo and an extinction per mass"):
        vrte.read_scattering(path, wavelength_um=0.65, density_g_cm3=1.0)
    with pytest.raises(SceneError, match="effective_radius_um must not be given"):
        vrte.read_scattering(path, wavelength_um=0.65, effective_radius_um=1.0)


def test_p34_that_was_copied_to_p43_is_told_and_a_scalar_table_has_one_element(tmp_path: Path) -> None:
    path = eradiate(tmp_path / "converted.nc", False)
    with h5py.File(path, "r+") as file:
        file["phase"][..., 2, 3] *= -1.0  # libRadtran's P34, and with it F43 = +F34
    with pytest.warns(vrte.UnitsWarning, match=r"its F43 is \+F34, .* libRadtran's tables"):
        found = vrte.read_scattering(path, wavelength_um=0.65)
    assert_matrix(found, powder(0.65).phase_matrix)
    turned = vrte.read_scattering(path, wavelength_um=0.65, convention="vrte")
    assert_close(turned.b2, -found.b2, rtol=1e-9, atol=1e-11)
    with h5py.File(path, "r+") as file:
        file["phase"][:] = file["phase"][:] * np.diag([1.0, 0.0, 0.0, 0.0])
    found = vrte.read_scattering(path, wavelength_um=0.65)
    assert found.is_scalar
    assert_close(found.a1, powder(0.65).phase_matrix.a1, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("labels", "name", "values", "words"),
    [
        (False, "phase", h5py.ExternalLink("secret", "/phase"), "its phase is a link to elsewhere"),
        (False, "phase", [b"a"], "its phase must be an array of numbers"),
        (False, "phase", np.ones(3), "its phase must be of shape"),
        (False, "phase", None, "it must have the variables"),
        (False, "mu", np.full(181, 2.0), "its mu must be cosines from -1 to 1"),
        (False, "sigma_t", np.ones(2), "its albedo and extinction must have a value for each wavelength"),
        (True, "phamat", np.ones(6), "its phamat must be an array of words"),
        (True, "phamat", [b"11"] * 5 + [b"45"], "its phamat must be of 11, 12, 22, 33, 34, 44, not 11, 11,"),
    ],
)
def test_hostile_files_are_refused_before_a_value_is_read(
    labels: bool, name: str, values: Any, words: str, tmp_path: Path
) -> None:
    """All ways to lead elsewhere: test_foreign_files.py, by the same reader."""
    path = eradiate(tmp_path / "aerosol.nc", labels)
    with h5py.File(path, "r+") as file:
        del file[name]
        if values is not None:
            file[name] = values
    with pytest.raises(SceneError, match=words) as refused:
        vrte.read_scattering(path, wavelength_um=0.65)
    assert str(refused.value).isprintable()


@pytest.mark.slow
def test_a_file_is_opened_by_a_process_of_its_own(
    mie_table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    assert_matrix(vrte.read_scattering(mie_table, **ASKED), powder(0.55).phase_matrix)
    assert_matrix(
        vrte.read_scattering(eradiate(tmp_path / "a.nc", True), wavelength_um=0.65), powder(0.65).phase_matrix
    )
    cut = tmp_path / "cut.cdf"
    cut.write_bytes(mie_table.read_bytes()[:5000])
    with pytest.raises(SceneError, match="it is not a NetCDF file"):
        vrte.read_scattering(cut, wavelength_um=0.55)


SCENE = """
wavelength_um = 0.55
[[layer]]
phase = {{ {phase} }}
albedo = 0.99
thickness = 0.5
[brdf]
mu_i = 0.6
mu_o = 0.5
"""


def scene_of(folder: Path, phase: str) -> Path:
    return written(folder, SCENE.format(phase=phase), "scene.toml")


def test_a_scene_file_names_a_table_over_angle(mie_table: Path, tmp_path: Path) -> None:
    sphere = make_reference_sphere().phase_matrix
    angles, about = sphere.to_angles().angle_deg, CONVENTIONS["granada"]
    as_csv(tmp_path, ["angle_deg", *about.columns], [angles, *tabulate_card(about, angles)], "dust.csv")
    path = scene_of(tmp_path, 'table = "dust.csv", convention = "granada", normalise = true')
    first, again = (read_scene(path).scene.layers[0].phase_matrix for _ in range(2))
    assert_matrix(first, sphere)
    assert first is again
    as_csv(tmp_path, ["angle_deg", *about.columns], [angles, *(2.0 * tabulate_card(about, angles))], "dust.csv")
    with pytest.raises(SceneError, match=r"layer\[1\]\.phase\.table: the table is not physical"):
        read_scene(path)
    of_mie = scene_of(tmp_path, f'table = "{mie_table}", effective_radius_um = 0.3')
    assert_matrix(read_scene(of_mie, wavelength_um=0.65).scene.layers[0].phase_matrix, powder(0.65, 0.3).phase_matrix)


def test_a_scene_file_says_what_is_wrong_with_its_table(mie_table: Path, tmp_path: Path) -> None:
    as_csv(tmp_path, ["angle_deg", "F11"], [np.arange(0.0, 181.0, 30.0), np.ones(7)], "dust.csv")
    written(tmp_path, "angle_deg,F11\n0,nan\n180,1\n", "bad.csv")
    for phase, words in (
        ('table = "dust.csv", convention = "mine"', "layer[1].phase.convention"),
        ('table = "dust.csv", terms = 3', "must be"),
        ('table = "dust.csv", convention = "granada"', "phase.table: normalise must be True for the convention"),
        ('table = "bad.csv"', "layer[1].phase.table: line 2: F11 must be a finite number, not nan"),
        ('table = "dust.csv", effective_radius_um = 1', "effective_radius_um must not be given with a .csv"),
        (f'table = "{mie_table}", effective_radius_um = 0.4', "must be one of the file's, 0.3 is nearest"),
    ):
        with pytest.raises(SceneError, match=re.escape(words)):
            read_scene(scene_of(tmp_path, phase))


@pytest.fixture
def dust_table(tmp_path: Path) -> Path:
    """The sphere of the card as measured tables are: 3 to 177 degrees, F11 = 1 at 30."""
    angles, about = np.arange(3.0, 178.0), CONVENTIONS["granada"]
    return as_csv(tmp_path, ["angle_deg", *about.columns], [angles, *tabulate_card(about, angles)], "dust.csv")


def test_the_command_tells_what_a_table_is_and_writes_it(
    dust_table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--convention", "granada", "--normalise", "--ends", "extrapolate")
    coefficients, picture = tmp_path / "coefficients.csv", tmp_path / "dust.png"
    assert run("phase", dust_table, *options, "-o", coefficients, "--plot", picture) == 0
    reported = capsys.readouterr().out
    found = vrte.read_scattering(dust_table, convention="granada", normalise=True, ends="extrapolate")
    assert isinstance(found, PhaseMatrix)
    assert "175 angles, convention granada; a spline over 175 angles, extrapolated short of 3 degrees" in reported
    assert f"integral    {found.expansion.integral:.6g}" in reported
    assert re.search(r"peak +F11 is 10\.\d+ at 0 degrees, half of that at 28\.\d degrees", reported)
    assert f"asymmetry   {found.asymmetry:.6g}\nterms       {found.terms}\n" in reported
    assert read_coefficients(coefficients).coefficients.tobytes() == found.coefficients.tobytes()
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run("phase", dust_table, "--recognise") == 0
    assert capsys.readouterr().out == f"{dust_table} is in the convention granada\n"
    assert run("phase") == 0
    reported = capsys.readouterr().out
    assert all(f"\n{name}: " in reported for name in CONVENTIONS)
    assert "F34      0.5014 at 30" in reported
