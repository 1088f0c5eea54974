"""Shading models of renderers fitted to a BRDF: Mitsuba's ``principled`` and OpenPBR, of MaterialX.

Both have a base colour, a GGX lobe of a roughness whose square is alpha, an index of refraction and a metalness. With D
the density of facets, G Smith's factors, F Fresnel's reflectance and d the angle between a direction and the half
vector, what facets reflect is F D G/(4 mu_i mu_o); a metal has F = c + (1 - c)(1 - cos d)^5, c its colour. Below the
facets of a dielectric lies a diffuse base: Burley's for ``principled`` (Burley 2012 and 2015), flattened by
``flatness`` towards one that is scattered below the surface; for OpenPBR a Lambertian one, times what facets do not
reflect towards the eye. OpenPBR's coat is a second surface over all that: it mirrors, takes what it mirrors from what
lies below, and darkens that. The fit is by least squares of CIEDE2000 between the colours, in D65, of BRDF times cosine
of incidence, at half vectors that crowd at the normal as lobes of facets do.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from vrte.appearance.colours import find_white, import_colour_science
from vrte.basics.arrays import Array
from vrte.exports.colour import LIGHT, weigh_channels
from vrte.exports.lobes import follow_intensities
from vrte.exports.polarized import CHUNK
from vrte.formats.atomic import PathName, write_text
from vrte.formats.measured_polarized import find_half_angles, make_pairs, make_unit_vectors
from vrte.optics.facet_energy import share_energy
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth
from vrte.results.brdf import Spectrum

LEAST_ALPHA = 0.001  # of facets: Mitsuba's own limit, and ours
COMPARED = 0.15, 0.3, 0.5, 0.7, 0.85, 1.0  # cosines of incidence
HALVES = 20, 12  # half vectors and their azimuths, half a turn
INDICES = 1.01, 3.0
COAT_INDEX = 1.6  # OpenPBR's own, where there is no coat
METALS = 0.02, 0.9  # metalnesses that a fit starts from
COAT_GAIN = 0.8  # of the sum of squares: a coat is taken where it brings at least that much
NOTE = (
    "a fit: colours are linear sRGB (Rec. 709 primaries), a perfect white diffuser in D65 at 1 (2 degrees observer); "
    "by least squares of CIEDE2000 of BRDF times cosine of incidence"
)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Cosines of incidence, of exit, between both and their half vector, and of the half vector, (n,) each."""

    mu_i: Array
    mu_o: Array
    between: Array
    half: Array

    @classmethod
    def of(cls, into: Array, out: Array) -> "Geometry":
        """Those of directions (n, 3) away from the surface."""
        _, theta_d, theta_h = find_half_angles(into, out).T
        return cls(into[:, 2], out[:, 2], np.cos(theta_d), np.cos(theta_h))


@dataclass(frozen=True)
class Model:
    """``shade`` is its BRDF (n, 3) [sr-1] of numbers, colour first, and a geometry; ``names`` are those of the numbers
    after the colour: roughness, index, metalness, and others that start at ``rest``; ``coat``: these are the weight and
    the index of a coat, which are not fitted."""

    title: str
    colour: str
    names: tuple[str, ...]
    rest: tuple[float, ...]
    coat: bool
    shade: Callable[[Array, Geometry], Array]
    print_file: Callable[[dict[str, Any], str], str]


