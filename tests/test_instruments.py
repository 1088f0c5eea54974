"""Files as instruments write them: what is understood, what is asked for, and that nothing is guessed in silence."""

import contextlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import vrte
from vrte.fit.files import read_fit

from .helpers import assert_close, close_to, run

CXF = """<?xml version="1.0" encoding="UTF-8"?>
<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core"><cc:Resources><cc:ObjectCollection>
<cc:Object ObjectType="Target" Name="White" Id="1"><cc:ColorValues>
<cc:ReflectanceSpectrum StartWL="400" ColorSpecification="X">0.5 0.6 0.7 0.8</cc:ReflectanceSpectrum>
<cc:ColorCIELab ColorSpecification="X"><cc:L>90</cc:L><cc:A>-1</cc:A><cc:B>3</cc:B></cc:ColorCIELab>
</cc:ColorValues></cc:Object></cc:ObjectCollection>
<cc:ColorSpecificationCollection><cc:ColorSpecification Id="X">
<cc:TristimulusSpec><cc:Illuminant>D50</cc:Illuminant><cc:Observer>2_Degree</cc:Observer></cc:TristimulusSpec>
<cc:MeasurementSpec><cc:GeometryChoice><cc:SphereGeometry>Specular_Excluded</cc:SphereGeometry></cc:GeometryChoice>
<cc:WavelengthRange StartWL="400" Increment="10"/></cc:MeasurementSpec>
</cc:ColorSpecification></cc:ColorSpecificationCollection></cc:Resources></cc:CxF>"""
CGATS = """CGATS.17
ORIGINATOR "a laboratory"
ILLUMINATION_NAME "D50"
OBSERVER_ANGLE "2"
BEGIN_DATA_FORMAT
SAMPLE_NAME LAB_L LAB_A LAB_B SPECTRAL_NM400 SPECTRAL_NM410 SPECTRAL_NM420 SPECTRAL_NM430
END_DATA_FORMAT
NUMBER_OF_SETS 2
BEGIN_DATA
"White tile" 90 -1 3 0.5 0.6 0.7 0.8
Black 10 0 0 0.05 0.05 0.05 0.05
END_DATA
"""
PAIRS = """CGATS.17
BEGIN_DATA_FORMAT
SAMPLE_NAME SPECTRAL_NM SPECTRAL_PCT SPECTRAL_NM SPECTRAL_PCT SPECTRAL_NM SPECTRAL_PCT SPECTRAL_NM SPECTRAL_PCT
END_DATA_FORMAT
BEGIN_DATA
"White tile" 400 50 410 60 420 70 430 80
END_DATA
"""
VALUES = "400 50 410 60 420 70 430 80"
CARY = """White,,Black,,
Wavelength (nm),%R,Wavelength (nm),%R,
430,80,430,5,
420,70,420,5,
410,60,410,5,
400,50,400,5,

White
Scan rate: 600
"""
ANGLES = "# goniometer\n# Angle   BRDF   Error\n -60  0.10  0.001\n   0  0.12  0.002\n  60  0.11  0.001\n"
MINOLTA = (
    "Specular component;SCE\r\nSample;Mode;400 nm;410 nm;420 nm;430 nm\r\nA;x;50,0;60,0;70,0;80,0\r\nB;x;1;1;1;1\r\n"
)
GERMAN = "Gerät\tCM-3700\r\nDatum\t1.2.2024\r\nWellenlänge\tWeiß\tSchwarz\r\n" + "".join(
    f"{nm}\t0,{nm // 10 - 35}\t0,05\r\n" for nm in (400, 410, 420, 430)
).replace("0,5", "0,5").replace("0,6", "0,6")
NAMED = {"columns": {"wavelength_um": "Wellenlänge", "value": "Weiß"}}
SPECTRUM = "nm\tWhite (%)\n400\t50\n410\t60\n420\t70\n430\t80\n"

