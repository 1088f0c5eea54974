"""Results, phase matrices and plans as figures: panels described once, for pictures, notebooks and the viewer."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.polarization import find_degree_of_linear_polarization, find_degree_of_polarization
from vrte.basics.views import Figure
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.pictures.describe import (
    BLUE,
    GREEN,
    INCIDENT,
    INK,
    MIRRORED,
    ORANGE,
    PALETTE,
    RED,
    ZERO,
    Axis,
    Body,
    Curve,
    Line,
    Picture,
    PlotPanel,
    colour_scale,
    spread,
)
from vrte.pictures.figures import draw_picture, plot_suffix, require_pictures, save_figure
from vrte.pictures.interactive import draw_interactive, import_plotly
from vrte.pictures.lobes import (
    UNPOLARIZED,
    choose_range,
    compute_lobe,
    describe_incidence,
    describe_mirrored_beam,
    label_quantity,
    make_lobe_colours,
    name_brdf,
)
from vrte.results.brdf import Brdf, Spectrum
from vrte.results.field import Field, require_one_beam
from vrte.results.over_hemisphere import between_angles, check_directions, light_in_plane
from vrte.results.quantities import ANGLES, FIELD_QUANTITIES, check_name, incident_for, of_light, of_stokes, unit_of

MOST_LOBES = 4  # beside each other; with more incident directions, these are spread evenly over them
MOST_DEPTHS, MOST_POLAR_DEPTHS, MOST_AZIMUTHS = 6, 12, 3
MOST_CHANGES = 6  # derivatives in a picture
MOST_DEGREES = 2000  # of an expansion: beyond, a line on the screen is a smear
FEW = 40  # directions of a line, or fewer: each is marked
CUTS = ((0.0, "in the plane of incidence", BLUE, "-"), (90.0, "across it", ORANGE, "--"))
SIDES = "right: φ = 0°, forward; left: φ = 180°, back"
ANGLES_DEG = np.linspace(0.0, 180.0, 361)  # of scattering
SCATTERING = Axis("scattering angle [°]", 0.0, 180.0, ticks=range(0, 181, 30))
EXIT = Axis("angle of exit [°], forward > 0")
WAVELENGTH = Axis("wavelength in vacuum [µm]")
RATIOS = (  # an element of F, its sign, over F11, and the column of a table that has it
    ("F22/F11", (1, 1), 1.0, "F22"),
    ("F33/F11", (2, 2), 1.0, "F33"),
    ("F44/F11", (3, 3), 1.0, "F44"),
    ("−F12/F11", (0, 1), -1.0, "F12"),
    ("F34/F11", (2, 3), 1.0, "F34"),
)
BASES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (RED, ":"))
ALGORITHMS = {"modes": BLUE, "doubling": ORANGE, "invariance": GREEN, "scatterings": "#b5446e"}


def save_plot(result: Brdf | Field | Spectrum, path: str | os.PathLike[str]) -> None:
    """Draws a result into a PNG, SVG or PDF by the suffix, all of it or nothing."""
    plot_suffix(path)
    save_figure(result.plot(), path)


# ---- BRDFs


def describe_cuts(brdf: Brdf, index: int, quantity: str = "f00", stokes: Any = UNPOLARIZED) -> PlotPanel:
    """A quantity against the angle of exit in upright planes, as a half circle with its centre as far below 0."""
    incident = incident_for(quantity, stokes)
    found = [light_in_plane(brdf, index, phi, incident) for phi, *_ in CUTS]
    values = [of_light(light, quantity) for _, light in found]
    low, high = choose_range(np.stack(values), quantity)
    parts = describe_zero(low, 90.0)
    for (angle, _), value, (_, name, colour, dash) in zip(found, values, CUTS, strict=True):
        parts.append(describe_polar_curve(angle, value, quantity, name, colour, dash))
    beam, mirrored = float(np.degrees(np.arccos(brdf.mu_i[index]))), describe_mirrored_beam(brdf, index, stokes)
    parts.append(describe_arrow(-beam, high, low, "incident light"))
    if mirrored:
        parts.append(describe_arrow(beam, low, high, f"{mirrored}, not in the curves", MIRRORED))
    return PlotPanel(parts, y=Axis(label_quantity(quantity), low, low + 1.05 * (high - low)), polar="half")


def describe_zero(low: float, last: float) -> list[Curve]:
    """The circle where a quantity that may be negative is 0, to ``last`` degrees on both sides."""
    angle = np.linspace(-last, last, 91)
    return [Curve(angle, 0.0 * angle, "0", ZERO, ":", width=1.0)] if low < 0.0 else []


def describe_polar_curve(angle: Array, value: Array, quantity: str, name: str, colour: Any, dash: str = "-") -> Curve:
    """A line in a polar panel; of an angle, it is parted where that passes from 180 to 0."""
    if quantity in ANGLES:
        jumps = 1 + np.flatnonzero(np.abs(np.diff(value)) > 90.0)
        angle, value = np.insert(angle, jumps, np.nan), np.insert(value, jumps, np.nan)
    hover = f"{name}<br>%{{theta:.1f}}° from the upward normal<br>{quantity} = %{{r:.4g}} {unit_of(quantity)}"
    return Curve(angle, value, name, colour, dash, hover=hover)


def describe_arrow(angle: float, start: float, end: float, name: str, colour: str = INCIDENT) -> Curve:
    """A straight arrow along an angle, from one radius to another."""
    return Curve([angle, angle], [start, end], name, colour, width=1.6, arrow=True, hover=name)


def cuts(brdf: Brdf, place: int, quantity: str = "f00", stokes: Any = UNPOLARIZED) -> Any:
    """A quantity of `vrte.quantities.QUANTITIES` against the angle of exit, in and across the plane of incidence."""
    check_whole("place", place, 0, brdf.mu_i.size - 1)
    title, under = f"{name_brdf(brdf)}: {label_quantity(quantity)}", f"{describe_incidence(brdf, place)}; {SIDES}"
    return draw_interactive([describe_cuts(brdf, place, quantity, stokes)], title, under)


def draw_brdf(brdf: Brdf) -> Figure:
    """The lobes of a BRDF, all on one scale, its polar cuts, and its derivatives where it has some."""
    check_directions(brdf.mu_o, brdf.phi)
    require_pictures()
    chosen = spread(brdf.mu_i.size, MOST_LOBES)
    lobes = [compute_lobe(brdf, index) for index in chosen]
    scale = max(float(lobe.radius.max()) for lobe in lobes) or 1.0  # a dark scene is drawn as a point
    colours = make_lobe_colours(lobes)
    bodies: list[PlotPanel] = []
    cuts: list[PlotPanel] = []
    for index, lobe in zip(chosen, lobes, strict=True):
        title = f"μ$_i$ = {lobe.mu_i:.4g}  ({np.degrees(np.arccos(lobe.mu_i)):.0f}° from the normal)"
        title += f"\nlargest $f_{{00}}$ = {lobe.radius.max():.3g} sr$^{{-1}}$"
        bodies.append(PlotPanel([Body(lobe, 1.0 / scale, colours)], title=title, bare=True))
        panel = describe_cuts(brdf, index)
        beams = [  # along the whole radius; the lobe's own arrow has the share
            replace(one, name=re.sub(":.*,", " beam,", one.name), y=[0.0, 1.05 * scale]) if one.arrow else one
            for one in panel.parts
            if isinstance(one, Curve)
        ]
        legend = "" if cuts else "best"
        cuts.append(replace(panel, parts=beams, y=Axis(panel.y.label, 0.0, 1.05 * scale), legend=legend, columns=2))
    changes = describe_changes(brdf, chosen) if brdf.jacobian else []
    rows, heights = [bodies, cuts, *([changes] if changes else [])], (1.2, 1.0, *([0.8] if changes else []))
    title = f"{name_brdf(brdf)}: radius $f_{{00}}$, colour degree of linear polarization"
    bar = "degree of linear polarization, unpolarized incidence"
    size = max(4.6 * len(chosen), 8.0), 8.2 + 3.2 * bool(changes)
    return draw_picture(Picture(rows, *size, title, heights=heights, bar=bar))


def describe_changes(brdf: Brdf, chosen: Sequence[int]) -> list[PlotPanel]:
    """Derivatives of f00 in the plane of incidence, each over its largest; a panel an incident direction."""
    jacobian = brdf.jacobian or {}
    changes = dict(list(jacobian.items())[:MOST_CHANGES])
    parts: list[list[Any]] = [[Line(y=0.0, width=0.8)] for _ in chosen]
    for number, (dash, (name, values)) in enumerate(zip(cycle(("-", "--", ":")), changes.items(), strict=False)):
        shown = Brdf(values, brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {})
        found = [light_in_plane(shown, index, 0.0) for index in chosen]
        largest = max(float(np.abs(light[:, 0]).max()) for _, light in found) or 1.0
        for some, (angle, light) in zip(parts, found, strict=True):
            label = f"{name}: over {largest:.3g} sr$^{{-1}}$ a unit"
            some.append(Curve(angle, light[:, 0] / largest, label, f"C{number}", dash, width=1.8))
    along = Axis("angle of exit in the plane of incidence [°]", -90.0, 90.0, ticks=range(-90, 91, 30))
    left_out = len(jacobian) - len(changes)
    title = "derivatives of f00, each over its largest" + (f" ({left_out} more are not drawn)" if left_out else "")
    return [
        PlotPanel(
            [*some, Line(x=-float(np.degrees(np.arccos(brdf.mu_i[index]))), colour=INCIDENT)],
            along,
            Axis(low=-1.05, high=1.05),
            "" if k else title,
            legend="" if k else "best",
        )
        for k, (some, index) in enumerate(zip(parts, chosen, strict=True))
    ]


def describe_brdf(brdf: Brdf, indices: Sequence[int]) -> tuple[PlotPanel, PlotPanel]:
    """f00 and the degree of linear polarization in the plane of incidence, a curve an incident direction."""
    light: list[Any] = []
    polarized: list[Any] = []
    for index, colour in zip(indices, colour_scale(len(indices)), strict=True):
        angle, stokes = light_in_plane(brdf, index, step_deg=1.0)
        light.append(Curve(angle, stokes[:, 0], f"μ incident = {brdf.mu_i[index]:.4g}", colour))
        polarized.append(Curve(angle, find_degree_of_linear_polarization(stokes), colour=colour))
        if brdf.specular is not None:
            light.append(Line(x=float(np.degrees(np.arccos(brdf.mu_i[index]))), colour=colour, dash=":"))
    beam = "" if brdf.specular is None else "; dotted: mirrored beam, not in it"
    titles = f"f00 [sr⁻¹]{beam}", "degree of linear polarization"
    first, second = (
        PlotPanel(some, EXIT, Axis(low=0.0), title) for some, title in zip((light, polarized), titles, strict=True)
    )
    return first, second


# ---- fields


def name_field(field: Field) -> str:
    """The title of a picture of a field."""
    return "Subsurface radiance, diffuse light" if field.index is None else "Radiance, diffuse light, without beams"


def name_depth(field: Field, depth: int) -> str:
    """A depth, and where light is refracted the index n of its medium."""
    return f"τ = {field.tau[depth]:.4g}" + ("" if field.index is None else f", n = {field.index[depth]:.4g}")


def describe_field(field: Field, azimuth: int, depths: Sequence[int]) -> tuple[PlotPanel, PlotPanel]:
    """I and degree of polarization against mu at one azimuth, a line a depth and hemisphere, dots where few."""
    panels: tuple[list[Any], list[Any]] = [], []
    for depth, colour in zip(depths, colour_scale(len(depths)), strict=True):
        name = name_depth(field, depth)
        for side in (field.mu < 0.0, field.mu > 0.0):
            if not side.any():
                continue
            mu, first = np.unique(field.mu[side], return_index=True)
            given = field.stokes[depth, side, azimuth][first]
            angle, light = between_angles(np.arccos(mu), given)
            for parts, quantity in zip(panels, (lambda one: one[..., 0], find_degree_of_polarization), strict=True):
                parts.append(Curve(np.cos(angle), quantity(light), name, colour, width=1.7))
                if mu.size < FEW:
                    parts.append(Curve(mu, quantity(given), "", colour, "", "o"))
                name = "" if parts is panels[0] else name
            name = ""
    where = "" if field.index is None else ", in the medium of each depth"
    mu_axis = Axis(f"μ  (< 0 down, > 0 up{where})")
    light_panel = PlotPanel([*panels[0], Line(x=0.0)], mu_axis, Axis("I  [W m⁻² sr⁻¹]", low=0.0))
    return light_panel, PlotPanel([*panels[1], Line(x=0.0)], mu_axis, Axis("degree of polarization", low=0.0))


def draw_field(field: Field) -> Figure:
    """I and the degree of polarization against mu: a column an azimuth, or a beam of several, a line a depth."""
    if not field.mu.size:
        raise SceneError("a picture of a field needs directions mu: this one holds fluxes alone")
    depths = spread(field.tau.size, MOST_DEPTHS)
    if isinstance(field.mu0, float):
        chosen = [(field, index, f"φ = {field.phi[index]:g}°") for index in spread(field.phi.size, MOST_AZIMUTHS)]
        common = f"μ₀ = {field.mu0:g}"
    else:
        beams = [field.beam(index) for index in spread(field.mu0.size, MOST_AZIMUTHS)]
        chosen, common = [(beam, 0, f"μ₀ = {beam.mu0:g}") for beam in beams], f"φ = {field.phi[0]:g}°"
    columns = [(describe_field(beam, azimuth, depths), title) for beam, azimuth, title in chosen]
    tops = [
        replace(light, title=title, x=Axis(), letters=9.0, legend="" if k else "best")
        for k, ((light, _), title) in enumerate(columns)
    ]
    width = max(4.4 * len(columns), 6.4)
    rows = [tops, [part for (_, part), _ in columns]]
    return draw_picture(Picture(rows, width, 6.6, f"{name_field(field)}, {common}", share_y=True))


def field_polar(field: Field, quantity: str = "I", over_largest: bool = False, dark: bool = False) -> Any:
    """One of FIELD_QUANTITIES in the plane of incidence as polar diagrams, a curve a depth, up above."""
    check_name(quantity, FIELD_QUANTITIES)
    mu0 = require_one_beam(field)
    angle, values = select_in_plane(field, quantity)
    if over_largest:
        largest = np.nanmax(np.abs(values), axis=1, keepdims=True)
        values = values / np.where(largest > 0.0, largest, 1.0)
    depths = spread(field.tau.size, MOST_POLAR_DEPTHS)
    low, high = choose_range(values[depths], quantity)
    lightness = np.linspace(*((0.3, 1.0) if dark else (0.0, 0.85)), len(depths)).tolist()  # none as the page is
    colours = import_plotly().colors.sample_colorscale("Viridis", lightness)
    parts = describe_zero(low, 180.0)
    for depth, colour in zip(depths, colours, strict=True):
        parts.append(describe_polar_curve(angle, values[depth], quantity, name_depth(field, depth), colour))
    beam = float(np.degrees(np.arccos(mu0)))  # from straight up, where it goes
    beam = beam if field.diagnostics.get("illuminate") == "bottom" else 180.0 - beam
    outside = "" if field.index is None else ", outside"
    parts.append(describe_arrow(beam, low, high, f"the beam{outside}"))
    shown = "" if len(depths) == field.tau.size else f"; {len(depths)} of {field.tau.size} depths"
    what = f"{quantity}, each depth over its largest" if over_largest else label_quantity(quantity)
    panel = PlotPanel(parts, y=Axis(label_quantity(quantity), low, low + 1.05 * (high - low)), polar="whole")
    under = f"μ<sub>0</sub> = {mu0:.4g}{outside}; above: going up; {SIDES}{shown}"
    return draw_interactive([panel], f"{name_field(field)}: {what}", under)


def select_in_plane(field: Field, quantity: str) -> tuple[Array, Array]:
    """Angles (n,) [degrees] of travel from straight up, clockwise, and the quantity (tau, n), NaN between."""
    sides = {sign: np.flatnonzero(np.abs(field.phi % 360.0 - phi) < 1e-9) for sign, phi in ((1.0, 0.0), (-1.0, 180.0))}
    known = [(sign, found[0]) for sign, found in sides.items() if found.size]
    if not known or not field.mu.size:
        raise SceneError("polar diagrams of a field need directions mu, at phi_deg 0 or 180: the plane of incidence")
    theta = np.degrees(np.arccos(field.mu))
    angle = np.concatenate([sign * theta for sign, _ in known])
    value = np.concatenate([of_stokes(field.stokes[:, :, index], quantity) for _, index in known], axis=1)
    goes_up = np.abs(angle) < 90.0
    angles: list[Any] = []
    values: list[Any] = []
    for half, turned in ((goes_up, angle), (~goes_up, angle % 360.0)):
        order = np.flatnonzero(half)[np.argsort(turned[half], kind="stable")]
        angles += [turned[order], [np.nan]]
        values += [value[:, order], np.full((field.tau.size, 1), np.nan)]
    return np.concatenate(angles), np.concatenate(values, axis=1)


# ---- spectra


def describe_spectrum(spectrum: Spectrum) -> list[PlotPanel]:
    """Reflectance against wavelength, a line an incidence; f00 in the plane of the first, a line a wavelength."""
    first, indices = spectrum[0], spread(spectrum[0].mu_i.size, MOST_LOBES)
    marker = "o" if len(spectrum) < FEW else ""
    parts = []
    for index, colour in zip(indices, colour_scale(len(indices)), strict=True):
        label = f"μ incident = {first.mu_i[index]:.4g}"
        shares = spectrum.reflectance[:, index]
        parts.append(Curve(spectrum.wavelength_um, shares, label, colour, "-", marker, size=3.0))
        if first.specular is not None:
            beams = [float(one.specular[index, 0, 0]) for one in spectrum if one.specular is not None]
            parts.append(Curve(spectrum.wavelength_um, beams, "", colour, "--", marker, size=3.0))
    words = "reflectance" if first.specular is None else "diffuse reflectance; dashed: mirrored as a beam"
    panels = [PlotPanel(parts, WAVELENGTH, Axis(low=0.0), words)]
    try:
        check_directions(first.mu_o, first.phi)
    except SceneError:
        return panels
    shown = spread(len(spectrum), MOST_DEPTHS)
    found = [light_in_plane(spectrum[index], 0) for index in shown]
    lines = [
        Curve(angle, light[:, 0], f"{spectrum.wavelength_um[index]:.4g} µm", colour)
        for index, (angle, light), colour in zip(shown, found, colour_scale(len(shown)), strict=True)
    ]
    return [*panels, PlotPanel(lines, EXIT, Axis(low=0.0), f"f00 [sr⁻¹], μ incident = {first.mu_i[0]:.4g}")]


def draw_spectrum(spectrum: Spectrum, width: float = 9.6, height: float = 4.2) -> Figure:
    """Reflectance against wavelength, and beside it f00 in the plane of incidence. Raises MissingExtraError."""
    return draw_picture(Picture([describe_spectrum(spectrum)], width, height))


def reflectance(found: Any, wavelength_um: Sequence[float], index: int) -> Any:
    """Reflectance of light from ``mu_i[place]`` against wavelength, or of one wavelength against incidence."""
    angle = np.degrees(np.arccos(found.mu_i))
    spectral = len(wavelength_um) > 1
    x = np.array(wavelength_um) if spectral else angle
    order, unit = np.argsort(x), " µm" if spectral else "°"
    parts = [
        Curve(x[order], (shares[:, index] if spectral else shares[0])[order], name, colour, dash, "o",
              hover=f"{name}<br>%{{x:.4g}}{unit}: %{{y:.4f}}")
        for (name, shares), (colour, dash) in zip(found.curves.items(), BASES, strict=False)
    ]  # fmt: skip
    light = f"light from {angle[index]:.0f}° off the normal; " if spectral else ""
    under = f"{light}unpolarized, all directions of exit"
    along = WAVELENGTH if spectral else Axis("angle of incidence [°]")
    return draw_interactive(
        [PlotPanel(parts, along, Axis("reflectance", low=0.0))], "Reflectance", under, showlegend=True
    )


def spectra(found: Any, before: Any, geometry: str) -> Any:
    """Reflectance factors over black and white against wavelength, thinner those ``before``, as `CardSpectra`."""
    parts = [
        Curve(shares.wavelength_um, curve, name if now else f"{name}, before", colour, dash if now else ":",
              opacity=1.0 if now else 0.6, hover=f"{name}<br>%{{x:.4g}} µm: %{{y:.4f}}")
        for shares, now in ((found, True), (before, False)) if shares is not None
        for name, curve, (colour, dash) in zip(
            ("over black", "over white"), (shares.over_black, shares.over_white), BASES, strict=False)
    ]  # fmt: skip
    panel = PlotPanel(parts, WAVELENGTH, Axis("reflectance factor", low=0.0))
    title, under = f"Reflectance factor, {geometry}", "1 is the perfect white diffuser"
    return draw_interactive([panel], title, under, showlegend=True)


# ---- phase matrices


def describe_phase_matrix(phase_matrix: PhaseMatrix) -> list[PlotPanel]:
    """F11 on a logarithmic scale, with gaps where it is not above 0, and the other elements over it."""
    matrix = phase_matrix.scattering_matrix(ANGLES_DEG)
    f11 = np.where(matrix[:, 0, 0] > 0.0, matrix[:, 0, 0], np.nan)
    hover = "{} at %{{x:.1f}}°: %{{y:.4g}}"
    ratios = [
        Curve(ANGLES_DEG, sign * matrix[:, row, column] / f11, name, colour, hover=hover.format(name))
        for (name, (row, column), sign, _), colour in zip(RATIOS, PALETTE, strict=True)
    ]
    first = PlotPanel([Curve(ANGLES_DEG, f11, "F11", INK, width=1.7, hover=hover.format("F11"))], SCATTERING)
    first = replace(first, y=Axis("F11", log=10.0), title=f"F11, asymmetry {phase_matrix.asymmetry:.4g}", legend="")
    second = PlotPanel(ratios, SCATTERING, Axis("ratio to F11", -1.05, 1.05), "ratios to F11", columns=2)
    return [first, second]


def draw_phase_matrix(phase_matrix: PhaseMatrix, width: float = 9.6, height: float = 4.0) -> Figure:
    """F11 on a logarithmic scale, and the other elements over it; of an expansion over its table, the error below."""
    panels = [replace(one, y=replace(one.y, label="")) for one in describe_phase_matrix(phase_matrix)]
    known = phase_matrix.expansion
    if known is None:
        return draw_picture(Picture([panels], width, height))
    table = known.table
    above = table.F11 > 0.0
    angle, f11 = table.angle_deg[above], table.F11[above]
    points = [Curve(angle, f11, "", ORANGE, "", "o", size=2.5)]
    panels[0] = replace(panels[0], parts=[*panels[0].parts, *points])
    points = [
        Curve(angle, sign * getattr(table, column)[above] / f11, "", colour, "", "o", size=2.5)
        for (_, _, sign, column), colour in zip(RATIOS, PALETTE, strict=True)
    ]
    panels[1] = replace(panels[1], parts=[*panels[1].parts, *points])
    error = [Curve(table.angle_deg, np.maximum(known.error, 1e-16), "", RED, width=1.2)]
    below = PlotPanel(error, SCATTERING, Axis("error/F11", log=10.0))
    return draw_picture(Picture([panels, [below]], width, 1.4 * height, heights=(3.0, 1.0)))


def scattering_matrix(phase_matrix: PhaseMatrix) -> Any:
    """The same for a page. Raises MissingExtraError without Plotly."""
    under = "mean of F11 over the sphere 1; −F12/F11: polarization of unpolarized light"
    return draw_interactive(describe_phase_matrix(phase_matrix), "Scattering matrix", under)


def coefficients(phase_matrix: PhaseMatrix) -> Any:
    """The six expansion sequences against their degree l; one that vanishes is named so, and not drawn."""
    shown = min(phase_matrix.terms, MOST_DEGREES)
    columns = zip(SEQUENCES, phase_matrix.coefficients[:shown].T, (INK, *PALETTE), strict=True)
    parts = [
        Curve(np.arange(shown), values, name if values.any() else f"{name} = 0", colour, size=3.5,
              marker="o" if shown <= 100 else "", hover=f"{name}, l = %{{x}}: %{{y:.5g}}", shown=bool(values.any()))
        for name, values, colour in columns
    ]  # fmt: skip
    some = "" if shown == phase_matrix.terms else f", the first {shown} of {phase_matrix.terms} degrees"
    under = f"g = {phase_matrix.asymmetry:.4g}, {phase_matrix.terms} terms{some}"
    panel = PlotPanel(parts, Axis("degree l"), Axis("coefficient"))
    return draw_interactive([panel], "Expansion coefficients", under)


# ---- plans


def draw_plan(plan: Plan, width: float = 9.6, height: float = 3.2) -> Figure:
    """Predicted operations of each Fourier order, by algorithm, and the orders left out, a panel a part of the plan."""
    parts = plan.parts or (plan,)
    names = ("unpolarized light", "polarized light") if plan.parts else ("",)
    panels = [
        describe_orders(part, f"Plan of {plan.request.kind}{': ' * bool(name)}{name}")
        for part, name in zip(parts, names, strict=True)
    ]
    return draw_picture(Picture([[one] for one in panels], width, height * len(panels)))


def describe_orders(plan: Plan, title: str) -> PlotPanel:
    """A step an order, blocks of the same order on top of each other; what is left out is hatched."""
    base, parts = np.zeros(plan.orders), []
    edges = np.repeat(np.arange(plan.orders + 1) - 0.5, 2)[1:-1]
    for algorithm, values in sum_operations_by_order(plan.as_dict()).items():
        top = base + [values.get(order, 0.0) for order in range(plan.orders)]
        outline = np.concatenate([np.repeat(top, 2), np.repeat(base, 2)[::-1]])
        colour = ALGORITHMS.get(algorithm, PALETTE[2])
        parts.append(Curve(np.concatenate([edges, edges[::-1]]), outline, algorithm, colour, filled=True))
        base = top
    last = max(int(plan.problem.terms.max()), plan.orders)
    if last > plan.orders:
        name = f"left out of multiple scattering: {last - plan.orders} of {last}"
        first, end, high = plan.orders - 0.5, last - 0.5, float(base.max()) or 1.0
        x, y = [first, end, end, first], [0.0, 0.0, high, high]
        parts.append(Curve(x, y, name, "#eeeeee", filled=True, hatch="//"))
    return PlotPanel(parts, Axis("Fourier order", -0.5, last - 0.5, whole=True), Axis("operations"), title, letters=8.0)


def sum_operations_by_order(facts: Mapping[str, Any]) -> dict[str, dict[int, float]]:
    """Operations by algorithm and order, from `Plan.as_dict`; a block's are shared out evenly over its orders."""
    found: dict[str, dict[int, float]] = {}
    for block in facts["blocks"]:
        costs = found.setdefault(block["algorithm"], {})
        for order in block["orders"]:
            costs[order] = costs.get(order, 0.0) + block["operations"] / len(block["orders"])
    return found
