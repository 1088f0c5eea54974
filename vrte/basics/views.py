"""The one door upward: what shows, labels or writes a result lies in folders above it, and is found here by name."""

from importlib import import_module
from typing import Any

# (class, verb): "module:function", called with the object and the verb's own arguments
VIEWS: dict[tuple[str, str], str] = {
    ("Brdf", "_repr_html_"): "vrte.pictures.notebook:brdf_html",
    ("Brdf", "plot"): "vrte.pictures.lobes:brdf_figure",
    ("Field", "_repr_html_"): "vrte.pictures.notebook:field_html",
    ("Field", "plot"): "vrte.pictures.lobes:field_figure",
    ("Layer", "_repr_html_"): "vrte.pictures.notebook:layer_html",
    ("Particles", "_repr_html_"): "vrte.pictures.notebook:particles_html",
    ("PhaseMatrix", "_repr_html_"): "vrte.pictures.notebook:phase_matrix_html",
    ("PhaseMatrix", "plot"): "vrte.pictures.phase_pictures:phase_matrix_figure",
    ("Plan", "_repr_html_"): "vrte.pictures.notebook:plan_html",
    ("Plan", "plot"): "vrte.pictures.plan_picture:plan_figure",
    ("Result", "save"): "vrte.formats:save",
    ("Result", "to_xarray"): "vrte.formats.netcdf:to_xarray",
    ("Scene", "_repr_html_"): "vrte.pictures.notebook:scene_html",
    ("Spectrum", "_repr_html_"): "vrte.pictures.notebook:spectrum_html",
    ("Spectrum", "plot"): "vrte.pictures.lobes:spectrum_figure",
    ("Views", "to_xarray"): "vrte.formats.netcdf:views_to_xarray",
}


def view(shown: Any, verb: str, *arguments: Any) -> Any:
    """What the row of an object's class, or of one that it is made from, makes of it.

    A row for a class of one's own, or another function in the place of a row: ``VIEWS["Brdf", "plot"] =
    "my_module:my_figure"``, which is called with the BRDF. Raises LookupError where there is no row.

    >>> import vrte
    >>> view(vrte.isotropic(), "_repr_html_")[:5]
    '<div>'
    """
    for kind in type(shown).__mro__:
        if row := VIEWS.get((kind.__name__, verb)):
            module, name = row.split(":")
            return getattr(import_module(module), name)(shown, *arguments)
    raise LookupError(f"{type(shown).__name__} has no view {verb!r}: add a row to vrte.basics.views.VIEWS")
