"""Pictures, and what a notebook shows: they are drawn from what is right, and say what they show; the mirrored beam is
an arrow, told and in no lobe; nothing that a notebook shows raises."""

import base64
import io
import pickle
import re
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.text import Annotation

import vrte
from vrte.app.solving.solve import WITH_BEAM, WITHOUT_BEAM, collect_reflectances, compute_colours
from vrte.app.solving.worker import Reflectances
from vrte.optics.fresnel import reflect_smooth
from vrte.pictures import results
from vrte.pictures.describe import MIRRORED
from vrte.pictures.lobes import STEP, compute_lobe, describe_mirrored_beam, lobe, name_brdf
from vrte.pictures.notebook import draw_brdf
from vrte.results.brdf import Spectrum
from vrte.results.over_hemisphere import check_directions, stokes_over_hemisphere
from vrte.results.quantities import FIELD_QUANTITIES, QUANTITIES, of_stokes

from .helpers import assert_close, close_to

MU_O, PHI = np.linspace(0.05, 1.0, 20), np.arange(0, 361, 15)
BREWSTER = 1.0 / np.sqrt(1.0 + 1.5**2)  # its cosine
HOW: dict[str, Any] = {"nodes": 8, "threads": 1}
SCENE = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)], vrte.Lambertian(0.2))
DARK = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=1.0)])
PLAIN = vrte.brdf(SCENE, [0.3, BREWSTER, 1.0], MU_O, PHI, **HOW)
SHINY = replace(PLAIN, specular=reflect_smooth(1.5, PLAIN.mu_i))  # as if a surface of index 1.5 mirrored a share
SEEN = vrte.brdf(SCENE, [0.6, 1.0], MU_O, PHI, **HOW)
UP = np.linspace(0.05, 1.0, 20)
DEEP = vrte.radiance(SCENE, 0.6, mu=[*-UP[::-1], *UP], phi=[0, 90, 180], tau=[0.0, 0.5, 1.0], **HOW)
LIGHT, ANGLE = (1.0, 0.2, -0.5, 0.6), "angle of linear polarization"
FIELD = vrte.radiance(SCENE, 0.6, phi=[0, 90], tau=[0.0, 0.5], **HOW)
THINGS: dict[str, Any] = {
    "field": FIELD,
    "brdf": vrte.brdf(SCENE, 0.5, MU_O[1::2], PHI[:-1:2], **HOW),
    "phase matrix": vrte.rayleigh(),
    "plan": vrte.plan("brdf", SCENE, mu_i=0.5, mu_o=MU_O, phi=PHI, **HOW),
}
THINGS["spectrum"] = Spectrum([0.5, 0.6], 2 * [THINGS["brdf"]])


def cells(thing: Any) -> str:
    """What a notebook shows of it, without tags."""
    return re.sub("<[^>]+>", "|", thing._repr_html_())


# ---- lobes and cuts


@pytest.mark.parametrize("place", [1, 2])
def test_a_lobe_goes_through_directions_that_were_not_given(place: int) -> None:
    """And through the azimuths that mirror symmetry gives."""
    drawn = compute_lobe(PLAIN, place)
    theta, phi = np.arange(0, drawn.theta.size, 14), np.arange(0, drawn.phi.size, 42)
    cosines = np.cos(np.radians(drawn.theta[theta]))
    exact = vrte.brdf(SCENE, PLAIN.mu_i[place], cosines, drawn.phi[phi], **HOW).mueller[0]
    degree = np.hypot(exact[..., 1, 0], exact[..., 2, 0]) / exact[..., 0, 0]
    assert_close(drawn.radius[np.ix_(theta, phi)], exact[..., 0, 0], rtol=0.0, atol=2e-4 * drawn.radius.max())
    assert_close(drawn.polarized[np.ix_(theta, phi)], degree, rtol=0.0, atol=5e-3)
    half = np.arange(0, 181, 15)
    for azimuths in (half, np.roll(half, 5), -half):
        partial = compute_lobe(vrte.brdf(SCENE, PLAIN.mu_i[place], MU_O[::-1], azimuths, **HOW), 0)
        assert_close(partial.radius, drawn.radius, rtol=0.0, atol=1e-9)
        assert_close(partial.polarized, drawn.polarized, rtol=0.0, atol=1e-9)


