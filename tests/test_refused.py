"""What calls refuse: each in one sentence that names what is wrong, and says as data where."""

import math
import sys
from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance import kubelka_munk as km
from vrte.appearance.colours import find_colour
from vrte.appearance.geometries import Rectangular, Round, collect_mirrored, read_geometry
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, find_hiding
from vrte.appearance.panel import Panel, make_panel
from vrte.appearance.two_flux_fit import find_kubelka_munk
from vrte.basics.splines import make_cosines
from vrte.formats.scene_file import make_scene_file
from vrte.formats.toml_table import parse_toml
from vrte.methods.slabs import propagator
from vrte.optics import shapes, spheres
from vrte.request.how import AUTO, How
from vrte.results.quantities import of_brdf, of_stokes

from .samples import rough_mirror
from .scenes import make_leaf

Row = tuple[Any, ...]  # a call, words of its error, and the place, first of which is the first word where it is None
index, matrix, table = vrte.refractive_index, vrte.PhaseMatrix, vrte.PhaseMatrix.from_angles
layer, fill, mueller, facets = vrte.Layer, vrte.Layer.of, vrte.MuellerBase, vrte.Facets
RAYLEIGH, WIDE, MU = vrte.rayleigh(), vrte.Lognormal(0.2, 1.2), make_cosines(6)
GLASS, SMOOTH = vrte.spheres(1.5, radius_um=0.1, wavelength_um=0.5), vrte.Interface(1.0, 1.5)
TINTED = vrte.spheres(1.7, radius_um=0.1, wavelength_um=0.5, host_index=(1.5, 2e-4))
ONE, ENDLESS, EMPTY = layer(RAYLEIGH, 1, 1), layer(RAYLEIGH, 0.5, math.inf), layer(vrte.isotropic(), 0.0, 0.0)
SCENE, WHITE = vrte.Scene([ONE]), vrte.Lambertian(0.9)
brdf = partial(vrte.brdf, SCENE, 0.5, 0.5, nodes=2)
field = partial(vrte.radiance, SCENE, 0.5, nodes=2)
BEAMS = vrte.radiance(SCENE, [0.6], mu=[], nodes=2)

OPTICS: list[Row] = [
    (partial(index, "golld", 0.5), r"'golld' is neither a known name .* did you mean 'gold'", "index"),
    (partial(index, "aluminum oxide", 0.5), r"did you mean 'alumina'\?", "index"),
    (partial(index, "TiO2", 0.5), r"did you mean 'rutile' or 'anatase'\?", "index"),
    (partial(index, "main/Au/Jonson", 0.5), "did you mean 'main/Au/Johnson'", "index"),
    (partial(index, "main/Au", 0.5), "neither a known name", "index"),
    (partial(index, "iron", 0.5), "did you mean 'main/Fe/", "index"),
    (partial(index, "nowhere at all", 0.5), "such as 'main/Au/Johnson'$", "index"),
    (partial(index, "gold", 3.0), "gold goes from 0.1879 to 1.937 um; a wavelength of 3 um is", "index"),
    (partial(index, "gold", 550.0), r"550 um is outside: did you mean 0\.55\?$", "index"),
    (partial(index, 1.5 - 0.1j, 0.5), r"k must be >= 0 .* not -0.1.*n \+ ik here, 1\.5\+0\.1j", "index"),
    (partial(index, 0.0, 0.5), "n must be above 0", "index"),
    (partial(index, 1e-5, 0.5), "n must be at least 0.0001, not 1e-05", "index"),
    (partial(index, 1e5, 0.5), "n and k must be at most 10000", "index"),
    (partial(index, math.nan, 0.5), "finite", "index"),
    (partial(index, (1.0, 2.0, 3.0), 0.5), "a pair", "index"),
    (partial(vrte.IndexTable, (0.4, 0.7), (1.5,), (0.0,)), "as many n and k as wavelengths", "index"),
    (partial(vrte.IndexTable, (0.7, 0.4), (1.5, 1.5), (0.0, 0.0)), "wavelengths must ascend", "index"),
    (partial(vrte.Lognormal, 0.2, 1.0), "sigma must be a geometric standard deviation above 1", "sigma"),
    (partial(vrte.Lognormal, -0.2, 1.5), "median_um must be a length", "median_um"),
    (partial(vrte.Gamma, 0.2, 0.5), "v_eff must be an effective variance .* below 0.5", "v_eff"),
    (partial(vrte.Monodisperse, math.nan), "radius_um", None),
    (partial(vrte.Tabulated, [0.1, 0.2], [1.0]), "equally long"),
    (partial(vrte.Tabulated, [0.2, 0.1], [1.0, 1.0]), "must increase", "radius_um"),
    (partial(vrte.Tabulated, [0.0, 0.1], [1.0, 1.0]), "must be a length", "radius_um"),
    (partial(vrte.Tabulated, [0.1, 0.2], [0.0, 0.0]), "not zero everywhere", "density"),
    (partial(vrte.Tabulated, [0.1, 0.2], [1.0, -1.0]), ">= 0", "density"),
    (partial(vrte.mixture, []), "at least one kind"),
    (partial(vrte.mixture, [0.3]), "pairs"),
    (partial(vrte.mixture, [(RAYLEIGH, 1.0)]), "vrte.mix "),
    (partial(vrte.mixture, [(GLASS, -1.0)]), "number fraction must be a number >= 0", "number fraction"),
    (partial(vrte.mixture, [(GLASS, 0.0)]), "needs more than 0"),
    (partial(matrix, [1.0 + 2e-6]), r"a1\[0\] must be 1 within 1e-6 .* not 1.000002"),
    (partial(matrix, [[1.0, 0.0]]), "a1 must be .* 1-D", None),
    (partial(matrix, [1.0], b2=[0, 0, np.inf]), "b2 must be finite", None),
    (partial(matrix, [1.0, 2e9]), "a1 holds 2e.09: a coefficient is at most 2 l . 1 in size", None),
    (partial(matrix, [1.0, 3.1]), "180 degrees .* coherency matrix has the eigenvalue"),
    (partial(matrix, [1.0], tolerance=-1e-3), "tolerance must be between 0 and 1, of the mean of F11 over the", None),
    (partial(vrte.rayleigh, 0.9), "depolarization must be between 0 and 6/7, not 0.9", None),
    (partial(vrte.henyey_greenstein, 1.0, 10), "g must be between -1 and 1", None),
    (partial(vrte.henyey_greenstein, 0.5, 0), "terms must be a whole number", None),
    (partial(vrte.henyey_greenstein, 0.9999), r"g = 0\.9999 takes \d+ terms, and at most 100000 are allowed"),
    (partial(vrte.mix, [(RAYLEIGH, -1.0)]), "weights .* >= 0"),
    (partial(vrte.mix, [(RAYLEIGH, 0.0)]), "not all zero"),
    (partial(vrte.mix, [(GLASS, 1.0)]), "pairs .* not Particles .* vrte.mixture"),
    (partial(RAYLEIGH.scattering_matrix, np.nan), "angle_deg"),
]

