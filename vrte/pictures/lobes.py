"""The lobe of a BRDF: a body over the directions of exit, drawn flat by matplotlib, or by Plotly to turn around.

Without interfaces the light is inside the host medium, before any refraction at its surface, and titles say
"subsurface". What comes back as a beam, mirrored, is an arrow with its share, and in no lobe. A lobe ends where the
directions of the result end.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_whole
from vrte.basics.polarization import find_degree_of_polarization
from vrte.pictures.describe import FAINT, INCIDENT, INK, MIRRORED
from vrte.pictures.interactive import FAINT as PALE
from vrte.pictures.interactive import import_plotly, make_plotly_figure
from vrte.results.brdf import Brdf
from vrte.results.over_hemisphere import light_on_mesh
from vrte.results.quantities import ANGLES, DEGREE_LINEAR, SIGNED, incident_for, of_light, unit_of

COLOURED_TO = 80.0  # [degrees]; what is brighter nearer to the horizon takes the last colour
UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
ELEVATION, AZIMUTH = np.radians([24.0, -72.0])  # of the eye that sees a lobe, from far away
TOWARD = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
UPRIGHT = np.cross(TOWARD, RIGHT)
LAMP = np.array([-0.45, -0.6, 0.66])
GROUND = {"color": FAINT, "linewidth": 0.8, "zorder": 1}
FINE, STEP = 0.5, 1.5  # degrees between rings, and between spokes, of a lobe drawn flat, and of one to turn around
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


def make_unit_vector_grid(theta: Any, phi: Array) -> Array:
    """Unit vectors (theta, phi, 3) at polar angles and azimuths [degrees]: x along phi = 0, z up."""
    polar, azimuth = np.meshgrid(np.radians(theta), np.radians(phi), indexing="ij")
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)


RIM = make_unit_vector_grid([90.0], np.linspace(0.0, 360.0, 181))[0].round(12)  # of the surface, a disc
RINGS = 0.5, 1.0  # radii that are drawn on it


@dataclass(frozen=True, eq=False)
class Lobe:
    """``heights`` and ``colours`` (theta, phi) of the quantities ``height`` and ``colour`` on rings ``theta`` and
    spokes ``phi`` [degrees] for light from ``mu_i``; ``mirrored``: the beam in words, or ""."""

    mu_i: float
    theta: Array
    phi: Array
    heights: Array
    colours: Array
    height: str
    colour: str
    mirrored: str = ""

    @property
    def radius(self) -> Array:
        """The size of the heights (theta, phi), which is drawn."""
        return np.nan_to_num(np.abs(self.heights))

    @property
    def polarized(self) -> Array:
        """The colours (theta, phi) as degrees, from 0 to 1."""
        return np.clip(np.nan_to_num(self.colours), 0.0, 1.0)

    @property
    def points(self) -> Array:
        """The body (theta, phi, 3): x along phi = 0, z up."""
        return self.radius[..., None] * make_unit_vector_grid(self.theta, self.phi)

    def list_beams(self) -> Iterator[tuple[Array, str, str]]:
        """Incident and mirrored light: unit vectors (3,) from the centre, words and colours."""
        sine = float(np.sqrt(1.0 - self.mu_i**2))
        yield np.array([-sine, 0.0, self.mu_i]), "", INCIDENT
        if self.mirrored:
            yield np.array([sine, 0.0, self.mu_i]), self.mirrored, MIRRORED


def compute_lobe(
    brdf: Brdf,
    place: int,
    height: str = "f00",
    colour: str = DEGREE_LINEAR,
    stokes: Any = UNPOLARIZED,
    step_deg: float = FINE,
) -> Lobe:
    """The lobe for light of the Stokes vector ``stokes`` from ``mu_i[place]``."""
    check_whole("place", place, 0, brdf.mu_i.size - 1)
    names = height, colour
    meshes = [light_on_mesh(brdf, place, incident_for(name, stokes), step_deg) for name in names]
    heights, colours = (of_light(light, name) for (*_, light), name in zip(meshes, names, strict=True))
    theta, phi, _ = meshes[0]
    return Lobe(
        float(brdf.mu_i[place]), theta, phi, heights, colours, *names, describe_mirrored_beam(brdf, place, stokes)
    )


def describe_mirrored_beam(brdf: Brdf, index: int, stokes: Any = UNPOLARIZED) -> str:
    """What comes back as a beam of light with the Stokes vector ``stokes`` from ``mu_i[place]``; "" where none does."""
    if brdf.specular is None:
        return ""
    beam = brdf.specular[index] @ np.asarray(stokes, float)
    words = f"mirrored: {beam[0] / stokes[0]:.3g}"
    degree = float(np.nan_to_num(find_degree_of_polarization(beam)))
    return words + (f", degree of polarization {degree:.3g}" if degree >= 5e-4 else "")


def name_brdf(brdf: Brdf) -> str:
    """What a BRDF is called: of light inside the medium, or with what refracts and mirrors it."""
    if brdf.specular is not None:
        return "BRDF, without the mirrored beam"
    return "Subsurface BRDF" if brdf.surface is None else "BRDF, rough surface included"


def choose_range(values: Array, quantity: str) -> tuple[float, float]:
    """The ends of an axis: 0 to 180 for angles, symmetric where a quantity may be negative, else from 0."""
    if quantity in ANGLES:
        return 0.0, 180.0
    largest = float(np.abs(np.nan_to_num(values)).max()) or 1.0  # where nothing is, any scale will do
    return (-largest if quantity in SIGNED else 0.0), largest


def label_quantity(quantity: str) -> str:
    """The name of a quantity with its unit."""
    unit = unit_of(quantity)
    return f"{quantity} [{unit}]" if unit else quantity


def describe_incidence(brdf: Brdf, index: int) -> str:
    """Where the light comes from, in words."""
    mu = float(brdf.mu_i[index])
    return f"μ<sub>i</sub> = {mu:.4g}, {np.degrees(np.arccos(mu)):.0f}° from the normal"


def make_triangles(corner: Any) -> Any:
    """Corners (n, 3) of the triangles of a mesh, two between neighbours; ``corner`` (rings, spokes) numbers points."""
    here, below, beside, across = corner[:-1, :-1], corner[1:, :-1], corner[:-1, 1:], corner[1:, 1:]
    halves = (here, below, across), (here, across, beside)
    return np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in halves])


# ---- flat, by matplotlib


def make_lobe_colours(lobes: Sequence[Lobe]) -> Any:
    """The colours of the degrees of polarization of some lobes, from 0 on; nearest to the horizon there may be more."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    most = (float(one.polarized[one.theta <= COLOURED_TO].max()) for one in lobes)
    return ScalarMappable(Normalize(0.0, max(1e-3, *most)), SEQUENTIAL.lower())


