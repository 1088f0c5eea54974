"""vrte.paint: all that a coatings laboratory reads off a paint, on one page."""

import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vrte.appearance.appearance import (
    Appearance,
    InstrumentReading,
    appearance,
    list_colour_readings,
    list_gloss_readings,
    list_spectrum,
)
from vrte.appearance.colours import Colour, find_colour
from vrte.appearance.geometries import STANDARD_GEOMETRIES, TRAVEL
from vrte.appearance.gloss import find_glosses
from vrte.appearance.hiding import Conditions, Hiding, find_hiding
from vrte.appearance.panel import Panel, find_wavelengths, make_panel
from vrte.appearance.quantities import QUANTITIES
from vrte.appearance.spread import SOURCES, Spread, find_spread
from vrte.appearance.two_flux_fit import INSIDE, KubelkaMunk, find_kubelka_munk
from vrte.basics.arrays import Array
from vrte.basics.errors import LongSolveWarning, SceneError
from vrte.basics.running import Progress
from vrte.basics.views import view
from vrte.calls.spectrum import Source, read_source
from vrte.formats.materials import PAINT_KEYS, expand_content
from vrte.formats.toml_table import show_toml
from vrte.optics.crowding import PACKINGS
from vrte.request.how import complete_docstring
from vrte.results.brdf import Brdf

GLOSS_ANGLES = 20.0, 60.0, 85.0
LOBE_UM, LOBE_DEG, LOBE_STEP = 0.55, 45.0, 2.5  # of the polar cut: wavelength, incidence, degrees between directions
PARTS = 3, 4, 1, 30, 6, 1, 30  # of the work: particles, geometries, gloss, hiding, Kubelka-Munk, polar cut, spread
OF_FILMS = "contrast ratio of a film of "  # and its thickness: what the readings of the hiding curve are called
Found = TypeVar("Found")


