"""Geometries of instruments, by the names that CIE 15 gives them: light in, a colon, what is collected.

A reading is a reflectance factor: what is collected over what the perfect white diffuser would send to the same place,
so that an even white panel reads 1 in every geometry. Light is unpolarized where nothing else is said, and then
illumination and collection may be exchanged, for the exact BRDF is reciprocal.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.appearance.apertures import Round, collect_mirrored, project_solid_angle
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number, show_value
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.results.field import Field
from vrte.results.spectrum import Spectrum
from vrte.scene.illumination import hemisphere
from vrte.scene.interface import Interface

NODES = 16  # of the quadrature over an even sky: doubled, readings of paints move by 2e-10 at most
SAME = 1e-9  # of cosines, of degrees
PORT_DEG = 10.0  # full angle of a specular port: the 5 degrees around the mirrored beam that CIE 15 speaks of
MULTI_ANGLE = "45:as15", "45:as25", "45:as45", "45:as75", "45:as110"
METAL_FLAKE = "45:as15", "45:as45", "45:as110"  # the three that ASTM E2194 asks for
STANDARD_GEOMETRIES = "8:di", "8:de", "di:di", "45:0", "0:45", *MULTI_ANGLE
ALLOWED = (
    "a geometry such as '45:0', '8:di' (diffuse, surface's mirror image included), '8:de' (excluded), 'di:8', 'di:di', "
    "'45:as15' (15 degrees off the mirrored beam, towards the light), or as laboratories write it: 'd/8', '8/d', "
    "'SCI', 'SCE', '45/0', '45a:0', '45x:0'"
)
NUMBER = r"\d+(?:\.\d+)?"
DIRECTION = re.compile(rf"({NUMBER}):(as)?(-?{NUMBER})")
# a sphere, d, whose specular component is included, if nothing else is said of light or eye at 8 degrees, or excluded
SPHERE = re.compile(rf"(?=.)(?:d:({NUMBER})|({NUMBER}):d)?(sci|spin|sce|spex)?")
# light or eye all around (a), at several azimuths (c), at one (x): along the normal all read the same
AROUND = re.compile(rf"({NUMBER})[acx]:0|0:({NUMBER})[acx]")
HEMISPHERE = re.compile(rf"({NUMBER}):(di|de)|(di|de):({NUMBER})|(di):(di)")


@dataclass(frozen=True)
class Geometry:
    """Angles [degrees] from the normal of the light, None for even light from all sides, and of what is seen, below 0
    on the side of the light, None where all is collected; ``excluded``: without the specular port."""

    name: str
    angle_i: float | None
    angle_o: float | None
    excluded: bool = False

    @property
    def words(self) -> str:
        """The geometry in a sentence."""
        return f"the geometry {self.name!r}"

    @property
    def definition(self) -> str:
        """The quantity that is read, in words."""
        if self.angle_i is None:
            return "bihemispherical reflectance: even light from all sides, all that comes back"
        if self.angle_o is None:
            without = "without what goes out of the specular port" if self.excluded else "the mirrored beam included"
            return f"hemispherical reflectance of light at {self.angle_i:g} degrees, {without}"
        sides = ", on the side of the light", "", ", on the side of the mirrored beam"
        side = sides[1 + int(np.sign(self.angle_o))]
        return f"reflectance factor, light at {self.angle_i:g} degrees, seen at {abs(self.angle_o):g} degrees{side}"

    @property
    def standard(self) -> str:
        """The standards that define the geometry."""
        if self.angle_i is None:
            return "CIE 15, di:di; CIE S 017, reflectance (17-24-064)"
        if self.angle_o is None:
            return "CIE 15; ASTM E1331"
        if {self.angle_i, abs(self.angle_o)} == {45.0, 0.0} and ":as" not in self.name:
            return "CIE 15; ASTM E1349"
        if self.name not in MULTI_ANGLE:
            return "CIE 15, bidirectional"
        flake = "ASTM E2194 (metal flake); " if self.name in METAL_FLAKE else ""
        return f"{flake}ASTM E2539 (interference pigments); DIN 6175-2"

    @property
    def reading(self) -> tuple[Any, ...]:
        """The same for all geometries that read the same: others' names, and light and eye exchanged."""
        if self.angle_i is None or self.angle_o is None:
            return self.angle_i, self.angle_o, self.excluded
        same_side = self.angle_i * self.angle_o < 0.0
        return (*sorted((self.angle_i, abs(self.angle_o))), same_side)

    @property
    def collects(self) -> bool:
        """Whether all light is collected: fluxes tell what is read."""
        return self.angle_o is None and not self.excluded

    @property
    def lights(self) -> tuple[Array, Array, Array]:
        """Cosines of incidence and exit and azimuths [degrees] of `Panel.light`: no exit where fluxes do."""
        mu_i, mu_o, phi = self.directions
        return mu_i, mu_o[: 0 if self.collects else None], phi

    @property
    def directions(self) -> tuple[Array, Array, Array]:
        """Cosines of incidence and exit and azimuths [degrees] that `vrte.brdf` has to be asked for."""
        if self.angle_i is None:
            return hemisphere(NODES)[0], np.ones(1), np.zeros(1)
        mu_i = find_cosine(self.angle_i)
        if self.angle_o is None:
            return np.array([mu_i]), np.array([mu_i if self.excluded else 1.0]), np.zeros(1)
        phi = 0.0 if self.angle_o >= 0.0 else 180.0
        return np.array([mu_i]), np.array([find_cosine(self.angle_o)]), np.array([phi])