def test_bodies_and_cuts_end_where_the_directions_end() -> None:
    """Of too few directions there are none."""
    few = vrte.brdf(SCENE, 0.6, np.linspace(0.5, 1.0, 8), PHI, **HOW)
    beyond = stokes_over_hemisphere(few, 0, np.array([59.9, 60.0, 60.1, 90.0]), np.array([7.0]))
    assert np.isnan(beyond).all(axis=(1, 2)).tolist() == [False, False, True, True]
    assert np.asarray(body(lobe(few, 0)).customdata)[:, 0].min() == close_to(0.5, rtol=0.0, atol=1e-6)
    for curve in named(results.cuts(few, 0)).values():
        if curve.mode == "lines" and curve.name != "0":
            assert np.abs(np.asarray(curve.theta, float)).max() == close_to(60.0, rtol=0.0, atol=1e-4)
    small: Any = draw_brdf(few)
    assert max(np.abs(line.get_xdata()).max() for panel in small.axes for line in panel.get_lines()) < 60.001
    for mu_o, phi in (([0.5], [0, 90, 180]), ([0.5, 0.5], [0, 90, 180]), ([0.5, 1], [0, 180, 360])):
        with pytest.raises(vrte.SceneError, match="at least 2 different mu_o and 3 different phi_deg"):
            check_directions(mu_o, phi)


def test_the_mesh_of_a_lobe_is_fine_enough_for_zeros_of_the_polarization() -> None:
    """Degrees have cusps there, which a coarse mesh shows as a mottle: 0.1 of the largest between rings 2 degrees
    apart. Colours run evenly between neighbours here, and so are right half way."""
    gold = vrte.Scene([vrte.Layer.of(vrte.spheres((0.19, 3.5), radius_um=0.6, wavelength_um=0.64), 5.0)])
    brdf = vrte.brdf(gold, 0.6, np.linspace(0.05, 1.0, 40), np.arange(0, 181, 4), nodes=24)
    drawn = compute_lobe(brdf, 0)
    half_way = 0.5 * (drawn.theta[1:] + drawn.theta[:-1])
    exact = of_stokes(stokes_over_hemisphere(brdf, 0, half_way, drawn.phi), "degree of linear polarization")
    difference = np.abs(0.5 * (drawn.polarized[1:] + drawn.polarized[:-1]) - exact).max()
    assert difference < 0.05 * drawn.polarized.max()


# ---- the mirrored beam


def test_what_is_mirrored_is_told_in_words() -> None:
    assert describe_mirrored_beam(SHINY, 2) == "mirrored: 0.04"
    assert describe_mirrored_beam(SHINY, 1) == "mirrored: 0.074, degree of polarization 1"  # ((n^2 - 1)/(n^2 + 1))^2/2
    in_the_plane = describe_mirrored_beam(SHINY, 1, (1.0, 1.0, 0.0, 0.0))
    assert float(in_the_plane.split(": ")[1]) < 1e-14  # nothing of it, at Brewster's angle
    assert describe_mirrored_beam(PLAIN, 1) == ""
    assert name_brdf(PLAIN) == "Subsurface BRDF"
    assert name_brdf(replace(PLAIN, surface=PLAIN.mueller)) == "BRDF, rough surface included"


def test_the_arrow_goes_out_where_a_mirror_sends_it() -> None:
    """Seen from 24 degrees above, the sun's plane turned by 72: right is x sin 72, up z cos 24 - x sin 24 cos 72."""
    figure = SHINY.plot()
    assert "without the mirrored beam" in figure.get_suptitle()
    assert any("degree of linear polarization" in axes.get_ylabel() for axes in figure.axes)
    lobes, cuts = figure.axes[:3], figure.axes[4:7]  # a colour bar between
    sine24, cosine24, sine72, cosine72 = (f(np.radians(angle)) for angle in (24, 72) for f in (np.sin, np.cos))
    for axes, mu in zip(lobes, SHINY.mu_i, strict=True):
        falls, goes = [text for text in axes.texts if isinstance(text, Annotation)]
        across = np.sqrt(1.0 - mu**2)
        for tail, side, reach in ((falls.xyann, -1.0, 1.2), (goes.xy, 1.0, 1.3)):
            right = reach * side * across * sine72 + (0.07 if mu == 1.0 and side > 0.0 else 0.0)
            up = reach * (mu * cosine24 - side * across * sine24 * cosine72)
            assert_close(tail, (right, up), rtol=0.0, atol=1e-12)
        assert any("mirrored: " in text.get_text() for text in axes.texts)
        assert f"{mu:.4g}" in axes.get_title()
    for axes, mu in zip(cuts, SHINY.mu_i, strict=True):
        (line,) = [line for line in axes.lines if line.get_color() == MIRRORED]
        assert_close(line.get_xdata(), np.arccos(mu), rtol=1e-7, atol=0.0)
    assert not [line for line in PLAIN.plot().axes[4].lines if line.get_color() == MIRRORED]


