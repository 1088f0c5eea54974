"""A result as a picture: the lobes of a BRDF with their polar cuts, a radiance field against the direction cosine.

Without interfaces the light is inside the host medium, before any refraction at its surface, and titles say
"subsurface". What comes back as a beam, mirrored, is an arrow with its share, and in no lobe. What is drawn ends where
the directions of the result end.
"""

import os
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.polarization import find_degree_of_linear_polarization, find_degree_of_polarization
from vrte.pictures.figures import finish, limit_ticks, make_figure, plot_suffix, save_figure
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.over_hemisphere import between_angles, check_directions, light_in_plane, light_on_mesh
from vrte.results.spectrum import Spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LOBES = 4  # beside each other; with more incident directions, these are spread evenly over them
MOST_DEPTHS = 6
MOST_AZIMUTHS = 3
MOST_CHANGES = 6  # derivatives in a picture
CHANGES_HEIGHT = 3.2  # [inch] of theirs
FEW = 40  # directions of a line, or fewer: each is marked
COLOURS = "plasma"
COLOURED_TO = 80.0  # [degrees]; what is brighter nearer to the horizon takes the last colour
INCIDENT, MIRRORED = "#d62728", "#2a8f5b"
INK, FAINT = "#222222", "#b5b5b5"
UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
CUTS = ((0.0, "in the plane of incidence", "#1f4e79", "-"), (90.0, "across it", "#d98200", "--"))
ELEVATION, AZIMUTH = np.radians([24.0, -72.0])  # of the eye that sees a lobe, from far away
TOWARD = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
UPRIGHT = np.cross(TOWARD, RIGHT)
LAMP = np.array([-0.45, -0.6, 0.66])


def save_plot(result: Brdf | Field | Spectrum, path: str | os.PathLike[str]) -> None:
    """Draws ``result`` into the file ``path``, PNG, SVG or PDF by its suffix, all of it or nothing.

    A BRDF gives a lobe for each mu_i, its radius f00 and its colour the degree of linear polarization for
    unpolarized incident light, above cuts in and across the plane of incidence. A field gives I and the degree of
    polarization against mu, a spectrum its reflectance and its cuts. Raises MissingExtraError without the extra
    "plot", SceneError where there are too few directions for a picture or for another suffix, OSError.

    >>> save_plot(brdf, "lobes.png")
    """
    plot_suffix(path)
    save_figure(result.plot(), path)


@dataclass(frozen=True, eq=False)
class Lobe:
    """f00 ``radius`` and degree of linear polarization ``polarized`` (theta, phi) of light that falls in unpolarized at
    ``mu_i``, on the rings ``theta`` and spokes ``phi`` [degrees] of a fine mesh that ends at the last mu_o;
    ``mirrored`` says what comes back as a beam, "" for nothing."""

    mu_i: float
    theta: Array
    phi: Array
    radius: Array
    polarized: Array
    mirrored: str = ""

    @property
    def most_polarized(self) -> float:
        """The largest degree, but nearest to the horizon."""
        return float(self.polarized[self.theta <= COLOURED_TO].max())


def compute_lobe(brdf: Brdf, place: int) -> Lobe:
    """The lobe for light from ``mu_i[place]``. Raises SceneError for too few directions, or what is not finite."""
    theta, phi, light = light_on_mesh(brdf, place)
    polarized = np.clip(np.nan_to_num(find_degree_of_linear_polarization(light)), 0.0, 1.0)
    radius, mirrored = np.maximum(light[..., 0], 0.0), describe_mirrored_beam(brdf, place)
    return Lobe(float(brdf.mu_i[place]), theta, phi, radius, polarized, mirrored)


def describe_mirrored_beam(brdf: Brdf, place: int, stokes: Any = UNPOLARIZED) -> str:
    """What comes back as a beam of light with the Stokes vector ``stokes`` from ``mu_i[place]``; "" where none does."""
    if brdf.specular is None:
        return ""
    beam = brdf.specular[place] @ np.asarray(stokes, float)
    words = f"mirrored: {beam[0] / stokes[0]:.3g}"
    degree = float(np.nan_to_num(find_degree_of_polarization(beam)))
    return words + (f", degree of polarization {degree:.3g}" if degree >= 5e-4 else "")


def name_brdf(brdf: Brdf) -> str:
    """What a BRDF is called: of light inside the medium, or with what refracts and mirrors it.

    >>> name_brdf(Brdf(np.zeros((1, 1, 1, 4, 4)), [0.0], [0.6], [0.5], [0.0], {}))
    'Subsurface BRDF'
    """
    if brdf.specular is not None:
        return "BRDF, without the mirrored beam"
    return "Subsurface BRDF" if brdf.surface is None else "BRDF, rough surface included"


