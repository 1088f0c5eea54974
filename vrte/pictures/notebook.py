"""Results as a notebook shows them: a small picture above a table, as HTML.

Nothing here raises: what cannot be drawn, for want of directions or of matplotlib, is a table alone.
"""

import base64
import html
from collections.abc import Callable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, Any

from vrte.basics.arrays import Array, in_one_line
from vrte.basics.polarization import degree_of_linear_polarization
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.optics.spheres import Particles
from vrte.pictures.figures import finish, new_figure
from vrte.pictures.lobes import depth_colour, draw_depth, spectrum_figure, spread
from vrte.pictures.phase_pictures import phase_matrix_figure
from vrte.pictures.plan_picture import plan_figure
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.over_hemisphere import check_directions, light_in_plane
from vrte.results.spectrum import Spectrum
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 7.2, 2.5  # of a picture [inches]
MARGINS = {"left": 0.09, "right": 0.98, "bottom": 0.2, "top": 0.89, "wspace": 0.2}
MOST_LAYERS = 20  # in the table of a scene
MOST_LINES = 4  # incident directions or depths in it
MOST_TERMS_DRAWN = 5000  # more take longer than anyone waits for a glance, and so do
MOST_DIRECTIONS_DRAWN = 300_000  # incident ones of the picture times outgoing ones
MOST_BYTES = 400_000  # of a plan's text
DEGREES_SHOWN = 6  # of an expansion
CELL = 'style="text-align:left;vertical-align:top;padding:1px 10px 1px 0"'
# of diagnostics, where there
MADE = ("method", "method_rule", "algorithm", "backend", "nodes", "accuracy", "truncation", "base")


def shown(title: str, draw: Callable[[Any], "Figure | None"] = lambda _: None) -> Callable[[Any], Callable[[Any], str]]:
    """Of what tells a thing's facts, a table or a text, makes what shows the thing: title, picture and facts, as far as
    they can be made."""

    def with_facts(facts: Callable[[Any], Mapping[str, str] | str]) -> Callable[[Any], str]:
        @wraps(facts)
        def as_html(thing: Any) -> str:
            try:
                found = facts(thing)
                text = f"<pre>{html.escape(found)}</pre>" if isinstance(found, str) else table(found)
            except Exception:  # a notebook must show something, whatever a result holds
                text = f"<pre>{html.escape(in_one_line(object.__repr__(thing)))}</pre>"
            return f"<div><b>{html.escape(title)}</b><br>{image(draw, thing)}{text}</div>"

        return as_html

    return with_facts


def field_picture(field: Field) -> "Figure | None":
    """I and the degree of polarization of the first beam at the first azimuth."""
    if not field.mu.size:
        return None
    field = field if isinstance(field.mu0, float) else field.beam(0)
    figure, panels = two_panels()
    depths = spread(field.tau.size, MOST_LINES)
    for order, depth in enumerate(depths):
        draw_depth(panels, field, depth, 0, depth_colour(order, len(depths)))
    finish(panels, ("I [W m⁻² sr⁻¹]", "degree of polarization"), f"μ, at φ = {field.phi[0]:g}°")
    return figure


def brdf_picture(brdf: Brdf) -> "Figure | None":
    """f00 and the degree of linear polarization in the plane of incidence. SceneError for too few directions."""
    check_directions(brdf.mu_o, brdf.phi)
    places = spread(brdf.mu_i.size, MOST_LINES)
    if len(places) * brdf.mu_o.size * brdf.phi.size > MOST_DIRECTIONS_DRAWN:
        return None
    figure, panels = two_panels()
    for order, place in enumerate(places):
        angle, light = light_in_plane(brdf, place, step_deg=1.0)
        style = {"color": depth_colour(order, len(places)), "linewidth": 1.5}
        panels[0].plot(angle, light[:, 0], label=f"μ incident = {brdf.mu_i[place]:.4g}", **style)
        panels[1].plot(angle, degree_of_linear_polarization(light), **style)
    finish(panels, ("f00 [sr⁻¹]", "degree of linear polarization"), "angle of exit [°], forward > 0")
    return figure


def two_panels() -> tuple["Figure", Any]:
    """A small figure, and its two halves."""
    figure = new_figure(WIDTH, HEIGHT)
    panels = figure.subplots(1, 2)
    figure.subplots_adjust(**MARGINS)
    return figure, panels


def phase_picture(phase_matrix: PhaseMatrix) -> "Figure | None":
    """F11 and the ratios to it, of a phase matrix that is drawn at a glance."""
    return phase_matrix_figure(phase_matrix, WIDTH, HEIGHT) if phase_matrix.terms <= MOST_TERMS_DRAWN else None


@shown("Radiance field", field_picture)
def field_html(field: Field) -> dict[str, str]:
    """A field: I and degree of polarization against mu at the first azimuth; its directions and fluxes. Of several
    beams the first."""
    several = "" if isinstance(field.mu0, float) else f"{in_short(field.mu0)}, the first one here: μ0 = "
    field = field.beam(0) if several else field
    beam = "up" if field.diagnostics.get("illuminate") == "bottom" else "down"
    return {
        "optical depths τ": in_short(field.tau),
        "μ": in_short(field.mu),
        "φ [°]": in_short(field.phi),
        "beam": f"μ0 = {several}{field.mu0:.6g}; I, Q, U, V = {in_short(field.incident_stokes)}",
        "flux up, diffuse [W m⁻²]": in_short(field.flux_up),
        "flux down, diffuse": in_short(field.flux_down),
        f"flux {beam}, direct": in_short(field.direct),
    } | made(field.diagnostics)