def test_the_viewer_has_the_arrow_too() -> None:
    figure, sine = lobe(SHINY, 1), np.sqrt(1.0 - BREWSTER**2)
    falls, goes = [trace for trace in figure.data if trace.type == "cone"]
    assert_close([falls.u[0], falls.v[0], falls.w[0]], [sine, 0.0, -BREWSTER], rtol=0.0, atol=1e-12)
    assert_close([goes.u[0], goes.v[0], goes.w[0]], [sine, 0.0, BREWSTER], rtol=0.0, atol=1e-12)
    assert "mirrored: 0.074, degree of polarization 1" in figure.layout.title.text
    assert "mirrored: 0.074" in goes.hovertemplate
    assert "mirrored: 0.148" in lobe(SHINY, 1, stokes=(1.0, -1.0, 0.0, 0.0)).layout.title.text
    assert len([trace for trace in lobe(PLAIN, 1).data if trace.type == "cone"]) == 1
    (beam,) = [trace for trace in results.cuts(SHINY, 0).data if "mirrored" in trace.name]
    assert_close(beam.theta, np.degrees(np.arccos(0.3)), rtol=1e-6, atol=0.0)
    assert beam.name == "mirrored: 0.208, degree of polarization 0.666, not in the curves"


def test_shares_that_come_back_count_the_beam_and_tell_it_apart() -> None:
    names = "over black", "over white"
    found = collect_reflectances((0.64,), (SHINY,), (SHINY,), names)
    for name in names:
        np.testing.assert_array_equal(found.curves[f"{name}{WITHOUT_BEAM}"][0], SHINY.reflectance)
        total = SHINY.reflectance + SHINY.specular_reflectance
        np.testing.assert_array_equal(found.curves[f"{name}{WITH_BEAM}"][0], total)
    assert len(results.reflectance(found, (0.64,), 0).data) == 4
    matt = collect_reflectances((0.64,), (PLAIN,), (PLAIN,), names)
    assert tuple(matt.curves) == names
    for brdf, dashed in ((SHINY, SHINY.specular[:, 0, 0]), (PLAIN, [])):
        panel = Spectrum([0.5, 0.6], [brdf, brdf]).plot().axes[0]
        drawn = [line.get_ydata()[0] for line in panel.lines if line.get_linestyle() == "--"]
        assert_close(drawn, dashed, rtol=1e-7, atol=0.0)


# ---- fields, spectra and plans


def test_a_field_is_drawn_smoothly_through_marked_directions() -> None:
    """Degrees of polarization are divided after the line is drawn through I, Q, U and V. A column an azimuth, or a beam
    of several."""
    figure = FIELD.plot()
    assert "Subsurface radiance" in figure.get_suptitle()
    assert [axes.get_title() for axes in figure.axes[:2]] == ["φ = 0°", "φ = 90°"]
    lines = {line.get_linestyle(): line for line in figure.axes[0].get_lines()[4:6]}
    down = np.flatnonzero(FIELD.mu < 0.0)[np.argsort(FIELD.mu[FIELD.mu < 0.0])]
    np.testing.assert_array_equal(lines["None"].get_xdata(), FIELD.mu[down])
    np.testing.assert_array_equal(lines["None"].get_ydata(), FIELD.stokes[1, down, 0, 0])
    mu = lines["-"].get_xdata()
    assert mu.size == 7 * 8 + 1
    exact = vrte.radiance(SCENE, 0.6, mu=mu, phi=[0], tau=[0.5], **HOW).stokes[0, :, 0, 0]
    assert_close(lines["-"].get_ydata(), exact, rtol=0.0, atol=0.03 * exact.max())
    beams = vrte.radiance(SCENE, [0.3, 0.6], mu=[-0.5, 0.5, 1.0], phi=[0, 90], nodes=4, threads=1).plot()
    assert [axes.get_title() for axes in beams.axes[:2]] == ["μ₀ = 0.3", "μ₀ = 0.6"]
    assert "φ = 0°" in beams.get_suptitle()


