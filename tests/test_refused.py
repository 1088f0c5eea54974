"""What optics and scenes refuse, each in one sentence that names the argument."""

import math
import warnings
from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.splines import make_cosines
from vrte.optics import shapes, spheres

from .samples import rough_mirror

index = vrte.refractive_index
matrix, table = vrte.PhaseMatrix, vrte.PhaseMatrix.from_angles
GLASS = vrte.spheres(1.5, radius_um=0.1, wavelength_um=0.5)
WIDE = vrte.Lognormal(0.2, 1.2)
RAMP = vrte.rayleigh().to_angles(np.arange(0.0, 181.0, 5.0))
PLAIN: dict[str, Any] = {"angle_deg": [0.0, 90.0, 100.0, 180.0], "F11": [1.0, 1.0, 1.0, 1.0]}
SPHERES_F: dict[str, Any] = {name: getattr(RAMP, name) for name in ("angle_deg", "F11", "F12", "F33", "F34")}

OPTICS: list[tuple[Any, ...]] = [  # call, words, and the place as data where it is not the first word
    (partial(index, "golld", 0.5), r"'golld' is neither a known name .* did you mean 'gold'", ["index"]),
    (partial(index, "main/Au/Jonson", 0.5), "did you mean 'main/Au/Johnson'", ["index"]),
    (partial(index, "main/Au", 0.5), "neither a known name", ["index"]),
    (partial(index, "iron", 0.5), "did you mean 'main/Fe/", ["index"]),
    (partial(index, "nowhere at all", 0.5), "such as 'main/Au/Johnson'$", ["index"]),
    (partial(index, "gold", 3.0), "main/Au/Johnson goes from 0.1879 to 1.937 um; a wavelength of 3 um is", ["index"]),
    (partial(index, "gold", 550.0), r"550 um is outside: did you mean 0\.55\?$", ["index"]),
    (partial(index, "gold", math.nan), "wavelength_um must be .* not nan", None),
    (partial(index, 1.5 - 0.1j, 0.5), "k must be >= 0 .* not -0.1", ["index"]),
    (partial(index, 0.0, 0.5), "n must be above 0", ["index"]),
    (partial(index, 1e5, 0.5), "n and k must be at most 10000", ["index"]),
    (partial(index, math.nan, 0.5), "finite", ["index"]),
    (partial(index, (1.0, 2.0, 3.0), 0.5), "a pair", ["index"]),
    (partial(vrte.IndexTable, (0.4, 0.7), (1.5,), (0.0,)), "as many n and k as wavelengths", ["index"]),
    (partial(vrte.IndexTable, (0.7, 0.4), (1.5, 1.5), (0.0, 0.0)), "wavelengths must ascend", ["index"]),
    (partial(vrte.Lognormal, 0.2, 1.0), "sigma must be a geometric standard deviation above 1", ["sigma"]),
    (partial(vrte.Lognormal, -0.2, 1.5), "median_um must be a length", ["median_um"]),
    (partial(vrte.Gamma, 0.2, 0.5), "v_eff must be an effective variance .* below 0.5", ["v_eff"]),
    (partial(vrte.Monodisperse, math.nan), "radius_um", None),
    (partial(vrte.Tabulated, [0.1, 0.2], [1.0]), "equally long", []),
    (partial(vrte.Tabulated, [0.2, 0.1], [1.0, 1.0]), "must increase", ["radius_um"]),
    (partial(vrte.Tabulated, [0.0, 0.1], [1.0, 1.0]), "must be a length", ["radius_um"]),
    (partial(vrte.Tabulated, [0.1, 0.2], [0.0, 0.0]), "not zero everywhere", ["density"]),
    (partial(vrte.Tabulated, [0.1, 0.2], [1.0, -1.0]), ">= 0", ["density"]),
    (partial(vrte.mixture, []), "at least one kind", []),
    (partial(vrte.mixture, [("gold", 1.0)]), "not str", []),
    (partial(vrte.mixture, [0.3]), "pairs", []),
    (partial(vrte.mixture, [(GLASS, -1.0)]), "number fraction must be a number >= 0", ["number fraction"]),
    (partial(vrte.mixture, [(GLASS, 0.0)]), "needs more than 0", []),
    (partial(matrix, [1.0 + 2e-6]), r"a1\[0\] must be 1 within 1e-6 .* not 1.000002", []),
    (partial(matrix, [[1.0, 0.0]]), "a1 must be .* 1-D", None),
    (partial(matrix, [1.0], b2=[0, 0, np.inf]), "b2 must be finite", None),
    (partial(matrix, [1.0, 2e9]), "a1 holds 2e.09: a coefficient is at most 2 l . 1 in size", None),
    (partial(matrix, [1.0, 3.1]), "180 degrees .* coherency matrix has the eigenvalue", []),
    (partial(matrix, [1.0], [0, 0, 5.0]), "not physical", []),
    (partial(matrix, [1.0], tolerance=-1e-3), "tolerance must be between 0 and 1, of the mean of F11 over the", None),
    (partial(vrte.rayleigh, 0.9), "depolarization must be between 0 and 6/7, not 0.9", None),
    (partial(vrte.henyey_greenstein, 1.0, 10), "g must be between -1 and 1", None),
    (partial(vrte.henyey_greenstein, 0.5, 0), "terms must be a whole number", None),
    (partial(vrte.henyey_greenstein, 0.9999), r"g = 0\.9999 takes \d+ terms, and at most 100000 are allowed", []),
    (partial(vrte.mix, []), "at least one kind", []),
    (partial(vrte.mix, [(vrte.rayleigh(), -1.0)]), "weights .* >= 0", []),
    (partial(vrte.mix, [(vrte.rayleigh(), 0.0)]), "not all zero", []),
    (partial(vrte.mix, [vrte.rayleigh()]), "pairs", []),
    (partial(vrte.mix, [(1.0, 1.0)]), "pairs .* not float", []),
    (partial(vrte.rayleigh().scattering_matrix, np.nan), "angle_deg", []),
    (
        partial(table, [0.0, 90.0, 80.0, 180.0], PLAIN["F11"]),
        "angle_deg must ascend from 0 to 180 degrees, not be 80",
        None,
    ),
    (
        partial(table, [0.0, 90.0, 90.0, 180.0], PLAIN["F11"]),
        "angle_deg must .* not be 90 behind a larger or the same one",
        None,
    ),
    (partial(table, [-1.0, 90.0, 100.0, 180.0], PLAIN["F11"]), "angle_deg must ascend .* not be -1 to 180", None),
    (partial(table, [0.0], [1.0]), "angle_deg must be 2 to 20000 angles, not 1", None),
    (partial(table, PLAIN["angle_deg"], [1.0, 1.0, 1.0]), "F11 must have a value for each of 4 angles, not 3", None),
    (partial(table, PLAIN["angle_deg"], [1.0, -0.1, 1.0, 1.0]), "F11 must be positive, not -0.1 at 90 degrees", None),
    (partial(table, PLAIN["angle_deg"], [1.0, 0.0, 1.0, 1.0]), "F11 must be above 0: it is 0 at 90 degrees", None),
    (partial(table, **PLAIN, convention="mine"), "convention must be one of vrte, bohren-huffman", None),
    (partial(table, **PLAIN, ends="guess"), "ends must be \"extrapolate\" or left out, not 'guess'", None),
    (partial(table, **PLAIN, ends="extrapolate"), "ends fills what a table leaves out, and this one", None),
    (
        partial(table, [1.0, 170.0], [1.0, 1.0], ends="extrapolate"),
        "angle_deg must be at least 3 angles where the ends",
        None,
    ),
    (partial(table, [3.0, 90.0, 174.0], [1.0] * 3), r"not from 3 to 174.*ends=\"extrapolate\"", ["angle_deg"]),
    (partial(table, **PLAIN, accuracy=0.0), "accuracy must be from 1e-12 to 0.1", None),
    (partial(table, **PLAIN, tolerance=2.0), "tolerance must be between 0 and 1", None),
    (partial(table, **PLAIN, convention="granada"), 'normalise must be True for the convention "granada"', None),
    (partial(table, **PLAIN, convention="chandrasekhar"), "F12 is missing: in the convention F11 alone is not", None),
    (partial(table, **SPHERES_F), "F22 is missing: all six elements are needed.*spheres=True", None),
    (partial(table, **PLAIN, spheres=True), "F12 is missing", None),
    (partial(table, RAMP.angle_deg, *RAMP.elements, spheres=True), "spheres fills columns that are missing", None),
    (
        partial(table, RAMP.angle_deg, RAMP.F11, np.where(RAMP.angle_deg == 60.0, 0.9, RAMP.F12), *RAMP.elements[2:]),
        "the table is not physical: at 60 degrees its coherency matrix has",
        [],
    ),
]


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