RAMP = RAYLEIGH.to_angles(np.arange(0.0, 181.0, 5.0))
SPHERES_F: dict[str, Any] = {name: getattr(RAMP, name) for name in ("angle_deg", "F11", "F12", "F33", "F34")}
TOO_DARK = [RAMP.F11, np.where(RAMP.angle_deg == 60.0, 0.9, RAMP.F12), *RAMP.elements[2:]]


def plain(angle_deg: Any = (0.0, 90.0, 100.0, 180.0), F11: Any = (1.0, 1.0, 1.0, 1.0), **how: Any) -> Any:
    return partial(table, angle_deg, F11, **how)


TABLES: list[Row] = [
    (plain([0.0, 90.0, 80.0, 180.0]), "angle_deg must ascend from 0 to 180 degrees, not be 80", None),
    (plain([0.0, 90.0, 90.0, 180.0]), "angle_deg must .* not be 90 behind a larger or the same one", None),
    (plain([-1.0, 90.0, 100.0, 180.0]), "angle_deg must ascend .* not be -1 to 180", None),
    (plain([0.0], [1.0]), "angle_deg must be 2 to 20000 angles, not 1", None),
    (plain(F11=[1.0, 1.0, 1.0]), "F11 must have a value for each of 4 angles, not 3", None),
    (plain(F11=[1.0, -0.1, 1.0, 1.0]), "F11 must be positive, not -0.1 at 90 degrees", None),
    (plain(F11=[1.0, 0.0, 1.0, 1.0]), "F11 must be above 0: it is 0 at 90 degrees", None),
    (plain(convention="mine"), "convention must be one of vrte, bohren-huffman", None),
    (plain(ends="guess"), "ends must be \"extrapolate\" or left out, not 'guess'", None),
    (plain(ends="extrapolate"), "ends fills what a table leaves out, and this one", None),
    (plain([1.0, 170.0], [1.0, 1.0], ends="extrapolate"), "angle_deg must be at least 3 angles where the ends", None),
    (plain([3.0, 90.0, 174.0], [1.0] * 3), r"not from 3 to 174.*ends=\"extrapolate\"", "angle_deg"),
    (plain(accuracy=0.0), "accuracy must be from 1e-12 to 0.1", None),
    (plain(tolerance=2.0), "tolerance must be between 0 and 1", None),
    (plain(convention="granada"), 'normalise must be True for the convention "granada"', None),
    (plain(convention="chandrasekhar"), "F12 is missing: in the convention F11 alone is not", None),
    (plain(spheres=True), "F12 is missing", None),
    (partial(table, **SPHERES_F), "F22 is missing: all six elements are needed.*spheres=True", None),
    (partial(table, RAMP.angle_deg, *RAMP.elements, spheres=True), "spheres fills columns that are missing", None),
    (partial(table, RAMP.angle_deg, *TOO_DARK), "the table is not physical: at 60 degrees its coherency matrix has"),
]

GOOD: dict[str, dict[str, Any]] = {
    "spheres": {"material": 1.5, "radius_um": 0.3},
    "coated_spheres": {"core": 2.7, "shell": 1.5, "core_ratio": 0.5, "radius_um": 0.2},
    "spheroids": {"material": 1.6, "aspect_ratio": 1.5, "radius_um": 0.1},
    "cylinders": {"material": 1.6, "aspect_ratio": 1.5, "radius_um": 0.1},
}


def make(kind: str, **changes: Any) -> Any:
    """A call of that particle's maker; its check, which does no work, refuses it in the same words."""
    given = {"wavelength_um": 0.5, **GOOD[kind], **changes}

    def call() -> None:
        check = getattr(shapes if hasattr(shapes, kind) else spheres, f"check_{kind}")
        with pytest.raises(vrte.SceneError) as checked:
            check(**given)
        with pytest.raises(vrte.SceneError) as made:
            getattr(vrte, kind)(**given)
        assert (str(made.value), made.value.place) == (str(checked.value), checked.value.place)
        raise made.value

    return call


def coat(**changes: Any) -> Any:
    """A call of coated spheres; without the ratio of their radii where something else says how thick the shell is."""
    return make("coated_spheres", **{"core_ratio": None} | changes)


PARTICLES: list[Row] = [
    (make("spheres", host_index=1.5), "refractive index of their host, 1.5, so they scatter nothing", ()),
    (make("spheres", radius_um=None), "either radius_um or size", ()),
    (make("spheres", size=WIDE), "either radius_um or size", ()),
    (make("spheres", radius_um=-0.3), "radius_um must be a length", "radius_um"),
    (make("spheres", radius_um=1e4), r"size parameter .* at most 10000, not .* did you mean nanometres, 10 um\?", ()),
    (make("spheres", radius_um=None, size=0.3), "size must be a Lognormal", ()),
    (make("spheres", host_index=0.0), "must be a real refractive index from 0.001 to 1000, or", "host_index"),
    (make("spheres", host_index="watr"), "host_index: 'watr' is neither", "host_index"),
    (make("spheres", host_index=1.3 + 0.1j), "host_index: .* absorbs too much", "host_index"),
    (make("spheres", wavelength_um=0.0), "wavelength_um must be a length", "wavelength_um"),
    (coat(), "exactly one of core_radius_um, shell_um and core_ratio", ()),
    (coat(shell_um=0.1, core_ratio=0.5), "exactly one of core_radius_um, shell_um and core_ratio", ()),
    (coat(core_ratio=1.0), "must be a ratio of radii from 1e-06 to below 1, not 1.0", "core_ratio"),
    (coat(shell_um=0.2), "less than the smallest .* 0.2 um, not 0.2", "shell_um"),
    (coat(shell_um=0.1, radius_um=None, size=vrte.Lognormal(0.2, 1.4)), r"smallest .* 0.02\d+ um, not 0.1", "shell_um"),
    (coat(core_radius_um=0.2), "above 0 and less than radius_um", "core_radius_um"),
    (coat(core_radius_um=-1.0), "must be above 0", "core_radius_um"),
    (coat(core_radius_um=0.1, radius_um=None, size=WIDE), "of many sizes need shell_um or core", "core_radius_um"),
    (coat(core="golld", core_ratio=0.5), "^core: 'golld' is neither .* did you mean 'gold'", "core"),
    (coat(shell=1.5 - 0.1j, core_ratio=0.5), "^shell: k must be >= 0", "shell"),
    (coat(core=1.0, shell=1.0, core_ratio=0.5), "index of their host, 1, so they scatter nothing", ()),
    (coat(core=80.0, radius_um=700.0, core_ratio=0.5), "times the size parameter must be at most", ()),
    (make("spheroids", aspect_ratio=0.0), "must be a width over a length, from 0.1 to 10, not 0.0", "aspect_ratio"),
    (make("spheroids", radius_um=100.0), "must be at most 50, not 1.*did you mean nanometres, 0.1 um", ()),
    (make("cylinders", radius_um=5e-6), "must be at least 0.0001, not 6.283e-05", ()),
]

