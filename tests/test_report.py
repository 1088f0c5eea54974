"""Pictures: what they are drawn from is right, and they say what they show."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.pictures import lobes, results
from vrte.pictures.notebook import draw_brdf
from vrte.results.over_hemisphere import check_directions, stokes_over_hemisphere
from vrte.results.quantities import of_stokes

from .helpers import assert_close, close_to

MU_O = np.linspace(0.05, 1.0, 20)


@pytest.fixture(scope="module")
def scene() -> vrte.Scene:
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])


@pytest.fixture(scope="module")
def brdf(scene: vrte.Scene) -> vrte.Brdf:
    return vrte.brdf(scene, [0.6, 1.0], MU_O, np.arange(0, 361, 15), nodes=8, threads=1)


def degree(mueller: np.ndarray) -> np.ndarray:
    """Degree of linear polarization for unpolarized light."""
    return np.hypot(mueller[..., 1, 0], mueller[..., 2, 0]) / mueller[..., 0, 0]


@pytest.mark.parametrize("place", [0, 1])
def test_a_lobe_goes_through_directions_that_were_not_given(scene: vrte.Scene, brdf: vrte.Brdf, place: int) -> None:
    lobe = lobes.compute_lobe(brdf, place)
    theta, phi = np.arange(0, lobe.theta.size, 14), np.arange(0, lobe.phi.size, 42)
    cosines = np.cos(np.radians(lobe.theta[theta]))
    exact = vrte.brdf(scene, brdf.mu_i[place], cosines, lobe.phi[phi], nodes=8, threads=1).mueller[0]
    assert_close(lobe.radius[np.ix_(theta, phi)], exact[..., 0, 0], rtol=0.0, atol=2e-4 * lobe.radius.max())
    assert_close(lobe.polarized[np.ix_(theta, phi)], degree(exact), rtol=0.0, atol=5e-3)


def test_bodies_and_cuts_end_where_the_directions_end(scene: vrte.Scene) -> None:
    few = vrte.brdf(scene, 0.6, np.linspace(0.5, 1.0, 8), np.arange(0, 361, 15), nodes=8, threads=1)
    assert lobes.compute_lobe(few, 0).theta[-1] == close_to(60.0, rtol=1e-6, atol=0.0)
    assert np.isnan(stokes_over_hemisphere(few, 0, np.array([59.9, 60.0, 60.1, 90.0]), np.array([7.0]))).all(
        axis=(1, 2)
    ).tolist() == [False, False, True, True]
    cuts = few.plot().axes[2]  # behind the lobe and its colour bar
    for line in cuts.get_lines()[:2]:
        assert np.degrees(np.abs(line.get_xdata())).max() == close_to(60.0, rtol=1e-6, atol=0.0)
    left, right = lobes_of_notebook(few)
    assert max(np.abs(line.get_xdata()).max() for panel in (left, right) for line in panel.get_lines()) < 60.001


def lobes_of_notebook(brdf: vrte.Brdf) -> list[Any]:
    figure = draw_brdf(brdf)
    assert figure is not None
    return list(figure.axes)


def test_the_mesh_of_a_lobe_is_fine_enough_for_zeros_of_the_polarization() -> None:
    """Degrees have cusps there, which a coarse mesh shows as a mottle: 0.1 of the largest between rings 2 degrees
    apart. Colours run evenly between neighbours here, and so are right half way."""
    gold = vrte.spheres((0.19, 3.5), radius_um=0.6, wavelength_um=0.64)
    brdf = vrte.brdf(
        vrte.Scene([vrte.Layer.of(gold, 5.0)]), 0.6, np.linspace(0.05, 1.0, 40), np.arange(0, 181, 4), nodes=24
    )
    lobe = lobes.compute_lobe(brdf, 0)
    half_way = 0.5 * (lobe.theta[1:] + lobe.theta[:-1])
    exact = of_stokes(stokes_over_hemisphere(brdf, 0, half_way, lobe.phi), "degree of linear polarization")
    difference = np.abs(0.5 * (lobe.polarized[1:] + lobe.polarized[:-1]) - exact).max()
    assert difference < 0.05 * lobe.polarized.max()


@pytest.mark.parametrize("order", ["half a turn", "unsorted", "negative"])
def test_mirror_symmetry_gives_the_azimuths_left_out(brdf: vrte.Brdf, scene: vrte.Scene, order: str) -> None:
    half = np.arange(0, 181, 15)
    phi = {"half a turn": half, "unsorted": np.roll(half, 5), "negative": -half}[order]
    partial = vrte.brdf(scene, 0.6, MU_O[::-1], phi, nodes=8, threads=1)
    drawn, expected = lobes.compute_lobe(partial, 0), lobes.compute_lobe(brdf, 0)
    assert_close(drawn.radius, expected.radius, rtol=0.0, atol=1e-9)
    assert_close(drawn.polarized, expected.polarized, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("mu_o", "phi"), [([0.5], [0, 90, 180]), ([0.5, 0.5], [0, 90, 180]), ([0.5, 1], [0, 180, 360])]
)
def test_too_few_directions(mu_o: list[float], phi: list[float]) -> None:
    with pytest.raises(vrte.SceneError, match="at least 2 different mu_o and 3 different phi_deg"):
        check_directions(mu_o, phi)


def test_pictures_say_what_they_show(brdf: vrte.Brdf, scene: vrte.Scene) -> None:
    figure = results.draw_brdf(brdf)
    assert "Subsurface BRDF" in figure.get_suptitle()
    assert "0.6" in figure.axes[0].get_title()
    assert any("degree of linear polarization" in axes.get_ylabel() for axes in figure.axes)
    field = vrte.radiance(scene, 0.6, phi=[0, 90], tau=[0, 0.5], nodes=8, threads=1)
    figure = results.draw_field(field)
    assert "Subsurface radiance" in figure.get_suptitle()
    assert [axes.get_title() for axes in figure.axes[:2]] == ["φ = 0°", "φ = 90°"]


def test_a_dark_scene_can_be_drawn(tmp_path: Path) -> None:
    dark = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=1.0)])
    results.save_plot(vrte.brdf(dark, 0.6, MU_O, [0, 90, 180], nodes=4, threads=1), tmp_path / "brdf.png")
    results.save_plot(vrte.radiance(dark, 0.6, nodes=4, threads=1), tmp_path / "field.png")
    assert {path.name for path in tmp_path.iterdir()} == {"brdf.png", "field.png"}


def test_a_missing_extra_is_one_sentence(brdf: vrte.Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(vrte.MissingExtraError, match=r"a picture needs the extra 'plot': pip install 'vrte\[plot\]'"):
        results.save_plot(brdf, tmp_path / "brdf.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".png", ".pdf", pytest.param(".svg", marks=pytest.mark.slow)])
def test_the_suffix_says_what_a_picture_is_and_the_bytes_are_the_same_again(
    brdf: vrte.Brdf, scene: vrte.Scene, tmp_path: Path, suffix: str
) -> None:
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    field = vrte.radiance(scene, 0.6, mu=[-0.5, 0.5], nodes=4, threads=1)
    for result in (brdf, field) if suffix == ".svg" else (field,):
        twice = [tmp_path / f"{name}{suffix}" for name in "ab"]
        for path in twice:
            results.save_plot(result, path)
        first, second = (path.read_bytes() for path in twice)
        assert first == second
        assert first.startswith(starts[suffix])


@pytest.mark.parametrize("name", ["plot.jpg", "plot", "plot.svgz"])
def test_another_suffix_is_one_sentence(brdf: vrte.Brdf, tmp_path: Path, name: str) -> None:
    with pytest.raises(vrte.SceneError, match=r"must end in \.png or \.svg or \.pdf"):
        results.save_plot(brdf, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_field_is_drawn_smoothly_through_marked_directions(scene: vrte.Scene) -> None:
    """Degrees of polarization are divided after the line is drawn through I, Q, U and V."""
    field = vrte.radiance(scene, 0.6, phi=[0, 90], tau=[0, 0.5], nodes=8, threads=1)
    panel = field.plot().axes[0]
    lines = {line.get_linestyle(): line for line in panel.get_lines()[4:6]}
    down = np.flatnonzero(field.mu < 0.0)[np.argsort(field.mu[field.mu < 0.0])]
    np.testing.assert_array_equal(lines["None"].get_xdata(), field.mu[down])
    np.testing.assert_array_equal(lines["None"].get_ydata(), field.stokes[1, down, 0, 0])
    assert lines["-"].get_xdata().size == 7 * 8 + 1
    mu = lines["-"].get_xdata()
    exact = vrte.radiance(scene, 0.6, mu=mu, phi=[0], tau=[0.5], nodes=8, threads=1).stokes[0, :, 0, 0]
    assert_close(lines["-"].get_ydata(), exact, rtol=0.0, atol=0.03 * exact.max())


def test_a_field_of_several_beams_has_a_column_for_each(scene: vrte.Scene) -> None:
    field = vrte.radiance(scene, [0.3, 0.6], mu=[-0.5, 0.5, 1.0], phi=[0, 90], nodes=4, threads=1)
    figure = field.plot()
    assert [axes.get_title() for axes in figure.axes[:2]] == ["μ₀ = 0.3", "μ₀ = 0.6"]
    assert "φ = 0°" in figure.get_suptitle()
