"""Geometries of instruments, by the names that CIE 15 gives them: light in, a colon, what is collected.

A reading is a reflectance factor: what is collected over what the perfect white diffuser would send to the same place,
so that an even white panel reads 1 in every geometry. Light is unpolarized where nothing else is said, and then
illumination and collection may be exchanged, for the exact BRDF is reciprocal.

Receptors have finite apertures around the mirror direction. Light falls in at an angle t in the plane x, z and would be
mirrored along a = (sin t, 0, cos t), the axis of the receptor. With e_1 = (cos t, 0, -sin t), e_2 = (0, 1, 0) a
direction of the receptor is d = x e_1 + y e_2 + z a. A source's extent is given by its mirror image: the same three
numbers, so that a smooth surface images one on the other.

    share = (1/S) int_source dOmega int_receptor f(-d', d) (d . n) dOmega,    S = int_source dOmega

Lobes are 2 alpha wide in the plane of incidence and 2 alpha cos t across it. Quadrature is Gauss's on panels that begin
with half of that on either side of the mirrored beam and double: a Gaussian falls as fast as panels grow, and the poles
of GGX's tails at i alpha are as far from each panel as it is long, so that errors fall exponentially with the points.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_cosines, check_fields, check_number, check_whole, show_value
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Progress, share_progress
from vrte.optics.facet_energy import restore_lost
from vrte.results.brdf import Spectrum
from vrte.results.field import Field
from vrte.scene.illumination import hemisphere
from vrte.scene.interface import Interface

POINTS, MOST_POINTS = 8, 64  # of a panel; half as many of what has no peak
SOURCE_POINTS = 4  # of half a source, either way: it is smaller than its receptor, and 3e-6 of a share is left out
AXIS, EVEN = np.array([0.0, 0.0, 1.0]), (math.inf, math.inf)  # of a receptor; widths of light that has no peak


def limit_opening(most: float) -> tuple[float, float, str]:
    """The limits of a full angle [deg], and what they are in words."""
    return 1e-3, most, f"an angle from 0.001 to {most:g} degrees"


@dataclass(frozen=True)
class Rectangular:
    """A rectangular stop in the focal plane of a lens, by the full angles [deg], at most 170, that it opens in the
    plane of incidence and across; it is 2 tan(angle/2) focal lengths wide (ASTM D523, from memory)."""

    in_plane_deg: float
    across_deg: float

    def __post_init__(self) -> None:
        check_fields("aperture: ", self, dict.fromkeys(("in_plane_deg", "across_deg"), limit_opening(170.0)))

    @property
    def reach_deg(self) -> float:
        """The angle [deg] from the axis to the edge in the plane of incidence."""
        return 0.5 * self.in_plane_deg

    @property
    def half(self) -> Array:
        """Half of the sides over the focal length (2,)."""
        return np.tan(0.5 * np.radians([self.in_plane_deg, self.across_deg]))

    def aim(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Directions (x, y, z) (..., 3) at s, t from -1 to 1, and the solid angle dOmega/(ds dt) there."""
        (x, y), (broad, high) = (s * self.half[0], t * self.half[1]), self.half
        size = np.sqrt(1.0 + x**2 + y**2)
        return np.stack([x, y, np.ones_like(x)], -1) / size[..., None], broad * high / size**3

    def locate(self, direction: Array) -> tuple[float, float]:
        """The coordinates s, t of a direction (3,), beyond -1 and 1 outside."""
        s, t = direction[:2] / direction[2] / self.half
        return float(s), float(t)

    def scale(self, width: float, height: float) -> tuple[float, float]:
        """Angles [rad] near the axis as s and t."""
        return width / self.half[0], height / self.half[1]