SCENES: list[tuple[Any, ...]] = [
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
    (partial(vrte.Scene, None), "layers must be a list"),
    (partial(vrte.Scene, [ONE], 0.3), "base must be None .* not 0.3; .* vrte.Lambertian"),
    (partial(vrte.Scene, [ONE], interfaces=[None]), "interfaces must be one more than the 1 layers"),
    (partial(vrte.Lambertian, 1.1), "albedo must be between 0 and 1, not 1.1"),
    (partial(vrte.Lambertian, None), "albedo must be a number, not None"),
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
    (vary([1.0], [0.0, 0.0]), "one a layer", ["derivatives", "p"]),
    (vary([np.nan], [0.0]), "finite", ["derivatives", "p"]),
    (vary([0.0], [0.0], coefficients=[np.eye(6)]), "cannot change", ["derivatives", "p"]),
    (vary([0.0], [0.0], coefficients=[np.zeros((2, 5))]), r"must be \(terms, 6\)", ["derivatives", "p"]),
    (vary([0.0], [0.0], is_outside=True), "scene_at", ["derivatives", "p"]),
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


@pytest.mark.parametrize("row", [*OPTICS, *SCENES], ids=lambda row: row[1])
def test_what_is_wrong_is_refused_in_one_sentence(row: tuple[Any, ...]) -> None:
    call, words, *index = row
    with pytest.raises(vrte.SceneError, match=words) as caught:
        call()
    if index:
        assert list(caught.value.place) == ([words.split()[0]] if index[0] is None else index[0])


GOOD: dict[str, dict[str, Any]] = {
    "spheres": {"material": 1.5, "radius_um": 0.3, "wavelength_um": 0.5},
    "coated_spheres": {"core": 2.7, "shell": 1.5, "core_ratio": 0.5, "radius_um": 0.2, "wavelength_um": 0.5},
    "spheroids": {"material": 1.6, "aspect_ratio": 1.5, "radius_um": 0.1, "wavelength_um": 0.5},
    "cylinders": {"material": 1.6, "aspect_ratio": 1.5, "radius_um": 0.1, "wavelength_um": 0.5},
}
PARTICLES = [  # kind, changes, words, the place as data
    ("spheres", {"host_index": 1.5}, "refractive index of their host, 1.5, so they scatter nothing", None),
    ("spheres", {"radius_um": None}, "either radius_um or size", None),
    ("spheres", {"size": WIDE}, "either radius_um or size", None),
    ("spheres", {"radius_um": -0.3}, "radius_um must be a length", "radius_um"),
    ("spheres", {"radius_um": 1e4}, r"size parameter .* at most 10000, not .* did you mean nanometres, 10 um\?", None),
    ("spheres", {"radius_um": None, "size": 0.3}, "size must be a Lognormal", None),
    ("spheres", {"host_index": 0.0}, "host_index must be a real refractive index from 0.001 to 1000, or", "host_index"),
    ("spheres", {"host_index": "watr"}, "host_index: 'watr' is neither", "host_index"),
    ("spheres", {"host_index": 1.3 + 0.1j}, "host_index: .* absorbs too much", "host_index"),
    ("spheres", {"wavelength_um": 0.0}, "wavelength_um must be a length", "wavelength_um"),
    ("coated_spheres", {"core_ratio": None}, "exactly one of core_radius_um, shell_um and core_ratio", None),
    ("coated_spheres", {"shell_um": 0.1}, "exactly one of core_radius_um, shell_um and core_ratio", None),
    ("coated_spheres", {"core_ratio": 1.0}, "must be a ratio of radii from 1e-06 to below 1, not 1.0", "core_ratio"),
    ("coated_spheres", {"core_ratio": "thin"}, "core_ratio must be a number", "core_ratio"),
    ("coated_spheres", {"core_ratio": None, "shell_um": 0.2}, "less than the smallest .* 0.2 um, not 0.2", "shell_um"),
    (
        "coated_spheres",
        {"core_ratio": None, "shell_um": 0.1, "radius_um": None, "size": vrte.Lognormal(0.2, 1.4)},
        r"less than the smallest radius that is averaged over, 0.02\d+ um, not 0.1",
        "shell_um",
    ),
    (
        "coated_spheres",
        {"core_ratio": None, "core_radius_um": 0.2},
        "above 0 and less than radius_um",
        "core_radius_um",
    ),
    ("coated_spheres", {"core_ratio": None, "core_radius_um": -1.0}, "must be above 0", "core_radius_um"),
    (
        "coated_spheres",
        {"core_ratio": None, "core_radius_um": 0.1, "radius_um": None, "size": WIDE},
        "core_radius_um goes with radius_um; spheres of many sizes need shell_um or core_ratio",
        "core_radius_um",
    ),
    ("coated_spheres", {"core": "golld"}, "^core: 'golld' is neither .* did you mean 'gold'", "core"),
    ("coated_spheres", {"shell": 1.5 - 0.1j}, "^shell: k must be >= 0", "shell"),
    ("coated_spheres", {"core": 1.0, "shell": 1.0}, "index of their host, 1, so they scatter nothing", None),
    ("coated_spheres", {"radius_um": 700.0, "core": 80.0}, "times the size parameter must be at most", None),
    ("spheroids", {"aspect_ratio": 0.0}, "must be a width over a length, from 0.1 to 10, not 0.0", "aspect_ratio"),
    ("spheroids", {"radius_um": 100.0}, "must be at most 50, not 1.*did you mean nanometres, 0.1 um", None),
    ("cylinders", {"radius_um": 5e-6}, "must be at least 0.0001, not 6.283e-05", None),
]


@pytest.mark.parametrize(("kind", "changes", "words", "place"), PARTICLES)
def test_particles_are_refused_by_make_and_check_alike(
    kind: str, changes: dict[str, Any], words: str, place: str | None
) -> None:
    room = shapes if hasattr(shapes, kind) else spheres
    for call in (getattr(vrte, kind), getattr(room, f"check_{kind}")):
        with pytest.raises(vrte.SceneError, match=words) as caught:
            call(**GOOD[kind] | changes)
        assert caught.value.place == ((place,) if place else ())


def latex(**how: Any) -> vrte.Particles:
    """Polystyrene in water."""
    return vrte.spheres(1.59, **{"radius_um": 0.2, "wavelength_um": 0.6, "host_index": 1.33} | how)


def rutile(**how: Any) -> vrte.Particles:
    """Titania in resin, in green light."""
    return vrte.spheres(2.7, **{"radius_um": 0.1, "wavelength_um": 0.55, "host_index": 1.5} | how)


UNKNOWN = vrte.Particles(vrte.rayleigh(), 1.0, 0.0, 1.0, 1.0, 1.0)
METAL = vrte.spheres((0.2, 3.4), radius_um=0.05, wavelength_um=0.6)
TWO = vrte.mixture([(latex(), 1.0), (latex(wavelength_um=0.5), 1.0)])
PACKINGS = [  # particles, volume fraction, packing, words of a warning or, where it is no warning, of the error
    (latex(), 0.3, "percus-yevick", ""),
    (rutile(), 0.3, "effective-medium", ""),
    (rutile(radius_um=0.13), 0.3, "coherent-potential", ""),
    (
        latex(),
        0.11,
        "independent",
        'warn: 0.11 is above 0.1: .*; packing="percus-yevick" or .* accounts for neighbours',
    ),
    (latex(), 0.31, "percus-yevick", "warn: volume_fraction of 0.31 is above 0.3"),
    (
        rutile(),
        0.2,
        "percus-yevick",
        r'warn: \|m - 1\| is 0.8 here, and up to 0.35 allowed; packing="coherent-potential"',
    ),
    (rutile(radius_um=0.13), 0.2, "effective-medium", r"warn: \|m - 1\| is 3.56 here, and up to 3 allowed"),
    (latex(), 0.65, "percus-yevick", "volume_fraction must be at most 0.64 .*, not 0.65: hard spheres"),
    (latex(), 0.2, "crystal", r'packing must be "independent" or "percus-yevick" or .*, not \'crystal\''),
    (UNKNOWN, 0.2, "percus-yevick", "of known substance and size"),
    (TWO, 0.2, "percus-yevick", "needs particles at one wavelength"),
    (METAL, 0.5, "coherent-potential", "no solution"),
]


@pytest.mark.parametrize(("particles", "fraction", "packing", "words"), PACKINGS)
def test_packings_say_where_their_domain_ends(
    particles: vrte.Particles, fraction: float, packing: str, words: str, recwarn: pytest.WarningsRecorder
) -> None:
    def fill() -> vrte.Layer:
        return vrte.Layer.of(particles, thickness_um=1.0, volume_fraction=fraction, packing=packing)

    if words.startswith("warn: "):
        with pytest.warns(vrte.PackingWarning, match=words.removeprefix("warn: ")) as reported:
            fill()
        assert reported[0].filename == __file__
    elif words:
        warnings.simplefilter("ignore", vrte.PackingWarning)
        with pytest.raises(vrte.SceneError, match=words):
            fill()
    else:
        assert fill().thickness > 0.0
        assert not recwarn.list
