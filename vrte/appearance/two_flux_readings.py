"""What K and S are found from: exact reflectances of a film over black and over white, or what it lets through."""

import numpy as np

from vrte.appearance.geometries import NODES, Geometry, find_reflectance, solve_geometry
from vrte.appearance.kubelka_munk import put_film_over
from vrte.appearance.panel import Panel
from vrte.appearance.surface_shares import solve_fluxes
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.scene.boundary import Lambertian
from vrte.scene.illumination import hemisphere


def find_length(panel: Panel) -> float:
    """How thick the film is [um], 1 where that is known optically alone. Raises SceneError for no film, or one without
    end."""
    known = panel.length_um
    if known is None:
        return 1.0
    return check_number("length_um", known, 5e-324, np.finfo(float).max, "above 0 and finite: K and S are of a film")


def check_film(panel: Panel) -> None:
    """Raises SceneError for other layers and interfaces than one film under a surface."""
    film = panel.film
    for scene in panel.scenes:
        others = [layer.thickness > 0.0 for place, layer in enumerate(scene.layers) if place != film]
        if any(others) or any(scene.interfaces[1:]) or not 0.0 < scene.layers[film].thickness < np.inf:
            raise SceneError(
                "K and S are of one film that ends, under one surface or none: no other layer or interface"
            )


def is_inside(panel: Panel, geometry: Geometry) -> bool:
    """Whether light is evenly diffuse where it enters the film: no surface, and even light."""
    return geometry.angle_i is None and not any(panel.surface)


def measure_panel(panel: Panel, geometry: Geometry, white: float, progress: Progress | None = None) -> Array:
    """Exact reflectances (2, n) over black and over a white Lambertian base."""
    if is_inside(panel, geometry):
        alone, through = solve_film(panel, progress)
        return np.stack([alone, put_film_over(alone, through, white)])
    found = []
    for place, base in enumerate((None, Lambertian(white))):
        over = panel.put_over(base)
        found.append(find_reflectance(solve_geometry(over, geometry, share_progress(progress, place, 2)), geometry))
    return np.stack(found)


def solve_film(panel: Panel, progress: Progress | None = None) -> tuple[Array, Array]:
    """Reflectance and transmittance (n,) of a film without surface and base under even light."""
    mu, weights = hemisphere(NODES)
    fields = solve_fluxes(panel.put_over(None), mu, "above", progress)
    alone = np.array([2.0 * weights @ one.flux_up[:, 0] for one in fields])
    through = np.array(
        [2.0 * weights @ (one.flux_down + one.direct)[:, -1] if one.tau.size > 1 else 0.0 for one in fields]
    )
    return alone, through
