"""Polar diagrams: cuts through a BRDF, and the radiance field in the plane of incidence, a curve a depth."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.figures.style import (
    GRID,
    UNPOLARIZED,
    ZERO,
    choose_range,
    describe_incidence,
    import_plotly,
    label_quantity,
    make_curve,
    make_plotly_figure,
)
from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import SceneError
from vrte.pictures.lobes import CUTS, INCIDENT, MIRRORED, describe_mirrored_beam, name_brdf, name_field, spread
from vrte.results.brdf import Brdf
from vrte.results.field import Field, require_one_beam
from vrte.results.over_hemisphere import light_in_plane
from vrte.results.quantities import ANGLES, FIELD_QUANTITIES, check_name, incident_for, of_light, of_stokes, unit_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STEP = 0.5  # degrees
DASHES = {"-": "solid", "--": "dash"}
MOST_DEPTHS = 12  # of more depths, these are spread evenly over them
DEPTH_COLOURS = "Viridis"
LEGEND = {"orientation": "h", "x": 0.5, "xanchor": "center", "y": -0.06, "yanchor": "top"}
SIDES = "right: φ = 0°, forward; left: φ = 180°, back"


def cuts(brdf: Brdf, place: int, quantity: str = "f00", stokes: Any = UNPOLARIZED) -> "Figure":
    """A quantity of the light that leaves against its angle from the normal, in and across the plane of incidence.

    ``quantity`` is one of `vrte.quantities.QUANTITIES`, ``stokes`` the incident light at ``mu_i[place]``. Where the
    quantity may be negative, the centre is as far below 0 as the rim is above, and 0 is drawn as a half circle. Raises
    SceneError for an unknown quantity or place, or too few directions, MissingExtraError without Plotly.
    """
    check_whole("place", place, 0, brdf.mu_i.size - 1)
    incident = incident_for(quantity, stokes)
    planes = [light_in_plane(brdf, place, phi, incident, STEP) for phi, *_ in CUTS]
    found = [(angle, of_light(light, quantity)) for angle, light in planes]
    low, high = choose_range(np.stack([value for _, value in found]), quantity)
    curves = [
        make_polar_curve(*one, quantity, name, colour, dash=DASHES[dash])
        for one, (_, name, colour, dash) in zip(found, CUTS, strict=True)
    ]
    beam, mirrored = float(np.degrees(np.arccos(brdf.mu_i[place]))), describe_mirrored_beam(brdf, place, stokes)
    arrows = [make_arrow(-beam, (high, low), "incident light")]
    arrows += [make_arrow(beam, (low, high), f"{mirrored}, not in the curves", MIRRORED)] if mirrored else []
    return make_plotly_figure(
        [*make_zero_line(low, 90.0), *curves, *arrows],
        f"{name_brdf(brdf)}: {label_quantity(quantity)}",
        f"{describe_incidence(brdf, place)}; {SIDES}",
        polar=make_polar_axes(low, high, [0.0, 180.0]),
        legend=LEGEND,
    )


def field_polar(field: Field, quantity: str = "I", over_largest: bool = False, dark: bool = False) -> "Figure":
    """The radiance field in the plane of incidence as polar diagrams, one curve a depth: light going up is above.

    ``quantity`` is one of `vrte.quantities.FIELD_QUANTITIES`. The plane is where ``field.phi`` is 0 and 180; one of
    them gives half of it. ``over_largest``: each depth as a share of its own largest, since light fades with depth;
    ``dark``: in colours for a dark page. Raises SceneError for an unknown quantity, or where both are missing or there
    are no directions, MissingExtraError without Plotly.
    """
    check_name(quantity, FIELD_QUANTITIES)
    mu0 = require_one_beam(field)
    angle, values = select_in_plane(field, quantity)
    if over_largest:
        largest = np.nanmax(np.abs(values), axis=1, keepdims=True)
        values = values / np.where(largest > 0.0, largest, 1.0)
    depths = spread(field.tau.size, MOST_DEPTHS)
    low, high = choose_range(values[depths], quantity)
    lightness = np.linspace(*((0.3, 1.0) if dark else (0.0, 0.85)), len(depths))  # none as the page is
    curves = [
        make_polar_curve(angle, values[depth], quantity, name_depth(field, depth), colour)
        for depth, colour in zip(
            depths, import_plotly().colors.sample_colorscale(DEPTH_COLOURS, lightness.tolist()), strict=True
        )
    ]
    beam = float(np.degrees(np.arccos(mu0)))  # from straight up, where it goes
    beam = beam if field.diagnostics.get("illuminate") == "bottom" else 180.0 - beam
    shown = "" if len(depths) == field.tau.size else f"; {len(depths)} of {field.tau.size} depths"
    outside = "" if field.index is None else ", outside"
    what = f"{quantity}, each depth over its largest" if over_largest else label_quantity(quantity)
    return make_plotly_figure(
        [*make_zero_line(low, 180.0), *curves, make_arrow(beam, (low, high), f"the beam{outside}")],
        f"{name_field(field)}: {what}",
        f"μ<sub>0</sub> = {mu0:.4g}{outside}; above: going up; {SIDES}{shown}",
        polar=make_polar_axes(low, high),
        legend=LEGEND,
    )


def name_depth(field: Field, depth: int) -> str:
    """A depth, and where light is refracted the index n of its medium."""
    return f"τ = {field.tau[depth]:.4g}" + ("" if field.index is None else f", n = {field.index[depth]:.4g}")


def select_in_plane(field: Field, quantity: str) -> tuple[Array, Array]:
    """Angles (n,) [degrees] of travel from straight up, clockwise, and the quantity there (tau, n).

    NaN parts light that goes up from light that goes down: it may jump at the horizon.
    """
    sides = {sign: np.flatnonzero(np.abs(field.phi % 360.0 - phi) < 1e-9) for sign, phi in ((1.0, 0.0), (-1.0, 180.0))}
    known = [(sign, found[0]) for sign, found in sides.items() if found.size]
    if not known or not field.mu.size:
        raise SceneError("polar diagrams of a field need directions mu, at phi_deg 0 or 180: the plane of incidence")
    theta = np.degrees(np.arccos(field.mu))
    angle = np.concatenate([sign * theta for sign, _ in known])
    value = np.concatenate([of_stokes(field.stokes[:, :, place], quantity) for _, place in known], axis=1)
    goes_up = np.abs(angle) < 90.0
    angles: list[Any] = []
    values: list[Any] = []
    for half, turned in ((goes_up, angle), (~goes_up, angle % 360.0)):
        order = np.flatnonzero(half)[np.argsort(turned[half], kind="stable")]
        angles += [turned[order], [np.nan]]
        values += [value[:, order], np.full((field.tau.size, 1), np.nan)]
    return np.concatenate(angles), np.concatenate(values, axis=1)


def make_polar_curve(angle: Array, value: Array, quantity: str, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """A line in a polar diagram; of an angle, it is parted where that passes from 180 to 0."""
    if quantity in ANGLES:
        jumps = 1 + np.flatnonzero(np.abs(np.diff(value)) > 90.0)
        angle, value = np.insert(angle, jumps, np.nan), np.insert(value, jumps, np.nan)
    hover = f"{name}<br>%{{theta:.1f}}° from the upward normal<br>{quantity} = %{{r:.4g}} {unit_of(quantity)}"
    return make_curve(angle, value, name, colour, hover, polar=True, **more)


def make_zero_line(low: float, last: float) -> list[dict[str, Any]]:
    """Where a quantity that may be negative is 0, to ``last`` degrees on both sides."""
    angle = np.linspace(-last, last, 91)
    line = {"color": ZERO, "width": 1, "dash": "dot"}
    return (
        [make_curve(angle, 0.0 * angle, "0", ZERO, "0", polar=True, line=line, hoverinfo="skip")] if low < 0.0 else []
    )


def make_arrow(angle: float, radii: Sequence[float], name: str, colour: str = INCIDENT) -> dict[str, Any]:
    """A straight arrow along an angle, from the first radius to the second."""
    marker = {"symbol": "arrow", "size": [0, 15], "angleref": "previous", "color": colour, "opacity": 1}
    about = {"mode": "lines+markers", "marker": marker, "hoverinfo": "name"}
    return make_curve(np.array([angle, angle]), np.array(radii), name, colour, name, polar=True, **about)


def make_polar_axes(low: float, high: float, sector: Sequence[float] = (0.0, 360.0)) -> dict[str, Any]:
    """Angles clockwise from straight up; the sector is Plotly's, counter-clockwise from the right."""
    marked = range(-90, 91, 30) if sector[1] == 180.0 else range(0, 360, 30)
    return {
        "sector": list(sector),
        "bgcolor": "white",
        "angularaxis": {
            "rotation": 90,
            "direction": "clockwise",
            "tickvals": list(marked),
            "ticktext": [f"{min(abs(angle), 360 - angle)}°" for angle in marked],
            **GRID,
        },
        "radialaxis": {
            "range": [low, low + 1.05 * (high - low)],
            "angle": 0,
            "tickangle": 0,
            "nticks": 5,
            "tickfont": {"size": 11},
            "exponentformat": "power",
            **GRID,
        },
    }