@shown("Subsurface BRDF", brdf_picture)
def brdf_html(brdf: Brdf) -> dict[str, str]:
    """A BRDF: f00 and degree of linear polarization in the plane of incidence; its directions and reflectances."""
    transmission = {"transmission": "no" if brdf.transmission is None else "yes"}
    return directions(brdf) | {"reflectance": in_short(brdf.reflectance)} | transmission | made(brdf.diagnostics)


@shown("Subsurface BRDFs", lambda spectrum: spectrum_figure(spectrum, WIDTH, HEIGHT))
def spectrum_html(spectrum: Spectrum) -> dict[str, str]:
    """A spectrum: reflectance against wavelength; its wavelengths and directions."""
    wavelengths = {"wavelength [µm]": in_short(spectrum.wavelength_um)}
    reflectance = {"reflectance": in_short(spectrum.reflectance.ravel())}
    return wavelengths | directions(spectrum) | reflectance | made(spectrum.brdfs[0].diagnostics)


@shown("Phase matrix", phase_picture)
def phase_matrix_html(phase_matrix: PhaseMatrix) -> dict[str, str]:
    """A phase matrix: F11 and the ratios to it against the angle; its first coefficients."""
    kind = "scalar phase function" if phase_matrix.is_scalar else "polarizing"
    more = ", …" if phase_matrix.terms > DEGREES_SHOWN else ""
    first = zip(SEQUENCES, phase_matrix.coefficients[:DEGREES_SHOWN].T, strict=True)
    return {
        "terms": f"{phase_matrix.terms}, {kind}",
        "asymmetry g": f"{phase_matrix.asymmetry:.6g}",
        **{name: ", ".join(f"{value:.5g}" for value in values) + more for name, values in first},
    }


@shown("Particles", lambda particles: phase_picture(particles.phase_matrix))
def particles_html(particles: Particles) -> dict[str, str]:
    """Particles: what they are, their cross sections, and F11 and the ratios to it against the angle."""
    return {
        "what": particles.description or "given by their phase matrix",
        "single-scattering albedo": f"{particles.albedo:.6g}",
        "extinction [µm²]": f"{particles.extinction_um2:.6g}",
        "scattering [µm²]": f"{particles.scattering_um2:.6g}",
        "volume [µm³]": f"{particles.volume_um3:.6g}",
        "phase matrix": particles.phase_matrix.in_words,
    }


@shown("Layer", lambda layer: phase_picture(layer.phase_matrix))
def layer_html(layer: Layer) -> dict[str, str]:
    """A layer: its thickness and albedo, and F11 and the ratios to it against the angle."""
    return {
        "optical thickness": f"{layer.thickness:.6g}",
        "single-scattering albedo": f"{layer.albedo:.6g}",
        "phase matrix": layer.phase_matrix.in_words,
    }


@shown("Scene")
def scene_html(scene: Scene) -> dict[str, str]:
    """A scene: its layers, top first, and its base."""
    layers = {f"layer {place}": layer.in_words for place, layer in enumerate(scene.layers[:MOST_LAYERS], 1)}
    more = len(scene.layers) - MOST_LAYERS
    return layers | ({"and": f"{more} more layers"} if more > 0 else {}) | {"base": scene.base_in_words}


@shown("Plan", lambda plan: plan_figure(plan, WIDTH, HEIGHT))
def plan_html(plan: Plan) -> str:
    """A plan: operations of each Fourier order and the orders left out; the text that `print` gives."""
    return str(plan)[:MOST_BYTES]


def table(facts: Mapping[str, str]) -> str:
    """Two columns, escaped.

    >>> "&lt;b&gt;" in table({"method": "<b>"})
    True
    """
    rows = (
        f"<tr><th {CELL}>{html.escape(name)}</th><td {CELL}>{html.escape(in_one_line(value, 160))}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{''.join(rows)}</table>"


def image(draw: Callable[[Any], "Figure | None"], thing: Any) -> str:
    """The picture, embedded; nothing where it cannot be drawn."""
    try:
        figure: Any = draw(thing)
        drawn = b"" if figure is None else figure._repr_png_()
    except Exception:  # too few directions, no matplotlib, numbers that no axis takes
        drawn = b""
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(drawn).decode()}"><br>' if drawn else ""


def in_short(values: Array) -> str:
    """A list of numbers: all of a few, else how many and from where to where.

    >>> import numpy as np
    >>> in_short(np.array([0.5, 1.0])), in_short(np.linspace(0.0, 1.0, 11)), in_short(np.array([]))
    ('0.5, 1', '11 from 0 to 1', 'none')
    """
    if values.size <= 5:
        return ", ".join(f"{value:.6g}" for value in values) or "none"
    return f"{values.size} from {values.min():.6g} to {values.max():.6g}"


def directions(result: Brdf | Spectrum) -> dict[str, str]:
    """Those that a BRDF, or BRDFs, are for."""
    return {
        "μ incident": in_short(result.mu_i),
        "μ out": in_short(result.mu_o),
        "φ [°]": in_short(result.phi),
    }


def made(diagnostics: Mapping[str, Any]) -> dict[str, str]:
    """How a result was made, and what could not be promised."""
    found = {name: str(diagnostics[name]) for name in MADE if name in diagnostics}
    notes = diagnostics.get("notes")
    return found | ({"notes": "; ".join(map(str, notes)) if isinstance(notes, list) else str(notes)} if notes else {})
