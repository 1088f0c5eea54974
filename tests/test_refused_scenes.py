"""What layers, bases, interfaces, scenes, their light and their variations refuse, each in one sentence."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.splines import make_cosines

from .samples import rough_mirror

layer, fill, mueller, facets = vrte.Layer, vrte.Layer.of, vrte.MuellerBase, vrte.Facets
DUST = vrte.Particles(vrte.rayleigh(), 0.9, 0.0, extinction_um2=2.0, scattering_um2=1.8, volume_um3=0.5)
ONE, EITHER = layer(vrte.rayleigh(), 1, 1), "either thickness, or thickness_um together with volume_fraction"
ENDLESS = layer(vrte.rayleigh(), 0.5, math.inf)
MU = make_cosines(6)
TABLE: dict[str, Any] = {"mu_i": MU, "mu_o": MU, "phi_deg": [0, 90, 180]}


def of_diagonal(*values: float) -> np.ndarray:
    return np.broadcast_to(np.diag(values), (6, 6, 3, 4, 4))


def tabulate(**changes: Any) -> Any:
    return partial(vrte.TabulatedBase, **TABLE | {"mueller": of_diagonal(0.1, 0, 0, 0)} | changes)


def vary(thickness: Any, albedo: Any, **more: Any) -> Any:
    return partial(vrte.Variation, "p", 1.0, thickness, albedo, **more)


def tilted(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    f = rough_mirror(mu_i, mu_o, phi_deg)
    f[..., 0, 2] += 1e-6
    return f


SKY = vrte.brdf(vrte.Scene([ONE]), vrte.hemisphere(2)[0], 0.5, np.arange(4) * 90.0, nodes=4)
GREEN = [1.0, 0.0, 0.0, 0.0]

REFUSED = [
    (partial(layer, vrte.rayleigh(), 1.5, 1.0), "albedo must be between 0 and 1, not 1.5"),
    (partial(layer, vrte.rayleigh(), 0.5, -1.0), "thickness must be an optical thickness >= 0"),
    (partial(layer, vrte.rayleigh(), 0.5, 1e13), "thickness must be an optical thickness >= 0, at most 1e.12 or inf"),
    (partial(layer, np.ones(3), 0.5, 1.0), "phase_matrix must be a vrte.PhaseMatrix, not array"),
    (partial(fill, DUST), EITHER),
    (partial(fill, DUST, thickness=1.0, thickness_um=1.0, volume_fraction=0.05), EITHER),
    (partial(fill, DUST, thickness_um=1.0), EITHER),
    (partial(fill, DUST, thickness=1.0, volume_fraction=0.05), "volume_fraction is not used beside thickness"),
    (partial(fill, DUST, thickness=1.0, packing="percus-yevick"), "volume_fraction is needed beside thickness"),
    (partial(fill, DUST, thickness_um=1.0, volume_fraction=0.0), "must be above 0 and below 1"),
    (partial(fill, DUST, thickness_um=-1.0, volume_fraction=0.05), "thickness_um must be a length"),
    (partial(vrte.Scene, []), "at least one layer, or a base"),
    (partial(vrte.Scene, [ONE, vrte.rayleigh()]), "item 2 of layers must be a vrte.Layer or a vrte.Interface, not an"),
    (partial(vrte.Scene, [ENDLESS, ONE]), "layer 1: thickness inf .* last layer only"),
    (partial(vrte.Scene, [ENDLESS, vrte.Interface(1.0, 1.5)]), "thickness inf is allowed for the last layer only"),
    (partial(vrte.Scene, [ONE], 0.3), "base must be None .* not 0.3; .* vrte.Lambertian"),
    (partial(vrte.Scene, [ONE], interfaces=[None]), "interfaces must be one more than the 1 layers"),
    (partial(vrte.Lambertian, 1.1), "albedo must be between 0 and 1, not 1.1"),
    (partial(mueller, tilted), r"f\(-phi\) must equal D f\(phi\) D"),
    (partial(mueller, lambda i, o, p: np.full((4, 4), np.nan)), "finite"),
    (partial(mueller, lambda i, o, p: 1e101 * np.eye(4)), "at most 1e.100 in size"),
    (partial(mueller, lambda i, o, p: -np.eye(4)), "f_00 must be >= 0, not -1"),
    (partial(mueller, lambda i, o, p: np.zeros((3, 3))), "must return the shape"),
    (partial(mueller, lambda i, o, p: 1j * np.eye(4)), "real numbers"),
    (partial(mueller, lambda i, o: np.eye(4)), "called with arrays .* failed with TypeError"),
    (partial(mueller(rough_mirror), [0.1, 0.2], [0.1, 0.2, 0.3], 0.0), "must broadcast, not be of the shapes"),
    (partial(facets, 1.5, 0.0), "base: roughness must be above 0: vrte.Mirror"),
    (partial(facets, 1.5, 2.0), "base: roughness must be 0 .smooth. or from"),
    (partial(facets, 1.5, 0.001), "base: roughness must be 0 .smooth. or from"),
    (partial(facets, 1.5, 0.1, "gauss"), "Facets: distribution must be 'beckmann' or 'ggx'"),
    (partial(facets, 1.5, 0.1, "beckmann", False, True), "conserving gives back what facets hide from each other, and"),
    (partial(facets, 0.0, 0.1), "base: index must be n or n"),
    (partial(facets, (1.5, -1.0), 0.1), "base: index must be n or n.* n - ik of the other convention is n . ik here"),
    (partial(vrte.Interface, 1.0, 1.5, conserving=True), "interface: conserving is for facets"),
    (partial(vrte.Interface, 1.0, 20.0), "index_below must be a real refractive index from 0.1 to 10, not 20"),
    (partial(vrte.Interface(1.0, 1.5).share, [0.0, 1.0]), "mu must satisfy 1e-8 <= mu <= 1"),
    (tabulate(mu_i=[0.5]), "base: mu_i must be at least two different cosines above 0, up to 1"),
    (tabulate(phi_deg=[0, 30, 60]), r"base: phi_deg must be at least 3 azimuths, .* images counted, not 240"),
    (tabulate(phi_deg=[0, 180]), "base: mueller must have the shape"),
    (tabulate(mueller=np.zeros((6, 6, 4, 4))), r"base: mueller must have the shape \(6, 6, 3, 4, 4\) to fit its"),
    (tabulate(mueller=np.full((6, 6, 3, 4, 4), np.nan)), "base: mueller must be finite"),
    (tabulate(mueller=of_diagonal(-0.1, 0, 0, 0)), r"base: mueller must have f_00 >= 0, not -0\.1"),
    (tabulate(mueller=of_diagonal(0.5, 0, 0, 0)), r"base: it gives back 1\.571 of the light along mu_i = "),
    (tabulate(mueller=of_diagonal(0.1, 0.2, 0, 0)), r"not physical: .* eigenvalue -0\.025 where f_00 is 0\.1;"),
    (tabulate(mueller=np.full((6, 6, 3, 4, 4), 0.01)), r"base: f\(-phi\) must equal D f\(phi\) D"),
    (tabulate(specular=np.zeros((5, 4, 4))), r"base: specular must have the shape \(6, 4, 4\)"),
    (tabulate(specular=0.9 * np.broadcast_to(np.eye(4), (6, 4, 4))), r"base: it gives back 1\.214 of the light"),
    (tabulate(index_above=0.0), r"base: index_above must be a real refractive index from 0\.1 to 10, not 0\.0"),
    (vary([1.0], [0.0, 0.0]), "one a layer"),
    (vary([np.nan], [0.0]), "finite"),
    (vary([0.0], [0.0], coefficients=[np.eye(6)]), "cannot change"),
    (vary([0.0], [0.0], coefficients=[np.zeros((2, 5))]), r"must be \(terms, 6\)"),
    (vary([0.0], [0.0], is_outside=True), "scene_at"),
    (partial(SKY.under, np.ones((3, 4, 4))), r"must have the shape \(2, 4, 4\), not \(3, 4, 4\)"),
    (partial(SKY.under, [np.nan, 0.0, 0.0, 0.0]), "incident light must be finite"),
    (partial(SKY.under, [-1.0, 0.0, 0.0, 0.0]), "must be light, I >= 0 and"),
    (partial(SKY.under, [1e101, 0.0, 0.0, 0.0]), "must be numbers of at most 1e.100 in size"),
    (partial(SKY.under, GREEN, [1.0]), "weights must be 2 numbers"),
    (partial(SKY.under, GREEN, transmitted=True), "no transmission here"),
    (vrte.brdf(vrte.Scene([ONE]), vrte.hemisphere(2)[0], MU, [0, 90], nodes=4).diffuse_reflectance, "phi all around"),
    (vrte.brdf(vrte.Scene([ONE]), [0.3, 0.8], MU, nodes=4).bihemispherical_reflectance, "weights are missing"),
    (partial(vrte.brdf, vrte.Scene([ONE], vrte.Lambertian(0.2)), MU, MU, illuminate="bottom"), "without a base"),
    (partial(vrte.radiance, vrte.Scene([ENDLESS]), 0.5, illuminate="bottom"), "needs a finite thickness"),
    (partial(vrte.brdf, vrte.Scene([ONE]), MU, MU, illuminate="left"), "must be 'top', 'bottom', not 'left'"),
]


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_scenes_refuse_in_one_sentence(call: Any, words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words) as caught:
        call()
    if getattr(call, "func", None) is vrte.Variation:
        assert caught.value.place == ("derivatives", "p")
