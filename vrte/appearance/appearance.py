"""vrte.appearance: what the instruments of a coatings laboratory read off a panel."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from vrte.appearance.colours import Colour, check_light, find_colour, find_difference, find_flop_index
from vrte.appearance.geometries import (
    METAL_FLAKE,
    PORT_DEG,
    STANDARD_GEOMETRIES,
    TRAVEL,
    find_light,
    find_reflectance,
    read_geometry,
    see_spectrum,
    solve_geometries,
)
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, Hiding, find_hiding
from vrte.appearance.panel import Panel, make_panel
from vrte.appearance.two_flux_fit import KubelkaMunk, find_kubelka_munk
from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError
from vrte.basics.polarization import find_angle_of_linear_polarization, find_degree_of_linear_polarization
from vrte.basics.running import Progress, share_progress
from vrte.calls.spectrum import Source
from vrte.request.how import complete_docstring
from vrte.results.brdf import Spectrum

VISUAL = "45:0"  # the default: the surface's mirror image is left out


class InstrumentReading(NamedTuple):
    """A number that an instrument reads: quantity, geometry ("45:0"), wavelength [um], value, unit, definition."""

    quantity: str
    geometry: str
    wavelength_um: float | None
    value: float
    unit: str
    definition: str
    standard: str


@dataclass(frozen=True, eq=False, repr=False)
class Appearance:
    """What instruments read off a panel, as `vrte.appearance` finds it.

    Attributes
    ----------
    wavelength_um
        Wavelengths in vacuum [um], (n,), ascending.
    reflectances
        Reflectance factors (n,) by the name of a geometry, 1 for the perfect white diffuser.
    light
        Stokes vectors (n, 4) under unpolarized light, I being the reflectance factor, by the name of the geometries
        that look along one direction.
    illuminant
        The light of its colours.
    observer
        Degrees of the standard observer, 2 or 10.
    port_deg
        Full angle of the specular port of geometries with "de" [degrees].
    panel
        What was solved; None where a spectrum was given.

    Examples
    --------
    >>> painted.look.illuminant, painted.look.observer
    ('D65', 10)
    """

    wavelength_um: Array
    reflectances: Mapping[str, Array]
    light: Mapping[str, Array]
    illuminant: str
    observer: int
    port_deg: float
    panel: Panel | None = None

    def __repr__(self) -> str:
        first, last = self.wavelength_um[[0, -1]]
        which = f"{self.wavelength_um.size} wavelengths from {first:g} to {last:g} um"
        return f"Appearance({', '.join(self.reflectances)} at {which}, {self.illuminant}/{self.observer})"

    def reflectance(self, geometry: str = VISUAL) -> Array:
        """The reflectance factor (n,) in a geometry of ``reflectances``, or in one with light and eye exchanged."""
        wanted = read_geometry(geometry).reading
        for name, values in self.reflectances.items():
            if read_geometry(name).reading == wanted:
                return values
        known = ", ".join(self.reflectances)
        raise SceneError.of("geometry", f"{show_value(geometry)} was not asked for: there are {known}")

    def colour(self, geometry: str = VISUAL) -> Colour:
        """The colour in a geometry: X, Y, Z, L*, a*, b*, chroma, hue, and for a screen."""
        return find_colour(self.wavelength_um, self.reflectance(geometry), self.illuminant, self.observer)

    def difference(self, other: "Appearance", geometry: str = VISUAL) -> float:
        """The colour difference CIEDE2000 of this panel and another in a geometry; about 1 is just seen."""
        return find_difference(self.colour(geometry), other.colour(geometry))

    def flop_index(self) -> float:
        """The flop index by L* in "45:as15", "45:as45" and "45:as110": 0 for solid colours, 15 and more for strong
        metallic ones (Alman 1987)."""
        return find_flop_index(*(self.colour(name).L for name in METAL_FLAKE))

    def colour_travel(self) -> dict[float, Colour]:
        """Colours by the angle [degrees] off the mirrored beam of light at 45 degrees, ascending, in all geometries of
        ``reflectances`` that are named so, "45:as15"."""
        offs = {float(name.removeprefix(ASPECULAR)): name for name in self.reflectances if name.startswith(ASPECULAR)}
        if not offs:
            raise SceneError.of("geometries", f"have none along which colours travel: ask for {', '.join(TRAVEL)}")
        return {off: self.colour(offs[off]) for off in sorted(offs)}

    def polarization(self, geometry: str = VISUAL) -> tuple[Array, Array]:
        """Degree (n,), 0 to 1, and angle (n,) [degrees] of linear polarization in a geometry that looks along one
        direction; the angle is counted from the plane of the panel's normal and the line of sight."""
        name = read_geometry(geometry).name
        if name not in self.light:
            known = ", ".join(self.light) or "none"
            raise SceneError.of("geometry", f"{show_value(geometry)} has no polarization here: there are {known}")
        stokes = self.light[name]
        return find_degree_of_linear_polarization(stokes), find_angle_of_linear_polarization(stokes)

    def gloss(self, angle_deg: float = 60.0) -> float:
        """Specular gloss at 20, 60 or 85 degrees [gloss units]; a black glass of n = 1.567 has 100."""
        return find_gloss(self._panel("gloss is read off"), float(angle_deg))

    def hiding(
        self,
        black: float = Conditions.black,
        white: float = Conditions.white,
        geometry: str = VISUAL,
        target: float = Conditions.target,
        progress: Progress | None = None,
    ) -> Hiding:
        """How well the panel's film hides cards of albedos ``black`` and ``white``, and how thick it has to be for a
        contrast ratio of ``target``; ``progress`` is called with (solves done, solves)."""
        panel = self._panel("hiding power is of")
        seen = Conditions(geometry, self.illuminant, self.observer, black, white, target)
        return find_hiding(panel, seen, progress)

    def _panel(self, what: str) -> Panel:
        if self.panel is None:
            raise SceneError(f"{what} a scene, not its spectrum alone: give the scene in its place")
        return self.panel

    def kubelka_munk(
        self,
        white: float = 0.8,
        geometry: str = "8:di",
        k1: Any = None,
        k2: Any = None,
        progress: Progress | None = None,
    ) -> KubelkaMunk:
        """Kubelka and Munk's K and S of the panel's film over black and over an albedo ``white``, read in "8:di",
        "di:di" or "inside"; Saunderson's k1 and k2 (n,) of its surface are computed, or given."""
        return find_kubelka_munk(self._panel("K and S are of"), white, geometry, k1, k2, progress)

    def list_readings(self) -> Iterator[InstrumentReading]:
        """All reflectances, polarizations and colours, with one number in each row."""
        at = self.wavelength_um
        for name, values in self.reflectances.items():
            known = read_geometry(name)
            yield from list_spectrum("reflectance factor", name, at, values, "1", known.definition, known.standard)
        for name in self.light:
            words = f"of unpolarized light, after {read_geometry(name).definition}", "Stokes parameters I, Q, U"
            for quantity, values, unit in zip(POLARIZATION, self.polarization(name), ("1", "degree"), strict=True):
                yield from list_spectrum(quantity, name, at, values, unit, *words)
        for name in self.reflectances:
            yield from list_colour_readings(self.colour(name), name)
        if {*METAL_FLAKE} <= {*self.reflectances}:
            words = "2.69 (L*15 - L*110)^1.11/L*45^0.86 of light at 45 degrees", "Alman 1987"
            yield InstrumentReading("flop index", "45:as", None, self.flop_index(), "1", *words)


