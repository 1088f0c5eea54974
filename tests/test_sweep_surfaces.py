"""Sweeps over surfaces: what their tables hold, axes over media and roughness, and what lies between."""

from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.sweep.store import describe_sweep_results
from vrte.sweep.template import read_sweep

BINDER: dict[str, Any] = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
BRDF = {"mu_i": [0.5, 1.0], "mu_o": [0.5, 1.0]}
FIELD = {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5], "tau": [0.0, 0.5]}
BEAMS = {"specular", "specular_reflectance", "total_reflectance"}
PLAIN = {"mueller", "reflectance", "direct_transmittance"}


def make_content(axes: dict[str, Any], interface: Any = None, **more: Any) -> dict[str, Any]:
    """A Rayleigh layer under an interface."""
    pile = [{"interface": {"above": 1.0, "below": 1.5} if interface is None else interface}, BINDER]
    asked = {} if "field" in more else {"brdf": BRDF}
    return {"nodes": 8, "layer": pile, **asked, **more, "axes": axes}


GLOSSY, ROUGH = {"layer[1].interface.below": [1.0, 1.33, 1.5]}, {"layer[1].interface.roughness": [0.1, 0.2]}
DEPTH, MIRROR = {"layer[1].thickness": [0.5, 1.0]}, {"layer": [BINDER], "base": {"kind": "mirror", "index": 1.5}}


FACETS = {"kind": "facets", "index": 1.34, "roughness": 0.1}


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (make_content(GLOSSY), PLAIN | BEAMS),
        (make_content(ROUGH), PLAIN | {"surface"}),
        (make_content({"layer[1].interface.roughness": [0.0, 0.1]}), PLAIN | BEAMS | {"surface"}),
        (make_content(GLOSSY, brdf=BRDF | {"transmission": True}), {"transmission", "specular_transmission"}),
        (make_content(DEPTH, **MIRROR), PLAIN | BEAMS),
        (make_content({"base.index": [1.4, 1.5]}, **MIRROR), PLAIN | BEAMS),
        (make_content(DEPTH, layer=[BINDER]), PLAIN),
        (make_content({"base.roughness": [0.1, 0.2]}, layer=[BINDER], base=FACETS), PLAIN),
        (make_content(DEPTH, layer=[BINDER], field=FIELD), {"stokes", "flux_up", "flux_down", "direct"}),
        (make_content(GLOSSY, field=FIELD), {"stokes", "flux_up", "flux_down", "direct", "direct_up", "index"}),
    ],
)
def test_a_table_has_what_its_scenes_may_have(content: dict[str, Any], names: set[str]) -> None:
    found = set(describe_sweep_results(read_sweep(content)).variables)
    assert found == names | (found & (PLAIN | BEAMS) if "transmission" in names else set())


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (make_content({"layer[1].interface.below": [1.5, 20.0]}), r"value 2: layer\[1\]\.interface\.below must be"),
        (make_content({"layer[1].interface.roughness": [0.1, 0.001]}), r"layer\[1\]\.interface\.roughness must be 0"),
        (make_content(GLOSSY, {"above": 1.0, "below": "water"}), 'is "water", and only a number can be changed'),
        (make_content({"base.index": [1.5, -1.0]}, **MIRROR), "value 2: base.index must be"),
        (make_content({"specular": {"key": "layer[2].thickness", "values": [1.0]}}), "is taken by the table itself"),
        (
            make_content(GLOSSY, layer=[{"interface": {"above": 1.0, "below": 1.5}}, BINDER | {"thickness": "x"}]),
            r"layer\[2\]\.thickness",
        ),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_computed(content: dict[str, Any], complaint: str) -> None:
    with pytest.raises(SceneError, match=complaint):
        read_sweep(content)


def test_media_that_do_not_fit_are_told_before_anything_is_computed() -> None:
    particles = {"particles": {"glass": {"index": 1.7, "radius_um": 0.1}}, "wavelength_um": 0.55, "host_index": 1.33}
    layers = [{"interface": {"above": 1.0, "below": 1.33}}, {"particles": "glass", "thickness": 1.0}]
    with pytest.raises(SceneError, match=r"value 2: .*has the refractive index 1\.33, and the interface .* 1\.5"):
        read_sweep(make_content({"layer[1].interface.below": [1.33, 1.5]}, layer=layers, **particles))
    together = {
        "below": {"key": "layer[1].interface.below", "values": [1.33, 1.5], "along": "binder"},
        "host": {"key": "host_index", "values": [1.33, 1.5], "along": "binder"},
    }
    assert read_sweep(make_content(together, layer=layers, **particles)).dimensions == {"binder": 2}


def test_an_axis_may_have_any_name_that_its_table_has_not() -> None:
    axes = {"specular": {"key": "layer[1].thickness", "values": [0.5, 1.0]}}
    table = vrte.sweep({"nodes": 4, "layer": [BINDER], "brdf": BRDF, "axes": axes}, workers=1)
    assert np.diff(table.reflectance.isel(mu_i=0).sel(specular=[0.5, 1.0]))[0] > 0.0
