"""What a panel's surface sends back: k1 of the light that falls in, k2 of the light that comes up from inside, exactly.

Saunderson's formula wants both, and a laboratory guesses the second, 0.6 for even light below a binder or 0.4 because
that fits. Here it follows from the fluxes right below the surface, whatever directions the light there has.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from vrte.appearance.geometries import NODES, Geometry
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.calls.radiance import radiance
from vrte.calls.side_by_side import run_side_by_side
from vrte.results.field import Field
from vrte.scene.boundary import Lambertian
from vrte.scene.illumination import hemisphere
from vrte.scene.interface import Interface

FINE = 64  # nodes of the means of R and T of a surface


def find_surface_shares(
    panel: Panel, geometry: Geometry, white: float, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """k1 (n,), k2 over black and over white (2, n), and k2 of even light (n,) of the surface on top; 0 without one.

    k2 is a balance of fluxes right below the surface: what goes down there, less what just came in, over what goes up;
    that of even light where none comes up. Raises SceneError.
    """
    outer, even = np.zeros((2, len(panel)))
    returned = np.zeros((2, len(panel)))  # over black, over white
    mu, weights = find_beams(geometry)
    for part, (base, inner) in enumerate(zip((None, Lambertian(white)), returned, strict=True)):
        lit = [place for place, surface in enumerate(panel.surface) if surface is not None]
        over = panel.put_over(base)
        over = replace(over, wavelength_um=panel.wavelength_um[lit], scenes=tuple(over.scenes[place] for place in lit))
        fields = solve_fluxes(over, mu, "below", share_progress(progress, part, 2))
        for place, scene, field in zip(lit, over.scenes, fields, strict=True):
            surface = scene.interfaces[0]
            assert surface is not None
            mirrored, through = surface.share(mu)
            outer[place], even[place] = weights @ (mu * mirrored), find_even_share(surface)
            assert field.direct_up is not None
            down, up = field.flux_down + field.direct, field.flux_up + field.direct_up
            risen = weights @ up[:, 0]
            # where no light comes up, any share will do
            inner[place] = weights @ (down[:, 0] - mu * through) / risen if risen > 0.0 else even[place]
    return outer, returned, even


def find_beams(geometry: Geometry) -> tuple[Array, Array]:
    """Cosines of what falls in and weights (n_in,) that add up beams to a flux of 1."""
    if geometry.angle_i is None:
        mu, weights = hemisphere(NODES)
        return mu, 2.0 * weights
    mu = geometry.directions[0]
    return mu, 1.0 / mu


def find_even_share(surface: Interface) -> float:
    """What a surface sends back of even light from below it, r_i: of smooth ones, by r_i = 1 - (1 - r_e)/n^2 where it
    is denser below, since totally reflected light has a corner that no quadrature likes.

    >>> round(find_even_share(Interface(1.0, 1.5)), 3)
    0.596
    """
    mu, weights = hemisphere(FINE)
    ratio = surface.index_below / surface.index_above
    if surface.is_smooth and ratio > 1.0:
        return float(1.0 - 2.0 * (weights * mu) @ surface.share(mu)[1] / ratio**2)
    return float(2.0 * (weights * mu) @ surface.turned.share(mu)[0])


def solve_fluxes(panel: Panel, mu0: Array, side: str, progress: Progress | None = None) -> list[Field]:
    """Fluxes at the top, and above the bottom where there is one, of beams mu0, a field a wavelength."""

    def solve(place: int) -> Field:
        scene = panel.scenes[place]
        tau = [0.0, scene.thickness] if side == "above" and scene.base_is_reached else [0.0]
        try:
            return radiance(scene, mu0, mu=[], tau=tau, side=side, threads=1, **panel.asked)
        except SceneError as error:
            raise error.behind(f"at {panel.wavelength_um[place]:g} um") from error

    return run_side_by_side([partial(solve, place) for place in range(len(panel))], progress)