DUST = vrte.Particles(RAYLEIGH, 0.9, 0.0, extinction_um2=2.0, scattering_um2=1.8, volume_um3=0.5)
EITHER = "either thickness, or thickness_um together with volume_fraction"
TABLE: dict[str, Any] = {"mu_i": MU, "mu_o": MU, "phi_deg": [0, 90, 180]}
SKY = vrte.brdf(SCENE, vrte.hemisphere(2)[0], 0.5, np.arange(4) * 90.0, nodes=4)
GREEN, P = [1.0, 0.0, 0.0, 0.0], ("derivatives", "p")


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


def grazing(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    """Brighter and brighter towards the horizon."""
    return (0.05 / np.maximum(mu_i, 0.05 + 0.0 * (mu_o + phi_deg)))[..., None, None] * np.diag([1.0, 0, 0, 0])


SCENES: list[Row] = [
    (partial(layer, RAYLEIGH, 1.5, 1.0), "albedo must be between 0 and 1, not 1.5"),
    (partial(layer, RAYLEIGH, True, 1.0), "Layer: albedo must be a number, not True"),
    (partial(layer, RAYLEIGH, 0.5, -1.0), "thickness must be an optical thickness >= 0"),
    (partial(layer, RAYLEIGH, 0.5, 1e13), "thickness must be an optical thickness >= 0, at most 1e.12 or inf"),
    (partial(layer, "x", 0.5, 1.0), "Layer: phase_matrix must be a vrte.PhaseMatrix, not 'x'"),
    (partial(layer, vrte.rayleigh, 0.5, 1.0), r"has to be called: rayleigh\(...\)"),
    (partial(fill, DUST), EITHER),
    (partial(fill, DUST, thickness=1.0, thickness_um=1.0, volume_fraction=0.05), EITHER),
    (partial(fill, DUST, thickness_um=1.0), EITHER),
    (partial(fill, DUST, thickness=1.0, volume_fraction=0.05), "volume_fraction is not used beside thickness"),
    (partial(fill, DUST, thickness=1.0, packing="percus-yevick"), "volume_fraction is needed beside thickness"),
    (partial(fill, DUST, thickness_um=1.0, volume_fraction=0.0), "must be above 0 and below 1"),
    (partial(fill, DUST, thickness_um=-1.0, volume_fraction=0.05), "thickness_um must be a length"),
    (partial(fill, TINTED, thickness=1.0), "volume_fraction is needed beside thickness: the host absorbs"),
    (
        partial(fill, GLASS, thickness=1.0, packing="percus-yevick"),
        "is needed beside thickness: .* packing asks for it",
    ),
    (make("spheres", host_index=(1.5, 0.1)), "host_index: 1.5 .* 0.1i absorbs too much"),
    (partial(layer.clear, 1.0, (1.5, 0.1), 0.55), "host_index: .* absorbs too much"),
    (partial(layer.clear, -1.0, 1.5, 0.55), "thickness_um must be a length"),
    (partial(layer.clear, 1.0, 1.5, 0.0), "wavelength_um must be a length from 1e-6 to 1e6 um"),
    (partial(vrte.mixture, [(TINTED, 1.0), (GLASS, 1.0)]), "lie in one medium"),
    (partial(vrte.Scene, []), "at least one layer, or a base"),
    (partial(vrte.Scene, [ONE, {}]), "Scene: item 2 of layers must be a vrte.Layer or a vrte.Interface, not {}"),
    (partial(vrte.Scene, [RAYLEIGH]), r"vrte.Layer\(phase_matrix, albedo, thickness\)"),
    (partial(vrte.Scene, [ONE] * 10_001), "layers must be a list of at most 10000"),
    (partial(vrte.Scene, [ENDLESS, ONE]), "layer 1: thickness inf .* last layer only"),
    (partial(vrte.Scene, [SMOOTH, vrte.Interface(1.5, 1.5 + 1e-7)]), r"1\.5 and 1\.5000001 are too much alike to tell"),
    (partial(vrte.Scene, [ONE], 0.3), r"base must be None .* not 0.3; .* vrte.Lambertian\(0.3\)"),
    (partial(vrte.Scene, [ONE], vrte.Lambertian), r"has to be called: Lambertian\(...\)"),
    (partial(vrte.Scene, [ONE], interfaces=[None]), "interfaces must be one more than the 1 layers"),
    (partial(vrte.Lambertian, 1.1), "albedo must be between 0 and 1, not 1.1"),
    (partial(vrte.Lambertian, np.array([1.0, 2.0], object)), "Lambertian: albedo must be a number"),
    (partial(vrte.Mirror, "gold"), r"vrte.refractive_index\('gold', wavelength_um\).value"),
    (partial(mueller, tilted), r"f\(-phi\) must equal D f\(phi\) D"),
    (partial(mueller, lambda i, o, p: np.full((4, 4), np.nan)), "finite"),
    (partial(mueller, lambda i, o, p: 1e101 * np.eye(4)), "at most 1e.100 in size"),
    (partial(mueller, lambda i, o, p: -np.eye(4)), "f_00 must be >= 0, not -1"),
    (partial(mueller, lambda i, o, p: np.zeros((3, 3))), "must return the shape"),
    (partial(mueller, lambda i, o, p: 1j * np.eye(4)), "real numbers"),
    (partial(mueller, lambda i, o: np.eye(4)), "called with arrays .* failed with TypeError"),
    (partial(mueller(rough_mirror), [0.1, 0.2], [0.1, 0.2, 0.3], 0.0), "must broadcast, not be of the shapes"),
    (partial(mueller, lambda i, o, p: np.diag([1e3, 0, 0, 0])), "gives back 3142 of the light along mu_i = "),
    (partial(mueller, lambda i, o, p: np.diag([0.33, 0, 0, 0])), r"1\.037 of the light .* at most 1\.001 is allowed"),
    (partial(mueller, grazing), r"gives back 3\.142 of the light along mu_i = 0\.05, and at most 1\.001"),
    (partial(mueller, lambda i, o, p: np.diag([0.1, 0.1, 0.1, -0.1])), r"eigenvalue -0\.05 where f_00 is 0\.1;"),
    (partial(mueller, lambda i, o, p: np.diag([0.1, 0.2, 0.0, 0.0])), r"eigenvalue -0\.025 where f_00 is 0\.1;"),
    (partial(mueller, lambda i, o, p: np.diag([0, 0, 0, 1e-3])), r"not physical: .* eigenvalue -0\.00025"),
    (partial(vrte.RPV, -0.1, 0.7), r"base: rho_0 must be between 0 and 10, not -0\.1"),
    (partial(vrte.RPV, 0.1, 0.7, 1.0), r"base: asymmetry must be between -0\.999 and 0\.999, not 1"),
    (partial(vrte.RPV, 0.1, 0.7, rho_c=3.0), "base: rho_c must be between 0 and 2, not 3"),
    (partial(vrte.RPV, 0.9, 0.5), r"base: it gives back \d\.\d+ of the light along mu_i = "),
    (partial(vrte.Hapke, 1.1), r"base: albedo must be between 0 and 1, not 1\.1"),
    (partial(vrte.Hapke, 1.0), r"base: it gives back 1\.013 of the light along mu_i = 0\.4"),
    (partial(vrte.Hapke, 0.5, h_function="1993"), "base: h_function must be '2002', '1981', not '1993'"),
    (partial(vrte.Hapke, 0.5, linear=1.5), r"base: linear must give a phase function of at least 0 .* not -0\.5"),
    (partial(vrte.Hapke, 0.5, linear=0.5, asymmetry=0.1), "base: asymmetry is instead of linear and quadratic"),
    (partial(vrte.Hapke, 0.5, width=0.0), r"base: width must be between 0\.001 and 10, not 0"),
    (partial(vrte.RossLi, 0.1, 0.1, 0.0, hot_spot=1), "RossLi: hot_spot must be True or False, not 1"),
    (partial(vrte.RossLi, 0.1, 0.1, 0.0, crown_shape=0.0), r"base: crown_shape must be between 0\.1 and 10, not 0"),
    (partial(vrte.cox_munk, -1.0), "base: wind must be a speed in m/s from 0 to 40, not -1"),
    (partial(vrte.cox_munk, 5.0, index=0.0), r"base: index must be n or n \+ ik"),
    (partial(facets, 1.5, 0.0), "base: roughness must be above 0: vrte.Mirror"),
    (partial(facets, 1.5, 2.0), "base: roughness must be 0 .smooth. or from"),
    (partial(facets, 1.5, 0.0005), "base: roughness must be 0 .smooth. or from"),
    (partial(facets, 1.5, 0.1, "gauss"), "Facets: distribution must be 'beckmann' or 'ggx'"),
    (partial(facets, 1.5, 0.1, "beckmann", False, True), "conserving gives back what facets hide from each other, and"),
    (partial(facets, 0.0, 0.1), "base: index must be n or n"),
    (partial(facets, (1.5, -1.0), 0.1), "base: index must be n or n.* n - ik of the other convention is n . ik here"),
    (partial(vrte.Interface, 1.0, 1.5, conserving=True), "interface: conserving is for facets"),
    (partial(vrte.Interface, 1.0, 20.0), "index_below must be a real refractive index from 0.1 to 10, not 20"),
    (partial(vrte.Interface, 1.0, 1.5j), "index_below must be a real number, not 1.5j"),
    (partial(SMOOTH.share, [0.0, 1.0]), "mu must satisfy 1e-8 <= mu <= 1"),
    (partial(SMOOTH.share, 60), "60 degrees have the cosine 0.5"),
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
    (vary([1.0], [0.0, 0.0]), "one a layer", P),
    (vary([np.nan], [0.0]), "finite", P),
    (vary([0.0], [0.0], coefficients=[np.eye(6)]), "cannot change", P),
    (vary([0.0], [0.0], coefficients=[np.zeros((2, 5))]), r"must be \(terms, 6\)", P),
    (vary([0.0], [0.0], is_outside=True), "scene_at", P),
]

GREY, PEAKED = layer(vrte.isotropic(), 0.9, 1.0), layer(vrte.henyey_greenstein(0.95, 300), 1, 1)
LEAF = mueller(make_leaf)


def brdf_of(scene: vrte.Scene, method: str, **how: Any) -> Any:
    return vrte.brdf(scene, 0.5, 0.5, method=method, **how)


def iterate(scene: vrte.Scene = SCENE, **how: Any) -> Any:
    return brdf_of(scene, "synthetic-iteration", **how)


HOW: list[Row] = [
    (partial(SKY.under, np.ones((3, 4, 4))), r"must have the shape \(2, 4, 4\), not \(3, 4, 4\)"),
    (partial(SKY.under, [np.nan, 0.0, 0.0, 0.0]), "incident light must be finite"),
    (partial(SKY.under, [-1.0, 0.0, 0.0, 0.0]), "must be light, I >= 0 and"),
    (partial(SKY.under, [1e101, 0.0, 0.0, 0.0]), "must be numbers of at most 1e.100 in size"),
    (partial(SKY.under, GREEN, [1.0]), "weights must be 2 numbers"),
    (partial(SKY.under, GREEN, transmitted=True), "no transmission here"),
    (partial(of_brdf, SKY, "f00", transmitted=True), "no transmission here"),
    (partial(of_brdf, SKY, "reflectance factor", (0, 0, 0, 0)), "intensity I above 0, not 0"),
    (partial(of_brdf, SKY, "I"), "a quantity must be one of f00, "),
    (partial(of_stokes, np.ones(4), "f00"), "a quantity must be one of I, Q, U, V"),
    (partial(of_stokes, np.ones(3), "I"), "along its last axis"),
    (vrte.brdf(SCENE, vrte.hemisphere(2)[0], MU, [0, 90], nodes=4).diffuse_reflectance, "phi all around"),
    (vrte.brdf(SCENE, [0.3, 0.8], MU, nodes=4).bihemispherical_reflectance, "weights are missing"),
    (partial(vrte.brdf, vrte.Scene([ONE], WHITE), MU, MU, illuminate="bottom"), "without a base"),
    (partial(vrte.radiance, vrte.Scene([ENDLESS]), 0.5, illuminate="bottom"), "needs a finite thickness"),
    (partial(brdf, illuminate="left"), "must be 'top', 'bottom', not 'left'"),
    (partial(vrte.brdf, ONE, 0.5, 0.5), r"scene must be a vrte.Scene, not an object of type Layer; vrte.Scene\("),
    (partial(vrte.brdf, SCENE, 30, 45), "as cosines do, not 30; 30 degrees have the cosine 0.866025"),
    (partial(vrte.brdf, SCENE, 0.5, np.array([0.5 + 1e-3j])), "mu_o must be real numbers"),
    (partial(vrte.brdf, SCENE, 0.5, np.ma.masked_array([0.5, 0.6], [0, 1])), "mu_o must be real numbers"),
    (partial(vrte.brdf, SCENE, 0.5, np.broadcast_to(0.5, 10**12)), "mu_o must be at most 100000000 numbers"),
    (partial(vrte.radiance, SCENE, 0.0), "mu0 must satisfy"),
    (partial(field, mu=[0.5, 1.5]), "mu must satisfy"),
    (partial(field, mu=[[]]), "mu must be"),
    (partial(field, phi=np.nan), "phi must be finite"),
    (partial(field, tau=2.0), "tau must lie between 0 and the total optical thickness 1"),
    (partial(field, tau=np.inf), "tau must be finite"),
    (partial(field, stokes=(1, 0, 0)), "stokes must be four"),
    (partial(field, stokes=(1, 0, np.nan, 0)), "stokes must be finite"),
    (partial(field, stokes=(1, 2, 0, 0)), r"stokes must be light, I >= 0 and I\^2 >= Q\^2 \+ U\^2 \+ V\^2: \["),
    (partial(field, stokes=(1, 0.8, 0.5, 0.4)), "stokes must be light"),
    (partial(field, stokes=(-1, 0, 0, 0)), "stokes must be light"),
    (partial(field, stokes=(0, 0, 0, 1e-3)), "stokes must be light"),
    (partial(BEAMS.beam, 1), "place must be one of 1 beams, from 0 on, not 1"),
    (partial(BEAMS.beam(0).beam, 0), "field of one beam"),
    (partial(vrte.views, SCENE, [0.3, 0.6, 1.0], [0.5, 0.6]), "must be of one length, a geometry each, not of 3, 2, 1"),
    (partial(vrte.views, SCENE, [0.5, -0.5], [0.5, 0.6]), "mu0 must satisfy"),
    (partial(brdf, transmission=1), "transmission must be True or False, not 1"),
    (partial(brdf, derivatives="layer[2].albedo"), "the scene has layer 1"),
    (partial(How, nodes=0), "^nodes must be a whole number from 1 to 4096, not 0", None),
    (partial(How, accuracy=1.0), "^accuracy must be between 1e-15 and 0.1, not 1.0", None),
    (partial(How, algorithm="magic"), "^algorithm must be 'auto', 'direct', 'modes', .*, not 'magic'", None),
    (partial(How, verify=1), "^verify must be True or False or 'photons', not 1", None),
    (partial(How, settings=3), "^settings must be a dictionary by names of settings, not 3", None),
    (partial(How, threads=0), "^threads must be a whole number from 1 to 4096, not 0", None),
    (partial(How, time_limit_s=-1), "^time_limit_s must be seconds, not -1", None),
    (partial(How, algorithm="modes", backend="opencl"), "^algorithm 'modes' needs an eigensolver", None),
    (partial(How, method=AUTO, nodes=8), "^method 'auto' takes no nodes: it goes by accuracy", None),
    (partial(How, method=AUTO, settings={"orders": 3}), "^method 'auto' takes no settings: it goes by accuracy", None),
    (partial(How, nodes=2.5), "^nodes must be a whole number", None),
    (partial(How, backend="cuda"), "^backend must be 'openmp', 'sequential', .*, not 'cuda'", None),
    (partial(brdf, backend="sequential", threads=2), "backend 'sequential' has one thread"),
    (partial(How, precision="half"), "^precision must be 'auto', 'double', 'single', not 'half'", None),
    (partial(How, precision="single"), "^precision 'single' is of .*: 'openmp' computes in doubles", None),
    (partial(How, precision="double", backend="opencl+lapack"), "^precision 'double' is of backend 'opencl'", None),
    (partial(How, precision="single", backend="opencl", accuracy=1e-5), "0.0001 .*, not 1e-05", "precision"),
    (partial(propagator, vrte.Scene([ONE], WHITE), nodes=6), "without a base"),
    (partial(propagator, vrte.Scene([ENDLESS]), nodes=6), "which end"),
    (partial(propagator, vrte.Scene([SMOOTH, ONE]), nodes=6), "in one medium"),
    *(
        (partial(brdf_of, vrte.Scene([GREY], LEAF), name), f"method '{name}' takes no base but a Lambertian one")
        for name in ("two-stream", "diffusion", "synthetic-iteration")
    ),
    (partial(field, tau=0.05, method="invariant-imbedding"), "takes no depth inside a layer"),
    (
        partial(brdf_of, vrte.Scene([PEAKED]), "two-stream", truncation="none"),
        "on one node an asymmetry of 0.95 .* ask",
    ),
    (partial(iterate, truncation="none"), "separates small angles: leave truncation out"),
    (partial(iterate, settings={"regular": "magic"}), "setting 'regular' of method 'synthetic-iteration' must be"),
    (partial(iterate, vrte.Scene([ENDLESS]), settings={"iterations": 2}), "needs layers that end"),
    (partial(vrte.load, 3), "path must be the name of a file, not 3"),
    (partial(vrte.paint, np.zeros(2)), "scene must be the name of a file, a dictionary by names or a Panel, not"),
    (partial(vrte.appearance, {}, geometries="45:0"), r"one alone is \['45:0'\]"),
    (lambda: make_scene_file(parse_toml('"a\\nb" = 1')), r"a\\nb"),
    (partial(parse_toml, "a" + ".a" * 5000 + " = 1"), "30 keys"),
    (partial(parse_toml, "nodes = " + "9" * 5000), "4000 digits"),
]

METAL_FLAKES = vrte.flakes(1.2 + 7.0j, tilt_deg=15.0, host_index=1.5)
TINTED_FLAKES = vrte.flakes(1.2 + 7.0j, wavelength_um=0.5, host_index=1.5 + 1e-4j)
POWDER = vrte.spheres(1.5, radius_um=0.05, wavelength_um=0.5)
flakes, fill_flakes, beside = vrte.flakes, partial(fill, METAL_FLAKES), partial(layer, vrte.isotropic(), 0.5, 1.0)
AREA = "flake_area of flakes alone is needed"

FLAKES: list[Row] = [
    (partial(flakes, tilt_deg=0.0), "flakes: tilt_deg must be from 0.5 to 60 degrees, not 0.0"),
    (partial(flakes, tilt_deg=61.0), "flakes: tilt_deg must be from 0.5 to 60 degrees, not 61.0"),
    (partial(flakes, "gold"), "flakes: index is that of a wavelength: give wavelength_um"),
    (partial(flakes, 1.5, host_index="water"), "flakes: host_index is that of a wavelength: give wavelength_um"),
    (partial(flakes, tilt_deg=3.0, tilts=([0.0, 9.0], [1.0, 0.0])), "give either tilt_deg or tilts"),
    (partial(flakes, tilts=([0.0, 99.0], [1.0, 0.0])), "tilts must have angles that ascend from 0 to 90"),
    (partial(flakes, tilts=([0.0, 9.0], [1.0, -0.1])), "tilts must have densities >= 0"),
    (partial(flakes, tilts=[1.0, 2.0, 3.0]), "tilts must be a pair"),
    (
        partial(flakes, 1.5, stack=[("silica", 0.3)]),
        "a stack of thin films is that of a wavelength: give wavelength_um",
    ),
    (partial(flakes, 1.5, stack=[("silica", 0.0)], wavelength_um=0.5), "thickness in stack must be above 0"),
    (partial(flakes, 1.5, stack=["silica"], wavelength_um=0.5), "stack must be pairs of a material and a thickness"),
    (partial(flakes, 1.5, stack=[("slica", 0.1)], wavelength_um=0.5), "stack: 'slica' is neither a known name"),
    (partial(flakes, "fabry-perot", stack=[(1.4, 0.1)], wavelength_um=0.5), "is that of 'fabry-perot' already"),
    (partial(flakes, "fabry-perot"), "index is that of a wavelength: give wavelength_um"),
    (partial(fill_flakes, flake_area=-1.0), "layer: flake_area must be an area >= 0"),
    (partial(fill_flakes, 2.0), "layer: thickness is that of particles, or beside them"),
    (fill_flakes, f"{AREA}, or volume_fraction"),
    (partial(fill_flakes, flake_area=1.0, volume_fraction=0.1), f"{AREA}, or"),
    (partial(fill_flakes, volume_fraction=0.1, thickness_um=9.0), AREA),
    (partial(fill_flakes, flake_area=1.0, thickness_um=9.0), "thickness_um is not used: the host is clear"),
    (partial(fill, TINTED_FLAKES, flake_area=1.0), "thickness_um is needed beside flake_area: the host absorbs"),
    (partial(fill, POWDER, 1.0, flake_area=1.0), "layer: give both of flakes and flake_area, or none"),
    (partial(fill, POWDER, 1.0, flakes=METAL_FLAKES, flake_area=1.0), "must be that of the medium of its flakes, 1.5"),
    (partial(beside, flake_area=1.0), "is that of flakes, and the layer has none"),
    (partial(beside, None, METAL_FLAKES, np.inf), "thickness must be 0 in a semi-infinite"),
    (partial(beside, 1.0, METAL_FLAKES, 1.0), "must be that of the medium of its flakes, 1.5"),
]

photons, carlo = partial(vrte.photons, photons=100), partial(vrte.brdf, mu_i=0.5, mu_o=0.5, method="monte-carlo")
EDGES, GREY_LAYER = " must be 2 to 1001 ascending numbers from 0 to ", layer(RAYLEIGH, 0.9, 1.0)
BEAM = partial(photons, SCENE, 0.5)

PHOTONS: list[Row] = [
    (partial(photons, SCENE, 0.0), "mu_i"),
    (partial(BEAM, photons=0), "photons must be a whole number from 1"),
    (partial(BEAM, seed=-1), "seed must be a whole number from 0"),
    (partial(BEAM, mu_edges=[0.0, 1.1]), f"mu_edges{EDGES}1"),
    (partial(BEAM, mu_edges=[0.5, 0.5]), f"mu_edges{EDGES}1"),
    (partial(BEAM, phi_edges=[0.0, 360.0]), f"phi_edges{EDGES}180"),
    (partial(BEAM, tau=2.0), "tau must lie between 0 and the total"),
    (partial(BEAM, illuminate="side"), "illuminate must be 'top', 'bottom', not 'side'"),
    (partial(BEAM, side="left"), "side must be 'above', 'below', not 'left'"),
    (partial(photons, vrte.Scene([ONE], WHITE), 0.5, illuminate="bottom"), "'bottom' needs a scene without a base"),
    (
        partial(BEAM, mu_edges=np.linspace(0, 1, 1001), phi_edges=np.linspace(0, 180, 1001)),
        "mu_edges and phi_edges must be fewer",
    ),
    (partial(carlo, vrte.Scene([SMOOTH, GREY_LAYER])), "takes no refracting or mirroring surface"),
    (
        partial(carlo, vrte.Scene([GREY_LAYER], vrte.RPV(0.2, 0.8, -0.1))),
        "takes no base but a Lambertian one",
    ),
    (partial(carlo, SCENE, nodes=8), "takes no nodes: it goes by its settings photons, seed"),
    (partial(carlo, SCENE, settings={"photons": 0}), "photons"),
    (partial(carlo, SCENE, verify="photons"), "takes no verify: it would compare photons"),
    (
        partial(carlo, vrte.Scene([layer(RAYLEIGH, 1.0, 500.0)]), settings={"photons": 10**9}, time_limit_s=60.0),
        "most of it for method 'monte-carlo'; fewer photons take less",
    ),
]

TWO, BROAD, VISIBLE = [0.5, 0.6], np.linspace(0.39, 0.73, 35), np.linspace(0.43, 0.66, 7)
FILM: dict[str, Any] = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
CLEAR: dict[str, Any] = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.1}
METAL = vrte.Facets((0.8, 6.0), roughness=0.02)


