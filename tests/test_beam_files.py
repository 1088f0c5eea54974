"""Beams of smooth surfaces, light of rough ones and media in results: kept by every file, added up where asked for."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import assert_same
from vrte.formats.contents import Result, convert_views, to_xarray
from vrte.formats.result_file import FORMATS
from vrte.optics.fresnel import reflect_smooth
from vrte.results.views import Views

from .helpers import assert_close, close_to

MU = np.array([0.3, 0.6, 1.0])
MADE: dict[str, Any] = {"mu_i": MU, "mu_o": MU, "phi": [0.0, 90.0, 180.0, 270.0], "diagnostics": {"nodes": 4}}
RANDOM = np.random.default_rng(3)


def make_brdf(**more: Any) -> vrte.Brdf:
    """Diffuse light of any kind, mirrored light of glass."""
    diffuse = RANDOM.normal(size=(3, 3, 4, 4, 4))
    arrays: dict[str, Any] = {
        "mueller": diffuse,
        "reflectance": [0.1 + 0.2, 0.5, 0.6],
        "direct_transmittance": [0.0] * 3,
    }
    return vrte.Brdf(**MADE, **arrays, **{"specular": reflect_smooth(1.5, MU)} | more)


GLOSSY = make_brdf()
PLATE = make_brdf(transmission=RANDOM.normal(size=(3, 3, 4, 4, 4)), specular_transmission=RANDOM.normal(size=(3, 4, 4)))
ROUGH = make_brdf(specular=None, surface=RANDOM.normal(size=(3, 3, 4, 4, 4)))
BOTH = replace(PLATE, surface=ROUGH.surface)
FIELD = vrte.Field(
    stokes=RANDOM.normal(size=(2, 3, 1, 4)),
    **{name: RANDOM.normal(size=2) for name in ("flux_up", "flux_down", "direct", "direct_up")},
    tau=[0.0, 1.0],
    mu=[-0.5, 0.5, 1.0],
    phi=[0.0],
    mu0=0.6,
    incident_stokes=[1.0, 0.0, 0.0, 0.0],
    diagnostics={},
    index=[1.0, 1.0 / 3.0],
)
FIELDS = replace(
    FIELD,
    mu0=[0.5, 1.0],
    stokes=RANDOM.normal(size=(2, 2, 3, 1, 4)),
    **{name: RANDOM.normal(size=(2, 2)) for name in ("flux_up", "flux_down", "direct", "direct_up")},
)
RESULTS = {
    "glossy": GLOSSY,
    "plate": PLATE,
    "rough": ROUGH,
    "both": BOTH,
    "field": FIELD,
    "fields": FIELDS,
    "spectrum": vrte.Spectrum([0.5, 0.6], (BOTH, replace(BOTH, specular=0.5 * BOTH.specular[:]))),
}


SLOWER = [pytest.param(name, marks=pytest.mark.slow) for name in RESULTS if name not in ("both", "fields", "spectrum")]


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("name", ["both", "fields", "spectrum", *SLOWER])
def test_a_file_brings_back_every_bit(name: str, suffix: str, tmp_path: Path) -> None:
    RESULTS[name].save(tmp_path / f"result{suffix}")
    assert_same(RESULTS[name], vrte.load(tmp_path / f"result{suffix}"))


@pytest.mark.parametrize("suffix", FORMATS)
def test_files_have_no_more_than_there_is(suffix: str, tmp_path: Path) -> None:
    """A result without surfaces has none of their names in its file, as files had before there were surfaces."""
    plain = replace(GLOSSY, specular=None)
    plain.save(tmp_path / f"result{suffix}")
    assert_same(plain, vrte.load(tmp_path / f"result{suffix}"))
    assert set(to_xarray(plain).data_vars) == {"mueller", "reflectance", "direct_transmittance"}
    bare = replace(FIELD, index=None, direct_up=None)
    assert not {"index", "direct_up"} & set(to_xarray(bare).variables)


@pytest.mark.parametrize("result", RESULTS.values(), ids=list(RESULTS))
def test_every_array_says_what_it_is(result: Result) -> None:
    dataset = to_xarray(result)
    for name, array in dataset.variables.items():
        assert array.attrs["long_name"], name
        assert array.dtype.kind != "f" or array.attrs["units"], name
    assert "not in mueller" in dataset.attrs["comment"]
    assert "in the medium of the light" in dataset.attrs["comment"]


def test_shares_for_other_programs() -> None:
    found = to_xarray(RESULTS["spectrum"])
    assert found.specular.dims == ("wavelength_um", "mu_i", "stokes_out", "stokes_in")
    assert found.surface.dims == found.mueller.dims
    np.testing.assert_array_equal(found.specular_reflectance[0], reflect_smooth(1.5, MU)[:, 0, 0])
    np.testing.assert_array_equal(found.total_reflectance, found.reflectance + found.specular_reflectance)
    assert to_xarray(FIELDS).direct_up.dims == ("mu0", "tau")
    assert to_xarray(FIELDS)["index"].dims == ("tau",)
    assert to_xarray(FIELDS).attrs["kind"] == "fields"


def test_one_beam_of_several_keeps_its_medium() -> None:
    np.testing.assert_array_equal(FIELDS.beam(1).direct_up, FIELDS.direct_up[1])  # type: ignore[index]
    np.testing.assert_array_equal(FIELDS.beam(1).index, FIELDS.index)  # type: ignore[arg-type]


def test_views_say_their_medium() -> None:
    rows = np.ones((2, 4)), *np.full((3, 2), 0.5)
    inside = Views(*rows, 1.0, np.ones(4), {}, 1.5)
    assert convert_views(inside)["index"].item() == 1.5
    assert "index" not in convert_views(replace(inside, index=None)).variables


def test_beams_that_are_gone_at_one_wavelength_are_zero_there() -> None:
    gone = replace(GLOSSY, specular=None)
    found = vrte.Spectrum([0.5, 0.6], (GLOSSY, gone))
    assert not found.specular[1].any()  # type: ignore[index]
    np.testing.assert_array_equal(found.total_reflectance, [GLOSSY.total_reflectance, gone.reflectance])
    assert vrte.Spectrum([0.5], (ROUGH,)).specular_reflectance is None
    np.testing.assert_array_equal(vrte.Spectrum([0.5], (ROUGH,)).total_reflectance, [ROUGH.reflectance])


class TestLightFromEverywhere:
    """A glossy thing under light that comes from all around."""

    mu, weights = vrte.hemisphere(8)

    def glass(self, **more: Any) -> vrte.Brdf:
        """Mirrors as glass does, and absorbs the rest."""
        arrays: dict[str, Any] = {"mueller": np.zeros((8, 8, 4, 4, 4)), "reflectance": np.zeros(8)}
        made: dict[str, Any] = MADE | {"mu_i": self.mu, "mu_o": self.mu}
        return vrte.Brdf(**made, **arrays, specular=reflect_smooth(1.5, self.mu), **more)

    def test_mirrored_light_counts_in_the_flux(self) -> None:
        # diffuse light falls on glass of index 1.5: 0.0917780 comes back (Walsh's closed form)
        assert self.glass().bihemispherical_reflectance(self.weights) == close_to(0.0917780, rtol=0.0, atol=2e-6)
        assert self.glass().diffuse_reflectance(self.weights).any() == 0.0

    def test_mirrored_light_is_added_on_request(self) -> None:
        sky = RANDOM.uniform(0.5, 1.0, (8, 4, 4)) * [1.0, 0.2, -0.2, 0.2]
        assert not self.glass().under(sky, self.weights).any()
        found = self.glass().under(sky, self.weights, mirrored=True)
        expected = reflect_smooth(1.5, self.mu)[:, None] @ sky[..., None]
        assert_close(found, expected[..., 0], rtol=1e-14, atol=0.0)

    def test_what_cannot_be_added_is_refused(self) -> None:
        other = replace(self.glass(), mu_o=np.linspace(0.1, 0.9, 8))
        with pytest.raises(vrte.SceneError, match="each mu_o must be one of mu_i"):
            other.under([1.0, 0.0, 0.0, 0.0], self.weights, mirrored=True)
