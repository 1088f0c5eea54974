"""sasktran2's discrete ordinates, plane-parallel: I, Q and U of the light that leaves the top.

Its b1, Q and U have the signs of vrte and its relative azimuth is phi. In plane-parallel geometry it refuses to look up
from the bottom, and V it does not have: those are NaN. Single scattering is left to the discrete ordinates, too: its
source "Exact", which sums along the line of sight, is further off with so few levels.
"""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.results.field import Field
from vrte.studies.methods.peers.asked import Asked, finite

STREAMS = (4, 8, 16, 32, 64)
COEFFICIENTS = ("a1", "a2", "a3", "b1")
BESIDE = 10.0  # height of the observer above the top, in layers


def check(asked: Asked) -> None:
    """Raises SceneError for what it does not take."""
    asked.check("sasktran2", polarization=True)


def engine_of(asked: Asked, streams: int, orders: int | None = None) -> tuple[Any, Any, Any]:
    """Engine, geometry and settings for as many layers and these directions; one layer fills one unit of height.
    ``orders`` fixes the number of azimuthal orders, which it finds itself otherwise. With more terms than streams it
    takes its delta-M scaling."""
    import sasktran2

    config = sasktran2.Config()
    config.num_stokes, config.num_streams, config.num_threads = 1 if asked.is_scalar else 3, streams, 1
    config.num_singlescatter_moments = max(streams, asked.terms)
    config.multiple_scatter_source = sasktran2.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sasktran2.SingleScatterSource.DiscreteOrdinates
    config.delta_m_scaling = asked.terms > streams
    if orders is not None:
        config.num_forced_azimuth = orders
    height = len(asked.scene.layers)
    geometry = sasktran2.Geometry1D(
        asked.mu0,
        0.0,
        6.371e6,
        np.arange(height + 1.0),
        sasktran2.InterpolationMethod.LowerInterpolation,
        sasktran2.GeometryType.PlaneParallel,
    )
    views = sasktran2.ViewingGeometry()
    for mu in asked.mu[asked.mu > 0.0]:
        for phi in np.radians(asked.phi):
            views.add_ray(sasktran2.GroundViewingSolar(asked.mu0, phi, mu, height + BESIDE))
    views.add_flux_observer(sasktran2.FluxObserverSolar(asked.mu0, float(height)))
    return sasktran2.Engine(config, geometry, views), geometry, config


def atmosphere_of(asked: Asked, geometry: Any, config: Any) -> Any:
    """The scene: levels from the bottom up, each of which fills what is above it; the topmost fills nothing."""
    import sasktran2

    atmosphere = sasktran2.Atmosphere(geometry, config, numwavel=1, calculate_derivatives=False)
    upwards = [*asked.scene.layers[::-1], asked.scene.layers[0]]
    atmosphere.storage.total_extinction[:, 0] = [layer.thickness for layer in upwards]
    atmosphere.storage.ssa[:, 0] = [layer.albedo for layer in upwards]
    atmosphere.storage.solar_irradiance[:] = asked.flux
    atmosphere.surface.albedo[:] = asked.base_albedo
    for name in COEFFICIENTS[:1] if asked.is_scalar else COEFFICIENTS:
        table = getattr(atmosphere.leg_coeff, name)  # (degree, level, wavelength)
        for level, layer in enumerate(upwards):
            values = getattr(layer.phase_matrix, name)
            table[: values.size, level, 0] = values
    return atmosphere


def field_of(asked: Asked, engine: Any, atmosphere: Any) -> Field:
    """Solved; light up at the top, and its flux."""
    found = engine.calculate_radiance(atmosphere)
    up, top = asked.mu > 0.0, np.nonzero(asked.tau == 0.0)[0]
    light = found["radiance"].values.reshape(int(up.sum()), asked.phi.size, -1)  # (mu, phi, 1 or 3)
    stokes: Array = np.full((asked.tau.size, asked.mu.size, asked.phi.size, 4), np.nan)
    if asked.is_scalar:
        stokes[..., 1:] = 0.0
    for level in top:
        stokes[level, up, :, : light.shape[-1]] = finite(light)
    fluxes = np.full(asked.tau.size, np.nan)
    fluxes[top] = found["upwelling_flux"].values.ravel()[0]
    return asked.answer(stokes, fluxes, np.where(asked.tau == 0.0, 0.0, np.nan))
