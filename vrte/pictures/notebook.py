"""Results as a notebook shows them: a small picture above a table, as HTML.

Nothing here raises: what cannot be drawn, for want of directions or of matplotlib, is a table alone.
"""

import base64
import html
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from vrte.basics.arrays import Array, in_one_line
from vrte.basics.polarization import degree_of_linear_polarization
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.optics.phase_matrix import PhaseMatrix
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
MADE = (
    "method",
    "method_rule",
    "algorithm",
    "backend",
    "nodes",
    "accuracy",
    "truncation",
    "base",
)  # of diagnostics, where there


def field_html(field: Field) -> str:
    """A field: I and degree of polarization against mu at the first azimuth; its directions and fluxes. Of several
    beams the first."""
    several = "" if isinstance(field.mu0, float) else f"{in_short(field.mu0)}, the first one here: μ0 = "
    field = field.beam(0) if several else field

    def facts() -> dict[str, str]:
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

    return shown(field, "Radiance field", facts, lambda: field_picture(field))


def brdf_html(brdf: Brdf) -> str:
    """A BRDF: f00 and degree of linear polarization in the plane of incidence; its directions and reflectances."""

    def facts() -> dict[str, str]:
        return {
            "μ incident": in_short(brdf.mu_i),
            "μ out": in_short(brdf.mu_o),
            "φ [°]": in_short(brdf.phi),
            "reflectance": in_short(brdf.reflectance),
            "transmission": "no" if brdf.transmission is None else "yes",
        } | made(brdf.diagnostics)

    return shown(brdf, "Subsurface BRDF", facts, lambda: brdf_picture(brdf))


def spectrum_html(spectrum: Spectrum) -> str:
    """A spectrum: reflectance against wavelength; its wavelengths and directions."""

    def facts() -> dict[str, str]:
        return {
            "wavelength [µm]": in_short(spectrum.wavelength_um),
            "μ incident": in_short(spectrum.mu_i),
            "μ out": in_short(spectrum.mu_o),
            "φ [°]": in_short(spectrum.phi),
            "reflectance": in_short(spectrum.reflectance.ravel()),
        } | made(spectrum.brdfs[0].diagnostics)

    return shown(spectrum, "Subsurface BRDFs", facts, lambda: spectrum_figure(spectrum, WIDTH, HEIGHT))


def phase_matrix_html(phase_matrix: PhaseMatrix) -> str:
    """A phase matrix: F11 and the ratios to it against the angle; its first coefficients."""

    def facts() -> dict[str, str]:
        kind = "scalar phase function" if phase_matrix.is_scalar else "polarizing"
        head = {"terms": f"{phase_matrix.terms}, {kind}", "asymmetry g": f"{phase_matrix.asymmetry:.6g}"}
        more = ", …" if phase_matrix.terms > DEGREES_SHOWN else ""
        first = phase_matrix.coefficients[:DEGREES_SHOWN].T
        names = ("a1", "a2", "a3", "a4", "b1", "b2")
        return head | {
            name: ", ".join(f"{value:.5g}" for value in values) + more
            for name, values in zip(names, first, strict=True)
        }

    return shown(phase_matrix, "Phase matrix", facts, lambda: quick_phase_picture(phase_matrix))


def particles_html(particles: Particles) -> str:
    """Particles: what they are, their cross sections, and F11 and the ratios to it against the angle."""

    def facts() -> dict[str, str]:
        return {
            "what": particles.description or "given by their phase matrix",
            "single-scattering albedo": f"{particles.albedo:.6g}",
            "extinction [µm²]": f"{particles.extinction_um2:.6g}",
            "scattering [µm²]": f"{particles.scattering_um2:.6g}",
            "volume [µm³]": f"{particles.volume_um3:.6g}",
            "phase matrix": particles.phase_matrix.in_words,
        }

    return shown(particles, "Particles", facts, lambda: quick_phase_picture(particles.phase_matrix))


def layer_html(layer: Layer) -> str:
    """A layer: its thickness and albedo, and F11 and the ratios to it against the angle."""

    def facts() -> dict[str, str]:
        return {
            "optical thickness": f"{layer.thickness:.6g}",
            "single-scattering albedo": f"{layer.albedo:.6g}",
            "phase matrix": layer.phase_matrix.in_words,
        }

    return shown(layer, "Layer", facts, lambda: quick_phase_picture(layer.phase_matrix))