def panel(*layers: dict[str, Any], at: Any = TWO, **asked: Any) -> Panel:
    return make_panel({"layer": list(layers)}, at, **asked)


def film(albedo: float = 0.99, thickness: float = 4.0, at: Any = (0.55,)) -> Panel:
    """A film under a surface."""
    coating = {"phase": "isotropic", "albedo": albedo, "thickness": thickness}
    return panel({"interface": {"above": 1.0, "below": 1.5}}, coating, at=at, nodes=16)


def shine(*stack: Any, angle: float = 60.0, at: Any = VISIBLE, base: Any = None) -> float:
    """The gloss of an interface, or of none, over a base."""
    scene = vrte.Scene([*stack, EMPTY], base)
    return find_gloss(Panel(at, (scene,) * at.size, (0.0,), {"nodes": 8}), angle)


def colour(wavelengths: Any = BROAD, reflectance: Any = None, **light: Any) -> Any:
    return find_colour(wavelengths, np.full(np.size(wavelengths), 0.5) if reflectance is None else reflectance, **light)


def hide(thickness: float = 2.0, **seen: Any) -> Any:
    return find_hiding(panel(FILM | {"thickness": thickness}, at=VISIBLE, nodes=4, layer=1), Conditions(**seen))


fluxes, slab, pair, geometry = find_kubelka_munk, km.find_slab_coefficients, km.find_coefficients, read_geometry
APPEARANCE: list[Row] = [
    # geometries; d/0 with a gloss trap or without: who means it says SCI or SCE
    (partial(geometry, "45/5a"), "must be a geometry such as '45:0'.*'d/8', '8/d', 'SCI', 'SCE', '45/0', '45a:0', "),
    *((partial(geometry, name), "must be a geometry such as '45:0'") for name in ("d/0", "d", "", 45, "di:de")),
    (partial(geometry, "8:8"), "looks along the mirrored beam.*ask for gloss"),
    (partial(geometry, "45:as0"), "looks along the mirrored beam"),
    (partial(geometry, "90:0"), "has an angle of 90 degrees: must be below 90"),
    (partial(geometry, "45:as150"), "has an angle of -105 degrees"),
    # panels
    (lambda: panel(FILM, FILM).film, "which layer is the film.*Say layer=1 to 2"),
    (partial(panel, FILM, layer=2), "layer must be"),
    (partial(make_panel, {"layer": [FILM], "illuminate": "bottom"}, TWO), "a panel is looked at from above"),
    (partial(panel, FILM, mu_i=0.5), "mu_i is not asked for here"),
    (partial(panel, FILM | {"thickness": -1.0}), r"at 0.5 um: layer\[1\].thickness"),
    (lambda: make_panel(panel(FILM), TWO), "a panel has its own"),
    (lambda: panel(FILM).make_as_thick(3.0), "is given by its optical thickness: give it a thickness_um"),
    (lambda: panel(FILM | {"thickness": math.inf}).scale_film(2.0), "semi-infinite, and can be made no thicker"),
    # colours; a lamp of ISO 7589 is known to 560 nm
    (partial(colour, np.linspace(0.45, 0.70, 20)), "47 % of Z .* below 0.45 µm, where at most 20 %.* begin at 0.434"),
    (partial(colour, np.linspace(0.40, 0.60, 20)), "32 % of X .* above 0.6 µm, where at most 5 %.* end at 0.642 µm or"),
    (partial(colour, np.linspace(0.40, 0.70, 6)), "at most 0.04 µm apart from 0.4 to 0.7 µm, not 0.06 as between 0.64"),
    (partial(colour, np.linspace(400.0, 700.0, 31)), "100 % of X .* below 400 µm"),
    (partial(colour, [0.55]), "must cover the visible"),
    (partial(colour, np.linspace(0.70, 0.40, 31)), "must rise from each to the next"),
    (partial(colour, [0.4, np.nan]), "must be finite"),
    (partial(colour, illuminant="F11"), "illuminant must be one of A, B, C, D50, .*, not 'F11'; did you mean 'FL11'"),
    (partial(colour, illuminant="ISO 7589 Sensitometric Printer"), "illuminant must be one of"),
    (partial(colour, illuminant=["D65"]), "illuminant must be a name"),
    (partial(colour, observer=5), "observer must be 2 or 10"),
    (partial(colour, observer="two"), "observer must be a whole number"),
    (partial(colour, reflectance=np.full(34, 0.5)), "one number a wavelength, 35, not 34"),
    (partial(colour, reflectance=np.linspace(-0.1, 0.5, 35)), "reflectance must be numbers >= 0, not -0.1"),
    # hiding
    (partial(hide, black=0.8), "black must be darker than the white, not 0.8 beside 0.8"),
    (partial(hide, white=1.1), "white must be an albedo from 0 to 1"),
    (partial(hide, target=1.0), "target must be a contrast ratio above 0 and below 1"),
    (partial(hide, math.inf), "the film is semi-infinite"),
    (partial(hide, 0.0), "the film is without thickness"),
    # apertures and gloss
    (partial(collect_mirrored, SMOOTH, math.cos(math.radians(87.0)), Round(10.0)), "reaches 5 degrees from its axis"),
    (partial(Round, 0.0), r"aperture: diameter_deg must be an angle from 0.001 to 180 degrees, not 0"),
    (partial(Rectangular, 1.0, 180.0), r"aperture: across_deg must be an angle from 0.001 to 170 degrees, not 180"),
    (partial(shine, base=WHITE), "gloss needs a surface"),
    (partial(shine, SMOOTH, angle=75.0), "must be one of 20, 60, 85 degrees"),
    (partial(shine, vrte.Interface(1.33, 1.5)), "gloss is read in air"),
    (partial(shine, SMOOTH, base=METAL, angle=20.0), "has a peak in the receptor"),
    (partial(shine, SMOOTH, at=VISIBLE[:1]), "wavelength"),
    # Kubelka and Munk
    (partial(pair, 0.5, 0.5, 0.8, 1.0), "over_base must be above over_black"),
    (partial(pair, 0.5, [0.6, 0.4], 0.8, 1.0), r"not 0\.4 \(at place 1\)"),
    (partial(pair, 0.1, 0.9, 0.8, 1.0), "keeps no light"),
    (partial(pair, 0.1, 0.2, 0.0, 1.0), "base must be above 0"),
    (partial(pair, -0.1, 0.2, 0.8, 1.0), "over_black must be a share of light"),
    (partial(pair, 0.1, np.nan, 0.8, 1.0), "over_base must be a share of light"),
    (partial(pair, 0.1, 0.2, 0.8, 0.0), "length must be above 0"),
    (partial(slab, 0.6, 0.5, 1.0), "must be 1 together at most, not 1.1"),
    (partial(slab, 0.6, 0.0, 1.0), "K/S alone"),
    (partial(km.reflect_film, -1.0, 1.0, 1.0), "K must be from 0"),
    (partial(km.reflect_film, 1.0, np.inf, 1.0), "S must be from 0"),
    (partial(km.reflect_film, 1.0, 1.0, -1.0), "length must be 0 or above"),
    (partial(km.remove_surface, 0.03, 0.04, 0.6), "measured must not be below k1"),
    (partial(km.add_surface, 0.5, 0.04, 1.0), "k2 must be below 1"),
    (lambda: fluxes(film(), geometry="45:0"), "must collect all light"),
    (lambda: fluxes(film(), geometry="8:de"), "must collect all light"),
    (lambda: fluxes(film(), white=0.0), "white must be an albedo above 0"),
    (lambda: fluxes(film(), k2=[0.6, 0.6]), "k2 must be one number, or one a wavelength"),
    (lambda: fluxes(film(), geometry="inside", k2=0.6), "are of a surface, and here is none"),
    (lambda: fluxes(film(), k1=0.5), "no film of two fluxes reads so: measured must not be below k1"),
    (lambda: fluxes(film(1.0), geometry="di:di"), "must not be above what a film that keeps"),
    (lambda: fluxes(film(0.5, 30.0)), r"hides its base at 0\.55 um"),
    (lambda: fluxes(film(0.5, np.inf)), "one film that ends"),
    (lambda: fluxes(panel(CLEAR, FILM)), "no other layer"),
    (lambda: fluxes(film()).compare([0.0]), "lengths must be above 0"),
    # measurements
    (partial(vrte.Measurement, "total_reflectance", 52.0, 0.5, theta_i_deg=8.0), "52 is above 1, .* per cent"),
]


