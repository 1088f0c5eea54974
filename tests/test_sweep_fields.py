"""Sweeps of fields: the Stokes vectors at depths of many scenes, and their fluxes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.sweep.interpolation import held_out

from .helpers import assert_close

DEPTHS = [0.2, 1.0, 3.0, 9.0]
BEAMS = {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5, 1.0], "phi_deg": [0, 90], "tau": [0, 0.1], "stokes": [1, 0.5, 0, 0.1]}
FLUXES = {"mu0": 0.6, "mu": [], "tau": [0, 0.1]}


def fields(field: dict[str, Any] = BEAMS, **more: Any) -> dict[str, Any]:
    """Rayleigh layers of several depths."""
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    axes = {"depth": {"key": "layer[1].thickness", "values": DEPTHS}}
    return {"nodes": 4, "layer": [layer], "field": field, "axes": axes} | more


@pytest.mark.parametrize("side", ["top", "bottom"])
@pytest.mark.parametrize("field", [BEAMS, FLUXES], ids=["Stokes vectors", "fluxes alone"])
def test_each_scene_has_its_field(field: dict[str, Any], side: str) -> None:
    table = vrte.sweep(fields(field, illuminate=side), workers=1)
    for place, depth in enumerate(DEPTHS):
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, depth)])
        asked = {name.removesuffix("_deg"): values for name, values in field.items()}
        alone = vrte.radiance(scene, nodes=4, illuminate=side, **asked | {"mu0": np.atleast_1d(field["mu0"])})
        names = ("flux_up", "flux_down", "direct", *(("stokes",) if field["mu"] else ()))
        assert set(table.data_vars) == {*names, "incident_stokes", "error"}
        for name in names:
            np.testing.assert_array_equal(table[name].values[place], getattr(alone, name))
        np.testing.assert_array_equal(table.incident_stokes, alone.incident_stokes)


def test_files_engines_and_what_lies_between(tmp_path: Path) -> None:
    expected = vrte.sweep(fields(), workers=1)
    for name in ("table.zarr", "table.nc"):
        with vrte.sweep(fields(), tmp_path / name, chunk=2) as table:
            assert table.load().identical(expected.assign_attrs(table.attrs))
    device = vrte.sweep(fields(), engine="opencl")
    assert_close(device.stokes, expected.stokes, rtol=0.0, atol=1e-12 * float(expected.stokes.max()))
    light = expected.stokes.sel(mu=0.5)
    assert (abs(light.sel(stokes_parameter="Q")) < light.sel(stokes_parameter="I")).all()
    between = vrte.interpolate(expected, {"depth": 2.0})
    alone = vrte.radiance(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 2.0)]), [0.6], BEAMS["stokes"], [0.5], nodes=4)
    assert_close(between.flux_up.values[0, 0], alone.flux_up[0, 0], rtol=0.02, atol=0.0)


def test_a_depth_below_one_of_the_scenes_is_that_scenes_error() -> None:
    with pytest.warns(UserWarning, match="1 of 4 scenes failed; the first said: field.tau must lie between 0 and"):
        table = vrte.sweep(fields(BEAMS | {"tau": 0.5}))
    assert (table.error != "").values.tolist() == [True, False, False, False]


def test_what_sweeps_of_fields_are_refused() -> None:
    with pytest.raises(SceneError, match=r"field\.mu is missing: all scenes of a table share their directions"):
        vrte.sweep(fields({"mu0": 0.6}))
    with pytest.raises(SceneError, match="this name is taken by the table itself"):
        vrte.sweep(fields(axes={"stokes": {"key": "layer[1].albedo", "values": [0.5]}}))
    with pytest.raises(SceneError, match="brdf is missing"):
        vrte.sweep({name: value for name, value in fields().items() if name != "field"})
    with pytest.raises(SceneError, match="held_out measures BRDFs"):
        held_out(vrte.sweep(fields()))