def draw_brdf(brdf: Brdf) -> "Figure":
    """The lobes of a BRDF, all on one scale, and its polar cuts.

    Raises SceneError where there are too few directions, MissingExtraError without matplotlib.
    """
    check_directions(brdf.mu_o, brdf.phi)
    chosen = spread(brdf.mu_i.size, MOST_LOBES)
    whole = make_figure(width=max(4.6 * len(chosen), 8.0), height=8.2 + CHANGES_HEIGHT * bool(brdf.jacobian))
    figure: Any = whole
    if brdf.jacobian:
        halves: Any = whole.subfigures(2, 1, height_ratios=(8.2, CHANGES_HEIGHT))
        figure = halves[0]
        draw_changes(halves[1], brdf, chosen)
    lobes = [compute_lobe(brdf, place) for place in chosen]
    scale = max(float(lobe.radius.max()) for lobe in lobes) or 1.0  # a dark scene is drawn as a point
    colours = make_lobe_colours(max(lobe.most_polarized for lobe in lobes))
    for column, (place, lobe) in enumerate(zip(chosen, lobes, strict=True)):
        width = 0.88 / len(chosen)  # the colour bar keeps the right edge
        left = 0.01 + width * column
        axes: Any = figure.add_axes((left, 0.40, width, 0.48))
        draw_lobe(axes, lobe, 1.0 / scale, colours)
        words = f"$\\mu_i$ = {lobe.mu_i:.4g}  ({np.degrees(np.arccos(lobe.mu_i)):.0f}° from the normal)"
        largest = f"largest $f_{{00}}$ = {lobe.radius.max():.3g} sr$^{{-1}}$"
        axes.set_title(f"{words}\n{largest}", fontsize=11, color=INK)
        below: Any = figure.add_axes((left + 0.03 * width, 0.05, 0.94 * width, 0.34), projection="polar")
        _draw_cuts(below, brdf, place, scale, legend=column == 0)
    bar = figure.colorbar(colours, cax=figure.add_axes((0.918, 0.44, 0.014, 0.38)), extend="max")
    bar.set_label("degree of linear polarization, unpolarized incidence", fontsize=10)
    bar.ax.yaxis.set_major_locator(limit_ticks())
    bar.ax.tick_params(labelsize=9)
    words = f"{name_brdf(brdf)}: radius $f_{{00}}$, colour degree of linear polarization"
    figure.suptitle(words, y=0.965, fontsize=14)
    return whole


def draw_changes(figure: Any, brdf: Brdf, chosen: list[int]) -> None:
    """Derivatives of f00 in the plane of incidence against the angle of exit, each over its largest, for the incident
    directions ``chosen``."""
    changes = dict(list((brdf.jacobian or {}).items())[:MOST_CHANGES])
    panels = figure.subplots(1, len(chosen), squeeze=False, sharey=True)[0]
    figure.subplots_adjust(left=0.07, right=0.98, top=0.86, bottom=0.3, wspace=0.08)
    for dash, (name, values) in zip(cycle(("-", "--", ":")), changes.items(), strict=False):
        shown = Brdf(values, brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {})
        cuts = [light_in_plane(shown, place, 0.0) for place in chosen]
        largest = max(float(np.abs(light[:, 0]).max()) for _, light in cuts) or 1.0
        for axes, (angle, light) in zip(panels, cuts, strict=True):
            label = f"{name}: over {largest:.3g} sr$^{{-1}}$ a unit"
            axes.plot(angle, light[:, 0] / largest, dash, linewidth=1.8, label=label)
    for axes, place in zip(panels, chosen, strict=True):
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
        axes.axvline(-np.degrees(np.arccos(brdf.mu_i[place])), color=INCIDENT, linewidth=1.0)
        axes.set_xlim(-90, 90), axes.set_xticks(range(-90, 91, 30)), axes.tick_params(labelsize=8)
        axes.set_xlabel("angle of exit in the plane of incidence [°]", fontsize=9)
    title = "derivatives of $f_{00}$, each over its largest"
    left_out = len(brdf.jacobian or {}) - len(changes)
    figure.suptitle(title + (f" ({left_out} more are not drawn)" if left_out else ""), y=0.97, fontsize=11)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=2, fontsize=9, frameon=False)


