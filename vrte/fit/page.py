"""A fit's page: one HTML file that opens without a network, with numbers, pictures and what the data cannot tell."""

import html
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrte.fit.figures import draw_fit, draw_profile
from vrte.fit.quantities import QUANTITIES
from vrte.fit.result import Fit
from vrte.pictures.figures import make_figure
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table, save_page

if TYPE_CHECKING:
    from vrte.fit.profile import Profile

MOST_ROWS = 2000  # that the page lists


def save_fit_page(
    fit: Fit, path: str | os.PathLike[str], title: str = "A fit", profiles: Sequence["Profile"] = ()
) -> None:
    """Writes the page, all of it or nothing. Raises SceneError for another suffix, MissingExtraError, OSError."""
    save_page(write_page(fit, title, profiles), path)


def write_page(fit: Fit, title: str, profiles: Sequence["Profile"] = ()) -> str:
    """The whole page, without anything that is elsewhere."""
    parts = [make_section("Numbers", write_numbers(fit))]
    image = f"<figure>{make_image(draw_fit(fit), 'measured, fitted')}</figure>"
    parts.append(make_section("Measured and fitted", image))
    for profile in profiles:
        figure = make_figure(5.0, 3.6)
        draw_profile(figure.add_subplot(), profile, float(profile.chi2.min()))
        figure.set_layout_engine("constrained")
        parts.append(f"<figure style='max-width:32rem'>{make_image(figure, repr(profile))}</figure>")
        parts.append(f"<p>{html.escape(describe_profile(profile))}</p>")
    blind = fit.blind_spots or ("Nothing: every direction among the free numbers is known to a third or better.",)
    parts.append(make_section("What the data cannot tell", f"<ul>{make_items(blind)}</ul>"))
    parts.append(make_section("Correlations", write_correlations(fit)))
    if len(fit.starts) > 1:
        parts.append(make_section("Starts", write_starts(fit)))
    if fit.notes:
        parts.append(make_section("What to know of these numbers", f"<ul>{make_items(fit.notes)}</ul>"))
    parts.append(f"<details><summary>All rows</summary>{write_measurement(fit)}</details>")
    return make_page(title, make_body(title, describe_fit(fit), *parts))


def describe_fit(fit: Fit) -> list[str]:
    """What was fitted, and how well, in lines."""
    from vrte import __version__

    lines = [
        f"{len(fit.names)} numbers from {len(fit.measurement)} rows: {', '.join(fit.measurement.names)}",
        f"chi2 {fit.chi2:.5g}, {fit.degrees_of_freedom} degrees of freedom"
        + (f", reduced {fit.reduced_chi2:.3g}" if fit.degrees_of_freedom else "")
        + (f", by chance as large in {fit.p_value:.2g} of fits" if fit.p_value == fit.p_value else ""),
        f"vrte {__version__}" + (f", {fit.nodes} nodes in each hemisphere" if fit.nodes else ""),
    ]
    return [*lines, "interrupted before it had converged"] if fit.interrupted else lines


def describe_profile(profile: "Profile") -> str:
    """The interval of a profile in words."""
    low, high = (f"{end:.6g}" if abs(end) < float("inf") else "beyond" for end in (profile.low, profile.high))
    return f"{profile.name}: chi2 is 1 above its least at {low} and {high}, all other numbers fitted anew."


def write_numbers(fit: Fit) -> str:
    """Values, errors, and singular values."""
    triples = zip(fit.names, fit.values.tolist(), fit.errors.tolist(), strict=True)
    rows = [(name, value, error, 100.0 * error / abs(value) if value else "") for name, value, error in triples]
    told = ", ".join(f"{one:.3g}" for one in fit.singular_values)
    words = f"Singular values of the derivatives, in sigmas by relative changes: {told}. One of s is known to 1/s."
    return f"{make_table(('number', 'value', 'standard deviation', '%'), rows, '.6g')}<p>{words}</p>"


def write_correlations(fit: Fit) -> str:
    """The matrix of correlations."""
    pairs = zip(fit.names, fit.correlations.tolist(), strict=True)
    return make_table(("", *fit.names), [(name, *row) for name, row in pairs], "+.3f")


def write_starts(fit: Fit) -> str:
    """All starts, the best first."""
    head = ("chi2", "ended", *(f"{name}, from" for name in fit.names), *(f"{name}, to" for name in fit.names))
    return make_table(head, [(one.chi2, one.ended, *one.values, *one.found) for one in fit.starts])


def write_measurement(fit: Fit) -> str:
    """Rows with what was measured, what the fit shows, and the residual."""
    given = fit.measurement
    head = ("row", "quantity", "where", "measured", "sigma", "fitted", "residual", "unit")
    rows = []
    for k in range(min(len(given), MOST_ROWS)):
        where = [f"{name.removesuffix('_deg').removesuffix('_um')} {getattr(given, name)[k]:g}" for name in NUMBERED
                 if getattr(given, name)[k] == getattr(given, name)[k]]  # fmt: skip
        where += [given.geometry[k]] if given.geometry[k] else []
        numbers = (fit.measured[k], fit.sigma[k], fit.predicted[k], fit.residuals[k])
        name = given.quantity[k]
        rows.append((str(k + 1), name, ", ".join(where), *map(float, numbers), QUANTITIES[name].unit))
    more = f"<p>and {len(given) - MOST_ROWS} more</p>" if len(given) > MOST_ROWS else ""
    return f"{make_table(head, rows)}{more}"


NUMBERED = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um")
