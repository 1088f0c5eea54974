"""Specular gloss as glossmeters read it, ISO 2813 and ASTM D523: light around the mirrored beam, 100 of a black glass.

    gloss = 100 sum_lambda y (mirrored/R_g + lobe/R_g' + diffuse/R_g),    y: CIE illuminant C, 1931 observer, sum y = 1

``mirrored``: beams that come back as beams, the source's image lying wholly inside the receptor; ``lobe``: what a rough
surface sends into the receptor, averaged over the source; ``diffuse``: the rest of the BRDF over the receptor. R_g is
Fresnel's reflectance of the polished glass, n = 1.567 at every wavelength, R_g' its average over the source.

Apertures are from memory of both standards; those of the receptors were found once more, in a public program's notes.
Lenses are ideal, the panel is flat, and light that the two polarizations share unevenly is none of the source's.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from vrte.appearance.colours import weigh_wavelengths
from vrte.appearance.geometries import Rectangular, collect_mirrored, find_place, project_solid_angle
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.results.brdf import Brdf, Spectrum
from vrte.scene.interface import Interface

SOURCE = Rectangular(0.75, 2.5)  # image of the lamp, in the plane of measurement and across it [deg]
RECEPTORS = {20.0: Rectangular(1.8, 3.6), 60.0: Rectangular(4.4, 11.7), 85.0: Rectangular(4.0, 6.0)}
BLACK_GLASS = Interface(1.0, 1.567)
NEEDS_SURFACE = "gloss needs a surface: put an interface between air and the medium of the first layer on top"
LEAST_BEAM = 1e-6  # share of light that counts as mirrored where there is no surface
SIMPSON, TRAPEZE = (np.outer(one, one) for one in (np.array([1, 4, 1]) / 6.0, np.array([1, 2, 1]) / 4.0))
MOST_UNEVEN = 0.01  # of the gloss: what both rules may differ by


def find_glosses(
    panel: Panel, angles: Iterable[float] = (20.0, 60.0, 85.0), progress: Progress | None = None
) -> dict[float, float]:
    """Specular gloss [gloss units] of a panel in air by the angle, any of 20, 60 and 85 degrees, of one solve."""
    return find_glosses_of([panel], angles, progress)[0]


def find_glosses_of(
    panels: Sequence[Panel], angles: Iterable[float], progress: Progress | None = None
) -> list[dict[float, float]]:
    """The same of several panels that are solved alike, in one call."""
    wanted = [check_gloss_angle(angle) for angle in angles]
    for panel in panels:  # what is refused is refused before the work
        weigh_wavelengths(panel.wavelength_um, "C", 2)
    mu_i, mu_o, phi = list_gloss_directions(wanted)
    solved = iter(panels[0].join(panels[1:]).solve_as("brdf", progress, mu_i=mu_i, mu_o=mu_o, phi=phi))
    spectra = [Spectrum(panel.wavelength_um, tuple(islice(solved, len(panel)))) for panel in panels]
    pairs = zip(panels, spectra, strict=True)
    return [{angle: read_gloss(spectrum, panel.surface, angle) for angle in wanted} for panel, spectrum in pairs]


def find_gloss(panel: Panel, angle_deg: float = 60.0, progress: Progress | None = None) -> float:
    """Specular gloss of a panel at one angle [gloss units]; parameters and errors as of `find_glosses`."""
    return find_glosses(panel, (angle_deg,), progress)[angle_deg]


def check_gloss_angle(angle_deg: Any) -> float:
    """One of the angles whose apertures are known. Raises SceneError."""
    if angle_deg not in RECEPTORS:
        angles = ", ".join(f"{angle:g}" for angle in RECEPTORS)
        words = f"of gloss must be one of {angles} degrees (ISO 2813, ASTM D523), not {show_value(angle_deg)}"
        raise SceneError.of("angle_deg", words)
    return float(angle_deg)


def list_gloss_directions(angles: Sequence[float]) -> tuple[Array, Array, Array]:
    """mu_i, mu_o and phi [deg] of what `read_gloss` takes at some angles, ascending: middles and rims of receptors."""
    rims = [list_rims(angle) for angle in angles]
    mu_o, phi = (np.unique(np.concatenate([rim[axis] for rim in rims])) for axis in (0, 1))
    return np.unique([math.cos(math.radians(angle)) for angle in angles]), mu_o, phi


def list_rims(angle_deg: float) -> tuple[Array, Array]:
    """Three cosines of exit and two azimuths [deg]: the receptor's middle and rims, in the plane and across."""
    receptor = RECEPTORS[angle_deg]
    reach = receptor.reach_deg
    mu_o = np.cos(np.radians([angle_deg - reach, angle_deg, angle_deg + reach]))
    rim = math.atan(receptor.half[1] / math.sin(math.radians(angle_deg)))
    return mu_o, np.array([0.0, math.degrees(rim)])


