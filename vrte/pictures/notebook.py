"""Results as a notebook shows them: a small picture above a table, as HTML, or the table alone; nothing raises."""

import html
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial, wraps
from typing import Any

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.views import Figure
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.pictures.describe import Axis, Picture, spread
from vrte.pictures.figures import draw_picture
from vrte.pictures.lobes import name_brdf
from vrte.pictures.page import make_data_address
from vrte.pictures.results import describe_brdf, describe_field, draw_phase_matrix, draw_plan, draw_spectrum, name_field
from vrte.results.brdf import Brdf, Spectrum
from vrte.results.field import Field
from vrte.results.over_hemisphere import check_directions
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

WIDTH, HEIGHT = 7.2, 2.5  # of a picture [inches]
MOST_LAYERS = 20  # in the table of a scene
MOST_LINES = 4  # incident directions or depths in it
MOST_TERMS_DRAWN = 5000  # more take longer than anyone waits for a glance, and so do
MOST_DIRECTIONS_DRAWN = 300_000  # incident ones of the picture times outgoing ones
MOST_BYTES = 400_000  # of a plan's text
DEGREES_SHOWN = 6  # of an expansion
CELL = 'style="text-align:left;vertical-align:top;padding:1px 10px 1px 0"'
# of diagnostics, where there
MADE = ("method", "method_rule", "algorithm", "backend", "nodes", "accuracy", "achieved", "truncation", "base")


def show_as_html(
    title: str | Callable[[Any], str], draw: Callable[[Any], Figure | None] = lambda _: None
) -> Callable[[Any], Callable[[Any], str]]:
    """Makes a notebook's view of an object from a function of its facts: title, picture and facts."""

    def show(facts: Callable[[Any], Mapping[str, str] | str], thing: Any) -> str:
        try:
            found = facts(thing)
            text = f"<pre>{html.escape(found)}</pre>" if isinstance(found, str) else write_html_table(found)
        except Exception:  # a notebook must show something, whatever a result holds
            text = f"<pre>{html.escape(put_in_one_line(object.__repr__(thing)))}</pre>"
        try:
            figure: Any = draw(thing)
            drawn = b"" if figure is None else figure._repr_png_()
        except Exception:  # too few directions, no matplotlib, numbers that no axis takes
            drawn = b""
        image = f'<img alt="" src="{make_data_address(drawn, "png")}"><br>' if drawn else ""
        name = title if isinstance(title, str) else title(thing)
        return f"<div><b>{html.escape(name)}</b><br>{image}{text}</div>"

    return lambda facts: wraps(facts)(partial(show, facts))


def draw_field(field: Field) -> Figure | None:
    """I and the degree of polarization of the first beam at the first azimuth."""
    if not field.mu.size:
        return None
    field = field if isinstance(field.mu0, float) else field.beam(0)
    panels = describe_field(field, 0, spread(field.tau.size, MOST_LINES))
    titles = f"I [W m⁻² sr⁻¹], φ = {field.phi[0]:g}°", "degree of polarization"
    shown = [replace(one, y=Axis(low=0.0), title=title) for one, title in zip(panels, titles, strict=True)]
    return draw_picture(Picture([shown], WIDTH, HEIGHT))


def draw_brdf(brdf: Brdf) -> Figure | None:
    """f00 and the degree of linear polarization in the plane of incidence. SceneError for too few directions."""
    check_directions(brdf.mu_o, brdf.phi)
    indices = spread(brdf.mu_i.size, MOST_LINES)
    if len(indices) * brdf.mu_o.size * brdf.phi.size > MOST_DIRECTIONS_DRAWN:
        return None
    return draw_picture(Picture([describe_brdf(brdf, indices)], WIDTH, HEIGHT))


def draw_short_phase_matrix(phase_matrix: PhaseMatrix) -> Figure | None:
    """F11 and the ratios to it, of a phase matrix that is drawn at a glance."""
    return draw_phase_matrix(phase_matrix, WIDTH, HEIGHT) if phase_matrix.terms <= MOST_TERMS_DRAWN else None


@show_as_html(lambda field: "Radiance field" if field.index is None else name_field(field), draw_field)
def show_field(field: Field) -> dict[str, str]:
    """A field: I and degree of polarization against mu at the first azimuth; directions; of beams the first."""
    several = "" if isinstance(field.mu0, float) else f"{shorten_numbers(field.mu0)}, the first one here: μ0 = "
    field = field.beam(0) if several else field
    fluxes, media = {"up" if field.diagnostics.get("illuminate") == "bottom" else "down": field.direct}, {}
    if field.index is not None and field.direct_up is not None:
        fluxes = {"down": field.direct, "up": field.direct_up}
        media = {"refractive index": shorten_numbers(field.index)}
    return {
        "optical depths τ": shorten_numbers(field.tau),
        **media,
        "μ": shorten_numbers(field.mu),
        "φ [°]": shorten_numbers(field.phi),
        "beam": f"μ0 = {several}{field.mu0:.6g}; I, Q, U, V = {shorten_numbers(field.incident_stokes)}",
        "flux up, diffuse [W m⁻²]": shorten_numbers(field.flux_up),
        "flux down, diffuse": shorten_numbers(field.flux_down),
        **{f"flux {way}, direct": shorten_numbers(flux) for way, flux in fluxes.items()},
    } | describe_solve(field.diagnostics)


