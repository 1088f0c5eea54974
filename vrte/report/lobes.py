"""A result as a PNG: the lobes of a BRDF with their polar cuts, a radiance field against the direction cosine.

The light is inside the host medium, before any refraction at its surface: every title says "subsurface".
"""

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array
from vrte.brdf import Brdf
from vrte.errors import SceneError
from vrte.field import Field, one_beam
from vrte.formats.atomic import atomic_write
from vrte.over_hemisphere import check_directions, stokes_over_hemisphere
from vrte.polarization import degree_of_polarization
from vrte.report.pictures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LOBES = 4  # beside each other; with more incident directions, these are spread evenly over them
MOST_DEPTHS = 6
MOST_AZIMUTHS = 3
FINE_PHI = np.linspace(0.0, 360.0, 241)  # [degrees]
FINE_THETA = np.linspace(0.0, 90.0, 91)
COLOURS = "plasma"
COLOURED_TO = 80.0  # [degrees]; what is brighter nearer to the horizon takes the last colour
INCIDENT = "#d62728"
INK, FAINT = "#222222", "#b5b5b5"
CUTS = ((0.0, "in the plane of incidence", "#1f4e79", "-"), (90.0, "across it", "#d98200", "--"))


def save_plot(result: Brdf | Field, path: str | os.PathLike[str]) -> None:
    """Draws ``result`` into the PNG file ``path``, all of it or nothing.

    A BRDF gives a lobe for each mu_i, its radius f00 and its colour the degree of linear polarization for
    unpolarized incident light, above cuts in and across the plane of incidence. A field gives I and the degree of
    polarization against mu. Raises MissingExtraError without the extra "plot", SceneError where there are too few
    directions for a picture, OSError.

    >>> save_plot(brdf, "lobes.png")
    """
    figure = brdf_figure(result) if isinstance(result, Brdf) else field_figure(result)
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=160)


def brdf_figure(brdf: Brdf) -> "Figure":
    """The lobes of a BRDF, all on one scale, and its polar cuts.

    Raises SceneError where there are too few directions, MissingExtraError without matplotlib.
    """
    check_directions(brdf.mu_o, brdf.phi)
    chosen = spread(brdf.mu_i.size, MOST_LOBES)
    lobes = [hemisphere(brdf, place) for place in chosen]
    scale = max(float(radius.max()) for radius, _ in lobes) or 1.0  # a dark scene is drawn as a point
    figure = new_figure(width=max(4.6 * len(chosen), 6.4), height=8.2)
    colours = lobe_colours(max(float(polarized[FINE_THETA <= COLOURED_TO].max()) for _, polarized in lobes))
    for column, (place, (radius, polarized)) in enumerate(zip(chosen, lobes, strict=True)):
        axes: Any = figure.add_axes(_slot(column, len(chosen), 0.36, 0.56), projection="3d")
        draw_lobe(axes, radius / scale, colours.to_rgba(polarized), brdf.mu_i[place])
        _lobe_title(axes, brdf.mu_i[place], float(radius.max()))
        below: Any = figure.add_axes(_slot(column, len(chosen), 0.05, 0.34, 0.06), projection="polar")
        _draw_cuts(below, radius, scale, brdf.mu_i[place], legend=column == 0)
    _colour_bar(figure, colours)
    figure.suptitle("Subsurface BRDF: radius $f_{00}$, colour degree of linear polarization", y=0.965, fontsize=14)
    return figure


def hemisphere(brdf: Brdf, place: int) -> tuple[Array, Array]:
    """f00 and the degree of linear polarization on a fine grid, (theta, phi) of FINE_THETA and FINE_PHI.

    Unpolarized light falls in at ``mu_i[place]``; between the given directions as `stokes_over_hemisphere` says.
    """
    stokes = stokes_over_hemisphere(brdf, place, FINE_THETA, FINE_PHI)
    radius = np.maximum(stokes[..., 0], 0.0)
    colour = np.hypot(stokes[..., 1], stokes[..., 2]) / np.where(radius > 0.0, radius, np.inf)
    return radius, np.clip(colour, 0.0, 1.0)


def spread(size: int, most: int) -> list[int]:
    """At most so many indices, evenly over all.

    >>> spread(9, 3), spread(2, 4)
    ([0, 4, 8], [0, 1])
    """
    return sorted({round(place) for place in np.linspace(0, size - 1, min(size, most)).tolist()})


