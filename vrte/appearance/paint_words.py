"""What a paint's page says in words: what the paint is made of, hiding number by number, and what is approximated."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vrte.appearance.appearance import Reading
from vrte.appearance.colours import Colour
from vrte.appearance.hiding import Hiding
from vrte.formats.paints import expand_content
from vrte.formats.toml_table import show_toml
from vrte.optics.crowding import PACKINGS

OF_FILMS = "contrast ratio of a film of "


def list_hiding_readings(hiding: Hiding) -> Iterator[Reading]:
    """Contrast ratio, opacity, the thickness that hides, and reflectance factors over the cards and without end."""
    seen, black, white = hiding.geometry, hiding.black, hiding.white
    cards = f"Y over a black card ({black:g}) over Y over a white one ({white:g})"
    ratio, standard = "ISO 6504-3; ASTM D2805", "ISO 6504-1; ASTM D2805"
    yield Reading("contrast ratio", seen, None, hiding.contrast_ratio, "1", cards, ratio)
    yield Reading("opacity", seen, None, hiding.opacity, "1", "Y over black over Y without end", "ISO 2471")
    words = "Y over black over Y over white of 0.89"
    yield Reading(
        "paper opacity", seen, None, hiding.paper_opacity, "1", words, "TAPPI T 425 (there 15:di, A, 2 degrees)"
    )
    words = "Y of the film without end, where the perfect white has 1"
    yield Reading("luminance without end", seen, None, hiding.luminance_without_end, "1", words, "ISO/CIE 11664-3")
    length, times, rate = hiding.hiding_length_um, hiding.hiding_times, hiding.spreading_rate
    words = f"dry film whose contrast ratio is {hiding.target:g}"
    if times is not None:
        yield Reading("hiding thickness over this film's", seen, None, times, "1", words, standard)
    if length is not None and rate is not None:
        yield Reading("hiding thickness", seen, None, length, "um", words, standard)
        yield Reading("spreading rate", seen, None, rate, "m2/l", "area that a litre of it hides", standard)
    at = hiding.wavelength_um.tolist()
    for name, values in (
        ("over black", hiding.reflectance_over_black),
        ("over white", hiding.reflectance_over_white),
        ("without end", hiding.without_end),
    ):
        for wavelength, value in zip(at, values.tolist(), strict=True):
            words = f"of the film {name}, where the perfect white diffuser has 1"
            yield Reading(f"reflectance factor {name}", seen, wavelength, value, "1", words, "CIE 15")
    for times, value in zip(hiding.times, hiding.contrast_ratios.tolist(), strict=True):
        film = f"{times:.6g} x film" if hiding.length_um is None else f"{times * hiding.length_um:.6g} um"
        yield Reading(OF_FILMS + film, seen, None, value, "1", cards, ratio)


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
    """A table of a scene file in words.

    >>> write_pairs({"host_index": "alkyd", "volume_fractions": {"rutile": 0.15}, "thickness_um": 60.0})
    'host index alkyd, volume fractions (rutile 0.15), thickness 60.0 µm'
    """

    def write(value: Any) -> str:
        if isinstance(value, Mapping):
            return f"({write_pairs(value)})"
        return value if isinstance(value, str) else show_toml(value)

    words = ((key.removesuffix("_um").replace("_", " "), write(one), key.endswith("_um")) for key, one in table.items())
    return ", ".join(f"{name} {value}{' µm' if length else ''}" for name, value, length in words)


def list_approximations(content: dict[str, Any], colour: Colour) -> Iterator[str]:
    """What a page has to say of its numbers: the file's own words, and what holds of all."""
    given = content.get("approximations", [])
    yield from [given] if isinstance(given, str) else given
    for layer in expand_content(content).get("layer", ()):
        if "packing" in layer:
            yield f"Packing: {PACKINGS[layer['packing']].words}."
    yield "Films are flat and even, their particles lie at random; cards are Lambertian and lie in the binder."
    yield f"Colours: {colour.illuminant}, {colour.observer} degree observer; gloss: illuminant C, 2 degrees."
    if colour.extrapolation:
        yield f"Beyond the wavelengths that are known reflectance stays as it is there: {colour.extrapolation}."
