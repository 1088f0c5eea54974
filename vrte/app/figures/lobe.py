"""The lobe of a BRDF as a body to turn around."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.figures.style import (
    FAINT,
    UNPOLARIZED,
    choose_range,
    describe_incidence,
    import_plotly,
    label_quantity,
    make_plotly_figure,
)
from vrte.basics.arrays import Array, check_whole
from vrte.pictures.lobes import (
    INCIDENT,
    INK,
    MIRRORED,
    describe_mirrored_beam,
    make_triangles,
    make_unit_vector_grid,
    name_brdf,
)
from vrte.results.brdf import Brdf
from vrte.results.over_hemisphere import light_on_mesh
from vrte.results.quantities import ANGLES, SIGNED, incident_for, of_light, unit_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STEP = 1.5  # degrees from ring to ring, and from spoke to spoke: where degrees of polarization vanish they have a kink
SEQUENTIAL, DIVERGING = "Plasma", "RdBu_r"
LAMP = {"ambient": 0.72, "diffuse": 0.45, "specular": 0.04, "roughness": 0.9}
FLAT = {"ambient": 0.95, "diffuse": 0.15, "specular": 0.0, "roughness": 1.0}
SPACE = {
    **{key: {"visible": False, "showbackground": False} for key in ("xaxis", "yaxis", "zaxis")},
    "aspectmode": "data",
    "camera": {"eye": {"x": 0.38, "y": -1.24, "z": 0.5}, "center": {"x": 0.0, "y": 0.0, "z": -0.14}},
    "domain": {"x": [0.0, 1.0], "y": [0.16, 1.0]},  # above the colour bar
}
BAR = {"orientation": "h", "len": 0.7, "thickness": 12, "x": 0.5, "y": 0.0, "yanchor": "bottom", "nticks": 6}


def lobe(
    brdf: Brdf,
    place: int,
    height: str = "f00",
    colour: str = "degree of linear polarization",
    stokes: Any = UNPOLARIZED,
) -> "Figure":
    """The BRDF as a body over the hemisphere of outgoing directions.

    Light of the Stokes vector ``stokes`` comes in at ``mu_i[place]``, along the red arrow; what goes back as a beam is
    the green one, its share in the line below the title, and in no lobe. The distance from the centre is the size of
    the quantity ``height``, as a share of the largest, which the title tells; the colour is the quantity ``colour``
    (both of `vrte.quantities.QUANTITIES`), cyclic for angles, white at 0 where it may be negative. Between the given
    directions splines run; the body ends at the last mu_o. Raises SceneError for an unknown quantity or place, or too
    few directions, MissingExtraError without Plotly.

    >>> lobe(brdf, 0, height="f00", colour="f10").write_html("lobe.html")
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
    scale_in_words = f"rim of the disc = {largest:.3g}{'' if unit == '°' else ' '}{unit}".rstrip()
    return make_plotly_figure(
        [
            *make_ground_disc(),
            solid,
            *([make_angle_bar(colour)] if colour in ANGLES else []),
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
        "lighting": FLAT if cyclic else LAMP,  # a hue in the shade is taken for another
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
    colours = import_plotly().colors
    circle = np.array(
        [colours.unlabel_rgb(colour) for colour in colours.cyclical.Phase], float
    )  # its last is its first
    place = (angle % 180.0) / 180.0 * (len(circle) - 1)
    levels = [np.interp(place, np.arange(len(circle)), channel).round().astype(int).tolist() for channel in circle.T]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in zip(*levels, strict=True)]


def make_angle_bar(colour: str) -> dict[str, Any]:
    """Nothing but the bar of colours that the corners of a body have by themselves."""
    bar = scale(np.zeros(1), colour) | {"color": [0.0], "opacity": 0.0, "size": 1}
    return make_space_trace(np.zeros((1, 3)), "markers", marker=bar)


def make_hover_text(
    theta: Array, phi: Array, heights: Array, colours: Array, height: str, colour: str
) -> dict[str, Any]:
    """What a point tells: its direction, and the quantities with their signs."""
    cosine, azimuth = np.meshgrid(np.cos(np.radians(theta)), phi, indexing="ij")
    told = np.stack([cosine, azimuth, heights, colours], axis=-1).reshape(-1, 4).astype(np.float32)
    lines = [
        "μ<sub>o</sub> = %{customdata[0]:.3f}, φ = %{customdata[1]:.0f}°",
        f"{height} = %{{customdata[2]:.4g}} {unit_of(height)}",
        f"{colour} = %{{customdata[3]:.4g}} {unit_of(colour)}",
    ]
    if height in SIGNED:
        lines.append(f"(drawn: the absolute value of {height})")
    return {"customdata": told, "hovertemplate": "<br>".join(dict.fromkeys(lines)) + "<extra></extra>"}


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
    rims = [make_space_trace(radius * rim, "lines", line={"color": FAINT, "width": 2}) for radius in (0.5, 1.0)]
    words = ["φ = 0°<br>forward", "90°", "180°<br>back", "270°"]
    return [disc, *rims, make_space_trace(1.16 * rim[:72:18], "text", text=words, textfont={"size": 12, "color": INK})]


def make_ray(mu_i: float, told: str, goes_back: bool = False) -> list[dict[str, Any]]:
    """The incident light, travelling down along phi = 0 to the centre, or the beam that goes back mirrored: a line
    whose arrow lies outside the body, and what its points tell."""
    sine = np.sqrt(1.0 - mu_i**2)
    away = np.array([sine if goes_back else -sine, 0.0, mu_i])
    tip, along, colour = (1.4, away, MIRRORED) if goes_back else (1.08, -away, INCIDENT)
    hover = {"hoverinfo": None, "hovertemplate": f"{told}<extra></extra>"}
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