def _slot(
    column: int, columns: int, bottom: float, height: float, margin: float = 0.0
) -> tuple[float, float, float, float]:
    """The rectangle of a panel; the colour bar keeps the right edge."""
    width = 0.88 / columns
    return (0.01 + width * (column + margin / 2.0), bottom, width * (1.0 - margin), height)


def lobe_colours(largest: float) -> Any:
    """The colours of degrees of polarization from 0 to ``largest``."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, max(largest, 1e-3)), COLOURS)


def draw_lobe(axes: Any, radius: Array, colours: Array, mu_i: float) -> None:
    """A lobe of radius 0 to 1 above the surface, and the ray that comes in along phi = 0."""
    theta, phi = np.meshgrid(np.radians(FINE_THETA), np.radians(FINE_PHI), indexing="ij")
    x, y, z = (radius * part for part in (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)))
    _draw_ground(axes)
    axes.plot_surface(
        x, y, z, facecolors=_shaded(colours, x, y, z), rstride=1, cstride=1, shade=False, antialiased=False
    )
    toward_light = float(radius[np.searchsorted(FINE_THETA, np.degrees(np.arccos(mu_i))), FINE_PHI.size // 2])
    _draw_rays(axes, mu_i, toward_light)
    axes.set_xlim(-1.0, 1.0), axes.set_ylim(-1.0, 1.0), axes.set_zlim(0.0, 1.0)
    axes.set_box_aspect((2.0, 2.0, 1.0), zoom=1.36)
    axes.view_init(elev=24.0, azim=-72.0)
    axes.set_axis_off()
    axes.patch.set_visible(False)  # drawn even so, it would cover the labels of the lobe beside


def _shaded(colours: Array, x: Array, y: Array, z: Array) -> Array:
    """The colours, a little darker where the lobe turns away from a lamp at the upper left."""
    along = [np.gradient(part, axis=0) for part in (x, y, z)]
    across = [np.gradient(part, axis=1) for part in (x, y, z)]
    normal = np.stack(np.broadcast_arrays(*np.cross(np.stack(along, -1), np.stack(across, -1)).transpose(2, 0, 1)))
    lamp = np.array([-0.45, -0.6, 0.66])
    size = np.linalg.norm(normal, axis=0)
    facing = np.einsum("c,c...->...", lamp, normal) / np.where(size > 0.0, size, 1.0)
    shaded = colours.copy()
    shaded[..., :3] *= (0.80 + 0.20 * facing)[..., None]
    return np.clip(shaded, 0.0, 1.0)


def _draw_ground(axes: Any) -> None:
    """The surface as a disc, with its azimuths."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for radius in (0.5, 1.0):
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), 0.0, color=FAINT, linewidth=0.8, zorder=0)
    for degrees in range(0, 360, 90):
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        axes.plot([0.0, cosine], [0.0, sine], [0.0, 0.0], color=FAINT, linewidth=0.8, zorder=0)
        axes.text(1.13 * cosine, 1.13 * sine, 0.0, f"{degrees}°", color=INK, fontsize=9, ha="center", va="center")


def _draw_rays(axes: Any, mu_i: float, inside: float) -> None:
    """The incident ray, travelling down along phi = 0; it ends where it meets the lobe, at the radius ``inside``."""
    start = np.array([-np.sqrt(1.0 - mu_i**2), 0.0, mu_i])
    far, near = 1.2 * start, (inside + 0.02) * start
    axes.quiver(*far, *(near - far), color=INCIDENT, linewidth=2.2, arrow_length_ratio=0.2, zorder=20)


def _lobe_title(axes: Any, mu_i: float, largest: float) -> None:
    angle = np.degrees(np.arccos(mu_i))
    text = f"$\\mu_i$ = {mu_i:.4g}  ({angle:.0f}° from the normal)\nlargest $f_{{00}}$ = {largest:.3g} sr$^{{-1}}$"
    axes.set_title(text, fontsize=11, color=INK, y=0.95)


