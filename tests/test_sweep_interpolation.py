"""Between the scenes of a table, and how much memory a table takes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import printed_by
from vrte.basics.errors import SceneError
from vrte.sweep.interpolation import held_out

from .helpers import assert_close


def table_of(depths: int, albedos: int) -> Any:
    """Rayleigh layers of many depths and albedos, over a Lambertian base."""
    axes = {
        "depth": {"key": "layer[1].thickness", "start": 0.05, "stop": 5, "count": depths, "spacing": "log"},
        "albedo": {"key": "layer[1].albedo", "start": 0.5, "stop": 1.0, "count": albedos},
    }
    return vrte.sweep(given(axes))


def given(axes: dict[str, Any]) -> dict[str, Any]:
    return {
        "nodes": 6,
        "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}],
        "base": {"kind": "lambertian", "albedo": 0.3},
        "brdf": {"mu_i": [0.5, 1.0], "mu_o": [0.2, 0.6, 1.0], "phi_deg": [0, 60, 120, 180]},
        "axes": axes,
    }


@pytest.fixture(scope="module")
def table() -> Any:
    return table_of(9, 5)


def test_at_a_scene_of_the_table_it_is_that_scene(table: Any) -> None:
    found = vrte.interpolate(table, {"depth": float(table.depth[3]), "albedo": float(table.albedo[1])})
    assert found.mueller.dims == ("mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in")
    assert_close(found.mueller, table.mueller[3, 1], rtol=1e-13, atol=1e-17)
    assert_close(found.reflectance, table.reflectance[3, 1], rtol=1e-13, atol=0.0)
    assert found.depth.item() == table.depth[3].item()


@pytest.mark.slow
def test_between_it_is_close_and_closer_in_a_finer_table(table: Any) -> None:
    coarse, fine = held_out(table, 10), held_out(table_of(17, 9), 10)
    assert coarse.largest < 5e-3
    assert coarse.median < 1.5e-3
    assert fine.median < coarse.median / 6.0  # cubic: by 16 where all is smooth
    assert set(coarse.points) == {"depth", "albedo"}
    assert coarse.errors.shape == (10,)


def test_an_error_that_is_measured_is_the_error(table: Any) -> None:
    found = held_out(table, 3, seed=4)
    for place in range(3):
        depth, albedo = found.points["depth"][place], found.points["albedo"][place]
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, depth)], vrte.Lambertian(0.3))
        solved = vrte.brdf(scene, [0.5, 1.0], [0.2, 0.6, 1.0], [0, 60, 120, 180], nodes=6)
        guess = vrte.interpolate(table, {"depth": depth, "albedo": albedo}).mueller.values
        gap = np.abs(guess - solved.mueller).max() / np.abs(solved.mueller).max()
        assert_close(found.errors[place], gap, rtol=1e-6, atol=0.0)
        assert (guess[..., 0, 0] > 0.0).all()


def test_axes_left_out_stay_and_directions_count_too(table: Any) -> None:
    found = vrte.interpolate(table, {"depth": 0.3, "phi_deg": 90.0})
    assert dict(found.mueller.sizes) == {"albedo": 5, "mu_i": 2, "mu_o": 3, "stokes_out": 4, "stokes_in": 4}
    assert found.mueller.sel(stokes_out="I", stokes_in="I").shape == (5, 2, 3)
    both = vrte.interpolate(vrte.interpolate(table, {"depth": 0.3}), {"phi_deg": 90.0})
    assert_close(found.mueller, both.mueller, rtol=1e-10, atol=1e-16)


@pytest.mark.slow
def test_only_scenes_nearby_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import zarr

    axes = {"layer[1].thickness": np.linspace(0.1, 3.0, 30), "layer[1].albedo": np.linspace(0, 1, 5)}
    table = vrte.sweep(given(axes), tmp_path / "t.zarr", chunk=1)
    read = []
    get = zarr.storage.LocalStore.get

    async def counted(self: Any, key: str, *rest: Any, **more: Any) -> Any:
        read.append(key)
        return await get(self, key, *rest, **more)

    monkeypatch.setattr(zarr.storage.LocalStore, "get", counted)
    vrte.interpolate(table, {"layer[1].thickness": 1.23, "layer[1].albedo": 0.5})
    assert len([key for key in read if key.startswith("mueller/c/")]) == 4


@pytest.mark.parametrize(
    ("point", "words"),
    [
        ({"depth": 10.0}, "depth must lie between 0.05 and 5"),
        ({"radius": 1.0}, "'radius' is no axis of the table; there are depth, albedo, mu_i, mu_o, phi_deg"),
        ({"depth": "deep"}, "point: depth must be a number"),
        ({"depth": float("nan")}, "point: depth must be a number"),
        ([0.1], "point must be a dictionary"),
    ],
)
def test_bad_points_end_in_a_sentence(table: Any, point: Any, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        vrte.interpolate(table, point)
    assert words in str(caught.value)


def test_lists_and_failed_scenes_are_refused() -> None:
    together = {
        "depth": {"key": "layer[1].thickness", "values": [0.1, 1.0, 2.0], "along": "sample"},
        "albedo": {"key": "layer[1].albedo", "values": [0.3, 0.6, 1.0], "along": "sample"},
    }
    with pytest.raises(SceneError, match="'depth' is one of several along a list, not a grid"):
        vrte.interpolate(vrte.sweep(given(together)), {"depth": 0.5})
    bad = given({"wavelength_um": [0.01, 0.5, 0.6, 0.7, 0.75, 0.8]}) | {
        "particles": {"gold": {"index": "gold", "radius_um": 0.05}},
        "layer": [{"particles": "gold", "thickness": 1.0}],
    }
    with pytest.warns(UserWarning, match="1 of 6 scenes failed"):
        table = vrte.sweep(bad)
    with pytest.raises(SceneError, match=r"a scene near the point has no result: .*0\.01"):
        vrte.interpolate(table, {"wavelength_um": 0.55})
    assert (vrte.interpolate(table, {"wavelength_um": 0.72}).reflectance > 0.0).all()


def test_of_fields_there_are_fluxes_between_but_no_errors_held_out() -> None:
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    asked = {"nodes": 4, "layer": [layer], "field": {"mu0": 0.6, "mu": []}}
    fields = vrte.sweep({**asked, "axes": {"depth": {"key": "layer[1].thickness", "values": [0.2, 1.0, 3.0, 9.0]}}})
    alone = vrte.radiance(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 2.0)]), 0.6, mu=[], nodes=4)
    flux = vrte.interpolate(fields, {"depth": 2.0}).flux_up.values
    assert_close(flux.ravel(), np.ravel(alone.flux_up), rtol=0.02, atol=0.0)
    with pytest.raises(SceneError, match="held_out measures BRDFs"):
        held_out(fields)


def test_infinite_depths_are_no_neighbours() -> None:
    table = vrte.sweep(given({"depth": {"key": "layer[1].thickness", "values": [1, 2, 4, 8, np.inf]}}))
    assert np.isfinite(vrte.interpolate(table, {"depth": 7.0}).mueller.values).all()
    np.testing.assert_array_equal(
        vrte.interpolate(table, {"depth": np.inf}).reflectance, table.reflectance.sel(depth=np.inf)
    )
    with pytest.raises(SceneError, match="must lie between 1"):
        vrte.interpolate(table, {"depth": 9.0})


MEMORY = """
import resource, sys
import vrte
layer = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
cosines, around = {"start": 0.1, "stop": 1, "count": 50}, {"start": 0, "stop": 360, "count": 37}
scene = {"nodes": 2, "layer": [layer], "brdf": {"mu_i": cosines, "mu_o": cosines, "phi_deg": around}}
axes = {"layer[1].albedo": {"start": 0.1, "stop": 0.9, "count": int(sys.argv[1])}}
vrte.sweep({**scene, "axes": axes}, sys.argv[2], workers=1, chunk=2).close()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
CHUNK = 2 * 50 * 50 * 37 * 16 * 8 / 1024  # kilobytes


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["zarr", "nc"])
def test_memory_is_bounded_by_the_chunk_not_by_the_sweep(suffix: str, tmp_path: Path) -> None:
    few, many = (float(*printed_by(MEMORY, tmp_path, scenes, f"t{scenes}.{suffix}")) for scenes in (6, 46))
    assert many - few < 5.0 * CHUNK  # of 20 chunks more