def test_depths_name_their_medium_and_notebooks_beams_and_media() -> None:
    field = replace(FIELD, index=np.array([1.0, 1.5]), direct_up=np.array([0.25, 0.125]))
    figure, polar = field.plot(), results.field_polar(field)
    names = ["τ = 0, n = 1", "τ = 0.5, n = 1.5"]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == names
    assert "medium of each depth" in figure.axes[-1].get_xlabel()
    assert {*names} <= {trace.name for trace in polar.data}
    assert "without beams" in polar.layout.title.text
    assert "BRDF, without the mirrored beam" in cells(SHINY)
    assert f"|reflectance, as a beam||{SHINY.specular[0, 0, 0]:.6g}, " in cells(SHINY)
    assert "|refractive index||1, 1.5|" in cells(field)
    assert "|flux up, direct||0.25, 0.125|" in cells(field)
    rough, slab = vrte.Interface(1.0, 1.5, 0.1), vrte.Layer(vrte.isotropic(), 1.0, 1.0)
    reported = cells(vrte.Scene([rough, slab, vrte.Interface(1.5, 1.0)], vrte.Mirror((0.2, 3.4))))
    rows = [reported.index(name) for name in ("above layer 1", "|layer 1|", "above layer 2", "|base|")]
    assert rows == sorted(rows)
    for words in ("index 1 above and 1.5 below, roughness 0.1", "|clear, of no thickness; in a medium of index 1|"):
        assert words in reported
    assert "Mirror" in reported


def test_a_spectrum_shows_its_reflectance_and_a_cut_a_wavelength() -> None:
    spectrum = THINGS["spectrum"]
    reflectance, cuts = spectrum.plot().axes
    np.testing.assert_array_equal(reflectance.get_lines()[0].get_ydata(), spectrum.reflectance[:, 0])
    assert [line.get_label() for line in cuts.get_lines()] == ["0.5 µm", "0.6 µm"]
    assert len(Spectrum([0.5], [vrte.brdf(SCENE, 0.5, 0.5, nodes=4)]).plot().axes) == 1


def test_the_plan_draws_its_operations_and_what_is_left_out() -> None:
    blocks = THINGS["plan"].as_dict()["blocks"]
    (panel,) = THINGS["plan"].plot().axes
    outlines = [np.asarray(area.get_xy()) for area in panel.patches]
    drawn = sum(0.5 * abs((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) for x, y in (one.T for one in outlines))  # areas
    assert drawn == close_to(sum(block["operations"] for block in blocks), rtol=1e-6, atol=0.0)
    layers = [vrte.Layer(one, 0.9, 1.0) for one in (vrte.henyey_greenstein(0.9, 300), vrte.rayleigh())]
    plan = vrte.plan("brdf", vrte.Scene(layers), mu_i=0.5, mu_o=0.5, **HOW)
    titles = [f"Plan of brdf: {light} light" for light in ("unpolarized", "polarized")]
    assert [panel.get_title() for panel in plan.plot().axes] == titles
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 40), albedo=0.9, thickness=1.0)])
    plan = vrte.plan("radiance", scene, mu0=0.5, mu=[0.5], nodes=20, threads=1)
    (panel,) = plan.plot().axes
    assert (plan.orders < 40, panel.get_xlim()) == (True, (-0.5, 39.5))
    texts = [text.get_text() for text in panel.get_legend().get_texts()]
    assert f"left out of multiple scattering: {40 - plan.orders} of 40" in texts


# ---- the viewer's figures


def body(figure: Any) -> Any:
    """The lobe: the mesh that tells something."""
    (mesh,) = [trace for trace in figure.data if trace.type == "mesh3d" and trace.customdata is not None]
    return mesh


def corners(mesh: Any) -> np.ndarray:
    return np.stack([mesh.i, mesh.j, mesh.k], axis=-1)


def named(figure: Any) -> dict[str, Any]:
    return {trace.name: trace for trace in figure.data}


