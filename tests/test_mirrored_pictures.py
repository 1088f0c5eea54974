"""Pictures of what meets interfaces: the mirrored beam is an arrow, told and in no lobe; depths name their medium."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Annotation

import vrte
from vrte.app.solving.solve import WITH_BEAM, WITHOUT_BEAM, collect_reflectances
from vrte.optics.fresnel import reflect_smooth
from vrte.pictures import results as figures
from vrte.pictures.describe import MIRRORED
from vrte.pictures.lobes import describe_mirrored_beam, lobe, name_brdf
from vrte.results.spectrum import Spectrum

from .helpers import assert_close
from .test_notebook import cells

MU_O, PHI = np.linspace(0.05, 1.0, 20), np.arange(0, 361, 15)
BREWSTER = 1.0 / np.sqrt(1.0 + 1.5**2)  # its cosine


@pytest.fixture(scope="module")
def plain() -> vrte.Brdf:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.95, thickness=1.0)])
    return vrte.brdf(scene, [0.3, BREWSTER, 1.0], MU_O, PHI, nodes=8, threads=1)


@pytest.fixture(scope="module")
def shiny(plain: vrte.Brdf) -> vrte.Brdf:
    """As if a surface of index 1.5 mirrored a share."""
    return replace(plain, specular=reflect_smooth(1.5, plain.mu_i))


@pytest.fixture(scope="module")
def field() -> vrte.Field:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.95, thickness=1.0)])
    found = vrte.radiance(scene, 0.6, mu=np.linspace(-1.0, 1.0, 20), phi=[0, 180], tau=[0.0, 1.0], nodes=6, threads=1)
    return replace(found, index=np.array([1.0, 1.5]), direct_up=np.array([0.25, 0.125]))


def test_what_is_mirrored_is_told_in_words(plain: vrte.Brdf, shiny: vrte.Brdf) -> None:
    assert describe_mirrored_beam(shiny, 2) == "mirrored: 0.04"
    assert describe_mirrored_beam(shiny, 1) == "mirrored: 0.074, degree of polarization 1"  # ((n^2 - 1)/(n^2 + 1))^2/2
    in_the_plane = describe_mirrored_beam(shiny, 1, (1.0, 1.0, 0.0, 0.0))
    assert float(in_the_plane.split(": ")[1]) < 1e-14  # nothing of it, at Brewster's angle
    assert describe_mirrored_beam(plain, 1) == ""
    assert name_brdf(plain) == "Subsurface BRDF"
    assert name_brdf(replace(plain, surface=plain.mueller)) == "BRDF, rough surface included"


def test_the_arrow_goes_out_where_a_mirror_sends_it(plain: vrte.Brdf, shiny: vrte.Brdf) -> None:
    """Seen from 24 degrees above, the sun's plane turned by 72: right is x sin 72, up z cos 24 - x sin 24 cos 72."""
    figure = shiny.plot()
    assert "without the mirrored beam" in figure.get_suptitle()
    lobes, cuts = figure.axes[:3], figure.axes[4:7]  # a colour bar between
    sine24, cosine24, sine72, cosine72 = (f(np.radians(angle)) for angle in (24, 72) for f in (np.sin, np.cos))
    for axes, mu in zip(lobes, shiny.mu_i, strict=True):
        falls, goes = [text for text in axes.texts if isinstance(text, Annotation)]
        across = np.sqrt(1.0 - mu**2)
        for tail, side, reach in ((falls.xyann, -1.0, 1.2), (goes.xy, 1.0, 1.3)):
            beside = 0.07 if mu == 1.0 and side > 0.0 else 0.0
            expected = (
                reach * (side * across * sine72) + beside,
                reach * (mu * cosine24 - side * across * sine24 * cosine72),
            )
            assert_close(tail, expected, rtol=0.0, atol=1e-12)
        assert any("mirrored: " in text.get_text() for text in axes.texts)
    for axes, mu in zip(cuts, shiny.mu_i, strict=True):
        (line,) = [line for line in axes.lines if line.get_color() == MIRRORED]
        assert_close(line.get_xdata(), np.arccos(mu), rtol=1e-7, atol=0.0)
    assert not [line for line in plain.plot().axes[4].lines if line.get_color() == MIRRORED]