# files that hold the spectrum 0.5, 0.6, 0.7, 0.8 from 400 to 430 nm; keywords; a sentence of what was understood
SPECTRA: list[tuple[str | bytes, dict[str, Any], str]] = [
    (SPECTRUM, {}, "wavelengths 400 to 430 nm in 'nm': by the head"),
    (SPECTRUM.encode("utf-16"), {}, "text in UTF-16"),
    (SPECTRUM.encode("utf-16-be"), {}, "text in UTF-16"),
    ("\ufeff" + SPECTRUM, {}, "text in UTF-8"),
    ("Wavelength,R\n.4,.5\n.41,.6\n.42,.7\n.43,.8\n", {}, "wavelengths 0.4 to 0.43 um in 'Wavelength': by their size"),
    ("λ [µm];R\n0,40;0,5\n0,41;0,6\n0,42;0,7\n0,43;0,8\n", {}, "columns by semicolons, decimal commas"),
    ("Wavenumber (cm-1) R\n25000 50\n24390.2439024 60\n23809.5238095 70\n23255.813953 80\n", {}, "1/cm in 'Wavenumber"),
    (
        "400 50\n410 60\n420 70\n430 80\n",
        {"columns": {"wavelength_um": 1, "value": 2}},
        "in per cent: by their size, up",
    ),
    ("Sample,400,410,420,430\nWhite,50,60,70,80\n", {}, "spectra in rows, wavelengths 400 to 430 nm in heads"),
    ("400,410,420,430\n50,60,70,80\n", {}, "spectra in rows"),
    ("Wavelength;R\nnm;%\n400;50\n410;60\n420;70\n430;80\n", {}, "in 'Wavelength (nm)': by the head"),
    (SPECTRUM + "440\t-\n", {}, "1 rows of 'White' without a number are left out"),
    (GERMAN.encode("cp1252").replace(b"0,5\r", b"0,50\r"), NAMED, "text in Latin-1 (Windows)"),
    (CARY, {"sample": 1}, "values of 'White %R', 1 of 2 samples"),
    (MINOLTA, {"sample": "A", "geometry": None}, "geometry SCE: as the file says"),
    (CXF, {"geometry": None}, "reflectance of 'White' in fractions: as the file says"),
    (CGATS, {"sample": "White tile", "geometry": "45:0", "value_unit": "fraction"}, "CGATS.17, 2 samples"),
    (PAIRS, {}, "reflectance of 'White tile' in per cent: as the file says"),
    (PAIRS.replace("PCT", "DEC").replace(VALUES, "400 .5 410 .6 420 .7 430 .8"), {}, "in fractions: as the file says"),
    ("Panel;nm;R\nA;400;50\nA;410;60\nA;420;70\nA;430;80\nB;400;1\n", {"sample": "A"}, "values of 'A', 1 of 2 samples"),
]


def write(folder: Path, content: str | bytes, name: str = "file.txt") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(("content", "keywords", "words"), SPECTRA, ids=[words for _, _, words in SPECTRA])
def test_a_spectrum_is_read_as_it_comes(content: Any, keywords: Any, words: str, tmp_path: Path) -> None:
    found = vrte.read_measurement(write(tmp_path, content), **{"geometry": "8:di"} | keywords)
    order = np.argsort(found.wavelength_um)
    assert_close(found.wavelength_um[order], [0.4, 0.41, 0.42, 0.43], rtol=1e-9, atol=0.0)
    assert_close(found.value[order], [0.5, 0.6, 0.7, 0.8], rtol=1e-14, atol=0.0)
    assert found.names == ("reflectance",)
    assert any(words in one for one in found.understood), found.understood
    assert str(found).splitlines()[1:] == [f"  {one}" for one in found.understood]


def test_colours_are_read_with_their_light(tmp_path: Path) -> None:
    heads = "Name,L*(D65/10°),a*(D65/10°),b*(D65/10°)\nWhite,90,-1,3\n"
    for content, keywords, light in (
        (heads, {}, ("D65", 10.0)),
        ("L;a;b\n90;-1;3\n", {"illuminant": "A", "observer": 2}, ("A", 2.0)),
        (CGATS, {"sample": "White tile", "quantity": "Lab"}, ("D50", 2.0)),
        (CXF, {"quantity": "Lab"}, ("D50", 2.0)),
    ):
        found = vrte.read_measurement(write(tmp_path, content), geometry="45:0", **keywords)
        assert (found.quantity.tolist(), found.value.tolist()) == (["L", "a", "b"], [90.0, -1.0, 3.0])
        assert (found.illuminant[0], found.observer[0], found.geometry[0]) == (*light, "45:0")
    more = vrte.read_measurement(
        write(tmp_path, "Name,Gloss,L,a,b,X,Y,Z\nWhite,80,90,-1,3,1,2,3\n"), geometry="45:0", illuminant="A", observer=2
    )
    assert more.understood[2:4] == (
        "X, Y, Z stand beside L, a, b: quantity='XYZ' takes them",
        "not read: 'Gloss', 'X', 'Y', 'Z'",
    )
    found = vrte.read_measurement(write(tmp_path, "X,Y,Z\n1,2,3\n"), geometry="45:0", illuminant="C", observer=2)
    assert (found.quantity.tolist(), found.value.tolist()) == (["X", "Y", "Z"], [1.0, 2.0, 3.0])


