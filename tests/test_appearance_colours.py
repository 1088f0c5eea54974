"""Colours of spectra: the perfect white, colour-science's own sums, published pairs and cards, and what is refused."""

import itertools
import sys
import warnings

import numpy as np
import pytest

from vrte.appearance.colours import (
    OBSERVERS,
    Colour,
    estimate_error,
    find_colour,
    find_difference,
    find_white,
    import_colour_science,
    list_illuminants,
    weigh_wavelengths,
)
from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError, SceneError

from .helpers import assert_close, close_to

FINE = np.linspace(0.36, 0.83, 471)
BROAD = np.linspace(0.39, 0.73, 35)
# published: Sharma, Wu and Dalal, Color Res. Appl. 30, 21 (2005), table 1, pairs 1, 2, 17, 18, 25 and 34
PAIRS = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (50.0, 3.1736, 0.5854), 1.0),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
]
# of the perfect white, 5 or 1 nm from 380 to 780 nm, as ASTM E308 prints them (from memory): X and Z
WHITES = {("D65", 2): (95.047, 108.883), ("D65", 10): (94.811, 107.304)}
WHITES |= {("A", 2): (109.850, 35.585), ("D50", 2): (96.422, 82.521)}


def smooth_spectra(wavelengths_um: Array) -> Array:
    """(4, n): a grey slope, a red edge, a green hump, a blue that falls."""
    x = wavelengths_um
    red, blue = 0.05 + 0.6 / (1.0 + np.exp((0.59 - x) / 0.015)), 0.6 / (1.0 + np.exp((x - 0.5) / 0.02))
    return np.array([0.2 + 0.5 * (x - 0.36), red, 0.1 + 0.4 * np.exp(-(((x - 0.53) / 0.05) ** 2)), blue])


def make_lab(lab: tuple[float, float, float], illuminant: str = "D65", observer: int = 10) -> Colour:
    nothing = (0.0, 0.0, 0.0)
    return Colour(0.0, 0.0, 0.0, *lab, illuminant, observer, (0.36, 0.83), (nothing, nothing))


def test_the_perfect_white_is_white_in_every_light() -> None:
    """Published ones are met but for the wavelengths beyond 780 nm, and tables of 1 nm against 5 nm."""
    for observer, illuminant in itertools.product(OBSERVERS, list_illuminants()):
        white = find_colour(BROAD, np.ones(BROAD.size), illuminant, observer)
        assert_close((white.Y, white.L, white.a, white.b), (100.0, 100.0, 0.0, 0.0), rtol=0.0, atol=1e-9)
        assert (white.is_in_gamut, white.hex, white.extrapolation) == (True, "#ffffff", "")
        assert_close(white.linear_srgb, 1.0, rtol=0.0, atol=1e-12)
    for light, expected in WHITES.items():
        assert_close(100.0 * find_white(*light)[[0, 2]], expected, rtol=2e-4, atol=0.0)


@pytest.mark.parametrize(
    ("light", "largest"), [(("D65", 10), 1e-4), (("A", 2), 1e-4), (("FL11", 10), 2e-4), (("LED-B1", 2), None)], ids=str
)
def test_sums_are_those_of_colour_science(light: tuple[str, int], largest: float | None) -> None:
    """1 nm by 1 nm, the illuminant straight between its 5 nm; and of measured spectra in 10 nm by another way to 1 nm,
    Sprague's interpolation or tables of weights (ASTM E308)."""
    colour = import_colour_science()
    matching, lamp = colour.MSDS_CMFS[OBSERVERS[light[1]]], colour.SDS_ILLUMINANTS[light[0]]
    fine = [colour.SpectralDistribution(values, matching.wavelengths) for values in smooth_spectra(FINE)]
    card = [] if largest is None else list(colour.SDS_COLOURCHECKERS["BabelColor Average"].values())
    for spectra, source, method, rtol, atol in (
        (fine, lamp.copy().align(matching.shape), "Integration", 1e-10, 0.0),
        (card, lamp, "ASTM E308", 0.0, 100.0 * (largest or 0.0)),
    ):
        for spectrum in spectra:
            found = find_colour(spectrum.wavelengths * 1e-3, spectrum.values, *light)
            with warnings.catch_warnings(action="ignore"):  # that it aligns its tables
                expected = colour.sd_to_XYZ(spectrum, matching, source, method=method)
            assert_close((found.X, found.Y, found.Z), expected, rtol=rtol, atol=atol)


def test_few_wavelengths_do_for_smooth_spectra() -> None:
    """CIEDE2000 from sums over 1 nm; docs/how_to/appearance.md has the errors on measured spectra."""
    for count, largest in ((16, 0.15), (31, 0.05), (61, 0.01)):
        few = np.linspace(0.40, 0.70, count)
        for sparse, full in zip(smooth_spectra(few), smooth_spectra(FINE), strict=True):
            assert find_difference(find_colour(few, sparse), find_colour(FINE, full)) < largest