@dataclass(frozen=True)
class Round:
    """A round receptor, the port of a sphere or a stop, by the full angle [deg] of its diameter, at most 180."""

    diameter_deg: float

    def __post_init__(self) -> None:
        check_fields("aperture: ", self, {"diameter_deg": limit_opening(180.0)})

    @property
    def reach_deg(self) -> float:
        """The angle [deg] from the axis to the edge."""
        return 0.5 * self.diameter_deg

    @property
    def radius(self) -> float:
        """Radius of the stereographic image, tan of a quarter of the angle: smooth up to a hemisphere."""
        return math.tan(0.5 * math.radians(self.reach_deg))

    def aim(self, s: Array, t: Array) -> tuple[Array, Array]:
        """Directions (x, y, z) (..., 3) at s, t from -1 to 1, and the solid angle dOmega/(ds dt) there."""
        turned, r = 0.5 * np.pi * s, self.radius
        x, y = r * np.sin(turned), r * np.cos(turned) * t
        size = 1.0 + x**2 + y**2
        direction = np.stack([2.0 * x, 2.0 * y, 2.0 - size], -1) / size[..., None]
        return direction, 2.0 * np.pi * (r * np.cos(turned) / size) ** 2

    def locate(self, direction: Array) -> tuple[float, float]:
        """The coordinates s, t of a direction (3,), clipped to where there are any."""
        x, y = direction[:2] / (1.0 + direction[2]) / self.radius
        chord = math.sqrt(max(1.0 - float(x) ** 2, 1e-12))
        return 2.0 / math.pi * math.asin(min(max(float(x), -1.0), 1.0)), float(y) / chord

    def scale(self, width: float, height: float) -> tuple[float, float]:
        """Angles [rad] near the axis as s and t."""
        return width / (math.pi * self.radius), height / (2.0 * self.radius)


Receptor = Rectangular | Round


def check_in_view(receptor: Receptor, angle_deg: float) -> None:
    """Whether all of a receptor is above the surface. Raises SceneError."""
    if angle_deg + receptor.reach_deg > 90.0 + 1e-9:
        words = f"reaches {receptor.reach_deg:g} degrees from its axis at {angle_deg:g}: below the surface's horizon"
        raise SceneError.of("aperture", words)


def project_solid_angle(receptor: Receptor, angle_deg: float) -> float:
    """The integral [sr] of cos(theta) over a receptor at ``angle_deg``. Raises SceneError below the horizon."""
    check_in_view(receptor, angle_deg)
    s, t, weights = make_rule(receptor, AXIS, EVEN, 2 * POINTS)
    direction, density = receptor.aim(s, t)
    return float((weights * density) @ turn_up(direction, math.radians(angle_deg))[:, 2])


def collect_mirrored(
    interface: Interface, mu_i: float, receptor: Receptor, source: Rectangular | None = None, points: int = POINTS
) -> float:
    """The share of an unpolarized beam that a surface by itself sends into a receptor around the mirror direction, from
    a ``source`` of that extent, by ``points`` a panel. Raises SceneError below the horizon."""
    angle_deg = math.degrees(math.acos(check_cosines("mu_i", mu_i).item()))
    check_in_view(receptor, angle_deg)
    if source is not None:
        check_in_view(source, angle_deg)
    return integrate_share(interface, angle_deg, receptor, source, check_whole("points", points, 2, MOST_POINTS))