def test_gloss_is_read_alone_or_beside_colours(tmp_path: Path) -> None:
    alone = vrte.read_measurement(write(tmp_path, "Panel;Gloss 20° [GU];60 GU;Gloss 85\nA;50,5;81;92\n"))
    assert alone.quantity.tolist() == ["gloss_20", "gloss_60", "gloss_85"]
    assert alone.value.tolist() == [50.5, 81.0, 92.0]
    beside = write(tmp_path, "Name,Gloss 60,L,a,b\nWhite,80,90,-1,3\n")
    light = {"geometry": "45:0", "illuminant": "A", "observer": 2}
    found = vrte.read_measurement(beside, **light)
    assert found.names == ("L", "a", "b")
    assert "gloss stands beside the colours: quantity='gloss' takes it" in found.understood
    assert vrte.read_measurement(beside, quantity="gloss").names == ("gloss_60",)


def test_goniometers_have_angles_and_errors(tmp_path: Path) -> None:
    found = vrte.read_measurement(write(tmp_path, ANGLES), theta_i_deg=30.0, wavelength_um=0.55)
    assert (found.names, found.theta_o_deg.tolist()) == (("f00",), [-60.0, 0.0, 60.0])
    assert (found.value.tolist(), found.sigma.tolist()) == ([0.1, 0.12, 0.11], [0.001, 0.002, 0.001])
    assert (found.theta_i_deg.tolist(), found.wavelength_um.tolist()) == ([30.0] * 3, [0.55] * 3)
    percent = "Angle (deg)   R (%)  Std (%)\n -60  10  0.1\n 0   12 0.2\n"
    found = vrte.read_measurement(write(tmp_path, percent), theta_i_deg=30.0, quantity="reflectance_factor")
    assert_close([*found.value, *found.sigma], [0.1, 0.12, 0.001, 0.002], rtol=1e-14, atol=0.0)


def test_over_black_and_over_white_come_from_columns_rows_or_words(tmp_path: Path) -> None:
    by_name = {"over black": 0.0, "over white": 0.8}
    for content, keywords in (
        ("nm;over black;over white\n400;50;60\n500;51;61\n", {"base": by_name}),
        ("Sample;base;400 nm;450 nm;500 nm\nfilm;0;50;50.5;51\nfilm;0.8;60;60.5;61\n", {}),
        ("base;nm;R\nover black;400;50\nover black;500;51\nover white;400;60\nover white;500;61\n", {"base": by_name}),
    ):
        found = vrte.read_measurement(write(tmp_path, content), geometry="8:di", **keywords)
        ends = np.isin(found.wavelength_um, (0.4, 0.5))
        assert found.base[ends].tolist() == [0.0, 0.0, 0.8, 0.8]
        assert_close(found.value[ends], [0.5, 0.51, 0.6, 0.61], rtol=1e-14, atol=0.0)
    alone = vrte.read_measurement(write(tmp_path, SPECTRUM), geometry="8:di", base=0.3)
    assert alone.base.tolist() == [0.3] * 4