def reflect_facets(alpha: float, at: Geometry) -> Array:
    """D G/(4 mu_i mu_o) of GGX's facets (n,) [sr-1], with Smith's factors of both directions."""
    density = alpha**2 / (np.pi * (at.half**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    for mu in (at.mu_i, at.mu_o):
        density = density / (mu + np.sqrt(mu**2 + alpha**2 * (1.0 - mu**2)))
    return np.asarray(density)


def shade_surface(colour: Array, alpha: float, index: float, metalness: float, at: Geometry) -> Array:
    """What facets of a metal and of a dielectric reflect, (n, 3) [sr-1]."""
    metal = colour + (1.0 - colour) * fall_off(at.between)[:, None]
    clear = reflect_smooth(index, at.between)[:, 0, 0]
    both = metalness * metal + (1.0 - metalness) * clear[:, None]
    return np.asarray(both * reflect_facets(alpha, at)[:, None])


def fall_off(cosine: Array) -> Array:
    """Schlick's (1 - cosine)^5, (n,)."""
    return np.asarray((1.0 - cosine) ** 5)


def shade_principled(numbers: Array, at: Geometry) -> Array:
    """Mitsuba's ``principled`` without sheen, clearcoat and transmission."""
    colour, (roughness, index, metalness, flatness) = numbers[:3], numbers[3:]
    light, eye = fall_off(at.mu_i), fall_off(at.mu_o)
    back = 2.0 * roughness * at.between**2
    burley = (1.0 - 0.5 * light) * (1.0 - 0.5 * eye) + back * (light + eye + light * eye * (back - 1.0))
    inside = (1.0 + (0.5 * back - 1.0) * light) * (1.0 + (0.5 * back - 1.0) * eye)
    flat = 1.25 * (inside * (1.0 / (at.mu_i + at.mu_o) - 0.5) + 0.5)
    base = (1.0 - metalness) / np.pi * ((1.0 - flatness) * burley + flatness * flat)
    return colour * base[:, None] + shade_surface(colour, find_alpha(roughness), index, metalness, at)


def shade_openpbr(numbers: Array, at: Geometry) -> Array:
    """OpenPBR's opaque base, and a smooth coat, without fuzz, film and roughness of the diffuse base."""
    colour, (roughness, index, metalness, coat, coat_index) = numbers[:3], numbers[3:]
    index = coat * max(index / coat_index, coat_index / index) + (1.0 - coat) * index
    alpha, mu = find_alpha(roughness), np.linspace(0.02, 1.0, 25)
    facets = RoughSurface(1.0, float(index), alpha, "ggx", shadowing=True)
    smooth = alpha <= LEAST_ALPHA or index == 1.0
    reflected = reflect_smooth(index, mu)[:, 0, 0] if smooth else share_energy(facets, mu)[0]
    base = (1.0 - metalness) / np.pi * (1.0 - np.interp(at.mu_o, mu, reflected))
    shaded = colour * base[:, None] + shade_surface(colour, alpha, index, metalness, at)
    if coat == 0.0:
        return shaded
    # light that the coat's lower side sends back diffusely is lost on the base again and again
    kept = (1.0 - reflect_smooth(coat_index, np.ones(1))[0, 0, 0]) / coat_index**2
    darkening = 1.0 + coat * (kept / (1.0 - colour * (1.0 - kept)) - 1.0)
    through = 1.0 - coat * reflect_smooth(coat_index, at.mu_o)[:, :1, 0]
    return through * darkening * shaded + coat * shade_mirror(coat_index, at)[:, None]


def shade_mirror(index: float, at: Geometry) -> Array:
    """The lobe (n,) [sr-1] that models have in place of a smooth surface's beam."""
    return np.asarray(reflect_smooth(index, at.between)[:, 0, 0] * reflect_facets(LEAST_ALPHA, at))


def find_alpha(roughness: float) -> float:
    """The width alpha of GGX's distribution of facets, the square of a model's roughness, kept from 0."""
    return max(float(roughness) ** 2, LEAST_ALPHA)


def print_principled(numbers: dict[str, Any], text: str) -> str:
    """JSON whose ``bsdf`` is what mitsuba.load_dict takes."""
    bsdf = {"type": "principled", **numbers, "base_color": {"type": "rgb", "value": numbers["base_color"]}}
    return json.dumps({"bsdf": bsdf, "about": text}, indent=2) + "\n"


def print_openpbr(numbers: dict[str, Any], text: str) -> str:
    """MaterialX with a surface of OpenPBR and a material of it."""
    inputs = [
        f'    <input name="{name}" type="{"color3" if isinstance(value, list) else "float"}" value="'
        f'{", ".join(map(str, value)) if isinstance(value, list) else value}" />'
        for name, value in numbers.items()
    ]
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            f'<materialx version="1.39" colorspace="lin_rec709" doc="{escape(text)}">'.replace("\n", "&#10;"),
            '  <open_pbr_surface name="surface" type="surfaceshader">',
            *inputs,
            "  </open_pbr_surface>",
            '  <surfacematerial name="material" type="material">',
            '    <input name="surfaceshader" type="surfaceshader" nodename="surface" />',
            "  </surfacematerial>",
            "</materialx>\n",
        ]
    )


