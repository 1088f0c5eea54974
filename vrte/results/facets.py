"""Light of facets on top of a scene, in closed form, apart from the rest of its BRDF, which splines follow better."""

from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Brdf


def find_facets(brdf: Brdf, surface: RoughSurface | None) -> RoughSurface | None:
    """The surface's facets, each by itself, where it is all that reflects without any particle: in closed form."""
    if surface is None:
        return None
    alone = surface.reflect(brdf.mu_i[:, None, None], brdf.mu_o[:, None], brdf.phi)
    found = brdf.mueller if brdf.surface is None else brdf.surface
    known = np.allclose(found, alone, rtol=1e-6, atol=1e-6 * np.abs(alone).max())
    return replace(surface, conserving=False) if known else None


def leave_out_facets(brdf: Brdf, facets: RoughSurface | None) -> Array:
    """The Mueller matrices of a BRDF without the reflection of these facets, each by itself."""
    if facets is None:
        return brdf.mueller
    return brdf.mueller - facets.reflect(brdf.mu_i[:, None, None], brdf.mu_o[:, None], brdf.phi)