def read_gloss(spectrum: Spectrum, surfaces: Sequence[Interface | None], angle_deg: float = 60.0) -> float:
    """Specular gloss [gloss units] of what was solved at `list_gloss_directions` under ``surfaces``, those on top at
    each wavelength. Raises SceneError for other angles or directions, light from below, no surface, and where light
    from inside has a peak in the receptor too narrow to be integrated."""
    angle = check_gloss_angle(angle_deg)
    if any(one.diagnostics.get("illuminate", "top") != "top" for one in spectrum):
        raise SceneError("gloss is read off the upper surface: the spectrum must be lit from the top")
    weights = weigh_wavelengths(spectrum.wavelength_um, "C", 2)[1]
    parts = weights @ np.array([read_parts(*pair, angle) for pair in zip(spectrum, surfaces, strict=True)])
    if not any(surfaces) and parts[0] < LEAST_BEAM:
        raise SceneError(NEEDS_SURFACE)
    check_evenness(parts, angle)
    return 100.0 * float(parts[0] + parts[1])


def read_parts(brdf: Brdf, surface: Interface | None, angle_deg: float) -> tuple[Any, Any, Any]:
    """The parts of `split_light` of a BRDF under a surface."""
    index, places = list_gloss_places(brdf, angle_deg)
    mirrored = 0.0 if brdf.specular is None else float(brdf.specular[index, 0, 0])
    light = brdf.mueller[index][..., 0, 0][places]
    return split_light(mirrored, light, find_own_lobe(surface, angle_deg), angle_deg)


def find_surface_gloss(surface: Interface, angle_deg: float = 60.0) -> float:
    """Specular gloss [gloss units] of a surface by itself, over black, with air above it."""
    angle = check_gloss_angle(angle_deg)
    if surface.index_above != 1.0:
        raise SceneError(f"gloss is read in air: above the surface the index must be 1, not {surface.index_above:g}")
    mu, receptor = math.cos(math.radians(angle)), RECEPTORS[angle]
    source = None if surface.is_smooth else SOURCE  # beams of smooth surfaces are those of the middle of the source
    share, glass = (collect_mirrored(one, mu, receptor, source) for one in (surface, BLACK_GLASS))
    return 100.0 * share / glass


def list_gloss_places(brdf: Brdf, angle_deg: float) -> tuple[int, Any]:
    """The index of the incident direction, and those (3, 2) of exit and azimuth that a gloss is read at."""
    mu_o, phi = list_rims(angle_deg)
    reading = f"gloss at {angle_deg:g} degrees"
    index = find_place("mu_i", brdf.mu_i, math.cos(math.radians(angle_deg)), reading)
    rows = [find_place("mu_o", brdf.mu_o, one, reading) for one in mu_o.tolist()]
    columns = [find_place("phi", brdf.phi, one, reading) for one in phi.tolist()]
    return index, np.ix_(rows, columns)


def find_own_lobe(surface: Interface | None, angle_deg: float) -> Array:
    """What a rough surface on top itself sends into the receptor over the black glass's, and f [1/sr] at the receptor's
    middle and rims in the plane and across, (1 + 6,); 0 of a smooth one, which mirrors beams, and of none."""
    if surface is None:
        return np.zeros(7)
    alone = 0.01 * find_surface_gloss(surface, angle_deg)  # refuses what is not in air
    if surface.is_smooth:
        return np.zeros(7)
    mu_o, phi = list_rims(angle_deg)
    lobe = surface.facets.reflect(math.cos(math.radians(angle_deg)), mu_o[:, None], phi)[..., 0, 0]
    return np.concatenate([[alone], lobe.ravel()])


def split_light(mirrored: Any, light: Array, own: Array, angle_deg: float) -> tuple[Any, Any, Any]:
    """Light in the receptor over the black glass's (...), mirrored, the rest, and the error of the rest's quadrature,
    of the share of the beam that is ``mirrored`` (...), f [1/sr] at middle and rims (..., 3, 2), and the surface's
    ``own`` (..., 7)."""
    receptor, mu = RECEPTORS[angle_deg], math.cos(math.radians(angle_deg))
    glass = collect_mirrored(BLACK_GLASS, mu, receptor)
    light = light - own[..., 1:].reshape(light.shape)
    seen, cosines = project_solid_angle(receptor, angle_deg) / glass, list_rims(angle_deg)[0][:, None]
    fine, coarse = (
        (rule * light[..., [1, 0, 1]] * cosines).sum((-2, -1)) / (rule * cosines).sum() for rule in (SIMPSON, TRAPEZE)
    )
    return mirrored / glass + own[..., 0], fine * seen, np.abs(fine - coarse) * seen


def check_evenness(parts: Any, angle_deg: float) -> None:
    """Raises SceneError where the parts (3,) of `split_light` say that light from inside has a peak that nine
    directions do not resolve."""
    surface, diffuse, uneven = (100.0 * float(part) for part in parts)
    if uneven > MOST_UNEVEN * (surface + diffuse):
        raise SceneError(
            f"gloss at {angle_deg:g} degrees: what comes from below the surface has a peak in the receptor, "
            f"{diffuse:.3g} gloss units give or take {uneven:.2g}; only the lobe of the surface on top may be as narrow"
        )
