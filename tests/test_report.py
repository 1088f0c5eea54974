"""Pictures: what they are drawn from is right, and they say what they show."""

import sys
from pathlib import Path

import numpy as np
import pytest

import vrte
from vrte.over_hemisphere import check_directions
from vrte.report import lobes

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
    radius, polarized = lobes.hemisphere(brdf, place)
    theta, phi = np.arange(0, 87, 7), np.arange(0, 241, 14)
    cosines = np.cos(np.radians(lobes.FINE_THETA[theta]))
    exact = vrte.brdf(scene, brdf.mu_i[place], cosines, lobes.FINE_PHI[phi], nodes=8, threads=1).mueller[0]
    np.testing.assert_allclose(radius[np.ix_(theta, phi)], exact[..., 0, 0], atol=2e-4 * radius.max())
    np.testing.assert_allclose(polarized[np.ix_(theta, phi)], degree(exact), atol=5e-3)


@pytest.mark.parametrize("order", ["half a turn", "unsorted", "negative"])
def test_mirror_symmetry_gives_the_azimuths_left_out(brdf: vrte.Brdf, scene: vrte.Scene, order: str) -> None:
    half = np.arange(0, 181, 15)
    phi = {"half a turn": half, "unsorted": np.roll(half, 5), "negative": -half}[order]
    partial = vrte.brdf(scene, 0.6, MU_O[::-1], phi, nodes=8, threads=1)
    for drawn, expected in zip(lobes.hemisphere(partial, 0), lobes.hemisphere(brdf, 0), strict=True):
        np.testing.assert_allclose(drawn, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("mu_o", "phi"), [([0.5], [0, 90, 180]), ([0.5, 0.5], [0, 90, 180]), ([0.5, 1], [0, 180, 360])]
)
def test_too_few_directions(mu_o: list[float], phi: list[float]) -> None:
    with pytest.raises(vrte.SceneError, match="at least 2 different mu_o and 3 different phi_deg"):
        check_directions(mu_o, phi)


def test_pictures_say_what_they_show(brdf: vrte.Brdf, scene: vrte.Scene) -> None:
    figure = lobes.brdf_figure(brdf)
    assert "Subsurface BRDF" in figure.get_suptitle()
    assert "0.6" in figure.axes[0].get_title()
    assert any("degree of linear polarization" in axes.get_ylabel() for axes in figure.axes)
    field = vrte.radiance(scene, 0.6, phi=[0, 90], tau=[0, 0.5], nodes=8, threads=1)
    figure = lobes.field_figure(field)
    assert "Subsurface radiance" in figure.get_suptitle()
    assert [axes.get_title() for axes in figure.axes[:2]] == [r"$\phi$ = 0°", r"$\phi$ = 90°"]


def test_a_dark_scene_can_be_drawn(tmp_path: Path) -> None:
    dark = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=1.0)])
    lobes.save_plot(vrte.brdf(dark, 0.6, MU_O, [0, 90, 180], nodes=4, threads=1), tmp_path / "brdf.png")
    lobes.save_plot(vrte.radiance(dark, 0.6, nodes=4, threads=1), tmp_path / "field.png")
    assert {path.name for path in tmp_path.iterdir()} == {"brdf.png", "field.png"}


def test_the_global_state_of_the_plotting_library_is_left_alone(brdf: vrte.Brdf) -> None:
    lobes.brdf_figure(brdf)
    assert "matplotlib.pyplot" not in sys.modules


def test_a_missing_extra_is_one_sentence(brdf: vrte.Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(vrte.MissingExtraError, match=r"a picture needs the extra 'plot': pip install 'vrte\[plot\]'"):
        lobes.save_plot(brdf, tmp_path / "brdf.png")
    assert not list(tmp_path.iterdir())
