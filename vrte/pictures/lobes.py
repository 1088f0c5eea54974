"""The lobe of a BRDF: a body over the directions of exit, drawn flat by matplotlib, or by Plotly to turn around.

Without interfaces the light is inside the host medium, before any refraction at its surface, and titles say
"subsurface". What comes back as a beam, mirrored, is an arrow with its share, and in no lobe. A lobe ends where the
directions of the result end.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_whole
from vrte.basics.polarization import find_degree_of_linear_polarization, find_degree_of_polarization
from vrte.pictures.describe import FAINT, INCIDENT, INK, MIRRORED
from vrte.pictures.interactive import FAINT as PALE
from vrte.pictures.interactive import import_plotly, make_plotly_figure
from vrte.results.brdf import Brdf
from vrte.results.over_hemisphere import light_on_mesh
from vrte.results.quantities import ANGLES, SIGNED, incident_for, of_light, unit_of

COLOURS = "plasma"
COLOURED_TO = 80.0  # [degrees]; what is brighter nearer to the horizon takes the last colour
UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
ELEVATION, AZIMUTH = np.radians([24.0, -72.0])  # of the eye that sees a lobe, from far away
TOWARD = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
UPRIGHT = np.cross(TOWARD, RIGHT)
LAMP = np.array([-0.45, -0.6, 0.66])
GROUND = {"color": FAINT, "linewidth": 0.8, "zorder": 1}
STEP = 1.5  # degrees from ring to ring, and from spoke to spoke: where degrees of polarization vanish they have a kink
SEQUENTIAL, DIVERGING = "Plasma", "RdBu_r"
SHINE = {"ambient": 0.72, "diffuse": 0.45, "specular": 0.04, "roughness": 0.9}
FLAT = {"ambient": 0.95, "diffuse": 0.15, "specular": 0.0, "roughness": 1.0}
SPACE = {
    **{key: {"visible": False, "showbackground": False} for key in ("xaxis", "yaxis", "zaxis")},
    "aspectmode": "data",
    "camera": {"eye": {"x": 0.38, "y": -1.24, "z": 0.5}, "center": {"x": 0.0, "y": 0.0, "z": -0.14}},
    "domain": {"x": [0.0, 1.0], "y": [0.16, 1.0]},  # above the colour bar
}
BAR = {"orientation": "h", "len": 0.7, "thickness": 12, "x": 0.5, "y": 0.0, "yanchor": "bottom", "nticks": 6}


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
    """What a BRDF is called: of light inside the medium, or with what refracts and mirrors it."""
    if brdf.specular is not None:
        return "BRDF, without the mirrored beam"
    return "Subsurface BRDF" if brdf.surface is None else "BRDF, rough surface included"


def choose_range(values: Array, quantity: str) -> tuple[float, float]:
    """From where to where an axis or a colour scale goes: 0 to 180 for angles, as far below 0 as above where a quantity
    may be negative, else from 0.

    >>> choose_range(np.array([-1.0, 0.5, np.nan]), "f01"), choose_range(np.array([0.2, 0.5]), "f00")
    ((-1.0, 1.0), (0.0, 0.5))
    """
    if quantity in ANGLES:
        return 0.0, 180.0
    largest = float(np.abs(np.nan_to_num(values)).max()) or 1.0  # where nothing is, any scale will do
    return (-largest if quantity in SIGNED else 0.0), largest


def label_quantity(quantity: str) -> str:
    """With its unit.

    >>> label_quantity("f00"), label_quantity("reflectance factor")
    ('f00 [sr⁻¹]', 'reflectance factor')
    """
    unit = unit_of(quantity)
    return f"{quantity} [{unit}]" if unit else quantity


def describe_incidence(brdf: Brdf, place: int) -> str:
    """Where the light comes from, in words."""
    mu = float(brdf.mu_i[place])
    return f"μ<sub>i</sub> = {mu:.4g}, {np.degrees(np.arccos(mu)):.0f}° from the normal"


def make_lobe_colours(lobes: Sequence[Lobe]) -> Any:
    """The colours of the degrees of polarization of some lobes, from 0 on."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, max(1e-3, *(lobe.most_polarized for lobe in lobes))), COLOURS)


