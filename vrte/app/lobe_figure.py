"""The lobe of a BRDF as a body to turn around."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.style import FAINT, INCIDENT, INK, UNPOLARIZED, incidence, labelled, plain, plotly, span
from vrte.basics.arrays import Array, whole
from vrte.results.brdf import Brdf
from vrte.results.over_hemisphere import light_on_mesh
from vrte.results.quantities import ANGLES, SIGNED, incident_for, of_light, unit_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STEP = 1.5  # degrees from ring to ring, and from spoke to spoke: where degrees of polarization vanish they have a kink
SEQUENTIAL, DIVERGING = "Plasma", "RdBu_r"
LAMP = {"ambient": 0.72, "diffuse": 0.45, "specular": 0.04, "roughness": 0.9}
FLAT = {"ambient": 0.95, "diffuse": 0.15, "specular": 0.0, "roughness": 1.0}
NO_AXIS = {"visible": False, "showbackground": False}
CAMERA = {"eye": {"x": 0.38, "y": -1.24, "z": 0.5}, "center": {"x": 0.0, "y": 0.0, "z": -0.14}}
DOMAIN = {"x": [0.0, 1.0], "y": [0.16, 1.0]}  # above the colour bar


def lobe(
    brdf: Brdf,
    place: int,
    height: str = "f00",
    colour: str = "degree of linear polarization",
    stokes: Any = UNPOLARIZED,
) -> "Figure":
    """The BRDF as a body over the hemisphere of outgoing directions.

    Light of the Stokes vector ``stokes`` comes in at ``mu_i[place]``, along the red arrow. The distance from the centre
    is the size of the quantity ``height``, as a share of the largest, which the title tells; the colour is the quantity
    ``colour`` (both of `vrte.quantities.QUANTITIES`), cyclic for angles, white at 0 where it may be negative. Between
    the given directions splines run; the body ends at the last mu_o. Raises SceneError for an unknown quantity or
    place, or too few directions, MissingExtraError without Plotly.

    >>> lobe(brdf, 0, height="f00", colour="f10").write_html("lobe.html")
    """
    go = plotly()
    whole("place", place, 0, brdf.mu_i.size - 1)
    meshes = [light_on_mesh(brdf, place, incident_for(name, stokes), STEP) for name in (height, colour)]
    theta, phi = meshes[0][0], meshes[0][1][:-1]  # the last spoke is the first
    heights, colours = (
        of_light(light[:, :-1], name) for (_, _, light), name in zip(meshes, (height, colour), strict=True)
    )
    size = np.nan_to_num(np.abs(heights))
    largest = float(size.max())
    solid = body(go, theta, phi, size / (largest or 1.0), colours, colour)
    solid.update(hover(theta, phi, heights, colours, height, colour))
    bars = [bar_of_angles(go, colour)] if colour in ANGLES else []
    figure = go.Figure([*ground(go), solid, *bars, *ray(go, float(brdf.mu_i[place]))])
    scene = {
        "xaxis": NO_AXIS,
        "yaxis": NO_AXIS,
        "zaxis": NO_AXIS,
        "aspectmode": "data",
        "camera": CAMERA,
        "domain": DOMAIN,
    }
    figure.update_layout(
        **plain(title(brdf, place, height, largest), margin={"l": 0, "r": 0, "t": 84, "b": 0}),
        scene=scene,
        showlegend=False,
        uirevision="lobe",  # a new lobe is seen from where the last one was
    )
    return figure


def title(brdf: Brdf, place: int, height: str, largest: float) -> str:
    """What the distance from the centre means, and its scale."""
    size = f"|{height}|" if height in SIGNED else height
    unit = unit_of(height)
    scale = f"rim of the disc = {largest:.3g}{'' if unit == '°' else ' '}{unit}".rstrip()
    return f"Subsurface BRDF: distance from the centre {size}<br><sup>{incidence(brdf, place)}; {scale}</sup>"


def body(go: Any, theta: Array, phi: Array, radius: Array, colours: Array, colour: str) -> Any:
    """The surface of ``radius`` (theta, phi), a mesh closed around the normal.

    Corners have their colours, and between them those of the screen run. So angles are coloured beforehand: from 179
    degrees to 1 there must be no band of what lies between as numbers.
    """
    corners = facets(theta.size, phi.size)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]).astype(np.int16)
    x, y, z = (part.ravel().astype(np.float32) for part in points(theta, phi, radius))
    shown = np.nan_to_num(colours.ravel())
    coloured = (
        {"vertexcolor": cyclic_colours(shown)}
        if colour in ANGLES
        else {"intensity": shown.astype(np.float32)} | scale(shown, colour)
    )
    return go.Mesh3d(
        x=x,
        y=y,
        z=z,
        **dict(zip("ijk", triangles.T, strict=True)),
        **coloured,
        uid="angles" if colour in ANGLES else "numbers",  # a body that is kept would keep the other's colours beneath
        lighting=FLAT if colour in ANGLES else LAMP,  # a hue in the shade is taken for another
        lightposition={"x": -4e4, "y": -6e4, "z": 9e4},
    )


def scale(values: Array, colour: str) -> dict[str, Any]:
    """The colours of a quantity, and the bar that tells them."""
    low, high = span(values, colour)
    shares = np.linspace(0.0, 1.0, 13)
    turn = [list(pair) for pair in zip(shares.tolist(), cyclic_colours(180.0 * shares), strict=True)]
    return {
        "colorscale": turn if colour in ANGLES else DIVERGING if colour in SIGNED else SEQUENTIAL,
        "cmin": low,
        "cmax": high,
        "colorbar": {
            "title": {"text": labelled(colour), "side": "top"},
            "orientation": "h",
            "len": 0.7,
            "thickness": 12,
            "x": 0.5,
            "y": 0.0,
            "yanchor": "bottom",
            "nticks": 6,
        },
    }


def cyclic_colours(angle: Array) -> list[str]:
    """Colours of angles [degrees], the same at 0 and 180, as "#rrggbb".

    >>> first, last, between = cyclic_colours(np.array([0.0, 180.0, 90.0]))
    >>> first == last, first == between
    (True, False)
    """
    from plotly.colors import cyclical, unlabel_rgb

    circle = np.array([unlabel_rgb(colour) for colour in cyclical.Phase], float)  # its last is its first
    place = (angle % 180.0) / 180.0 * (len(circle) - 1)
    levels = [np.interp(place, np.arange(len(circle)), channel).round().astype(int).tolist() for channel in circle.T]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in zip(*levels, strict=True)]


def bar_of_angles(go: Any, colour: str) -> Any:
    """Nothing but the bar of colours that the corners of a body have by themselves."""
    bar = scale(np.zeros(1), colour) | {"color": [0.0], "opacity": 0.0, "size": 1}
    return go.Scatter3d(x=[0.0], y=[0.0], z=[0.0], mode="markers", marker=bar, hoverinfo="skip")


def hover(theta: Array, phi: Array, heights: Array, colours: Array, height: str, colour: str) -> dict[str, Any]:
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


def points(theta: Array, phi: Array, radius: Array) -> tuple[Array, Array, Array]:
    """x along phi = 0, y, z up, (theta, phi) each."""
    polar, azimuth = np.meshgrid(np.radians(theta), np.radians(phi), indexing="ij")
    sine = np.sin(polar)
    return radius * sine * np.cos(azimuth), radius * sine * np.sin(azimuth), radius * np.cos(polar)


def facets(rings: int, spokes: int) -> Any:
    """Four corners (n, 4) of each facet, around it, places in (rings, spokes); the last spoke is joined to the first.

    >>> facets(2, 3).tolist()
    [[0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]]
    """
    corner = np.arange(rings * spokes).reshape(rings, spokes)
    beside = np.roll(corner, -1, axis=1)
    return np.stack([corner[:-1], corner[1:], beside[1:], beside[:-1]], axis=-1).reshape(-1, 4)


def ground(go: Any) -> list[Any]:
    """The surface as a disc of radius 1, with its azimuths."""
    turn = np.linspace(0.0, 2.0 * np.pi, 73).astype(np.float32)
    cosine, sine = np.cos(turn), np.sin(turn)
    flat = {"hoverinfo": "skip"}
    centre = np.zeros(72, np.int16)
    disc = go.Mesh3d(
        x=[0.0, *cosine.tolist()],
        y=[0.0, *sine.tolist()],
        z=[0.0] * 74,
        i=centre,
        j=np.arange(1, 73, dtype=np.int16),
        k=np.arange(2, 74, dtype=np.int16),
        color="#dfe3e8",
        opacity=0.45,
        **flat,
    )
    line = {"color": FAINT, "width": 2}
    rims = [
        go.Scatter3d(x=size * cosine, y=size * sine, z=0.0 * turn, mode="lines", line=line, **flat)
        for size in (0.5, 1.0)
    ]
    label = np.radians([0.0, 90.0, 180.0, 270.0])
    words = ["φ = 0°<br>forward", "90°", "180°<br>back", "270°"]
    azimuths = go.Scatter3d(
        x=1.16 * np.cos(label),
        y=1.16 * np.sin(label),
        z=0.0 * label,
        mode="text",
        text=words,
        textfont={"size": 12, "color": INK},
        **flat,
    )
    return [disc, *rims, azimuths]


def ray(go: Any, mu_i: float) -> list[Any]:
    """The incident light, travelling down along phi = 0 to the centre: a line whose arrow lies outside the body."""
    toward = np.array([-np.sqrt(1.0 - mu_i**2), 0.0, mu_i])
    far, near = 1.45 * toward, 1.08 * toward
    told = f"incident light, μ<sub>i</sub> = {mu_i:.4g}<extra></extra>"
    line = go.Scatter3d(
        **{axis: [start, 0.0] for axis, start in zip("xyz", far.tolist(), strict=True)},
        mode="lines",
        line={"color": INCIDENT, "width": 6},
        hovertemplate=told,
    )
    head = go.Cone(
        **{axis: [place] for axis, place in zip("xyz", near.tolist(), strict=True)},
        **{axis: [part] for axis, part in zip("uvw", (-toward).tolist(), strict=True)},
        anchor="tip",
        sizemode="absolute",
        sizeref=0.16,
        colorscale=[[0.0, INCIDENT], [1.0, INCIDENT]],
        showscale=False,
        hovertemplate=told,
    )
    return [line, head]