PRINCIPLED = Model(
    "Mitsuba's principled",
    "base_color",
    ("roughness", "eta", "metallic", "flatness"),
    (0.3,),
    False,
    shade_principled,
    print_principled,
)
OPENPBR = Model(
    "OpenPBR",
    "base_color",
    ("specular_roughness", "specular_ior", "base_metalness", "coat_weight", "coat_ior"),
    (0.0, COAT_INDEX),
    True,
    shade_openpbr,
    print_openpbr,
)


@dataclass(frozen=True, eq=False)
class FittedFile:
    """A model with its numbers, colour first; CIEDE2000 from the BRDF: ``median`` and ``most``, for 95 of 100 pairs."""

    model: Model
    numbers: Array
    median: float
    most: float

    @property
    def note(self) -> str:
        """How far the fitted model is from the BRDF, in words."""
        return (
            f"fitted by {self.model.title}: off by {self.median:.1f} CIEDE2000 in the median, {self.most:.1f} for 95%"
        )

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """The model's BRDF: (k, n, 3, 1, 1) [sr-1]."""
        found = self.model.shade(self.numbers, Geometry.of(*make_pairs(mu_i[:, None], mu_o, phi)))
        return found.reshape(*mu_o.shape, 3, 1, 1)

    def write(self, path: PathName, text: str) -> None:
        """Writes the file, all or nothing. Raises OSError."""
        rounded = [float(f"{number:.5g}") for number in self.numbers]
        named = {self.model.colour: rounded[:3], **dict(zip(self.model.names, rounded[3:], strict=True))}
        write_text(self.model.print_file(named, text), path)