def find_cosine(degrees: float) -> float:
    """Of an angle from the normal."""
    return math.cos(math.radians(degrees))


def read_geometry(name: Any) -> Geometry:
    """A geometry by its name. Raises SceneError for another."""
    if isinstance(name, Geometry):
        return name
    text = translate_name(name) if isinstance(name, str) else ""
    if found := HEMISPHERE.fullmatch(text):
        if found[5]:
            return Geometry("di:di", None, None)
        angle, way = float(found[1] or found[4]), found[2] or found[3]
        return Geometry(text, check_angle(name, angle), None, way == "de")
    if found := DIRECTION.fullmatch(text):
        angle_i, angle_o = float(found[1]), float(found[3])
        if found[2]:  # counted from the mirrored beam towards the light
            angle_o = angle_i - angle_o
        if angle_i == angle_o:
            words = "looks along the mirrored beam, which has no radiance: ask for gloss"
            raise SceneError.of("geometry", f"{show_value(name)} {words}")
        return Geometry(text, check_angle(name, angle_i), check_angle(name, angle_o))
    raise SceneError.of("geometry", f"must be {ALLOWED}, not {show_value(name)}")


def translate_name(name: str) -> str:
    """CIE's name of a geometry that a laboratory may write otherwise; any other text without blanks, in lower case."""
    text = re.sub(r"[°\s(),]", "", name).lower().replace("/", ":")
    if found := AROUND.fullmatch(text):
        return f"{found[1]}:0" if found[1] else f"0:{found[2]}"
    found = SPHERE.fullmatch(text)
    if not found or not (found[3] or float(found[1] or found[2]) == 8.0):
        return text
    way = "de" if found[3] in ("sce", "spex") else "di"
    return f"{found[2]}:{way}" if found[2] else f"{way}:{found[1] or 8}"


def check_angle(name: Any, angle: float) -> float:
    """An angle from the normal, on either side."""
    if not abs(angle) < 90.0:
        raise SceneError.of("geometry", f"{show_value(name)} has an angle of {angle:g} degrees: must be below 90")
    return angle


@dataclass(frozen=True, eq=False)
class Seen:
    """What becomes of unpolarized light at some wavelengths: Stokes vectors (wavelength, n_in, n_out, n_phi, 4) [1/sr]
    of diffuse light over the irradiance, from cosines mu_i (n_in,) into mu_o (n_out,) at azimuths phi (n_phi,)
    [degrees]; the shares of it that go up diffuse and mirrored (wavelength, n_in)."""

    mu_i: Array
    mu_o: Array
    phi: Array
    stokes: Array
    diffuse: Array
    mirrored: Array


def see_spectrum(spectrum: Spectrum) -> Seen:
    """What BRDFs make of unpolarized light."""
    diffuse, mirrored = spectrum.reflectance, spectrum.specular_reflectance
    mirrored = np.zeros_like(diffuse) if mirrored is None else mirrored
    stokes = np.stack([one.mueller[..., 0] for one in spectrum])
    return Seen(spectrum.mu_i, spectrum.mu_o, spectrum.phi, stokes, diffuse, mirrored)


def see_fields(fields: Sequence[Field]) -> Seen:
    """Fields above a panel, of several unpolarized beams each."""
    first = fields[0]
    mu_i = np.atleast_1d(first.mu0)
    stokes = np.stack([one.stokes[:, 0] for one in fields]) / mu_i[:, None, None, None]
    diffuse = np.stack([one.flux_up[:, 0] for one in fields]) / mu_i
    mirrored = np.stack([np.zeros_like(mu_i) if one.direct_up is None else one.direct_up[:, 0] for one in fields])
    return Seen(mu_i, first.mu, first.phi, stokes, diffuse, mirrored / mu_i)


def find_light(seen: Seen, geometry: Any) -> Array:
    """Stokes vectors (wavelength, 4) seen in a bidirectional geometry, pi radiance over irradiance. Raises SceneError
    for another geometry, and for directions that are not there."""
    known = read_geometry(geometry)
    if known.angle_o is None:
        raise SceneError.of("geometry", f"{known.name!r} collects light from all sides, which has no polarization here")
    return np.pi * pick_light(seen, known)


def find_reflectance(
    spectrum: Spectrum | Seen, geometry: Any, surface: Sequence[Interface | None] = (), port_deg: float = PORT_DEG
) -> Array:
    """The reflectance factor (wavelength,) that an instrument reads; a port of ``port_deg`` [degrees] needs the panel's
    ``surface`` at each wavelength where it is rough. Raises SceneError for directions that the spectrum lacks."""
    known, seen = read_geometry(geometry), spectrum if isinstance(spectrum, Seen) else see_spectrum(spectrum)
    if known.angle_o is not None:
        return find_light(seen, known)[:, 0]
    mu_i = known.directions[0]
    incident = [find_place("mu_i", seen.mu_i, mu, known.words) for mu in mu_i]
    if known.excluded:
        return leave_out_port(seen, known, incident[0], surface, port_deg)
    total = (seen.diffuse + seen.mirrored)[:, incident]
    return 2.0 * total @ (hemisphere(NODES)[1] * mu_i) if known.angle_i is None else total[:, 0]