def reflect(thickness: float = 1.0) -> vrte.Scene:
    return vrte.Scene([vrte.Layer(RAYLEIGH, 0.95, thickness)], vrte.Lambertian(0.3))


ROWS = vrte.Measurement("f00", 0.0, theta_i_deg=40.0, theta_o_deg=[-60.0, -30.0, 0.0])
BEAMS, THROUGH = (
    vrte.Measurement(f"{kind}", 0.1, 0.01, theta_i_deg=[0.0, 60.0])
    for kind in ("specular_reflectance", "total_transmittance")
)
AT_WAVELENGTHS = vrte.Measurement("reflectance", 0.1, geometry="8:di", wavelength_um=[0.5, 0.6])


def fit(rows: Any = ROWS, scene: Any = None, free: Any = ("base.albedo",), **how: Any) -> Any:
    return partial(vrte.fit, rows.measure(0.1, 0.01), scene or reflect(), free, nodes=4, **how)


def start(**albedo: Any) -> Any:
    return fit(free={"base.albedo": albedo})


FITS: list[Row] = [
    (fit(scene=reflect(np.inf)), r"base\.albedo"),
    (fit(THROUGH, reflect(np.inf), ["layer[1].albedo"]), "nothing comes out below a semi-infinite "),
    (fit(BEAMS), r"free: base\.albedo does nothing to these data"),
    (fit(AT_WAVELENGTHS), "knows no wavelength"),
    (start(start=0.5, high=0.4), "starts at 0.5, outside its bounds 0 and 0.4"),
    (start(low=0.5, high=0.4), "needs low below high"),
    (start(strat=0.5), r"takes its bounds, \[low, high\], or a table of start, low, high, spacing"),
    (start(spacing="even"), "has spacing 'linear' or 'log', not 'even'"),
    (start(start=np.inf), "needs a number as start"),
    (start(low=-1.0, spacing="log"), "with spacing 'log' needs a start above 0"),
    (fit(free={"base.albedo": {"low": 0.0}}, bounds={"base.albedo": (0.0, 1.0)}), "has bounds twice"),
    (fit(ROWS.pick([0, 1]), free=["layer[1].thickness", "layer[1].albedo", "base.albedo"]), "too few"),
    (fit(free=[]), "free must be one or more names"),
    (fit(free=["layer[3].thickness"]), r"free: layer\[3\].thickness: there is no such layer"),
    (fit(free=["layer[1].thickness"], starts=3), "needs finite bounds"),
    (fit(bounds={"base.albedo": 0.5}), "needs two numbers, low and high"),
    (fit(bounds={"base": (0.3, 0.5)}), "bounds: base is not free"),
    (fit(priors={"base.albedo": (0.3, 0.0)}), "a standard deviation above 0"),
    (fit(priors={"base.albedo": 0.3}), "needs a mean and a standard deviation"),
    (fit(priors={"base": (0.3, 0.1)}), "priors: base is not free"),
    (fit(loss="huber"), "loss must be"),
    (fit(wavelengths_um=[0.5]), "wavelengths_um are of colours"),
]