def test_a_lobe_is_where_the_solver_says() -> None:
    figure = lobe(SEEN, 0, "f00", "f10")
    mesh = body(figure)
    index = np.stack([mesh.x, mesh.y, mesh.z], axis=-1).astype(float)
    radius, largest = np.linalg.norm(index, axis=-1), float(mesh.customdata[:, 2].max())
    for some in (300, 1234, 3000, 8000):
        mu, phi, height, colour = np.asarray(mesh.customdata, float)[some]
        (x, y, z), size = index[some], radius[some]
        exact = vrte.brdf(SCENE, 0.6, mu, phi, **HOW).mueller[0, 0, 0]
        assert z / size == close_to(mu, rtol=0.0, atol=1e-6)
        assert np.degrees(np.arctan2(y, x)) % 360.0 == close_to(phi, rtol=0.0, atol=1e-3)
        assert size * largest == close_to(exact[0, 0], rtol=2e-3, atol=0.0)
        assert (height, colour) == close_to((exact[0, 0], exact[1, 0]), rtol=0.0, atol=2e-3 * largest)
    assert radius.max() == close_to(1.0, rtol=0.0, atol=1e-6)
    assert all(words in figure.layout.title.text for words in (f"{largest:.3g} sr", "Subsurface"))


def test_the_sign_is_in_the_colour_and_the_mesh_is_closed_around_the_normal() -> None:
    figure = lobe(SEEN, 0, "f10", "f10")
    mesh = body(figure)
    assert "|f10|" in figure.layout.title.text
    assert "absolute value" in mesh.hovertemplate
    assert (mesh.intensity.min() < 0.0 < mesh.intensity.max(), mesh.cmin) == (True, -mesh.cmax)
    np.testing.assert_array_equal(mesh.intensity, mesh.customdata[:, 2])
    edges = np.sort(np.concatenate([corners(mesh)[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]))
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert set(count) == {1, 2}
    assert (count == 1).sum() == 2 * 360 / STEP  # the pole and the edge at the horizon, nowhere else


def test_angles_are_coloured_without_a_seam_and_without_facets() -> None:
    figure = lobe(SEEN, 0, colour=ANGLE, stokes=LIGHT)
    mesh = body(figure)
    assert mesh.intensity is None
    angle = np.asarray(mesh.customdata, float)[:, 3]
    levels = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in mesh.vertexcolor], float)
    across = np.ptp(angle[corners(mesh)], axis=1) > 170.0
    assert across.any()
    spread = np.ptp(levels[corners(mesh)[across]], axis=1).max(axis=1)  # but around points without polarization,
    assert np.quantile(spread, 0.9) < 0.25 * 255  # near to each other where the numbers are not
    (bar,) = [trace for trace in figure.data if trace.type == "scatter3d" and trace.mode == "markers"]
    assert (bar.marker.cmin, bar.marker.cmax, bar.marker.colorscale[0][1]) == (0.0, 180.0, bar.marker.colorscale[-1][1])


def test_quantities_of_each_kind_can_be_drawn_and_are_small_and_so_can_a_dark_scene() -> None:
    dark = vrte.brdf(DARK, 0.6, MU_O, [0, 90, 180], nodes=4, threads=1)
    results.field_polar(vrte.radiance(DARK, 0.6, phi=0.0, nodes=4, threads=1))
    for name in ("f00", "f32", *QUANTITIES[-4:]):
        assert len(lobe(SEEN, 0, name, name, LIGHT).to_json()) < 1_300_000
        assert len(results.cuts(SEEN, 0, name, LIGHT).to_json()) < 20_000
        assert not np.asarray(body(lobe(dark, 0, name)).z).any()
        results.cuts(dark, 0, name)
    for name in FIELD_QUANTITIES:
        assert len(results.field_polar(DEEP, name).to_json()) < 40_000


def test_cuts_are_the_matrix_in_both_planes() -> None:
    curves = named(results.cuts(SEEN, 0, "f22"))
    theta = np.degrees(np.arccos(MU_O))
    for name, azimuth in (("in the plane of incidence", 0), ("across it", 90)):
        for side, phi in ((1.0, azimuth), (-1.0, azimuth + 180)):
            at_given = np.interp(side * theta, curves[name].theta, curves[name].r)
            assert_close(at_given, SEEN.mueller[0, :, phi == PHI, 2, 2][0], rtol=0.0, atol=2e-4)
    assert curves["incident light"].theta[0] == close_to(-np.degrees(np.arccos(0.6)), rtol=1e-6, atol=0.0)
    for curve in results.cuts(SEEN, 0, ANGLE, LIGHT).data:  # parted where angles turn over
        if curve.mode == "lines":
            assert not (np.abs(np.diff(np.asarray(curve.r, float))) > 90.0).any()