def test_what_was_understood_is_kept_by_what_is_written(tmp_path: Path) -> None:
    found = vrte.read_measurement(write(tmp_path, SPECTRUM), geometry="8:di", base=0.3, sigma=0.01)
    found.save(tmp_path / "own.csv", "\n".join(found.understood))
    back = vrte.read_measurement(tmp_path / "own.csv")
    for name in ("quantity", "value", "sigma", "wavelength_um", "geometry", "base"):
        np.testing.assert_array_equal(getattr(back, name), getattr(found, name))
    rows = write(tmp_path, "quantity\tvalue\twavelength_um\nreflectance\t0,5\t0,4\n")
    own = vrte.read_measurement(rows, geometry="8:di")  # vrte's own columns, which lack the geometry
    assert (own.value.tolist(), own.geometry.tolist()) == ([0.5], ["8:di"])


BARE = {"geometry": None}
REFUSED: list[tuple[str | bytes, dict[str, Any], str]] = [
    # what is missing, and the keyword that says it
    (SPECTRUM, BARE, "geometry='8:di' (sphere, the surface's mirror image included), '8:de' (excluded) or '45:0' says"),
    ("d/8\nSCI;SCE\n" + SPECTRUM, BARE, "geometry='8:di'"),
    ("SCI\nSCE\n" + SPECTRUM, BARE, "says how it was measured: the file names SCI, SCE"),
    (
        "Wave,R\n50,20\n60,30\n",
        {},
        "wavelength_unit='nm', 'um' or '1/cm' says what wavelengths are in: 'Wave' runs from",
    ),
    ("Wave,R\n4000,20\n6000,30\n", {}, "'Wave' runs from 4000 to 6000, which may be any of these"),
    ("nm,R\n400,0.5\n500,0.9\n", {"geometry": "45:0"}, "value_unit='fraction' or 'percent' says what values are in: v"),
    ("nm,A,B\n400,50,60\n", {}, "sample='A' takes one, base={'A': 0.0, 'B': 0.8} takes those of one film over several"),
    ("base;nm;R\nblack;400;50\nwhite;400;60\n", {}, "base={'black': ..., 'white': ...} says the albedos of the bases"),
    (
        "L;a;b\n90;-1;3\n",
        {},
        "illuminant='D65', 'D50', ... says the light of the colour; observer=10 or 2 says the obs",
    ),
    (ANGLES, BARE, "theta_i_deg=... says the angle of incidence in degrees"),
    ("Angle R\n10 0.5\n", BARE, "quantity='reflectance_factor', 'f00', ... says what 'R' is"),
    ("nm;Absorbance\n400;0.5\n", {}, "quantity='reflectance', 'total_transmittance', ... says what 'Absorbance' is"),
    ("nm;%T\n400;0.5\n", {}, "says what '%T' is"),
    ("longueur;valeur\n400;50\n", {}, "columns={'wavelength_um': ..., 'value': ...} says which is which: no column is"),
    (
        "nm;wavelength;R\n400;400;50\n",
        {},
        "columns={'wavelength_um': ...} says which column it is: 'wavelength' and 'nm'",
    ),
    ("nm;name\n400;1\n410;2\n", {}, "columns={'value': ...} says which are the values: there are 'nm', 'name'"),
    # what is wrong
    ("", {}, "no table of numbers was found: it is empty"),
    ("hello world", {}, "no table of numbers was found: it begins with 'hello world'"),
    (
        "Wavelength,R\n400,0.5\n410,abc\n420,0.6\n",
        {},
        "line 3: '410,abc' is no row of 2 numbers, as those before and beh",
    ),
    ("nm,R\n400,5\n\nnew\nnm,R\n400,6\n", {}, "a file holds one table"),
    (b"PK\x03\x04", {}, "it is a workbook or a zip archive, and no text: save its table as CSV"),
    (b"\x00\x01\x02", {}, "it is no text"),
    ("nm,R,R\n400,1,2\n", {}, "two columns have the same name"),
    ("nm,R\n-400,50\n410,60\n", {}, "line 2: nm must be a number above 0"),
    ("nm,R\n400,-\n410,-\n", {}, "'R' holds no number"),
    (
        "nm,R,Error (%)\n400,0.5,1\n",
        {"value_unit": "fraction"},
        "the errors of 'R' are in per cent, and its values are",
    ),
    ("Sample,base,L,a,b\nA,0,1,2,3\n", {"base": 0.5}, "base is a column of the file"),
    ("Sample,400,410,420\nA,1,2,3\nA,4,5,6\n", {}, "line 3: a second row of 'A': names of samples must differ"),
    (CXF.replace('Increment="10"', ""), BARE, "CxF: the spectrum of 'White' lacks its StartWL or its Increment"),
    (CXF.replace("<cc:CxF", "<!DOCTYPE x><cc:CxF", 1), BARE, "CxF: a document type is not read"),
    (CXF[:-9], BARE, "CxF: no XML"),
    ("<a/>", BARE, "CxF: no object has a ReflectanceSpectrum"),
    (CGATS.replace("Black 10", "10"), {}, "CGATS: 15 values in BEGIN_DATA must be a multiple of the 8 names"),
    (
        PAIRS.replace("END_DATA\n", "Black 401 5 410 5 420 5 430 5\nEND_DATA\n"),
        {"geometry": "45:0"},
        "CGATS: wavelengths of one column must be the same in all samples, not 400, 401",
    ),
    (CGATS + "BEGIN_DATA\n", {}, "line 13: a second BEGIN_DATA: a file holds one table"),
    # keywords
    (SPECTRUM, {"sample": "Grey"}, "sample must be one of 'White', or its number from 1, not 'Grey'"),
    (SPECTRUM, {"sample": 2}, "sample must be one of"),
    (SPECTRUM, {"columns": {"colour": "nm"}}, "columns names 'wavelength_um', 'theta_i_deg'"),
    (SPECTRUM, {"columns": {"value": "Grey"}}, "columns has no column 'Grey' for value"),
    (SPECTRUM, {"wavelength_unit": "um"}, "wavelength_unit is 'um', and the head 'nm' says nm"),
    (SPECTRUM, {"wavelength_unit": "mm"}, "wavelength_unit must be one of 'nm', 'um', '1/cm', not 'mm'"),
    (SPECTRUM, {"value_unit": "fraction"}, "value_unit is 'fraction', and the file says percent"),
    (SPECTRUM, {"base": 1.5}, "base must be an albedo from 0 to 1, or some by names, not 1.5"),
    (SPECTRUM, {"theta_i_deg": 8.0}, "theta_i_deg was given, and nothing that was read needs it"),
    (SPECTRUM, {"illuminant": "D65"}, "illuminant was given, and nothing that was read needs it"),
    (SPECTRUM, {"quantity": "colour"}, "quantity must be one of"),
    (SPECTRUM, {"geometry": "8"}, "geometry must be a geometry such as"),
    (
        "quantity,value,theta_i_deg\ntotal_reflectance,0.5,8\n",
        {"sample": "A", "geometry": None},
        "sample is of instrume",
    ),
    ("quantity,value,theta_i_deg\ntotal_reflectance,0.5,8\n", {"theta_i_deg": 8.0, "geometry": None}, "is in the file"),
]