@lru_cache(maxsize=1024)
def integrate_share(
    interface: Interface, angle_deg: float, receptor: Receptor, source: Rectangular | None, points: int
) -> float:
    """The integral of `collect_mirrored`, kept for surfaces that are the same at many wavelengths."""
    angle = math.radians(angle_deg)
    beams = [(AXIS, 1.0)] if source is None else list_beams(source)
    mirrored = [turn_up(beam, angle) for beam, _ in beams]
    if interface.is_smooth:
        shares = interface.share([min(float(up[2]), 1.0) for up in mirrored])[0]
        return float(shares @ [weight for _, weight in beams])
    once = replace(interface.facets, conserving=False)
    widths = receptor.scale(interface.roughness, interface.roughness * math.cos(angle))  # half of a lobe's
    found = 0.0
    for (beam, weight), up in zip(beams, mirrored, strict=True):
        s, t, weights = make_rule(receptor, beam, widths, points)
        direction, density = receptor.aim(s, t)
        out = turn_up(direction, angle)
        mu_o = np.clip(out[:, 2], 1e-9, 1.0)
        azimuth = np.degrees(np.arctan2(out[:, 1], out[:, 0]) - math.atan2(up[1], up[0]))
        f = once.reflect(min(float(up[2]), 1.0), mu_o, azimuth)[:, 0, 0]
        found += weight * float((weights * density * mu_o) @ f)
    if interface.conserving:  # even but for the cosines, and slow
        s, t, weights = make_rule(receptor, AXIS, EVEN, points // 2)
        direction, density = receptor.aim(s, t)
        mu_o = np.clip(turn_up(direction, angle)[:, 2].round(12), 1e-9, 1.0)  # alike on both sides
        restored = restore_lost(interface.facets, np.array(math.cos(angle)), mu_o, False)[:, 0, 0]
        found += float((weights * density * mu_o) @ restored)
    return float(found)


def list_beams(source: Rectangular) -> list[tuple[Array, float]]:
    """Directions (3,) of an evenly bright source and their shares of its light; of two equal halves the first."""
    s, t, weights = make_rule(source, AXIS, EVEN, SOURCE_POINTS)
    directions, density = source.aim(s, t)
    half = t > 0.0
    shares = (weights * density)[half]
    return list(zip(directions[half], shares / shares.sum(), strict=True))


def turn_up(direction: Array, angle: float) -> Array:
    """Turns directions from the receptor's axes to those of the surface, (..., 3): x along the light's travel, z up."""
    sine, cosine = math.sin(angle), math.cos(angle)
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([cosine * x + sine * z, y, cosine * z - sine * x], -1)


def make_rule(receptor: Receptor, peak: Array, widths: tuple[float, float], points: int) -> tuple[Array, Array, Array]:
    """Points s, t and weights (n,) of a quadrature over a receptor for light that peaks along a direction (3,)."""
    pairs = zip(receptor.locate(peak), widths, strict=True)
    (s, share_s), (t, share_t) = (place_points(index, width, points) for index, width in pairs)
    grid_s, grid_t = np.meshgrid(s, t, indexing="ij")
    return grid_s.ravel(), grid_t.ravel(), np.outer(share_s, share_t).ravel()


def place_points(peak: float, width: float, points: int) -> tuple[Array, Array]:
    """Points and weights on [-1, 1] of Gauss's rule on panels that begin so wide on both sides of a peak and double."""
    peak = min(max(peak, -1.0), 1.0)
    steps = width * 2.0 ** np.arange(max(0, math.ceil(math.log2(2.0 / width))) + 1) if width < 2.0 else np.empty(0)
    edges = np.concatenate([[-1.0, 1.0, peak], peak - steps, peak + steps])
    edges = np.unique(edges[np.abs(edges) <= 1.0])
    x, weights = make_double_gauss(points)
    size = np.diff(edges)[:, None]
    return (edges[:-1, None] + size * x).ravel(), (size * weights).ravel()


NODES = 16  # of the quadrature over an even sky: doubled, readings of paints move by 2e-10 at most
SAME = 1e-9  # of cosines, of degrees
PORT_DEG = 10.0  # full angle of a specular port: the 5 degrees around the mirrored beam that CIE 15 speaks of
MULTI_ANGLE = "45:as15", "45:as25", "45:as45", "45:as75", "45:as110"
METAL_FLAKE = "45:as15", "45:as45", "45:as110"  # the three that ASTM E2194 asks for
TRAVEL = tuple(f"45:as{off}" for off in (10, 15, 20, 25, 30, 35, 45, 55, 65, 75, 90, 110))  # of a curve of colours
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
    """The cosine of an angle from the normal."""
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
    """Unpolarized light at some wavelengths: Stokes vectors (wavelength, n_in, n_out, n_phi, 4) [1/sr] of diffuse light
    over irradiance, at mu_i, mu_o, phi [degrees]; shares that go up diffuse and mirrored (wavelength, n_in)."""

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
    """Stokes vectors (wavelength, 4) of a bidirectional geometry, pi radiance over irradiance. Raises SceneError."""
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
    """The geometry, or its reverse, which reads the same, where the eye looks along the normal: one Fourier order."""
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