ASPECULAR = "45:as"  # how geometries are named that count from the mirrored beam
POLARIZATION = "degree of linear polarization", "angle of linear polarization"
COLOURS = dict.fromkeys("XYZ", "ISO/CIE 11664-3") | dict.fromkeys("LabCh", "ISO/CIE 11664-4")


def list_spectrum(
    quantity: str, geometry: str, wavelength_um: Array, values: Array, *words: str
) -> Iterator[InstrumentReading]:
    """A reading at each wavelength (n,); ``words``: unit, definition and standard."""
    for wavelength, value in zip(wavelength_um.round(9).tolist(), values.tolist(), strict=True):
        yield InstrumentReading(quantity, geometry, wavelength, value, *words)


def list_gloss_readings(glosses: Mapping[float, float]) -> Iterator[InstrumentReading]:
    """Specular glosses [gloss units] by the angle [degrees]."""
    words = "specular gloss, 100 of polished black glass of index 1.567", "ISO 2813; ASTM D523"
    for angle, gloss in glosses.items():
        yield InstrumentReading("gloss", f"{angle:g}:{angle:g}", None, gloss, "GU", *words)


def list_colour_readings(colour: Colour, geometry: str, of: str = "") -> Iterator[InstrumentReading]:
    """X, Y, Z, L*, a*, b*, C* and h of a colour that is read in a geometry, ``of`` something."""
    light = f"{colour.illuminant}, {colour.observer} degree observer"
    for quantity, standard in COLOURS.items():
        value, unit = getattr(colour, quantity), "degree" if quantity == "h" else "1"
        yield InstrumentReading(quantity + of, geometry, None, value, unit, light, standard)