def test_polar_diagrams_of_the_field() -> None:
    for name in "IQ":
        curves = named(results.field_polar(DEEP, name))
        for depth, tau in enumerate(DEEP.tau):
            curve = curves[f"τ = {tau:g}"]
            for phi, side in ((0, 1.0), (2, -1.0)):
                for mu, value in zip(DEEP.mu, DEEP.stokes[depth, :, phi, "IQUV".index(name)], strict=True):
                    angle = side * np.degrees(np.arccos(mu))
                    near = np.abs((np.asarray(curve.theta, float) - angle + 180.0) % 360.0 - 180.0) < 1e-3
                    assert np.isclose(curve.r[near], value, rtol=1e-5, atol=1e-9).any()
        assert ("0" in curves) == (name == "Q")
    incidence = np.degrees(np.arccos(0.6))  # from the zenith clockwise: the beam goes down, along phi = 0
    for lit, theta in (("top", 180.0 - incidence), ("bottom", incidence)):
        figure = results.field_polar(replace(DEEP, diagnostics={"illuminate": lit}))
        assert named(figure)["the beam"].theta[1] == close_to(theta, rtol=1e-6, atol=0.0)


def test_depths_over_their_largest_and_of_many_some() -> None:
    whole, shares = results.field_polar(DEEP), results.field_polar(DEEP, over_largest=True)
    for trace, fraction in zip(whole.data[:-1], shares.data[:-1], strict=True):
        drawn = np.asarray(trace.r, float)
        assert_close(np.asarray(fraction.r, float), drawn / np.nanmax(drawn), rtol=1e-4, atol=0.0)
    assert "each depth over its largest" in shares.layout.title.text
    many = vrte.radiance(SCENE, 0.6, mu=[-0.5, 0.5], phi=0.0, tau=np.linspace(0, 1, 40), nodes=4, threads=1)
    figure = results.field_polar(many)
    assert ("12 of 40 depths" in figure.layout.title.text, len(figure.data)) == (True, 13)


def test_reflectances_over_both_bases_and_their_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    wavelengths = np.linspace(0.43, 0.7, 7)
    red = np.repeat(np.where(wavelengths > 0.6, 0.9, 0.05)[:, None], 2, axis=1)
    colours, why_none = compute_colours(wavelengths, {"red": red, "white": np.ones((7, 2)), "black": np.zeros((7, 2))})
    assert (colours["white"], colours["black"], why_none) == (("#ffffff",) * 2, ("#000000",) * 2, "")
    assert int(colours["red"][0][1:3], 16) > 150 > 90 > int(colours["red"][0][3:5], 16)
    found = Reflectances(np.array([0.5, 1.0]), {"over black": red, "over white (albedo 1)": np.ones((7, 2))}, colours)
    curves = named(results.reflectance(found, wavelengths.tolist(), 1))
    assert_close(curves["over black"].x, wavelengths, rtol=1e-6, atol=0.0)
    assert_close(curves["over black"].y, red[:, 1], rtol=1e-6, atol=0.0)
    one = named(results.reflectance(Reflectances(found.mu_i, {"over black": red[:1]}), (0.64,), 0))
    assert_close(one["over black"].x, [0.0, 60.0], rtol=0.0, atol=1e-5)
    assert "at least 5 wavelengths" in compute_colours(np.array([0.5, 0.6]), {})[1]
    monkeypatch.setitem(sys.modules, "colour", None)
    assert "extra 'render'" in compute_colours(wavelengths, {})[1]