@pytest.mark.parametrize(
    "row",
    [*OPTICS, *TABLES, *PARTICLES, *SCENES, *HOW, *FLAKES, *PHOTONS, *APPEARANCE, *FITS],
    ids=lambda row: row[1][:50],
)
def test_it_is_refused_in_one_sentence(row: Row) -> None:
    call, words, *place = row
    with pytest.raises(vrte.SceneError, match=words) as caught:
        call()
    assert str(caught.value).isprintable()
    for expected in place:
        first = words.strip("^").split()[0] if expected is None else expected
        assert caught.value.place == ((first,) if isinstance(first, str) else first)


RUTILE = {"paint": {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 40.0}}
PAINTS = [
    ({"scene": RUTILE, "wavelengths_um": [0.5, 0.55, 0.6]}, "wavelengths_um must cover the visible"),
    ({"scene": RUTILE, "wavelengths_um": [0.4, 0.5, 0.6, 0.7]}, "must be at most .* apart"),
    ({"scene": RUTILE, "wavelengths_um": np.linspace(0.43, 0.85, 12)}, "a wavelength of 0.85 um is outside"),
    ({"scene": RUTILE, "white": 2.0}, "white must be an albedo from 0 to 1"),
    ({"scene": RUTILE, "binder": "alkyd"}, "give either a scene file, or pigment, binder"),
    ({}, "give either a scene file"),
]


@pytest.mark.parametrize(("given", "words"), PAINTS)
def test_paints_are_refused_before_particles_are_made(given: Any, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[make_panel.__module__], "run_side_by_side", lambda *_: pytest.fail("worked"))
    with pytest.raises(vrte.SceneError, match=words):
        vrte.paint(**given)