@complete_docstring
def appearance(
    scene: Source | Spectrum | Panel,
    wavelengths_um: Any = None,
    geometries: Sequence[str] | None = None,
    illuminant: str = "D65",
    observer: int = 10,
    port_deg: float = PORT_DEG,
    layer: int | None = None,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    **asked: Any,
) -> Appearance:
    """What the instruments of a coatings laboratory read off a panel: reflectance, colour, polarization, gloss, hiding.

    Parameters
    ----------
    scene : path, mapping, Spectrum or Panel
        A scene file or its content; or a spectrum that was solved at the directions of the geometries, which is read
        without another solve, as far as it goes.
    {wavelengths_um}
    geometries : sequence of str, optional
        By CIE's names, light first: "8:di" (sphere, mirrored beam included), "8:de" (excluded), "di:di", "45:0",
        "0:45", "45:as15" (15 degrees off the mirrored beam, towards the light), "30:di" or "60:-20" (any angles; below
        0: on the side of the light); or as laboratories write them: "d/8", "8/d", "SCI", "SCE", "45/0". By
        default the standard ones, of a spectrum those that it has directions for.
    {illuminant, observer}
    port_deg : float, optional
        Full angle of the round specular port of "de" geometries.
    {layer, progress, folder}
    **asked
        How to solve, as for `vrte.brdf`: accuracy (1e-4 by default), nodes, method, ...

    Returns
    -------
    Appearance
        `reflectance`, `colour`, `polarization` of a geometry, `gloss`, `difference`, `hiding`, `kubelka_munk`.

    Raises
    ------
    SceneError
        For bad input; where a spectrum lacks directions; for colours, where the wavelengths do not cover the visible.
    {MissingExtraError}

    References
    ----------
    CIE 15, ASTM E1331, E1349, E2194, E2539 for the geometries (docs/how_to/appearance.md has all definitions).

    Examples
    --------
    >>> import vrte
    >>> layers = [{"phase": "isotropic", "albedo": 0.9, "thickness": 0.0}]
    >>> grey = {"layer": layers, "base": {"kind": "lambertian", "albedo": 0.2}}
    >>> look = vrte.appearance(grey, geometries=["8:di", "45:0"])
    >>> print(look.reflectance("8:di")[0].round(9), round(look.colour().L, 2))
    0.2 51.84
    """
    illuminant, observer = check_light(illuminant, observer)
    kept = illuminant, observer, port_deg
    if isinstance(scene, Spectrum):
        given = {"wavelengths_um": wavelengths_um, "layer": layer, **asked}
        for name in (name for name, value in given.items() if value is not None):
            raise SceneError.of(name, "is not used: the spectrum is solved already")
        reflectances, light = read_spectrum(scene, geometries, port_deg)
        return Appearance(scene.wavelength_um, reflectances, light, *kept)
    names = list(STANDARD_GEOMETRIES if geometries is None else geometries)
    first, second = (share_progress(progress, half, 2) for half in (0, 1))
    panel = make_panel(scene, wavelengths_um, folder, first, layer, **asked)
    reflectances, light = solve_geometries(panel, names, port_deg, second)
    return Appearance(panel.wavelength_um, reflectances, light, *kept, panel)


def read_spectrum(
    spectrum: Spectrum, geometries: Sequence[str] | None, port_deg: float
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Reflectance factors and Stokes vectors by geometry, as a spectrum has directions. Raises SceneError."""
    if spectrum[0].diagnostics.get("illuminate", "top") != "top":
        raise SceneError("the spectrum must be lit from the top: a panel is looked at from above", "illuminate")
    seen = see_spectrum(spectrum)
    reflectances: dict[str, Array] = {}
    light: dict[str, Array] = {}
    for one in map(read_geometry, STANDARD_GEOMETRIES if geometries is None else geometries):
        if one.excluded and spectrum.surface is not None:
            words = f"{one.name!r} of a rough surface needs the scene, not its spectrum alone"
            raise SceneError.of("geometries", words)
        try:
            reflectances[one.name] = find_reflectance(seen, one, port_deg=port_deg)
        except SceneError:
            if geometries is not None:
                raise
            continue
        if one.angle_o is not None:
            light[one.name] = find_light(seen, one)
    if not reflectances:
        known = ", ".join(STANDARD_GEOMETRIES)
        raise SceneError(f"the spectrum has the directions of none of {known}: give the scene in its place")
    return reflectances, light