def test_phase_matrices_are_drawn_as_they_are() -> None:
    drawn = results.coefficients(vrte.rayleigh()).data
    for curve, degrees in zip(drawn, ([1.0, 0.0, 0.5], [0.0, 0.0, 3.0]), strict=False):
        assert_close(curve.y, degrees, rtol=1e-7, atol=0.0)
    assert [curve.name for curve in drawn] == ["a1", "a2", "a3 = 0", "a4", "b1", "b2 = 0"]
    many = results.coefficients(vrte.henyey_greenstein(0.99, 4000))
    assert "the first 2000 of 4000 degrees" in many.layout.title.text
    curves = named(results.scattering_matrix(vrte.rayleigh()))
    cosine = np.cos(np.radians(np.asarray(curves["F11"].x, float)))
    for name, expected in (
        ("F11", 0.75 * (1 + cosine**2)),
        ("−F12/F11", (1 - cosine**2) / (1 + cosine**2)),
        ("F33/F11", 2 * cosine / (1 + cosine**2)),
    ):
        assert_close(curves[name].y, expected, rtol=1e-6, atol=1e-6 * (name != "F11"))


def test_bad_input_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    differences = vrte.Brdf(np.full_like(SEEN.mueller, np.nan), SEEN.reflectance, SEEN.mu_i, SEEN.mu_o, SEEN.phi, {})
    fields = [vrte.radiance(SCENE, 0.6, mu=mu, phi=phi, nodes=4) for mu, phi in ((None, 0.0), ([0.5], 90.0), ([], 0.0))]
    for words, draw, *arguments in (
        *(("place must be a whole number from 0 to 1", lobe, SEEN, wrong) for wrong in (2, -1, 0.5)),
        ("a quantity must be one of", lobe, SEEN, 0, "<b>"),
        ("a quantity must be one of I", results.field_polar, fields[0], "f00"),
        ("at least 2 different mu_o", results.cuts, vrte.brdf(SCENE, 0.6, 0.5, PHI, nodes=4), 0),
        ("finite Mueller matrices", lobe, differences, 0),
        *(("at phi_deg 0 or 180", results.field_polar, field) for field in fields[1:]),
    ):
        with pytest.raises(vrte.SceneError, match=words):
            draw(*arguments)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(vrte.MissingExtraError, match="extra 'app'"):
        lobe(SEEN, 0)


# ---- files


def test_the_suffix_says_what_a_picture_is_and_the_bytes_are_the_same_again(tmp_path: Path) -> None:
    """Also of a dark scene, whose lobe is a point."""
    field, brdf = vrte.radiance(DARK, 0.6, nodes=4), vrte.brdf(DARK, 0.6, MU_O, [0, 90, 180], nodes=4)
    for result, suffix, start in ((brdf, ".PNG", b"\x89PNG"), (field, ".pdf", b"%PDF")):
        twice = [tmp_path / f"{name}{suffix}" for name in "ab"]
        for path in twice:
            results.save_plot(result, path)
        first, second = (path.read_bytes() for path in twice)
        assert first == second
        assert first.startswith(start)
    before = sorted(tmp_path.iterdir())
    for name in ("plot.jpg", "plot", "plot.svgz"):
        with pytest.raises(vrte.SceneError, match=r"must end in \.png or \.svg or \.pdf"):
            results.save_plot(field, tmp_path / name)
    assert sorted(tmp_path.iterdir()) == before


# ---- notebooks


def decode_picture(text: str) -> np.ndarray:
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(encoded)), format="png")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("brdf", (f"|{THINGS['brdf'].reflectance[0]:.6g}|", "|10 from 0.1 to 1|")),
        ("field", ("μ0 = 0.6; I, Q, U, V = 1, 0, 0, 0", "|{:.6g}, {:.6g}|".format(*FIELD.flux_up))),
        ("phase matrix", ("|0, 0, 1.2247|",)),
        ("plan", ("right-hand sides",)),
        ("spectrum", ("|0.5, 0.6|",)),
    ],
)
def test_a_picture_and_a_table_soon(name: str, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """And without the extra a table alone, and one sentence where a picture is asked for."""
    thing = THINGS[name]
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)  # loaded by other tests
    spent = []
    for _ in range(2):  # of two, the machine disturbs one
        begin = time.process_time()
        text = thing._repr_html_()
        spent.append(time.process_time() - begin)
        if spent[-1] < 0.5:
            break
    assert min(spent) < 0.5
    assert np.ptp(decode_picture(text)[..., :3]) > 0.5  # something is drawn
    assert ("<pre>" if name == "plan" else "<table>") in text
    assert len(text) < 150_000
    assert all(one in cells(thing) for one in words)
    assert pickle.loads(pickle.dumps(thing.plot()))._repr_png_().startswith(b"\x89PNG")
    assert "matplotlib.pyplot" not in sys.modules
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    text = thing._repr_html_()
    assert ("<img" in text, "</table>" in text or "</pre>" in text) == (False, True)
    with pytest.raises(vrte.MissingExtraError, match=r"a picture needs the extra 'plot': pip install 'vrte\[plot\]'"):
        thing.plot()