def _draw_cuts(axes: Any, radius: Array, scale: float, mu_i: float, legend: bool) -> None:
    """f00 against the angle of exit: right of the vertical on the azimuth of the cut, left of it half a turn away."""
    theta = np.radians(FINE_THETA)
    for phi, label, colour, style in CUTS:
        right, left = (radius[:, np.searchsorted(FINE_PHI, azimuth)] for azimuth in (phi, phi + 180.0))
        angles, cut = np.concatenate([-theta[::-1], theta]), np.concatenate([left[::-1], right])
        axes.plot(angles, cut, color=colour, linestyle=style, linewidth=1.8, label=label)
    axes.plot([-np.arccos(mu_i)] * 2, [0.0, 1.05 * scale], color=INCIDENT, linewidth=1.4, label="incident light")
    axes.set_theta_zero_location("N"), axes.set_theta_direction(-1)
    axes.set_thetalim(-np.pi / 2.0, np.pi / 2.0), axes.set_ylim(0.0, 1.05 * scale)
    axes.set_thetagrids(range(-90, 91, 30), fontsize=8)
    axes.set_rlabel_position(90.0), axes.tick_params(axis="y", labelsize=8)
    axes.yaxis.set_major_locator(_few_ticks())
    axes.grid(color=FAINT, linewidth=0.6)
    axes.text(0.75, 0.11, "$f_{00}$  [sr$^{-1}$]", transform=axes.transAxes, fontsize=9, ha="center")
    if legend:
        axes.figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=3, fontsize=9, frameon=False)


def _few_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4, steps=[1, 2, 2.5, 5, 10])


def _colour_bar(figure: Any, colours: Any) -> None:
    bar = figure.colorbar(colours, cax=figure.add_axes((0.918, 0.44, 0.014, 0.38)), extend="max")
    bar.set_label("degree of linear polarization, unpolarized incidence", fontsize=10)
    bar.ax.yaxis.set_major_locator(_few_ticks())
    bar.ax.tick_params(labelsize=9)


def field_figure(field: Field) -> "Figure":
    """I and the degree of polarization against mu: a column an azimuth, a line a depth.

    Raises SceneError for a field of fluxes alone, MissingExtraError without matplotlib.
    """
    mu0 = one_beam(field)
    if not field.mu.size:
        raise SceneError("a picture of a field needs directions mu: this one holds fluxes alone")
    azimuths, depths = spread(field.phi.size, MOST_AZIMUTHS), spread(field.tau.size, MOST_DEPTHS)
    figure = new_figure(width=max(4.4 * len(azimuths), 6.4), height=6.6)
    panels: Any = figure.subplots(2, len(azimuths), sharex=True, sharey="row", squeeze=False)
    for column, azimuth in zip(panels.T, azimuths, strict=True):
        for order, depth in enumerate(depths):
            draw_depth(column, field, depth, azimuth, depth_colour(order, len(depths)))
        column[0].set_title(f"$\\phi$ = {field.phi[azimuth]:g}°", fontsize=11)
        column[1].set_xlabel("$\\mu$  (< 0 down, > 0 up)", fontsize=10)
    panels[0, 0].set_ylabel("I  [W m$^{-2}$ sr$^{-1}$]", fontsize=10)
    panels[1, 0].set_ylabel("degree of polarization", fontsize=10)
    for panel in panels.flat:
        panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
        panel.axvline(0.0, color=FAINT, linewidth=1.0)
        panel.set_ylim(bottom=0.0)
    panels[0, 0].legend(fontsize=9, frameon=False)
    figure.suptitle(f"Subsurface radiance, diffuse light, $\\mu_0$ = {mu0:g}", fontsize=14)
    figure.tight_layout()
    return figure


def depth_colour(order: int, count: int) -> Any:
    from matplotlib import colormaps

    return colormaps[COLOURS](0.9 * order / max(count - 1, 1))


def draw_depth(panels: Any, field: Field, depth: int, azimuth: int, colour: Any) -> None:
    """One depth at one azimuth; down and up are separate lines, because the radiance may jump at the horizon."""
    stokes = field.stokes[depth, :, azimuth]
    intensity, polarization = stokes[:, 0], degree_of_polarization(stokes)
    label: str | None = f"$\\tau$ = {field.tau[depth]:g}"
    for side in (field.mu < 0.0, field.mu > 0.0):
        order = np.flatnonzero(side)[np.argsort(field.mu[side], kind="stable")]
        style = {"color": colour, "linewidth": 1.7, "marker": "o" if order.size < 12 else None, "markersize": 4}
        if order.size:
            panels[0].plot(field.mu[order], intensity[order], label=label, **style)
            panels[1].plot(field.mu[order], polarization[order], **style)
            label = None