def fit_model(
    model: Model, spectrum: Spectrum, surfaces: Sequence[RoughSurface | None], smooth: float | None = None
) -> FittedFile:
    """The model fitted to a spectrum at `directions`; under a smooth surface of the index ``smooth`` its facets are
    that surface, or its coat is, where that is better."""
    lobes, weights = follow_intensities(spectrum.brdfs, surfaces), weigh_channels(spectrum.wavelength_um)
    into, out = choose_pairs()
    at = Geometry.of(into, out)
    parts = (slice(start, start + CHUNK) for start in range(0, len(into), CHUNK))
    wanted = np.concatenate([lobes(into[part], out[part]) for part in parts]) @ weights.T
    colour = np.clip(np.pi * np.median(wanted, axis=0), 0.02, 0.98)
    if smooth is not None:
        wanted += shade_mirror(smooth, at)[:, None]
    colours = find_lab(wanted, at)
    fitted = [*range(6 if model.coat else 6 + len(model.rest))]
    if smooth is None:
        top = surfaces[len(surfaces) // 2]
        roughness = 0.5 if top is None else min(max(float(np.sqrt(top.roughness)), 0.04), 0.99)
        index = 1.5 if top is None else float(np.clip(abs(top.ratio), 1.02, 2.9))
        starts = [[*colour, roughness, index, metalness, *model.rest] for metalness in METALS]
        numbers, off = fit_numbers(model, at, colours, np.array(starts), fitted)
    else:
        mirror = np.array([[*colour, np.sqrt(LEAST_ALPHA), smooth, 0.0, *model.rest]])
        numbers, off = fit_numbers(model, at, colours, mirror, fitted[:3] + fitted[6:])
        if model.coat:
            starts = [[*colour, 0.5, 1.1 * smooth, metalness, 1.0, smooth] for metalness in METALS]
            coated = fit_numbers(model, at, colours, np.array(starts), fitted)
            if (coated[1] ** 2).sum() < COAT_GAIN * (off**2).sum():
                numbers, off = coated
    return FittedFile(model, numbers, float(np.median(off)), float(np.quantile(off, 0.95)))


def fit_numbers(
    model: Model, at: Geometry, colours: Array, starts: Array, fitted: Sequence[int]
) -> tuple[Array, Array]:
    """The best numbers (n,) from one of ``starts`` (k, n), those at the indices ``fitted`` changed, and CIEDE2000
    between their colours and ``colours`` (pairs, 3)."""
    from scipy.optimize import least_squares

    def fill(values: Array, start: Array) -> Array:
        numbers = start.copy()
        numbers[fitted] = values
        return numbers

    def differ(values: Array, start: Array) -> Array:
        found = find_lab(model.shade(fill(values, start), at), at)
        return np.asarray(import_colour_science().delta_E(colours, found, method="CIE 2000"), float)

    def differ_smoothly(values: Array, start: Array) -> Array:
        return weigh_lab(colours, find_lab(model.shade(fill(values, start), at), at) - colours).ravel()

    lowest, highest = np.zeros(starts.shape[1]), np.ones(starts.shape[1])
    lowest[3], lowest[4], highest[4] = 0.03, *INDICES
    how: dict[str, Any] = {"bounds": (lowest[fitted], highest[fitted]), "max_nfev": 60}
    how["diff_step"] = np.full(len(fitted), 1e-4)
    tried = [(least_squares(differ_smoothly, one[fitted], args=(one,), **how), one) for one in starts]
    best, start = min(tried, key=lambda pair: float(pair[0].cost))
    found = least_squares(differ, best.x, args=(start,), **how)
    return fill(found.x, start), differ(found.x, start)


def choose_pairs() -> tuple[Array, Array]:
    """Directions (n, 3) of light and view at which a model is fitted: half vectors of even u = sqrt(2 theta_m / pi)."""
    u, azimuth = np.meshgrid(*((np.arange(count) + 0.5) / count for count in HALVES), indexing="ij")
    half = make_unit_vectors(np.cos(0.5 * np.pi * u.ravel() ** 2), np.pi * azimuth.ravel())
    light = make_unit_vectors(np.array(COMPARED), np.zeros(len(COMPARED)))
    out = 2.0 * (light @ half.T)[..., None] * half - light[:, None]
    there = out[..., 2] > 0.1
    return np.broadcast_to(light[:, None], out.shape)[there], out[there]


def weigh_lab(colours: Array, differences: Array) -> Array:
    """Differences of lightness, chroma and hue (n, 3) over CIE94's weights, of differences of L*, a*, b* (n, 3): nearly
    CIEDE2000's, and smooth where colours are equal."""
    chroma = np.hypot(colours[:, 1], colours[:, 2])
    along = colours[:, 1:] / np.maximum(chroma, 1e-6)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    parts = [differences[:, 0], *((differences[:, 1:] * one).sum(axis=1) for one in (along, across))]
    return np.stack([parts[0], parts[1] / (1.0 + 0.045 * chroma), parts[2] / (1.0 + 0.015 * chroma)], axis=1)


def find_lab(brdf: Array, at: Geometry) -> Array:
    """L*, a*, b* (n, 3) of linear sRGB (n, 3) [sr-1] times pi and the cosine of incidence."""
    colour = import_colour_science()
    to_xyz, white = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ, find_white(*LIGHT)
    xyz = np.pi * at.mu_i[:, None] * brdf @ to_xyz.T
    return np.asarray(colour.XYZ_to_Lab(np.maximum(xyz, 0.0), white[:2] / white.sum()), float)
