"""The viewer's figures: what they are drawn from is right, they say what they show, and they are small."""

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.solving.messages import Reflectances
from vrte.app.solving.solve import compute_colours
from vrte.pictures import results as figures
from vrte.pictures.lobes import STEP, lobe
from vrte.results.quantities import FIELD_QUANTITIES, QUANTITIES

from .helpers import assert_close, close_to

MU_O, PHI = np.linspace(0.05, 1.0, 20), np.arange(0, 361, 15)
LIGHT = (1.0, 0.2, -0.5, 0.6)
ANGLE = "angle of linear polarization"


SCENE, DARK = (vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, thickness=1.0)]) for albedo in (0.95, 0.0))


@pytest.fixture(scope="module")
def brdf() -> vrte.Brdf:
    return vrte.brdf(SCENE, [0.6, 1.0], MU_O, PHI, nodes=8, threads=1)


@pytest.fixture(scope="module")
def field() -> vrte.Field:
    mu = np.concatenate([np.linspace(-1.0, -0.05, 20), np.linspace(0.05, 1.0, 20)])
    return vrte.radiance(SCENE, 0.6, mu=mu, phi=[0, 90, 180], tau=[0.0, 0.5, 1.0], nodes=8, threads=1)


def body(figure: Any) -> Any:
    """The lobe: the mesh that tells something."""
    (mesh,) = [trace for trace in figure.data if trace.type == "mesh3d" and trace.customdata is not None]
    return mesh


def corners(mesh: Any) -> np.ndarray:
    return np.stack([mesh.i, mesh.j, mesh.k], axis=-1)


def named(figure: Any) -> dict[str, Any]:
    return {trace.name: trace for trace in figure.data}


def test_a_lobe_is_where_the_solver_says(brdf: vrte.Brdf) -> None:
    figure = lobe(brdf, 0, "f00", "f10")
    mesh = body(figure)
    index = np.stack([mesh.x, mesh.y, mesh.z], axis=-1).astype(float)
    radius, largest = np.linalg.norm(index, axis=-1), float(mesh.customdata[:, 2].max())
    for some in (300, 1234, 3000, 8000):
        mu, phi, height, colour = np.asarray(mesh.customdata, float)[some]
        (x, y, z), size = index[some], radius[some]
        exact = vrte.brdf(SCENE, 0.6, mu, phi, nodes=8, threads=1).mueller[0, 0, 0]
        assert z / size == close_to(mu, rtol=0.0, atol=1e-6)
        assert np.degrees(np.arctan2(y, x)) % 360.0 == close_to(phi, rtol=0.0, atol=1e-3)
        assert size * largest == close_to(exact[0, 0], rtol=2e-3, atol=0.0)
        assert (height, colour) == close_to((exact[0, 0], exact[1, 0]), rtol=0.0, atol=2e-3 * largest)
    assert radius.max() == close_to(1.0, rtol=0.0, atol=1e-6)
    assert all(words in figure.layout.title.text for words in (f"{largest:.3g} sr", "Subsurface"))