def test_a_colour_chart_has_its_published_colours() -> None:
    """sRGB of dark skin, red and white of the ColorChecker in D65 for 2 degrees, within the spread of batches: X-Rite's
    8-bit values are from memory; cyan is known for lying outside of sRGB."""
    spectra = list(import_colour_science().SDS_COLOURCHECKERS["BabelColor Average"].values())
    known = spectra[0].wavelengths * 1e-3
    for index, expected in ((0, (115, 82, 68)), (14, (175, 54, 60)), (18, (243, 243, 242))):
        found = find_colour(known, spectra[index].values, "D65", 2)
        assert_close(255.0 * found.srgb, expected, rtol=0.0, atol=6.0)
        assert found.is_in_gamut
    cyan = find_colour(known, spectra[17].values, "D65", 2)
    assert (cyan.is_in_gamut, cyan.linear_srgb[0] < 0.0, cyan.gamut_gap > 0.5) == (False, True, True)
    assert "cut off for the screen by" in str(cyan)


def test_published_differences() -> None:
    for one, other, expected in PAIRS:
        assert find_difference(make_lab(one), make_lab(other)) == close_to(expected, rtol=0.0, atol=5.1e-5)
        assert find_difference(make_lab(other), make_lab(one)) == close_to(expected, rtol=0.0, atol=5.1e-5)
    with pytest.raises(SceneError, match="not D65, 10 degrees and A, 10 degrees"):
        find_difference(make_lab(PAIRS[0][0]), make_lab(PAIRS[0][1], "A"))


def test_chroma_hue_and_what_a_screen_shows_instead() -> None:
    """What is brighter than white is shown as white, and the gap is that between the two."""
    yellow = make_lab((80.0, 0.0, 50.0))
    assert (yellow.C, yellow.h, make_lab((80.0, 3.0, -4.0)).C) == (50.0, 90.0, 5.0)
    assert make_lab((80.0, 3.0, -3.0)).h == close_to(315.0, rtol=1e-6, atol=0.0)
    bright, white = (find_colour(BROAD, np.full(BROAD.size, level)) for level in (1.2, 1.0))
    assert (bright.hex, white.gamut_gap, bright.is_in_gamut) == ("#ffffff", 0.0, False)
    assert bright.gamut_gap == close_to(find_difference(bright, white), rtol=1e-6, atol=0.0)


def test_what_lies_beyond_the_wavelengths_is_told() -> None:
    """Where a spectrum begins at 0.43 um, 15 % of Z is taken as there."""
    short = find_colour(np.linspace(0.43, 0.70, 16), np.full(16, 0.8))
    assert short.extrapolation == "X 4 %, Z 15 % below 0.43 µm, taken as at 0.43"
    assert short.beyond[0][2] == close_to(0.153, rtol=0.0, atol=1e-3)
    assert short.extrapolation in str(short)
    wide = np.linspace(0.3, 2.3, 101)  # what nobody sees does not matter
    assert_close(find_colour(wide, np.where(wide < 0.9, 0.5, 0.1)).Y, 50.0, rtol=0.0, atol=0.05)


def test_weights_are_kept_and_need_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    weights = weigh_wavelengths(BROAD)
    assert weigh_wavelengths(BROAD.tolist()) is weights
    assert not weights.flags.writeable
    monkeypatch.setitem(sys.modules, "colour", None)
    with pytest.raises(MissingExtraError, match="a colour needs the extra 'appearance'"):
        find_colour(BROAD + 1e-7, np.ones(BROAD.size))


def test_ripples_between_wavelengths_are_found() -> None:
    """The estimate is on the safe side for smooth spectra, and shouts where the steps are too wide for a ripple."""
    few = np.linspace(0.40, 0.70, 16)
    seen = np.linspace(0.40, 0.70, 301)  # not what lies beyond the ends, which is told otherwise
    for sparse, full in zip(smooth_spectra(few)[1:], smooth_spectra(seen)[1:], strict=True):
        estimate = estimate_error(few, sparse)
        assert find_difference(find_colour(few, sparse), find_colour(seen, full)) < estimate < 1.0
    assert estimate_error(few, 0.5 + 0.2 * np.sin(few / 0.01)) > 1.0
    assert estimate_error(few, 0.5 + 0.2 * np.sin(few / 0.003)) < 0.1  # 19 nm: as its docstring says, unseen
    nine = np.linspace(0.40, 0.70, 9)  # half of them are further apart than a colour may have them
    assert estimate_error(nine, np.full(9, 0.5)) < 1e-9