def leave_out_port(
    seen: Seen, geometry: Geometry, index: int, surface: Sequence[Interface | None], port_deg: float
) -> Array:
    """Hemispherical reflectance factors (wavelength,) of an ``index`` without a port around the mirrored beam."""
    check_number("port_deg", port_deg, 0.001, 60.0, "from 0.001 to 60, the full angle of a port [degrees]")
    assert geometry.angle_i is not None
    mu_i, there = float(seen.mu_i[index]), pick_light(seen, geometry)[:, 0]
    own = np.array([find_own_light(one, mu_i, port_deg) for one in surface or [None] * there.size])
    found: Array = subtract_port(seen.diffuse[:, index], there, own, geometry.angle_i, port_deg)
    return found


def find_own_light(surface: Interface | None, mu_i: float, port_deg: float) -> Array:
    """What a rough surface itself sends back (2,): along the mirrored beam [1/sr], and through a port around it."""
    if surface is None or surface.is_smooth:
        return np.zeros(2)
    there = surface.facets.reflect(*np.array([[mu_i], [mu_i], [0.0]]))[0, 0, 0]
    return np.array([float(there), collect_mirrored(surface, mu_i, Round(port_deg))])


def subtract_port(total: Any, there: Any, own: Array, angle_i: float, port_deg: float) -> Any:
    """A hemispherical reflectance ``total`` (...) without what goes out of a port: the surface's ``own`` (..., 2), and
    light from inside, as even as along the mirrored beam, where f is ``there`` (...) [1/sr]."""
    seen = project_solid_angle(Round(port_deg), angle_i)
    return (total - (there - own[..., 0]) * seen - own[..., 1]) / (1.0 - seen / np.pi)


def pick_light(seen: Seen, geometry: Geometry) -> Array:
    """The Stokes vectors (wavelength, 4) [1/sr] of a geometry's one pair of directions."""
    mu_i, mu_o, phi = (float(values[0]) for values in geometry.directions)
    i, o = (find_place(name, getattr(seen, name), mu, geometry.words) for name, mu in (("mu_i", mu_i), ("mu_o", mu_o)))
    turned = find_place("phi", seen.phi, phi, geometry.words) if mu_o < 1.0 else 0
    return seen.stokes[:, i, o, turned]


def find_place(name: str, values: Array, wanted: float, reading: str) -> int:
    """The index of a direction that a reading takes among those of a BRDF. Raises SceneError where it is missing."""
    index = int(np.abs(values - wanted).argmin())
    if abs(values[index] - wanted) > SAME * (360.0 if name == "phi" else 1.0):
        raise SceneError(
            f"{reading} needs {name} = {wanted:.10g}, and the nearest that was solved for is {values[index]:.10g}: ask "
            "for it, or give the scene in place of its spectrum"
        )
    return index


def measure_panel(panel: Panel, geometry: Any, progress: Progress | None = None) -> Array:
    """The reflectance factor (wavelength,) that an instrument reads off a panel, of one solve."""
    known = choose_way(geometry)
    return find_reflectance(see_fields(panel.light(*known.lights, progress)), known, panel.surface)


def choose_way(geometry: Any) -> Geometry:
    """The geometry, or that with light and eye exchanged, which reads the same, where the eye looks along the normal:
    unpolarized light along the normal takes one Fourier order."""
    known = read_geometry(geometry)
    return replace(known, angle_i=known.angle_o, angle_o=known.angle_i) if known.angle_o == 0.0 else known


def solve_geometries(
    panel: Panel, geometries: Sequence[Any], port_deg: float = PORT_DEG, progress: Progress | None = None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Reflectance factors (wavelength,) by geometry, and Stokes vectors (wavelength, 4) of those that look along one
    direction. Those that collect all share a solve, which takes one Fourier order, and those that do not share one."""
    known = {one.name: one for one in map(read_geometry, geometries)}
    collecting = [one for one in known.values() if one.collects]
    groups = [group for group in (collecting, [one for one in known.values() if not one.collects]) if group]
    reflectances: dict[str, Array] = {}
    light: dict[str, Array] = {}
    for index, group in enumerate(groups):
        mu_i, mu_o, phi = (np.unique(np.concatenate(each)) for each in zip(*(one.lights for one in group), strict=True))
        seen = see_fields(panel.light(mu_i, mu_o, phi, share_progress(progress, index, len(groups))))
        for one in group:
            reflectances[one.name] = find_reflectance(seen, one, panel.surface, port_deg)
            if one.angle_o is not None:
                light[one.name] = find_light(seen, one)
    return {name: reflectances[name] for name in known}, {name: light[name] for name in known if name in light}