def draw_lobe(axes: Any, lobe: Lobe, factor: float, colours: Any, letters: float = 9.0) -> None:
    """A lobe, its radius times ``factor``, 0 to 1, above the surface, and the ray that comes in along phi = 0; words in
    ``letters`` [points]. It is seen from far away and above, and drawn from its far side to its near one."""
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    points = factor * lobe.radius[..., None] * make_unit_vector_grid(lobe.theta, lobe.phi)
    corners = make_triangles(np.arange(lobe.radius.size).reshape(lobe.radius.shape))
    nearness = (points @ TOWARD).ravel()[corners].sum(axis=1)
    x, y = project_points(points.reshape(-1, 3))
    mesh = TriMesh(Triangulation(x, y, corners[np.argsort(nearness, kind="stable")]), rasterized=True, zorder=2)
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    size = np.linalg.norm(normal, axis=-1)
    facing = normal @ LAMP / np.where(size > 0.0, size, 1.0)
    facing[0] = facing[1].mean()  # all of ring 0 is one point
    shaded = colours.to_rgba(lobe.polarized)
    shaded[..., :3] *= (0.80 + 0.20 * facing)[..., None]  # darker where the body turns away from the lamp
    mesh.set_facecolor(np.clip(shaded, 0.0, 1.0).reshape(-1, 4))
    rim = make_unit_vector_grid(np.array([90.0]), np.linspace(0.0, 360.0, 181))[0]
    for radius in (0.5, 1.0):
        axes.plot(*project_points(radius * rim), **GROUND)
    for degrees in range(0, 360, 90):
        end = rim[degrees // 2]
        axes.plot(*project_points(np.stack([0.0 * end, end])), **GROUND)
        place = project_points(1.13 * end)
        axes.text(*place, f"{degrees}°", color=INK, fontsize=letters, ha="center", va="center", zorder=1)
    mesh.set_in_layout(False)
    axes.add_collection(mesh, autolim=False)  # its limits would be those of half a million paths
    ring = int(np.argmin(np.abs(lobe.theta - np.degrees(np.arccos(lobe.mu_i)))))
    draw_ray(axes, -1.0, lobe.mu_i, factor * float(lobe.radius[ring, lobe.phi.size // 2]))
    if lobe.mirrored:
        draw_ray(axes, 1.0, lobe.mu_i, factor * float(lobe.radius[ring, 0]), lobe.mirrored, letters)
    axes.set_xlim(-1.19, 1.19), axes.set_ylim(-0.55, 1.2)
    axes.set_aspect("equal")
    axes.set_axis_off()


def project_points(points: Array) -> tuple[Array, Array]:
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


def draw_ray(axes: Any, side: float, mu_i: float, inside: float, mirrored: str = "", letters: float = 9.0) -> None:
    """The incident ray, which comes down along phi = 0 from ``side`` -1 and ends where it meets the lobe, at the radius
    ``inside``; or, from there on, the one that goes back at ``side`` 1, with words on it."""
    sine = np.sqrt(1.0 - mu_i**2)
    beside = (0.07 if mirrored and sine < 0.07 else 0.0) * RIGHT  # both would lie upon each other
    toward = np.array([side * sine, 0.0, mu_i])
    near, far = (project_points(radius * toward + beside) for radius in (inside + 0.02, 1.3 if mirrored else 1.2))
    start, end, colour = (near, far, MIRRORED) if mirrored else (far, near, INCIDENT)
    arrow = {"arrowstyle": "-|>,head_length=0.7,head_width=0.3", "color": colour, "linewidth": 2.2}
    arrow |= {"shrinkA": 0.0, "shrinkB": 0.0, "zorder": 20}
    axes.annotate("", end, start, arrowprops=arrow, annotation_clip=False)
    if mirrored:
        axes.text(0.0, -0.6, mirrored, color=colour, fontsize=letters, ha="center", va="bottom")


def lobe(
    brdf: Brdf,
    place: int,
    height: str = "f00",
    colour: str = "degree of linear polarization",
    stokes: Any = UNPOLARIZED,
) -> Any:
    """The BRDF as a body over the hemisphere of outgoing directions, for light of the Stokes vector ``stokes``.

    It comes in at ``mu_i[place]``, along the red arrow; what is mirrored as a beam is the green one, and in no lobe.
    The distance from the centre is the size of the quantity ``height`` over its largest, the colour the quantity
    ``colour`` (both of `vrte.quantities.QUANTITIES`), cyclic for angles, white at 0 where it may be negative. Raises
    SceneError for an unknown quantity or place, or too few directions, MissingExtraError without Plotly.
    """
    import_plotly()
    check_whole("place", place, 0, brdf.mu_i.size - 1)
    meshes = [light_on_mesh(brdf, place, incident_for(name, stokes), STEP) for name in (height, colour)]
    theta, phi = meshes[0][0], meshes[0][1][:-1]  # the last spoke is the first
    heights, colours = (
        of_light(light[:, :-1], name) for (_, _, light), name in zip(meshes, (height, colour), strict=True)
    )
    size = np.nan_to_num(np.abs(heights))
    largest = float(size.max())
    solid = make_body(theta, phi, size / (largest or 1.0), colours, colour)
    solid |= make_hover_text(theta, phi, heights, colours, height, colour)
    unit, mu_i = unit_of(height), float(brdf.mu_i[place])
    mirrored = describe_mirrored_beam(brdf, place, stokes)
    angle_bar = scale(np.zeros(1), colour) | {"color": [0.0], "opacity": 0.0, "size": 1}  # of corners' own colours
    scale_in_words = f"rim of the disc = {largest:.3g}{'' if unit == '°' else ' '}{unit}".rstrip()
    return make_plotly_figure(
        [
            *make_ground_disc(),
            solid,
            *([make_space_trace(np.zeros((1, 3)), "markers", marker=angle_bar)] if colour in ANGLES else []),
            *make_ray(mu_i, f"incident light, μ<sub>i</sub> = {mu_i:.4g}"),
            *(make_ray(mu_i, mirrored, goes_back=True) if mirrored else []),
        ],
        f"{name_brdf(brdf)}: distance from the centre {f'|{height}|' if height in SIGNED else height}",
        "; ".join(filter(None, (describe_incidence(brdf, place), scale_in_words, mirrored))),
        margin={"l": 0, "r": 0, "t": 84, "b": 0},
        scene=SPACE,
        showlegend=False,
        uirevision="lobe",  # a new lobe is seen from where the last one was
    )


def make_body(theta: Array, phi: Array, radius: Array, colours: Array, colour: str) -> dict[str, Any]:
    """The surface of ``radius`` (theta, phi), a mesh closed around the normal.

    Corners have their colours, and between them those of the screen run. So angles are coloured beforehand: from 179
    degrees to 1 there must be no band of what lies between as numbers.
    """
    corner = np.arange(radius.size).reshape(radius.shape)
    corners = make_triangles(np.append(corner, corner[:, :1], axis=1)).astype(np.int16)
    points = (radius[..., None] * make_unit_vector_grid(theta, phi)).reshape(-1, 3).astype(np.float32)
    shown = np.nan_to_num(colours.ravel())
    cyclic = colour in ANGLES
    return {
        "type": "mesh3d",
        **dict(zip("xyzijk", (*points.T, *corners.T), strict=True)),
        **({"vertexcolor": list_cyclic_colours(shown)} if cyclic else {"intensity": shown.astype(np.float32)}),
        **({} if cyclic else scale(shown, colour)),
        "uid": "angles" if cyclic else "numbers",  # a body that is kept would keep the other's colours beneath
        "lighting": FLAT if cyclic else SHINE,  # a hue in the shade is taken for another
        "lightposition": {"x": -4e4, "y": -6e4, "z": 9e4},
    }


def scale(values: Array, colour: str) -> dict[str, Any]:
    """The colours of a quantity, and the bar that tells them."""
    low, high = choose_range(values, colour)
    shares = np.linspace(0.0, 1.0, 13)
    turn = [list(pair) for pair in zip(shares.tolist(), list_cyclic_colours(180.0 * shares), strict=True)]
    return {
        "colorscale": turn if colour in ANGLES else DIVERGING if colour in SIGNED else SEQUENTIAL,
        "cmin": low,
        "cmax": high,
        "colorbar": {"title": {"text": label_quantity(colour), "side": "top"}, **BAR},
    }


def list_cyclic_colours(angle: Array) -> list[str]:
    """Colours of angles [degrees], the same at 0 and 180, as "#rrggbb".

    >>> first, last, between = list_cyclic_colours(np.array([0.0, 180.0, 90.0]))
    >>> first == last, first == between
    (True, False)
    """
    colours = import_plotly().colors  # the last of the circle is its first
    circle = np.array([colours.unlabel_rgb(colour) for colour in colours.cyclical.Phase], float)
    place = (angle % 180.0) / 180.0 * (len(circle) - 1)
    levels = [np.interp(place, np.arange(len(circle)), channel).round().astype(int).tolist() for channel in circle.T]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in zip(*levels, strict=True)]


def make_hover_text(
    theta: Array, phi: Array, heights: Array, colours: Array, height: str, colour: str
) -> dict[str, Any]:
    """What a point tells: its direction, and the quantities with their signs."""
    cosine, azimuth = np.meshgrid(np.cos(np.radians(theta)), phi, indexing="ij")
    values = np.stack([cosine, azimuth, heights, colours], axis=-1).reshape(-1, 4).astype(np.float32)
    lines = [
        "μ<sub>o</sub> = %{customdata[0]:.3f}, φ = %{customdata[1]:.0f}°",
        f"{height} = %{{customdata[2]:.4g}} {unit_of(height)}",
        f"{colour} = %{{customdata[3]:.4g}} {unit_of(colour)}",
    ]
    if height in SIGNED:
        lines.append(f"(drawn: the absolute value of {height})")
    return {"customdata": values, "hovertemplate": "<br>".join(dict.fromkeys(lines)) + "<extra></extra>"}


def make_space_trace(points: Array, mode: str, **more: Any) -> dict[str, Any]:
    """Lines, marks or text at points (n, 3)."""
    return {"type": "scatter3d", **dict(zip("xyz", points.T, strict=True)), "mode": mode, "hoverinfo": "skip"} | more


def make_ground_disc() -> list[dict[str, Any]]:
    """The surface as a disc of radius 1, with its azimuths."""
    rim = make_unit_vector_grid(np.array([90.0]), np.linspace(0.0, 360.0, 73))[0].astype(np.float32)
    rim[:, 2] = 0.0
    places = np.arange(74, dtype=np.int16)
    disc = {
        "type": "mesh3d",
        **dict(zip("xyz", np.concatenate([np.zeros((1, 3)), rim]).T, strict=True)),
        **dict(zip("ijk", (0 * places[:-2], places[1:-1], places[2:]), strict=True)),
        "color": "#dfe3e8",
        "opacity": 0.45,
        "hoverinfo": "skip",
    }
    rims = [make_space_trace(radius * rim, "lines", line={"color": PALE, "width": 2}) for radius in (0.5, 1.0)]
    words = ["φ = 0°<br>forward", "90°", "180°<br>back", "270°"]
    return [disc, *rims, make_space_trace(1.16 * rim[:72:18], "text", text=words, textfont={"size": 12, "color": INK})]


def make_ray(mu_i: float, words: str, goes_back: bool = False) -> list[dict[str, Any]]:
    """The incident light, travelling down along phi = 0 to the centre, or the beam that goes back mirrored: a line
    whose arrow lies outside the body, and the words of its points."""
    sine = np.sqrt(1.0 - mu_i**2)
    away = np.array([sine if goes_back else -sine, 0.0, mu_i])
    tip, along, colour = (1.4, away, MIRRORED) if goes_back else (1.08, -away, INCIDENT)
    hover = {"hoverinfo": None, "hovertemplate": f"{words}<extra></extra>"}
    line = make_space_trace(np.outer([1.45, 0.0], away), "lines", line={"color": colour, "width": 6}, **hover)
    head = {
        "type": "cone",
        **{axis: [value] for axis, value in zip("xyzuvw", (*(tip * away), *along), strict=True)},
        "anchor": "tip",
        "sizemode": "absolute",
        "sizeref": 0.16,
        "colorscale": [[0.0, colour], [1.0, colour]],
        "showscale": False,
        **hover,
    }
    return [line, head]