def test_the_sign_is_in_the_colour_and_the_mesh_is_closed_around_the_normal(brdf: vrte.Brdf) -> None:
    figure = lobe(brdf, 0, "f10", "f10")
    mesh = body(figure)
    assert "|f10|" in figure.layout.title.text
    assert "absolute value" in mesh.hovertemplate
    assert (mesh.intensity.min() < 0.0 < mesh.intensity.max(), mesh.cmin) == (True, -mesh.cmax)
    np.testing.assert_array_equal(mesh.intensity, mesh.customdata[:, 2])
    edges = np.sort(np.concatenate([corners(mesh)[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]))
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert set(count) == {1, 2}
    assert (count == 1).sum() == 2 * 360 / STEP  # the pole and the edge at the horizon, nowhere else


def test_angles_are_coloured_without_a_seam_and_without_facets(brdf: vrte.Brdf) -> None:
    figure = lobe(brdf, 0, colour=ANGLE, stokes=LIGHT)
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


def test_bodies_and_cuts_end_where_the_data_end() -> None:
    short = vrte.brdf(SCENE, 0.6, np.linspace(0.5, 1.0, 8), PHI, nodes=8, threads=1)
    assert np.asarray(body(lobe(short, 0)).customdata)[:, 0].min() == close_to(0.5, rtol=0.0, atol=1e-6)
    for curve in named(figures.cuts(short, 0)).values():
        if curve.mode == "lines" and curve.name != "0":
            assert np.abs(np.asarray(curve.theta, float)).max() == close_to(60.0, rtol=0.0, atol=1e-4)


def test_quantities_of_each_kind_can_be_drawn_and_are_small_and_so_can_a_dark_scene(
    brdf: vrte.Brdf, field: vrte.Field
) -> None:
    dark = vrte.brdf(DARK, 0.6, MU_O, [0, 90, 180], nodes=4, threads=1)
    figures.field_polar(vrte.radiance(DARK, 0.6, phi=0.0, nodes=4, threads=1))
    for name in ("f00", "f32", *QUANTITIES[-4:]):
        assert len(lobe(brdf, 0, name, name, LIGHT).to_json()) < 1_300_000
        assert len(figures.cuts(brdf, 0, name, LIGHT).to_json()) < 20_000
        assert not np.asarray(body(lobe(dark, 0, name)).z).any()
        figures.cuts(dark, 0, name)
    for name in FIELD_QUANTITIES:
        assert len(figures.field_polar(field, name).to_json()) < 40_000


def test_cuts_are_the_matrix_in_both_planes(brdf: vrte.Brdf) -> None:
    curves = named(figures.cuts(brdf, 0, "f22"))
    theta = np.degrees(np.arccos(MU_O))
    for name, azimuth in (("in the plane of incidence", 0), ("across it", 90)):
        for side, phi in ((1.0, azimuth), (-1.0, azimuth + 180)):
            at_given = np.interp(side * theta, curves[name].theta, curves[name].r)
            assert_close(at_given, brdf.mueller[0, :, phi == PHI, 2, 2][0], rtol=0.0, atol=2e-4)
    assert curves["incident light"].theta[0] == close_to(-np.degrees(np.arccos(0.6)), rtol=1e-6, atol=0.0)
    for curve in figures.cuts(brdf, 0, ANGLE, LIGHT).data:  # parted where angles turn over
        if curve.mode == "lines":
            assert not (np.abs(np.diff(np.asarray(curve.r, float))) > 90.0).any()


def test_polar_diagrams_of_the_field(field: vrte.Field) -> None:
    for name in "IQ":
        curves = named(figures.field_polar(field, name))
        for depth, tau in enumerate(field.tau):
            curve = curves[f"τ = {tau:g}"]
            for phi, side in ((0, 1.0), (2, -1.0)):
                for mu, value in zip(field.mu, field.stokes[depth, :, phi, "IQUV".index(name)], strict=True):
                    angle = side * np.degrees(np.arccos(mu))
                    near = np.abs((np.asarray(curve.theta, float) - angle + 180.0) % 360.0 - 180.0) < 1e-3
                    assert np.isclose(curve.r[near], value, rtol=1e-5, atol=1e-9).any()
        assert ("0" in curves) == (name == "Q")
    incidence = np.degrees(np.arccos(0.6))  # from the zenith clockwise: the beam goes down, along phi = 0
    for lit, theta in (("top", 180.0 - incidence), ("bottom", incidence)):
        figure = figures.field_polar(replace(field, diagnostics={"illuminate": lit}))
        assert named(figure)["the beam"].theta[1] == close_to(theta, rtol=1e-6, atol=0.0)


def test_depths_over_their_largest_and_of_many_some(field: vrte.Field) -> None:
    whole, shares = figures.field_polar(field), figures.field_polar(field, over_largest=True)
    for trace, fraction in zip(whole.data[:-1], shares.data[:-1], strict=True):
        drawn = np.asarray(trace.r, float)
        assert_close(np.asarray(fraction.r, float), drawn / np.nanmax(drawn), rtol=1e-4, atol=0.0)
    assert "each depth over its largest" in shares.layout.title.text
    many = vrte.radiance(SCENE, 0.6, mu=[-0.5, 0.5], phi=0.0, tau=np.linspace(0, 1, 40), nodes=4, threads=1)
    figure = figures.field_polar(many)
    assert ("12 of 40 depths" in figure.layout.title.text, len(figure.data)) == (True, 13)


def test_reflectances_over_both_bases_and_their_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    wavelengths = np.linspace(0.43, 0.7, 7)
    red = np.repeat(np.where(wavelengths > 0.6, 0.9, 0.05)[:, None], 2, axis=1)
    colours, why_none = compute_colours(wavelengths, {"red": red, "white": np.ones((7, 2)), "black": np.zeros((7, 2))})
    assert (colours["white"], colours["black"], why_none) == (("#ffffff",) * 2, ("#000000",) * 2, "")
    assert int(colours["red"][0][1:3], 16) > 150 > 90 > int(colours["red"][0][3:5], 16)
    found = Reflectances(np.array([0.5, 1.0]), {"over black": red, "over white (albedo 1)": np.ones((7, 2))}, colours)
    curves = named(figures.reflectance(found, wavelengths.tolist(), 1))
    assert_close(curves["over black"].x, wavelengths, rtol=1e-6, atol=0.0)
    assert_close(curves["over black"].y, red[:, 1], rtol=1e-6, atol=0.0)
    one = named(figures.reflectance(Reflectances(found.mu_i, {"over black": red[:1]}), (0.64,), 0))
    assert_close(one["over black"].x, [0.0, 60.0], rtol=0.0, atol=1e-5)
    assert "at least 5 wavelengths" in compute_colours(np.array([0.5, 0.6]), {})[1]
    monkeypatch.setitem(sys.modules, "colour", None)
    assert "extra 'render'" in compute_colours(wavelengths, {})[1]


def test_phase_matrices_are_drawn_as_they_are() -> None:
    drawn = figures.coefficients(vrte.rayleigh()).data
    for curve, degrees in zip(drawn, ([1.0, 0.0, 0.5], [0.0, 0.0, 3.0]), strict=False):
        assert_close(curve.y, degrees, rtol=1e-7, atol=0.0)
    assert [curve.name for curve in drawn] == ["a1", "a2", "a3 = 0", "a4", "b1", "b2 = 0"]
    many = figures.coefficients(vrte.henyey_greenstein(0.99, 4000))
    assert "the first 2000 of 4000 degrees" in many.layout.title.text
    curves = named(figures.scattering_matrix(vrte.rayleigh()))
    cosine = np.cos(np.radians(np.asarray(curves["F11"].x, float)))
    for name, expected in (
        ("F11", 0.75 * (1 + cosine**2)),
        ("−F12/F11", (1 - cosine**2) / (1 + cosine**2)),
        ("F33/F11", 2 * cosine / (1 + cosine**2)),
    ):
        assert_close(curves[name].y, expected, rtol=1e-6, atol=1e-6 * (name != "F11"))


def test_bad_input_is_one_sentence(brdf: vrte.Brdf, monkeypatch: pytest.MonkeyPatch) -> None:
    differences = vrte.Brdf(np.full_like(brdf.mueller, np.nan), brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {})
    fields = [vrte.radiance(SCENE, 0.6, mu=mu, phi=phi, nodes=4) for mu, phi in ((None, 0.0), ([0.5], 90.0), ([], 0.0))]
    for words, draw, *arguments in (
        *(("place must be a whole number from 0 to 1", lobe, brdf, wrong) for wrong in (2, -1, 0.5)),
        ("a quantity must be one of", lobe, brdf, 0, "<b>"),
        ("a quantity must be one of I", figures.field_polar, fields[0], "f00"),
        ("at least 2 different mu_o", figures.cuts, vrte.brdf(SCENE, 0.6, 0.5, PHI, nodes=4), 0),
        ("finite Mueller matrices", lobe, differences, 0),
        *(("at phi_deg 0 or 180", figures.field_polar, field) for field in fields[1:]),
    ):
        with pytest.raises(vrte.SceneError, match=words):
            draw(*arguments)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(vrte.MissingExtraError, match="extra 'app'"):
        lobe(brdf, 0)
