"""Curves: a phase matrix against degree and scattering angle, the reflectance against wavelength or incidence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vrte.app.figures.style import ZERO, make_axis, make_curve, make_plotly_figure
from vrte.app.solving.appearance import Shares
from vrte.app.solving.reflectance import Reflectances
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.pictures.lobes import INK
from vrte.pictures.phase_pictures import ANGLES_DEG, COLOURS, compute_f11_and_ratios

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_DEGREES = 2000  # beyond, a line on the screen is a smear
BASES = (("#1f4e79", "solid"), ("#d98200", "dash"), ("#2a8f5b", "dashdot"), ("#b3262e", "dot"))


def coefficients(phase_matrix: PhaseMatrix) -> "Figure":
    """The six expansion sequences against their degree l; one that vanishes is named so, and not drawn.

    Raises MissingExtraError without Plotly.
    """
    shown = min(phase_matrix.terms, MOST_DEGREES)
    traces = [
        make_curve(
            np.arange(shown),
            values,
            name if values.any() else f"{name} = 0",
            colour,
            f"{name}, l = %{{x}}: %{{y:.5g}}",
            mode="lines+markers" if shown <= 100 else "lines",
            marker={"size": 5},
            visible=True if values.any() else "legendonly",
        )
        for name, values, colour in zip(SEQUENCES, phase_matrix.coefficients[:shown].T, (INK, *COLOURS), strict=True)
    ]
    some = "" if shown == phase_matrix.terms else f", the first {shown} of {phase_matrix.terms} degrees"
    under = f"g = {phase_matrix.asymmetry:.4g}, {phase_matrix.terms} terms{some}"
    axes = {"xaxis": make_axis("degree l"), "yaxis": make_axis("coefficient", zerolinecolor=ZERO)}
    return make_plotly_figure(traces, "Expansion coefficients", under, **axes)


def scattering_matrix(phase_matrix: PhaseMatrix) -> "Figure":
    """F11 on a logarithmic scale, and the ratios of the other elements to it, against the scattering angle.

    Where F11 is not above 0, as rounded tables have it, there is a gap. Raises MissingExtraError without Plotly.
    """
    f11, ratios = compute_f11_and_ratios(phase_matrix)
    curves = [("F11", f11, INK, "y")]
    curves += [(name, values, colour, "y2") for (name, values), colour in zip(ratios.items(), COLOURS, strict=True)]
    return make_plotly_figure(
        [
            make_curve(ANGLES_DEG, values, name, colour, f"{name} at %{{x:.1f}}°: %{{y:.4g}}", yaxis=where)
            for name, values, colour, where in curves
        ],
        "Scattering matrix",
        "mean of F11 over the sphere 1; −F12/F11: polarization of unpolarized light",
        xaxis=make_axis("scattering angle [°]", tickvals=list(range(0, 181, 30)), anchor="y2"),
        yaxis=make_axis("F11", type="log", domain=[0.54, 1.0], exponentformat="power"),
        yaxis2=make_axis("ratio to F11", domain=[0.0, 0.46], range=[-1.05, 1.05], zerolinecolor=ZERO),
    )


def reflectance(found: Reflectances, wavelength_um: Sequence[float], place: int) -> "Figure":
    """Reflectance of light from ``mu_i[place]`` against the wavelength; of one wavelength, against the angle of
    incidence. Raises MissingExtraError without Plotly."""
    angle = np.degrees(np.arccos(found.mu_i))
    spectral = len(wavelength_um) > 1
    x = np.array(wavelength_um) if spectral else angle
    order, unit = np.argsort(x), " µm" if spectral else "°"
    traces = [
        make_curve(
            x[order],
            (shares[:, place] if spectral else shares[0])[order],
            name,
            colour,
            f"{name}<br>%{{x:.4g}}{unit}: %{{y:.4f}}",
            mode="lines+markers",
            marker={"size": 6},
            dash=dash,
        )
        for (name, shares), (colour, dash) in zip(found.curves.items(), BASES, strict=False)
    ]
    return make_plotly_figure(
        traces,
        "Reflectance",
        f"{f'light from {angle[place]:.0f}° off the normal; ' if spectral else ''}unpolarized, all directions of exit",
        xaxis=make_axis("wavelength in vacuum [µm]" if spectral else "angle of incidence [°]"),
        yaxis=make_axis("reflectance", rangemode="tozero"),
        showlegend=True,
    )


def spectra(found: Shares, before: Shares | None, geometry: str) -> "Figure":
    """Reflectance factors over black and over white against the wavelength, and thinner those of ``before``. Raises
    MissingExtraError without Plotly."""
    traces = [
        make_curve(
            shares.wavelength_um,
            curve,
            name if now else f"{name}, before",
            colour,
            f"{name}<br>%{{x:.4g}} µm: %{{y:.4f}}",
            dash=dash if now else "dot",
            opacity=1.0 if now else 0.6,
        )
        for shares, now in ((found, True), (before, False))
        if shares is not None
        for name, curve, (colour, dash) in zip(
            ("over black", "over white"), (shares.over_black, shares.over_white), BASES, strict=False
        )
    ]
    return make_plotly_figure(
        traces,
        f"Reflectance factor, {geometry}",
        "1 is the perfect white diffuser",
        xaxis=make_axis("wavelength in vacuum [µm]"),
        yaxis=make_axis("reflectance factor", rangemode="tozero"),
        showlegend=True,
    )