def spread(size: int, most: int) -> list[int]:
    """At most so many indices, evenly over all.

    >>> spread(9, 3), spread(2, 4)
    ([0, 4, 8], [0, 1])
    """
    return sorted({round(place) for place in np.linspace(0, size - 1, min(size, most)).tolist()})


def make_lobe_colours(largest: float) -> Any:
    """The colours of degrees of polarization from 0 to ``largest``."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, max(largest, 1e-3)), COLOURS)


def draw_lobe(axes: Any, lobe: Lobe, factor: float, colours: Any, letters: float = 9.0) -> None:
    """A lobe, its radius times ``factor``, 0 to 1, above the surface, and the ray that comes in along phi = 0; words in
    ``letters`` [points].

    It is seen from far away and above: nothing of the ground is in front of it, and it is drawn from its far side to
    its near one, colours running evenly over each triangle.
    """
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    points = factor * lobe.radius[..., None] * make_unit_vector_grid(lobe.theta, lobe.phi)
    corners = make_triangles(np.arange(lobe.radius.size).reshape(lobe.radius.shape))
    nearness = (points @ TOWARD).ravel()[corners].sum(axis=1)
    x, y = _project_points(points.reshape(-1, 3))
    mesh = TriMesh(Triangulation(x, y, corners[np.argsort(nearness, kind="stable")]), rasterized=True, zorder=2)
    shaded: Any = _shade_colours(colours.to_rgba(lobe.polarized), points).reshape(-1, 4)
    mesh.set_facecolor(shaded)
    _draw_ground(axes, letters)
    mesh.set_in_layout(False)
    axes.add_collection(mesh, autolim=False)  # its limits would be those of half a million paths
    ring = int(np.argmin(np.abs(lobe.theta - np.degrees(np.arccos(lobe.mu_i)))))
    _draw_ray(axes, -1.0, lobe.mu_i, factor * float(lobe.radius[ring, lobe.phi.size // 2]))
    if lobe.mirrored:
        _draw_ray(axes, 1.0, lobe.mu_i, factor * float(lobe.radius[ring, 0]), lobe.mirrored, letters)
    axes.set_xlim(-1.19, 1.19), axes.set_ylim(-0.55, 1.2)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _project_points(points: Array) -> tuple[Array, Array]:
    """Where points (n, 3) are in the picture, to the right and up."""
    return points @ RIGHT, points @ UPRIGHT


def make_unit_vector_grid(theta: Array, phi: Array) -> Array:
    """Unit vectors (theta, phi, 3) at polar angles and azimuths [degrees]: x along phi = 0, z up."""
    polar, azimuth = np.meshgrid(np.radians(theta), np.radians(phi), indexing="ij")
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)


def make_triangles(corner: Any) -> Any:
    """Corners (n, 3) of the triangles of a mesh, two between neighbours; ``corner`` (rings, spokes) numbers its points.

    >>> make_triangles(np.arange(4).reshape(2, 2)).tolist()
    [[0, 2, 3], [0, 3, 1]]
    """
    here, below, beside, across = corner[:-1, :-1], corner[1:, :-1], corner[:-1, 1:], corner[1:, 1:]
    return np.concatenate(
        [np.stack(three, axis=-1).reshape(-1, 3) for three in ((here, below, across), (here, across, beside))]
    )


def _shade_colours(colours: Array, points: Array) -> Array:
    """The colours (theta, phi, 4), a little darker where the body turns away from the lamp."""
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    size = np.linalg.norm(normal, axis=-1)
    facing = normal @ LAMP / np.where(size > 0.0, size, 1.0)
    facing[0] = facing[1].mean()  # all of ring 0 is one point
    shaded = colours.copy()
    shaded[..., :3] *= (0.80 + 0.20 * facing)[..., None]
    return np.clip(shaded, 0.0, 1.0)


def _draw_ground(axes: Any, letters: float) -> None:
    """The surface as a disc, with its azimuths."""
    rim = make_unit_vector_grid(np.array([90.0]), np.linspace(0.0, 360.0, 181))[0]
    style = {"color": FAINT, "linewidth": 0.8, "zorder": 1}
    for radius in (0.5, 1.0):
        axes.plot(*_project_points(radius * rim), **style)
    for degrees in range(0, 360, 90):
        end = rim[degrees // 2]
        axes.plot(*_project_points(np.stack([0.0 * end, end])), **style)
        x, y = _project_points(1.13 * end)
        axes.text(x, y, f"{degrees}°", color=INK, fontsize=letters, ha="center", va="center", zorder=1)


def _draw_ray(axes: Any, side: float, mu_i: float, inside: float, mirrored: str = "", letters: float = 9.0) -> None:
    """The incident ray, which comes down along phi = 0 from ``side`` -1 and ends where it meets the lobe, at the radius
    ``inside``; or, from there on, the one that goes back at ``side`` 1, with what is said of it."""
    sine = np.sqrt(1.0 - mu_i**2)
    beside = (0.07 if mirrored and sine < 0.07 else 0.0) * RIGHT  # both would lie upon each other
    toward = np.array([side * sine, 0.0, mu_i])
    near, far = (_project_points(radius * toward + beside) for radius in (inside + 0.02, 1.3 if mirrored else 1.2))
    start, end, colour = (near, far, MIRRORED) if mirrored else (far, near, INCIDENT)
    arrow = {"arrowstyle": "-|>,head_length=0.7,head_width=0.3", "color": colour, "linewidth": 2.2}
    arrow |= {"shrinkA": 0.0, "shrinkB": 0.0, "zorder": 20}
    axes.annotate("", end, start, arrowprops=arrow, annotation_clip=False)
    if mirrored:
        axes.text(0.0, -0.6, mirrored, color=colour, fontsize=letters, ha="center", va="bottom")


def _draw_cuts(axes: Any, brdf: Brdf, place: int, scale: float, legend: bool) -> None:
    """f00 against the angle of exit: right of the vertical on the azimuth of the cut, left of it half a turn away."""
    for phi, label, colour, style in CUTS:
        angle, light = light_in_plane(brdf, place, phi)
        cut = np.maximum(light[:, 0], 0.0)
        axes.plot(np.radians(angle), cut, color=colour, linestyle=style, linewidth=1.8, label=label)
    beams = [(-1.0, INCIDENT, "-", "incident light")]
    beams += [(1.0, MIRRORED, "--", "mirrored beam, not in the curves")] if brdf.specular is not None else []
    for side, colour, dash, label in beams:
        angle = side * np.arccos(brdf.mu_i[place])
        axes.plot([angle] * 2, [0.0, 1.05 * scale], color=colour, linestyle=dash, linewidth=1.4, label=label)
    axes.set_theta_zero_location("N"), axes.set_theta_direction(-1)
    axes.set_thetalim(-np.pi / 2.0, np.pi / 2.0), axes.set_ylim(0.0, 1.05 * scale)
    axes.set_thetagrids(range(-90, 91, 30), fontsize=8)
    axes.set_rlabel_position(90.0), axes.tick_params(axis="y", labelsize=8)
    axes.yaxis.set_major_locator(limit_ticks())
    axes.grid(color=FAINT, linewidth=0.6)
    axes.text(0.75, 0.11, "$f_{00}$  [sr$^{-1}$]", transform=axes.transAxes, fontsize=9, ha="center")
    if legend:
        axes.figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=9, frameon=False)


def draw_field(field: Field) -> "Figure":
    """I and the degree of polarization against mu: a column an azimuth, or a beam of several, a line a depth.

    Raises SceneError for a field of fluxes alone, MissingExtraError without matplotlib.
    """
    if not field.mu.size:
        raise SceneError("a picture of a field needs directions mu: this one holds fluxes alone")
    columns = choose_field_columns(field)
    depths = spread(field.tau.size, MOST_DEPTHS)
    figure = make_figure(width=max(4.4 * len(columns), 6.4), height=6.6)
    panels: Any = figure.subplots(2, len(columns), sharex=True, sharey="row", squeeze=False)
    for column, (beam, azimuth, title) in zip(panels.T, columns, strict=True):
        for order, depth in enumerate(depths):
            draw_depth(column, beam, depth, azimuth, choose_depth_colour(order, len(depths)))
        column[0].set_title(title, fontsize=11)
        where = "" if field.index is None else ", in the medium of each depth"
        column[1].set_xlabel(f"$\\mu$  (< 0 down, > 0 up{where})", fontsize=10)
    panels[0, 0].set_ylabel("I  [W m$^{-2}$ sr$^{-1}$]", fontsize=10)
    panels[1, 0].set_ylabel("degree of polarization", fontsize=10)
    for panel in panels.flat:
        panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
        panel.axvline(0.0, color=FAINT, linewidth=1.0)
        panel.set_ylim(bottom=0.0)
    panels[0, 0].legend(fontsize=9, frameon=False)
    common = f"$\\mu_0$ = {field.mu0:g}" if isinstance(field.mu0, float) else f"$\\phi$ = {field.phi[0]:g}°"
    figure.suptitle(f"{name_field(field)}, {common}", fontsize=14)
    figure.tight_layout()
    return figure


def name_field(field: Field) -> str:
    """What a picture of a field shows: of light inside one medium, or in several."""
    return "Subsurface radiance, diffuse light" if field.index is None else "Radiance, diffuse light, without beams"


def label_depth(field: Field, depth: int) -> str:
    """A depth, and where light is refracted the index n of its medium."""
    medium = "" if field.index is None else f", $n$ = {field.index[depth]:.4g}"
    return f"$\\tau$ = {field.tau[depth]:g}{medium}"


def choose_field_columns(field: Field) -> list[tuple[Field, int, str]]:
    """What is drawn beside each other: fields of one beam, azimuths, and titles."""
    if isinstance(field.mu0, float):
        chosen = spread(field.phi.size, MOST_AZIMUTHS)
        return [(field, azimuth, f"$\\phi$ = {field.phi[azimuth]:g}°") for azimuth in chosen]
    beams = [field.beam(place) for place in spread(field.mu0.size, MOST_AZIMUTHS)]
    return [(beam, 0, f"$\\mu_0$ = {beam.mu0:g}") for beam in beams]


def choose_depth_colour(order: int, count: int) -> Any:
    from matplotlib import colormaps

    return colormaps[COLOURS](0.9 * order / max(count - 1, 1))


def draw_depth(panels: Any, field: Field, depth: int, azimuth: int, colour: Any) -> None:
    """One depth at one azimuth: the directions computed as marks where they are few, and smooth lines through them.

    Down and up are separate lines, because the radiance may jump at the horizon.
    """
    label: str | None = label_depth(field, depth)
    for side in (field.mu < 0.0, field.mu > 0.0):
        if not side.any():
            continue
        mu, first = np.unique(field.mu[side], return_index=True)
        given = field.stokes[depth, side, azimuth][first]
        angle, light = between_angles(np.arccos(mu), given)
        for panel, quantity in zip(panels, (find_intensity, find_degree_of_polarization), strict=True):
            panel.plot(np.cos(angle), quantity(light), color=colour, linewidth=1.7, label=label)
            if mu.size < FEW:
                panel.plot(mu, quantity(given), color=colour, linestyle="none", marker="o", markersize=4)
            label = None if panel is panels[0] else label
        label = None


def find_intensity(stokes: Array) -> Array:
    """I of Stokes vectors (..., 4)."""
    return stokes[..., 0]


def draw_spectrum(spectrum: Spectrum, width: float = 9.6, height: float = 4.2) -> "Figure":
    """Reflectance against wavelength, a line an incident direction, and beside it f00 in the plane of incidence of the
    first of them, a line a wavelength, where there are enough directions. Raises MissingExtraError without matplotlib.
    """
    figure = make_figure(width, height)
    first, panels = spectrum[0], 2
    try:
        check_directions(first.mu_o, first.phi)
    except SceneError:
        panels = 1
    left, *right = figure.subplots(1, panels, squeeze=False)[0].tolist()
    places = spread(first.mu_i.size, MOST_LOBES)
    marker = "o" if len(spectrum) < FEW else None
    for order, place in enumerate(places):
        style = {"color": choose_depth_colour(order, len(places)), "marker": marker, "markersize": 3}
        label = f"μ incident = {first.mu_i[place]:.4g}"
        left.plot(spectrum.wavelength_um, spectrum.reflectance[:, place], label=label, **style)
        if first.specular is not None:
            beams = [float(one.specular[place, 0, 0]) for one in spectrum if one.specular is not None]
            left.plot(spectrum.wavelength_um, beams, linestyle="--", **style)
    words = "reflectance" if first.specular is None else "diffuse reflectance; dashed: mirrored as a beam"
    finish([left], (words,), "wavelength [µm]")
    if right:
        shown = spread(len(spectrum), MOST_DEPTHS)
        for order, place in enumerate(shown):
            angle, light = light_in_plane(spectrum[place], 0)
            label, colour = f"{spectrum.wavelength_um[place]:.4g} µm", choose_depth_colour(order, len(shown))
            right[0].plot(angle, light[:, 0], label=label, color=colour, linewidth=1.5)
        finish(right, (f"f00 [sr⁻¹], μ incident = {first.mu_i[0]:.4g}",), "angle of exit [°], forward > 0")
    figure.subplots_adjust(left=0.09, right=0.98, bottom=0.2 if height < 4.0 else 0.13, top=0.89, wspace=0.2)
    return figure