def test_names_are_escaped() -> None:
    words = "<script>alert('x')</script>"
    hostile = {"method": words, "notes": [words], "base": 10_000 * "&", "algorithm": "two\nlines"}
    for name in ("brdf", "field"):
        text = replace(THINGS[name], diagnostics=hostile)._repr_html_()
        assert ("<script" in text, text.count("&lt;script&gt;"), len(text) < 150_000) == (False, 2, True)
    assert "<script" not in vrte.Particles(vrte.rayleigh(), *[1.0] * 5, description=words)._repr_html_()


def test_it_never_raises() -> None:
    class Nasty:
        def __str__(self) -> str:
            raise RuntimeError("no")

    few = vrte.brdf(SCENE, 0.5, 0.5, nodes=4)  # no picture of one direction
    fluxes = vrte.radiance(SCENE, 0.5, mu=[], nodes=4)
    dark = replace(PLAIN, mueller=np.full_like(PLAIN.mueller, np.nan))
    finer = vrte.Brdf(np.ones((1, 500, 721, 4, 4)), [0.5], [0.5], np.linspace(0.01, 1.0, 500), np.arange(721) / 2.0, {})
    many = vrte.henyey_greenstein(0.5, 6000)  # both would take too long for a glance
    for thing in (few, fluxes, dark, finer, many):
        assert "</table>" in thing._repr_html_()
        assert "<img" not in thing._repr_html_()
    assert "|6000, scalar" in cells(many)
    assert "<pre>&lt;vrte.results.brdf.Brdf object" in replace(PLAIN, diagnostics={"method": Nasty()})._repr_html_()
    for thing, words in ((fluxes, "holds fluxes alone"), (few, "at least 2 different mu_o")):
        with pytest.raises(vrte.SceneError, match=words):
            thing.plot()


def test_parts_of_a_scene_describe_themselves_in_three_lines_and_in_a_table() -> None:
    particles = vrte.spheres((0.19, 3.5), radius_um=0.6, wavelength_um=0.64)
    clear, white = vrte.Layer(vrte.isotropic(), 0.5, 1.0), vrte.Layer(vrte.rayleigh(), 1.0, 2.0)
    first = vrte.Layer.of(particles, 3.0)
    three = vrte.Scene([first, clear, white], vrte.Lambertian(0.2))
    semi_infinite = vrte.Scene(vrte.Layer(vrte.rayleigh(), 1.0, np.inf))
    for part, pattern in (
        (particles, r"Particles: spheres, Monodisperse\(radius_um=0.6\), at 0.64 um, index 0.19 \+ 3.5i \(given\)\n"
                    r".*albedo 0\.\d+, g 0\.\d+, \d+ terms, polarizing\n  extinction \d"),
        (particles.phase_matrix, r"PhaseMatrix\(g 0\.\d+, \d+ terms, polarizing\)$"),
        (first, r"Layer\(optical thickness 3, albedo 0\."),
        (three, r"Scene: 3 layers, optical thickness 6, base Lambertian\(albedo=0.2\)\n  top: optical thickness 3, .*\n"
                r"  bottom: optical thickness 2, albedo 1, g 0, 3 terms, polarizing \(1 more above\)$"),
        (semi_infinite, r"Scene: 1 layer, optical thickness inf, base black, which no light reaches\n"),
    ):  # fmt: skip
        assert re.match(pattern, repr(part))
        assert repr(part).count("\n") <= 2
    assert "|spheres, Monodisperse(radius_um=0.6), at 0.64 um" in cells(particles)
    assert all(decode_picture(part._repr_html_()).size for part in (particles, first))
    assert "|layer 3||optical thickness 2, albedo 1, g 0, 3 terms, polarizing|" in cells(three)
    assert "|base||Lambertian(albedo=0.2)|" in cells(three)
    assert "|and||5 more layers|" in cells(vrte.Scene(25 * [clear]))