@show_as_html(name_brdf, draw_brdf)
def show_brdf(brdf: Brdf) -> dict[str, str]:
    """A BRDF: f00 and degree of linear polarization in the plane of incidence; its directions and reflectances."""
    shares = {"reflectance" if brdf.specular is None else "reflectance, diffuse": shorten_numbers(brdf.reflectance)}
    if brdf.specular is not None:
        shares["reflectance, as a beam"] = shorten_numbers(brdf.specular[:, 0, 0])
    transmission = {"transmission": "no" if brdf.transmission is None else "yes"}
    return describe_directions(brdf) | shares | transmission | describe_solve(brdf.diagnostics)


@show_as_html(lambda one: name_brdf(one[0]).replace("BRDF", "BRDFs"), lambda one: draw_spectrum(one, WIDTH, HEIGHT))
def show_spectrum(spectrum: Spectrum) -> dict[str, str]:
    """A spectrum: reflectance against wavelength; its wavelengths and directions."""
    wavelengths = {"wavelength [µm]": shorten_numbers(spectrum.wavelength_um)}
    reflectance = {"reflectance": shorten_numbers(spectrum.reflectance.ravel())}
    return wavelengths | describe_directions(spectrum) | reflectance | describe_solve(spectrum.brdfs[0].diagnostics)


@show_as_html("Phase matrix", draw_short_phase_matrix)
def show_phase_matrix(phase_matrix: PhaseMatrix) -> dict[str, str]:
    """A phase matrix: F11 and the ratios to it against the angle; its first coefficients."""
    kind = "scalar phase function" if phase_matrix.is_scalar else "polarizing"
    more = ", …" if phase_matrix.terms > DEGREES_SHOWN else ""
    first = zip(SEQUENCES, phase_matrix.coefficients[:DEGREES_SHOWN].T, strict=True)
    return {
        "terms": f"{phase_matrix.terms}, {kind}",
        "asymmetry g": f"{phase_matrix.asymmetry:.6g}",
        **{name: ", ".join(f"{value:.5g}" for value in values) + more for name, values in first},
    }


@show_as_html("Particles", lambda particles: draw_short_phase_matrix(particles.phase_matrix))
def show_particles(particles: Particles) -> dict[str, str]:
    """Particles: what they are, their cross sections, and F11 and the ratios to it against the angle."""
    return {
        "what": particles.description or "given by their phase matrix",
        "single-scattering albedo": f"{particles.albedo:.6g}",
        "extinction [µm²]": f"{particles.extinction_um2:.6g}",
        "scattering [µm²]": f"{particles.scattering_um2:.6g}",
        "volume [µm³]": f"{particles.volume_um3:.6g}",
        "phase matrix": particles.phase_matrix.in_words,
    }


@show_as_html("Layer", lambda layer: draw_short_phase_matrix(layer.phase_matrix))
def show_layer(layer: Layer) -> dict[str, str]:
    """A layer: its thickness and albedo, and F11 and the ratios to it against the angle."""
    return {
        "optical thickness": f"{layer.thickness:.6g}",
        "single-scattering albedo": f"{layer.albedo:.6g}",
        "phase matrix": layer.phase_matrix.in_words,
    }


@show_as_html("Scene")
def show_scene(scene: Scene) -> dict[str, str]:
    """A scene: its layers, top first, the interfaces between them, and its base."""
    stack: dict[str, str] = {}
    for index, layer in enumerate(scene.layers[:MOST_LAYERS], 1):
        interface, medium = scene.interfaces[index - 1], ""
        if interface is not None:
            stack[f"above layer {index}"] = interface.in_words
        if scene.has_interfaces:
            medium = f"; in a medium of index {scene.indices[index - 1]:g}"
        clear = layer.thickness == layer.albedo == 0.0
        stack[f"layer {index}"] = f"{'clear, of no thickness' if clear else layer.in_words}{medium}"
    more = len(scene.layers) - MOST_LAYERS
    if more > 0:
        stack["and"] = f"{more} more layers"
    if scene.interfaces[-1] is not None:
        stack[f"below layer {len(scene.layers)}"] = scene.interfaces[-1].in_words
    return stack | {"base": scene.base_in_words}


@show_as_html("Plan", lambda plan: draw_plan(plan, WIDTH, HEIGHT))
def show_plan(plan: Plan) -> str:
    """A plan: operations of each Fourier order and the orders left out; the text that `print` gives."""
    return str(plan)[:MOST_BYTES]


def write_html_table(facts: Mapping[str, str]) -> str:
    """An HTML table of names and texts, a row each, both escaped."""
    rows = (
        f"<tr><th {CELL}>{html.escape(name)}</th><td {CELL}>{html.escape(put_in_one_line(value, 160))}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{''.join(rows)}</table>"


def shorten_numbers(values: Array) -> str:
    """A list of numbers: all of a few, else how many and from where to where."""
    if values.size <= 5:
        return ", ".join(f"{value:.6g}" for value in values) or "none"
    return f"{values.size} from {values.min():.6g} to {values.max():.6g}"


def describe_directions(result: Brdf | Spectrum) -> dict[str, str]:
    """The directions of a BRDF or of a spectrum."""
    axes = {"μ incident": result.mu_i, "μ out": result.mu_o, "φ [°]": result.phi}
    return {name: shorten_numbers(values) for name, values in axes.items()}


def describe_solve(diagnostics: Mapping[str, Any]) -> dict[str, str]:
    """How a result was made, and what could not be promised."""
    found = {name: str(diagnostics[name]) for name in MADE if diagnostics.get(name) is not None}
    notes = diagnostics.get("notes")
    return found | ({"notes": "; ".join(map(str, notes)) if isinstance(notes, list) else str(notes)} if notes else {})