def scene_html(scene: Scene) -> str:
    """A scene: its layers, top first, and its base."""

    def facts() -> dict[str, str]:
        layers = {f"layer {place}": layer.in_words for place, layer in enumerate(scene.layers[:MOST_LAYERS], 1)}
        more = len(scene.layers) - MOST_LAYERS
        return layers | ({"and": f"{more} more layers"} if more > 0 else {}) | {"base": scene.base_in_words}

    return shown(scene, "Scene", facts, lambda: None)


def quick_phase_picture(phase_matrix: PhaseMatrix) -> "Figure | None":
    """Of a phase matrix that is drawn at a glance."""
    return phase_matrix_figure(phase_matrix, WIDTH, HEIGHT) if phase_matrix.terms <= MOST_TERMS_DRAWN else None


def plan_html(plan: Plan) -> str:
    """A plan: operations of each Fourier order and the orders left out; the text that `print` gives."""
    return shown(plan, "Plan", lambda: str(plan)[:MOST_BYTES], lambda: plan_figure(plan, WIDTH, HEIGHT))


def shown(
    thing: Any, title: str, facts: Callable[[], Mapping[str, str] | str], draw: Callable[[], "Figure | None"]
) -> str:
    """Title, picture and table, or text where ``facts`` is one, as far as they can be made."""
    try:
        found = facts()
        text = f"<pre>{html.escape(found)}</pre>" if isinstance(found, str) else table(found)
    except Exception:  # a notebook must show something, whatever a result holds
        text = f"<pre>{html.escape(in_one_line(object.__repr__(thing)))}</pre>"
    return f"<div><b>{html.escape(title)}</b><br>{image(draw)}{text}</div>"


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


def image(draw: Callable[[], "Figure | None"]) -> str:
    """The picture, embedded; nothing where it cannot be drawn."""
    try:
        figure: Any = draw()
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


def made(diagnostics: Mapping[str, Any]) -> dict[str, str]:
    """How a result was made, and what could not be promised."""
    found = {name: str(diagnostics[name]) for name in MADE if name in diagnostics}
    notes = diagnostics.get("notes")
    return found | ({"notes": "; ".join(map(str, notes)) if isinstance(notes, list) else str(notes)} if notes else {})


def field_picture(field: Field) -> "Figure | None":
    """I and the degree of polarization at the first azimuth."""
    if not field.mu.size:
        return None
    figure = new_figure(WIDTH, HEIGHT)
    panels: Any = figure.subplots(1, 2)
    depths = spread(field.tau.size, MOST_LINES)
    for order, depth in enumerate(depths):
        draw_depth(panels, field, depth, 0, depth_colour(order, len(depths)))
    finish(panels, ("I [W m⁻² sr⁻¹]", "degree of polarization"), f"μ, at φ = {field.phi[0]:g}°")
    figure.subplots_adjust(**MARGINS)
    return figure


def brdf_picture(brdf: Brdf) -> "Figure | None":
    """f00 and the degree of linear polarization in the plane of incidence. SceneError for too few directions."""
    check_directions(brdf.mu_o, brdf.phi)
    places = spread(brdf.mu_i.size, MOST_LINES)
    if len(places) * brdf.mu_o.size * brdf.phi.size > MOST_DIRECTIONS_DRAWN:
        return None
    figure = new_figure(WIDTH, HEIGHT)
    panels: Any = figure.subplots(1, 2)
    for order, place in enumerate(places):
        angle, light = light_in_plane(brdf, place, step_deg=1.0)
        style = {"color": depth_colour(order, len(places)), "linewidth": 1.5}
        panels[0].plot(angle, light[:, 0], label=f"μ incident = {brdf.mu_i[place]:.4g}", **style)
        panels[1].plot(angle, degree_of_linear_polarization(light), **style)
    finish(panels, ("f00 [sr⁻¹]", "degree of linear polarization"), "angle of exit [°], forward > 0")
    figure.subplots_adjust(**MARGINS)
    return figure