@pytest.mark.parametrize(("content", "keywords", "words"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_missing_or_wrong_is_one_sentence(content: Any, keywords: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(vrte.SceneError, match=re.escape(words)) as caught:
        vrte.read_measurement(write(tmp_path, content), **{"geometry": "8:di"} | keywords)
    assert str(caught.value).isprintable()
    assert str(caught.value).startswith(str(tmp_path / "file.txt"))


QUIET = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@QUIET
@given(
    value=st.lists(st.floats(0.0005, 1.2).map(lambda x: round(x, 4)), min_size=2, max_size=40),
    step=st.sampled_from([1, 5, 10, 20]),
    dialect=st.sampled_from([(";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), ("  ", "."), (" ", ",")]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    unit=st.sampled_from(["nm", "um"]),
    is_percent=st.booleans(),
    preamble=st.lists(st.sampled_from(["Gerät CM", "Datum: heute", "# a comment", "", "Serial;47"]), max_size=5),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    is_wide=st.booleans(),
)
def test_whatever_way_a_spectrum_is_written_it_reads_back(
    value: Any, step: int, dialect: Any, encoding: str, unit: str, is_percent: bool, preamble: Any, end: str,
    is_wide: bool, tmp_path: Path,
) -> None:  # fmt: skip
    separator, point = dialect
    nm = [380 + step * k for k in range(len(value))]
    cells = [f"{100.0 * x:.2f}" if is_percent else f"{x:.4f}" for x in value]
    cells = [one.replace(".", point) for one in cells]
    is_wide = is_wide and len(value) > 2
    if is_wide:
        rows = [separator.join(["Sample", *(f"R{one}" for one in nm)]), separator.join(["panel", *cells])]
    else:
        numbers = [str(one) if unit == "nm" else f"{one / 1000:.4f}".replace(".", point) for one in nm]
        head = separator.join([f"Wavelength[{unit}]", "R[%]" if is_percent else "R"])
        rows = [head, *map(separator.join, zip(numbers, cells, strict=True))]
    path = write(tmp_path, end.join([*preamble, *rows, ""]).encode(encoding))
    found = vrte.read_measurement(path, geometry="SCE", value_unit="percent" if is_percent else "fraction")
    assert_close(found.wavelength_um, np.array(nm) / 1000, rtol=1e-12, atol=0.0)
    assert_close(found.value, value, rtol=1e-12, atol=1e-12)


PIECES = st.one_of(
    st.sampled_from([
        "nm", "Wavelength", "R (%)", "400", "0,5", "0.5", "-", "", "nan", "1e999", "inf", "L", "a", "b", "X", "base",
        "Angle", "Error", "Sample", '"', "'", "#", "BEGIN_DATA_FORMAT", "END_DATA_FORMAT", "BEGIN_DATA", "END_DATA",
        "SPECTRAL_NM400", "<cc:CxF>", "</a>", "%T", "SCE", "450 nm", "500 nm", "600 nm", "٣", "½", "\u2028", "\x85",
    ]),
    st.text(max_size=6),
)  # fmt: skip
LINES = st.lists(st.tuples(st.sampled_from([";", ",", "\t", " "]), st.lists(PIECES, max_size=5)), max_size=12)
KEYWORDS = {
    "geometry": st.sampled_from(["8:di", "45:0", "x"]),
    "columns": st.sampled_from([{"wavelength_um": 1, "value": 2}, {"theta_o_deg": 1, "f00": 2}, {"L": 1}, {}]),
    "quantity": st.sampled_from(["f00", "reflectance", "Lab", "total_reflectance"]),
    "base": st.sampled_from([0.5, {"R": 0.5}, {"400": 0.1}]),
    "sample": st.sampled_from([1, 2, "R"]),
    "value_unit": st.sampled_from(["percent", "fraction"]),
    "theta_i_deg": st.just(30.0),
    "illuminant": st.just("D65"),
    "observer": st.just(2),
}


@settings(QUIET, max_examples=400)
@given(
    lines=LINES, keywords=st.fixed_dictionaries({}, optional=KEYWORDS), encoding=st.sampled_from(["utf-8", "utf-16"])
)
def test_any_text_is_read_or_refused_in_one_sentence(lines: Any, keywords: Any, encoding: str, tmp_path: Path) -> None:
    text = "\n".join(separator.join(cells) for separator, cells in lines)
    path = write(tmp_path, text.encode(encoding, "surrogatepass" if encoding == "utf-8" else "replace"))
    found = read_or_refuse(path, **keywords)
    assert found is None or np.isfinite(found.value).all()


def read_or_refuse(path: Path, **keywords: Any) -> vrte.Measurement | None:
    """A measurement, or None where it is refused in a sentence; any other exception is a failure."""
    with contextlib.suppress(vrte.SceneError):  # whose sentence is printable whatever the file holds
        return vrte.read_measurement(path, **keywords)
    return None


@settings(QUIET, max_examples=200)
@given(content=st.binary(max_size=200), where=st.integers(0, len(CGATS)))
def test_any_bytes_are_read_or_refused_in_one_sentence(content: bytes, where: int, tmp_path: Path) -> None:
    for whole in (content, CGATS.encode()[:where] + content + CGATS.encode()[where:]):
        read_or_refuse(write(tmp_path, whole), geometry="8:di")


def test_the_command_says_what_was_understood_and_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "Wellenlänge;schwarz (%);weiß (%)\n450;60;65\n550;70;73\n", "card.txt")
    assert run("measurement", "card.txt", "--column", "wavelength_um=1") == 2
    out, complaint = capsys.readouterr()
    assert "wavelengths 450 to 550 nm in 'Wellenlänge': by their size\n" in out
    assert "\nmissing: sample='schwarz' takes one, base={'schwarz': 0.0, 'weiß': 0.8} takes" in out
    assert "\nmissing: geometry='8:di'" in out
    assert complaint == "vrte: error: card.txt: say what is missing by --sample, --geometry\n"
    bases = ("--base", "schwarz=0", "--base", "weiß=0.8", "-o", "card.csv")
    assert run("measurement", "card.txt", "--column", "wavelength_um=1", "--geometry", "SCE", *bases) == 0
    assert "\nreflectance: 4 rows, 0.6 to 0.73\nwrote card.csv" in capsys.readouterr().out
    found = vrte.read_measurement("card.csv")
    assert (found.base.tolist(), found.geometry[0]) == ([0.0, 0.0, 0.8, 0.8], "SCE")
    assert run("measurement", "card.csv") == 0
    assert run("init", "measurement") == 0
    assert run("measurement", "measurement.csv", "--sigma", "0.1") == 2
    assert "sigma is in the file" in capsys.readouterr().err
    assert run("init", "measurement", "-o", "x.toml") == 2


def test_a_fit_takes_files_of_instruments_and_several_of_them(tmp_path: Path) -> None:
    layer = 'layer = [{ phase = "rayleigh", albedo = 0.9, thickness = 0.7 }]'
    content = f'{layer}\nnodes = 4\n[fit]\nfree = ["layer[1].albedo"]\n'
    entry = '{ file = "black.txt", geometry = "8:di", base = 0.0, wavelength_um = 0.5 }'
    write(tmp_path, "nm;R\n500;0,4\n", "black.txt")
    write(tmp_path, "quantity,value,base,geometry\nreflectance,0.6,0.8,8:di\n", "white.csv")
    for asked in (
        f'[{entry.replace(", wavelength_um = 0.5", "")}, "white.csv"]',
        '[{ file = "white.csv" }, "white.csv"]',
    ):
        measured = read_fit(write(tmp_path, f"{content}measurement = {asked}\n", "fit.toml")).measurement
        assert len(measured) == 2
        assert measured.value[1] == 0.6
    for asked, words in (
        (entry, "wavelength_um was given, and nothing that was read needs it"),
        ("[]", "must be the name of a file, a table with its file, or a list of these"),
        ("3", "must be the name of a file"),
        ('{ file = "black.txt", geomtry = "8:di" }', "unknown key; did you mean"),
        ('{ file = "black.txt", geometry = 8 }', "geometry must be a text"),
        ('{ file = "black.txt", theta_i_deg = "8" }', "theta_i_deg must be a number"),
        ('{ file = "black.txt" }', "geometry='8:di'"),
    ):
        with pytest.raises(vrte.SceneError, match=re.escape(words)):
            read_fit(write(tmp_path, f"{content}measurement = {asked}\n", "fit.toml"))


def test_measurements_of_several_files_are_joined(tmp_path: Path) -> None:
    black = vrte.read_measurement(write(tmp_path, SPECTRUM), geometry="8:di", base=0.0)
    gloss = vrte.Measurement("L", 90.0, geometry="45:0")
    both = black.join([gloss, gloss])
    assert (both.names, len(both)) == (("reflectance", "L"), 6)
    assert both.understood == black.understood
    assert both.base.tolist()[:4] == [0.0] * 4
    with pytest.raises(vrte.SceneError, match="sigma is missing"):
        black.join([vrte.Measurement("L", 90.0, 0.1, geometry="45:0")])


@pytest.mark.slow
def test_the_thickness_of_a_drawdown_is_found_over_both_cards() -> None:
    """examples/drawdown.txt was computed for 15 um, with noise of 0.1 %."""
    file = Path(__file__).parents[1] / "examples" / "drawdown.txt"
    measured = vrte.read_measurement(file, geometry="8:de", base={"over black": 0.0, "over white": 0.8}, sigma=8e-4)
    paint = {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 8.0}
    free = {"paint.thickness_um": {"low": 2.0, "high": 60.0}}
    found = vrte.fit(measured, {"accuracy": 1e-4, "paint": paint}, free)
    assert found.values[0] == close_to(15.0, rtol=0.0, atol=3.0 * found.errors[0])
    assert found.errors[0] < 0.05