def test_the_viewer_has_the_arrow_too(plain: vrte.Brdf, shiny: vrte.Brdf) -> None:
    figure, sine = lobe(shiny, 1), np.sqrt(1.0 - BREWSTER**2)
    falls, goes = [trace for trace in figure.data if trace.type == "cone"]
    assert_close([falls.u[0], falls.v[0], falls.w[0]], [sine, 0.0, -BREWSTER], rtol=0.0, atol=1e-12)
    assert_close([goes.u[0], goes.v[0], goes.w[0]], [sine, 0.0, BREWSTER], rtol=0.0, atol=1e-12)
    assert "mirrored: 0.074, degree of polarization 1" in figure.layout.title.text
    assert "mirrored: 0.074" in goes.hovertemplate
    assert "mirrored: 0.148" in lobe(shiny, 1, stokes=(1.0, -1.0, 0.0, 0.0)).layout.title.text
    assert len([trace for trace in lobe(plain, 1).data if trace.type == "cone"]) == 1
    (beam,) = [trace for trace in figures.cuts(shiny, 0).data if "mirrored" in trace.name]
    assert_close(beam.theta, np.degrees(np.arccos(0.3)), rtol=1e-6, atol=0.0)
    assert beam.name == "mirrored: 0.208, degree of polarization 0.666, not in the curves"


def test_depths_name_their_medium_and_notebooks_beams_and_media(shiny: vrte.Brdf, field: vrte.Field) -> None:
    figure, polar = field.plot(), figures.field_polar(field)
    names = ["τ = 0, n = 1", "τ = 1, n = 1.5"]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == names
    assert "medium of each depth" in figure.axes[-1].get_xlabel()
    assert {*names} <= {trace.name for trace in polar.data}
    assert "without beams" in polar.layout.title.text
    assert "BRDF, without the mirrored beam" in cells(shiny)
    assert f"|reflectance, as a beam||{shiny.specular[0, 0, 0]:.6g}, " in cells(shiny)
    assert "|refractive index||1, 1.5|" in cells(field)
    assert "|flux up, direct||0.25, 0.125|" in cells(field)
    rough, slab = vrte.Interface(1.0, 1.5, 0.1), vrte.Layer(vrte.isotropic(), 1.0, 1.0)
    reported = cells(vrte.Scene([rough, slab, vrte.Interface(1.5, 1.0)], vrte.Mirror((0.2, 3.4))))
    assert (
        reported.index("above layer 1")
        < reported.index("|layer 1|")
        < reported.index("above layer 2")
        < reported.index("|base|")
    )
    for words in ("index 1 above and 1.5 below, roughness 0.1", "|clear, of no thickness; in a medium of index 1|"):
        assert words in reported
    assert "Mirror" in reported


def test_shares_that_come_back_count_the_beam_and_tell_it_apart(plain: vrte.Brdf, shiny: vrte.Brdf) -> None:
    names = "over black", "over white"
    found = collect_reflectances((0.64,), (shiny,), (shiny,), names)
    assert found is not None
    for name in names:
        np.testing.assert_array_equal(found.curves[f"{name}{WITHOUT_BEAM}"][0], shiny.reflectance)
        total = shiny.reflectance + shiny.specular_reflectance
        np.testing.assert_array_equal(found.curves[f"{name}{WITH_BEAM}"][0], total)
    assert len(figures.reflectance(found, (0.64,), 0).data) == 4
    matt = collect_reflectances((0.64,), (plain,), (plain,), names)
    assert matt is not None
    assert tuple(matt.curves) == names
    panel = Spectrum([0.5, 0.6], [shiny, shiny]).plot().axes[0]
    dashed = [line for line in panel.lines if line.get_linestyle() == "--"]
    assert_close([line.get_ydata()[0] for line in dashed], shiny.specular[:, 0, 0], rtol=1e-7, atol=0.0)
    assert not [line for line in Spectrum([0.5], [plain]).plot().axes[0].lines if line.get_linestyle() == "--"]