def draw_lobe(axes: Any, lobe: Lobe, factor: float, colours: Any, letters: float = 9.0) -> None:
    """A lobe, its radius times ``factor``, above the surface, with its rays; words in ``letters`` [points]."""
    from matplotlib.collections import TriMesh
    from matplotlib.patheffects import withStroke
    from matplotlib.tri import Triangulation

    points = factor * lobe.points
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
    for radius in RINGS:
        axes.plot(*project_points(radius * RIM), **GROUND)
    for degrees in range(0, 360, 90):
        end = RIM[degrees // 2]
        axes.plot(*project_points(np.stack([0.0 * end, end])), **GROUND)
        index = project_points(1.13 * end)
        how = {"color": INK, "fontsize": letters, "path_effects": [withStroke(linewidth=2.0, foreground="white")]}
        axes.text(*index, f"{degrees}°", ha="center", va="center", zorder=3, **how)
    mesh.set_in_layout(False)
    axes.add_collection(mesh, autolim=False)  # its limits would be those of half a million paths
    ring = int(np.argmin(np.abs(lobe.theta - np.degrees(np.arccos(lobe.mu_i)))))
    arrow = {"arrowstyle": "-|>,head_length=0.7,head_width=0.3", "linewidth": 2.2, "shrinkA": 0.0, "shrinkB": 0.0}
    for seen, words, colour in lobe.list_beams():  # as far as the body
        inside = factor * float(lobe.radius[ring, 0 if words else lobe.phi.size // 2])
        beside = (0.07 if words and seen[0] < 0.07 else 0.0) * RIGHT  # both would lie upon each other
        near, far = (project_points(radius * seen + beside) for radius in (inside + 0.02, 1.3 if words else 1.2))
        start, end = (near, far) if words else (far, near)
        axes.annotate("", end, start, arrowprops={**arrow, "color": colour, "zorder": 20}, annotation_clip=False)
        axes.text(1.19, -0.6, words, color=colour, fontsize=letters, ha="right", va="bottom")
    axes.set_xlim(-1.19, 1.19), axes.set_ylim(-0.55, 1.2)
    axes.set_aspect("equal")
    axes.set_axis_off()


def project_points(points: Array) -> tuple[Array, Array]:
    """Where points (n, 3) are in the picture, to the right and up."""
    return points @ RIGHT, points @ UPRIGHT


# ---- to turn around, by Plotly


def lobe(brdf: Brdf, index: int, height: str = "f00", colour: str = DEGREE_LINEAR, stokes: Any = UNPOLARIZED) -> Any:
    """The lobe of `compute_lobe` as a body to turn around, ``height`` its radius. Raises MissingExtraError."""
    import_plotly()
    shown = compute_lobe(brdf, index, height, colour, stokes, STEP)
    largest, unit = float(shown.radius.max()), unit_of(height)
    angle_bar = scale(np.zeros(1), colour) | {"color": [0.0], "opacity": 0.0, "size": 1}  # of corners' own colours
    scale_in_words = f"rim of the disc = {largest:.3g}{'' if unit == '°' else ' '}{unit}".rstrip()
    return make_plotly_figure(
        [
            *make_ground_disc(),
            make_body(shown, largest or 1.0),
            *([make_space_trace(np.zeros((1, 3)), "markers", marker=angle_bar)] if colour in ANGLES else []),
            *make_rays(shown),
        ],
        f"{name_brdf(brdf)}: distance from the centre {f'|{height}|' if height in SIGNED else height}",
        "; ".join(filter(None, (describe_incidence(brdf, index), scale_in_words, shown.mirrored))),
        margin={"l": 0, "r": 0, "t": 84, "b": 0},
        scene=SPACE,
        showlegend=False,
        uirevision="lobe",  # a new lobe is seen from where the last one was
    )


def make_body(lobe: Lobe, largest: float) -> dict[str, Any]:
    """The surface of a lobe, a mesh closed around the normal; angles are coloured by corner, not interpolated."""
    phi, heights, colours = lobe.phi[:-1], lobe.heights[:, :-1], lobe.colours[:, :-1]  # the last spoke is the first
    corner = np.arange(heights.size).reshape(heights.shape)
    corners = make_triangles(np.append(corner, corner[:, :1], axis=1)).astype(np.int16)
    points = (lobe.points[:, :-1] / largest).reshape(-1, 3).astype(np.float32)
    shown, cyclic = np.nan_to_num(colours.ravel()), lobe.colour in ANGLES
    cosine, azimuth = np.meshgrid(np.cos(np.radians(lobe.theta)), phi, indexing="ij")
    lines = [
        "μ<sub>o</sub> = %{customdata[0]:.3f}, φ = %{customdata[1]:.0f}°",
        f"{lobe.height} = %{{customdata[2]:.4g}} {unit_of(lobe.height)}",
        f"{lobe.colour} = %{{customdata[3]:.4g}} {unit_of(lobe.colour)}",
        *([f"(drawn: the absolute value of {lobe.height})"] if lobe.height in SIGNED else []),
    ]
    painted = {"intensity": shown.astype(np.float32), **scale(shown, lobe.colour)}
    return {
        "type": "mesh3d",
        **dict(zip("xyzijk", (*points.T, *corners.T), strict=True)),
        **({"vertexcolor": list_cyclic_colours(shown)} if cyclic else painted),
        "uid": "angles" if cyclic else "numbers",  # a body that is kept would keep the other's colours beneath
        "lighting": FLAT if cyclic else SHINE,  # a hue in the shade is taken for another
        "lightposition": {"x": -4e4, "y": -6e4, "z": 9e4},
        "customdata": np.stack([cosine, azimuth, heights, colours], axis=-1).reshape(-1, 4).astype(np.float32),
        "hovertemplate": "<br>".join(dict.fromkeys(lines)) + "<extra></extra>",
    }


def scale(values: Array, colour: str) -> dict[str, Any]:
    """The colours of a quantity, and the bar that explains them."""
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
    """Colours of angles [degrees], the same at 0 and 180, as "#rrggbb"."""
    colours = import_plotly().colors  # the last of the circle is its first
    circle = np.array([colours.unlabel_rgb(colour) for colour in colours.cyclical.Phase], float)
    index = (angle % 180.0) / 180.0 * (len(circle) - 1)
    levels = [np.interp(index, np.arange(len(circle)), channel).round().astype(int).tolist() for channel in circle.T]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in zip(*levels, strict=True)]


def make_space_trace(points: Array, mode: str, **more: Any) -> dict[str, Any]:
    """Lines, marks or text at points (n, 3)."""
    return {"type": "scatter3d", **dict(zip("xyz", points.T, strict=True)), "mode": mode, "hoverinfo": "skip"} | more


def make_ground_disc() -> list[dict[str, Any]]:
    """The surface as a disc of radius 1, with its azimuths."""
    rim = RIM.astype(np.float32)
    indices = np.arange(1 + len(rim), dtype=np.int16)
    disc: dict[str, Any] = {"type": "mesh3d", "color": "#dfe3e8", "opacity": 0.45, "hoverinfo": "skip"}
    disc |= dict(zip("xyz", np.concatenate([np.zeros((1, 3)), rim]).T, strict=True))
    disc |= dict(zip("ijk", (0 * indices[:-2], indices[1:-1], indices[2:]), strict=True))
    rims = [make_space_trace(radius * rim, "lines", line={"color": PALE, "width": 2}) for radius in RINGS]
    words = ["φ = 0°<br>forward", "90°", "180°<br>back", "270°"]
    return [disc, *rims, make_space_trace(1.16 * rim[:180:45], "text", text=words, textfont={"size": 12, "color": INK})]


def make_rays(lobe: Lobe) -> Iterator[dict[str, Any]]:
    """The incident beam along phi = 0 and the mirrored one: lines with arrows outside the body, and words."""
    for seen, words, colour in lobe.list_beams():
        words = words or f"incident light, μ<sub>i</sub> = {lobe.mu_i:.4g}"
        tip, along = (1.08, -seen) if colour == INCIDENT else (1.4, seen)
        hover = {"hoverinfo": None, "hovertemplate": f"{words}<extra></extra>"}
        yield make_space_trace(np.outer([1.45, 0.0], seen), "lines", line={"color": colour, "width": 6}, **hover)
        cone = {"type": "cone", "anchor": "tip", "sizemode": "absolute", "sizeref": 0.16, "showscale": False, **hover}
        ends = {axis: [value] for axis, value in zip("xyzuvw", (*(tip * seen), *along), strict=True)}
        yield cone | ends | {"colorscale": [[0.0, colour], [1.0, colour]]}
