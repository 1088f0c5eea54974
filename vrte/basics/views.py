"""The one door upward: what shows, labels or writes a result lies in folders above it, and is found here by name."""

from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = Any  # in annotations: matplotlib is loaded where a figure is drawn
VIEWS: dict[tuple[str, str], str] = {  # of class and verb: what is called with the object and the verb's own arguments
    ("Brdf", "_repr_html_"): "vrte.pictures.notebook:show_brdf",
    ("Brdf", "plot"): "vrte.pictures.results:draw_brdf",
    ("Field", "_repr_html_"): "vrte.pictures.notebook:show_field",
    ("Field", "plot"): "vrte.pictures.results:draw_field",
    ("Fit", "page"): "vrte.pictures.fit:save_fit_page",
    ("Fit", "plot"): "vrte.pictures.fit:draw_fit",
    ("Hiding", "plot"): "vrte.pictures.appearance:draw_hiding",
    ("KubelkaMunk", "plot"): "vrte.pictures.appearance:draw_two_fluxes",
    ("Layer", "_repr_html_"): "vrte.pictures.notebook:show_layer",
    ("Match", "_repr_html_"): "vrte.pictures.match:make_match_body",
    ("Match", "save"): "vrte.pictures.match:save_match",
    ("Paint", "_repr_html_"): "vrte.pictures.appearance:make_paint_body",
    ("Paint", "save"): "vrte.pictures.appearance:save_paint",
    ("Particles", "_repr_html_"): "vrte.pictures.notebook:show_particles",
    ("PhaseMatrix", "_repr_html_"): "vrte.pictures.notebook:show_phase_matrix",
    ("PhaseMatrix", "plot"): "vrte.pictures.results:draw_phase_matrix",
    ("Photons", "to_xarray"): "vrte.formats.contents:convert_photons",
    ("Plan", "_repr_html_"): "vrte.pictures.notebook:show_plan",
    ("Plan", "plot"): "vrte.pictures.results:draw_plan",
    ("Result", "save"): "vrte.formats:save",
    ("Result", "to_xarray"): "vrte.formats.contents:to_xarray",
    ("Scene", "_repr_html_"): "vrte.pictures.notebook:show_scene",
    ("Spectrum", "_repr_html_"): "vrte.pictures.notebook:show_spectrum",
    ("Spectrum", "plot"): "vrte.pictures.results:draw_spectrum",
    ("Views", "to_xarray"): "vrte.formats.contents:convert_views",
}


def view(shown: Any, verb: str, *arguments: Any) -> Any:
    """What the function finds that VIEWS has for a verb of the object's class or a base class. Raises LookupError."""
    for kind in type(shown).__mro__:
        if row := VIEWS.get((kind.__name__, verb)):
            return resolve_name(row)(shown, *arguments)
    raise LookupError(f"{type(shown).__name__} has no view {verb!r}: add a row to vrte.basics.views.VIEWS")