@dataclass(frozen=True, eq=False, repr=False)
class Paint:
    """A paint as instruments see it, as `vrte.paint` finds it; a notebook shows its page.

    ``painted`` in the examples is what the example of `vrte.paint` finds.

    Attributes
    ----------
    title
        What it is called.
    made_of
        Lines on its composition.
    look
        Reflectances, colours and polarization in all standard geometries.
    glosses
        Gloss units by angle [degrees]; empty where there is no surface.
    hiding
        How well its film hides cards; None where there is no such film.
    two_fluxes
        K and S, in even light inside the film; None where there are none.
    lobe
        The BRDF in the plane of incidence at 45 degrees.
    lobe_um
        The wavelength of that [um].
    notes
        Its approximations, why numbers are missing, and what was warned of.
    spread
        How far colour, hiding and gloss may be off, and by what; None where that was not asked for.

    Examples
    --------
    >>> painted.lobe_um
    0.54
    """

    title: str
    made_of: tuple[str, ...]
    look: Appearance
    glosses: Mapping[float, float]
    hiding: Hiding | None
    two_fluxes: KubelkaMunk | None
    lobe: Brdf
    lobe_um: float
    notes: tuple[str, ...]
    spread: Spread | None = None

    def __repr__(self) -> str:
        return f"Paint({self.title!r}, {self.look!r})"

    def __str__(self) -> str:
        """The title, what it is made of, and the numbers that a data sheet has."""
        numbers = [f"{name}: {value}" for name, value in self.list_numbers()]
        return "\n".join([self.title, *(f"  {line}" for line in (*self.made_of, *numbers))])

    def _repr_html_(self) -> str:
        return str(view(self, "_repr_html_"))

    @property
    def colours(self) -> dict[str, Colour]:
        """Colours over the black card, over the white one and of the semi-infinite film, by the words of ``hiding``, in
        its geometry; the panel's own colour where nothing is hidden."""
        if self.hiding is None:
            return {"as it lies": self.look.colour()}
        at, light = self.look.wavelength_um, (self.look.illuminant, self.look.observer)
        return {name: find_colour(at, values, *light) for name, values in self.hiding.reflectances.items()}

    def list_numbers(self) -> Iterator[tuple[str, str]]:
        """Names, and values with their units in words: what a data sheet has."""
        for name, colour in self.colours.items():
            yield f"colour {name}", f"L* {colour.L:.2f}, a* {colour.a:.2f}, b* {colour.b:.2f} ({colour.hex})"
        if self.hiding is not None:
            yield "contrast ratio", f"{self.hiding.contrast_ratio:.4f}"
            length, times, rate = self.hiding.hiding_length_um, self.hiding.hiding_times, self.hiding.spreading_rate
            hides = f"none: {self.hiding.reason}" if times is None else f"{times:.4g} times this film"
            yield (
                f"thickness for {self.hiding.conditions.target:g}",
                hides if length is None else f"{length:.4g} µm of dry film",
            )
            if rate is not None:
                yield "spreading rate", f"{rate:.4g} m² of hiding dry film a litre"
        yield "flop index", f"{self.look.flop_index():.1f}"
        for angle, gloss in self.glosses.items():
            yield f"gloss {angle:g}°", f"{gloss:.1f} GU"
        if (varied := self.spread) is None:
            return
        for name in varied.quantities:
            words = f"{name}* over black" if name in "Lab" else name.replace("_um", " [µm]").replace("_", " ")
            yield f"{words} may be off", varied.describe(name)

    def list_readings(self) -> Iterator[InstrumentReading]:
        """Every number of the page, one a row, as the table in .csv has them."""
        yield from self.look.list_readings()
        yield from list_gloss_readings(self.glosses)
        if self.hiding is not None:
            yield from list_hiding_readings(self.hiding)
            for name, colour in self.colours.items():
                yield from list_colour_readings(colour, self.hiding.conditions.geometry, f" {name}")
        if self.spread is not None:
            yield from list_spread_readings(self.spread)
        if self.two_fluxes is not None:
            found, source = self.two_fluxes, "Kubelka and Munk 1931; Saunderson 1942"
            for name, values, what in (("K", found.K, "absorption"), ("S", found.S, "scattering")):
                words = f"{what} of two fluxes, of even light inside the film"
                at = found.wavelength_um
                yield from list_spectrum(name, found.geometry.name, at, values, found.unit, words, source)
        for angle, light in zip(*cut_lobe(self.lobe), strict=True):
            words = "BRDF of unpolarized light in the plane of incidence, without the mirrored beam"
            name = f"{LOBE_DEG:g}:{angle:g}"
            yield InstrumentReading("BRDF f00", name, self.lobe_um, float(light[0]), "1/sr", words, "Nicodemus 1977")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the page (.html), one sheet of pictures (.png, .pdf) or all numbers (.csv), or nothing of it."""
        view(self, "save", path)


def cut_lobe(lobe: Brdf) -> tuple[Array, Array]:
    """Angles of exit (n,) [degrees] in the plane of incidence, and Stokes vectors (n, 4) [1/sr], of a BRDF."""
    angle = np.degrees(np.arccos(lobe.mu_o))
    order, off = np.argsort(angle), np.flatnonzero(lobe.mu_o < 1.0)
    ahead, back = (lobe.mueller[0, :, phi, :, 0] for phi in (0, 1))
    behind = off[np.argsort(-angle[off])]
    return np.concatenate([-angle[behind], angle[order]]), np.concatenate([back[behind], ahead[order]])


@complete_docstring
def paint(
    scene: Source | Panel | None = None,
    wavelengths_um: Any = None,
    illuminant: str = "D65",
    observer: int = 10,
    white: float = Conditions.white,
    layer: int | None = None,
    spread: bool = False,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    **asked: Any,
) -> Paint:
    """All that a coatings laboratory reads off a paint: colour, hiding, gloss, Kubelka-Munk, on one page.

    Parameters
    ----------
    scene : path or mapping, optional
        A scene file with a table [paint], or any other whose film lies in one layer; or its content. Without it, the
        keys of [paint] are given as keywords: pigment, volume_fraction, binder, thickness_um, surface, substrate,
        packing, particles, flakes, flake_area, flake_thickness_um (docs/how_to/materials.md).
    {wavelengths_um, illuminant, observer}
    white : float, optional
        Albedo of the white card, 0.8 on drawdown charts.
    {layer}
    spread : bool, optional
        Also how far colour, contrast ratio, hiding thickness and gloss may be off: by models of crowding, by sizes of
        grains known to 10 %, by their indices known to 1 %, by the solver's accuracy.
    {progress, folder}
    **asked
        Keys of [paint]; and how to solve, as for `vrte.brdf`: accuracy (1e-4 by default), nodes, method, ...

    Returns
    -------
    Paint
        Its numbers by name; ``print`` shows the main ones, `save` writes a page, a picture or a table.

    Raises
    ------
    SceneError
        For bad input, and where the wavelengths do not cover the visible.
    {MissingExtraError, OSError}

    References
    ----------
    The standards that each number names; docs/how_to/appearance.md has the definitions.

    Examples
    --------
    >>> import vrte
    >>> grey = {"layer": [{"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}]}
    >>> found = vrte.paint(grey, [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70], nodes=4)
    >>> round(found.hiding.contrast_ratio, 3), found.glosses
    (0.747, {})
    """
    seen = Conditions(illuminant=illuminant, observer=observer, white=white)
    fields = {key: asked.pop(key) for key in PAINT_KEYS if key in asked}
    if isinstance(fields.get("binder"), tuple):
        fields["binder"] = list(fields["binder"])  # n, k
    if (scene is None) == (not fields):
        raise SceneError("paint: give either a scene file, or pigment, binder, thickness_um and other keys of a paint")
    source: Source | Panel = {"title": "Paint", "paint": fields} if scene is None else scene
    notes: list[str] = []
    with note_warnings(notes):
        parts = share_parts(progress, PARTS if spread else PARTS[:-1])
        # what is refused is refused before the work
        seen.weigh(find_wavelengths(source, wavelengths_um, folder))
        panel = make_panel(source, wavelengths_um, folder, parts[0], layer, **asked)
        seen_from = [*STANDARD_GEOMETRIES, *TRAVEL]
        look = appearance(panel, None, seen_from, illuminant=illuminant, observer=observer, progress=parts[1])
        glosses = try_part("gloss", lambda: find_glosses(panel, GLOSS_ANGLES, parts[2]), notes) or {}
        hiding = try_part("hiding power", lambda: find_hiding(panel, seen, parts[3]), notes)
        fluxes = try_part("K and S", lambda: find_kubelka_munk(panel, geometry=INSIDE, progress=parts[4]), notes)
        index = int(np.abs(panel.wavelength_um - LOBE_UM).argmin())
        mu_o = np.cos(np.radians(np.arange(0.0, 90.0, LOBE_STEP)))
        content = read_source(source, folder)[0] if isinstance(source, str | os.PathLike | Mapping) else {}
        if spread and not content:
            raise SceneError.of("spread", "is of a scene file or its content, whose particles are varied")
        where = Path(scene).parent if isinstance(scene, str | os.PathLike) else Path(folder)
        names = list_varied(hiding, glosses)
        lobe = panel.pick([index]).solve(math.cos(math.radians(LOBE_DEG)), mu_o, [0.0, 180.0], parts[5])[0]
        varied = find_spread(content, panel, names, seen, where, parts[-1]) if spread else None
    made_of = tuple(describe_content(content, Path(folder))) if content else (repr(panel),)
    title = panel.title or (Path(scene).stem.replace("_", " ") if isinstance(scene, str | os.PathLike) else "Paint")
    lobe_um = float(panel.wavelength_um[index])
    known = (*list_approximations(content, look.colour()), *dict.fromkeys(notes), *(varied.notes if varied else ()))
    return Paint(title, made_of, look, glosses, hiding, fluxes, lobe, lobe_um, known, varied)


def list_varied(hiding: Hiding | None, glosses: Mapping[float, float]) -> list[str]:
    """The quantities of a paint whose spread is found."""
    names = ["L", "a", "b", *(["contrast_ratio"] if hiding else [])]
    names += ["hiding_thickness_um"] if hiding and hiding.hiding_length_um else []
    return names + [f"gloss_{angle:g}" for angle in glosses]


def share_parts(progress: Progress | None, parts: Sequence[int]) -> list[Progress | None]:
    """One call for each of the parts of the work, by what they take."""
    if progress is None:
        return [None] * len(parts)

    def report(start: int, part: int, done: int, total: int) -> None:
        progress(round(100 * (start + part * done / max(total, 1))), 100 * sum(parts))

    return [partial(report, sum(parts[:index]), part) for index, part in enumerate(parts)]


def try_part(name: str, find: Callable[[], Found], notes: list[str]) -> Found | None:
    """What is found, or None and a note where this paint has none."""
    try:
        return find()
    except SceneError as error:
        notes.append(f"There is no {name} here: {error}.")
        return None


@contextmanager
def note_warnings(notes: list[str]) -> Iterator[None]:
    """Notes what is warned of, beside the warnings themselves, but for those of long solves."""
    with warnings.catch_warnings():
        parts = warnings.showwarning

        def note(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
            if not issubclass(category, LongSolveWarning):
                notes.append(f"Warned of: {message}.")
            parts(message, category, *rest, **more)

        warnings.showwarning = note
        yield


def list_hiding_readings(hiding: Hiding) -> Iterator[InstrumentReading]:
    """Contrast ratio, opacity, the hiding thickness, and reflectance factors over the cards and semi-infinite."""
    seen, length, times = hiding.conditions, hiding.hiding_length_um, hiding.hiding_times
    cards = f"Y over a black card ({seen.black:g}) over Y over a white one ({seen.white:g})"
    white = "Y of the semi-infinite film, where the perfect white has 1"
    thick = f"dry film whose contrast ratio is {seen.target:g}"
    ratio, thickness = "ISO 6504-3; ASTM D2805", "ISO 6504-1; ASTM D2805"
    paper = "TAPPI T 425 (there 15:di, A, 2 degrees)"
    rows = (
        ("contrast ratio", hiding.contrast_ratio, "1", cards, ratio),
        ("opacity", hiding.opacity, "1", "Y over black over Y of the semi-infinite film", "ISO 2471"),
        ("paper opacity", hiding.paper_opacity, "1", "Y over black over Y over white of 0.89", paper),
        ("luminance of the semi-infinite film", hiding.luminance_semi_infinite, "1", white, "ISO/CIE 11664-3"),
        ("hiding thickness over this film's", times, "1", thick, thickness),
        ("hiding thickness", length, "um", thick, thickness),
        ("spreading rate", hiding.spreading_rate, "m2/l", "area that a litre of it hides", thickness),
    )  # fmt: skip
    for name, single, unit, words, standard in rows:
        if single is not None:
            yield InstrumentReading(name, seen.geometry, None, single, unit, words, standard)
    for name, values in hiding.reflectances.items():
        words = f"of the film {name}, where the perfect white diffuser has 1"
        name, at = f"reflectance factor {name}", hiding.wavelength_um
        yield from list_spectrum(name, seen.geometry, at, values, "1", words, "CIE 15")
    for one, value in zip(hiding.times.tolist(), hiding.contrast_ratios.tolist(), strict=True):
        film = f"{one:.6g} x film" if hiding.length_um is None else f"{one * hiding.length_um:.6g} um"
        yield InstrumentReading(OF_FILMS + film, seen.geometry, None, value, "1", cards, ratio)


def list_spread_readings(spread: Spread) -> Iterator[InstrumentReading]:
    """By how much each reading may be off, in all and by each source."""
    parts = {"all": (spread.total, "the root of the sum of squares"), **{
        source: (values, SOURCES[source]) for source, values in spread.parts.items()
    }}  # fmt: skip
    for source, (values, words) in parts.items():
        for name, value in zip(spread.quantities, values.tolist(), strict=True):
            known = QUANTITIES[name]
            of = f"spread of {name} by {source}"
            yield InstrumentReading(of, "as the reading", None, value, known.units, f"either way, {words}", "none")


def describe_content(content: dict[str, Any], folder: Path) -> Iterator[str]:
    """What a scene file's layers, particles and base are, a line each, top first."""
    expanded = expand_content(content, folder)
    for layer in expanded.get("layer", ()):
        if "interface" in layer:
            facets = {key: value for key, value in layer["interface"].items() if key not in ("above", "below")}
            yield f"surface: {write_pairs(facets) if facets.get('roughness') else 'smooth'}"
        else:
            yield f"layer: {write_pairs(layer)}"
    for name, grains in expanded.get("particles", {}).items():
        yield f"{name}: {write_pairs(grains)}"
    base = dict(expanded.get("base", {}))
    kind = str(base.pop("kind", "black"))
    yield f"over: {', '.join([kind, write_pairs(base)] if base else [kind])}"


def write_pairs(table: Mapping[str, Any]) -> str:
    """A table of a scene file in words."""

    def write(value: Any) -> str:
        if isinstance(value, Mapping):
            return f"({write_pairs(value)})"
        return value if isinstance(value, str) else show_toml(value)

    words = ((key.removesuffix("_um").replace("_", " "), write(one), key.endswith("_um")) for key, one in table.items())
    return ", ".join(f"{name} {value}{' µm' if length else ''}" for name, value, length in words)


def list_approximations(content: dict[str, Any], colour: Colour) -> Iterator[str]:
    """The notes of a page: those of the file, and those that hold for all paints."""
    given = content.get("approximations", [])
    yield from [given] if isinstance(given, str) else given
    for layer in expand_content(content).get("layer", ()):
        if "packing" in layer:
            yield f"Packing: {PACKINGS[layer['packing']].words}."
    yield "Films are flat and even, their particles lie at random; cards are Lambertian and lie in the binder."
    yield f"Colours: {colour.illuminant}, {colour.observer} degree observer; gloss: illuminant C, 2 degrees."
    if colour.extrapolation:
        yield f"Beyond the wavelengths that are known reflectance stays as it is there: {colour.extrapolation}."
