"""How each of the peers is told what is asked, and what it answers.

nanodisort, the C translation of DISORT: scalar, delta-M, and Nakajima and Tanaka's correction for the peak; albedo 1 it
lowers by itself, by some roundings.

PythonicDISORT, DISORT in NumPy: the same; off its nodes its own barycentric interpolation, with the correction at the
very directions ("eval").

sasktran2's discrete ordinates, plane-parallel: I, Q and U of the light that leaves the top. Its b1, Q and U have the
signs of vrte and its relative azimuth is phi. In plane-parallel geometry it refuses to look up from the bottom, and V
it does not have: those are NaN. Single scattering is left to the discrete ordinates, too: its source "Exact", which
sums along the line of sight, is further off with so few levels.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from bench.methods.peers.asked import Asked, make_unpolarized, require_finite
from vrte.basics.arrays import Array
from vrte.results.field import Field

ACCURACY = 1e-12  # of nanodisort's sum over azimuthal orders
COEFFICIENTS = ("a1", "a2", "a3", "b1")  # that sasktran2 takes
BESIDE = 10.0  # height of sasktran2's observer above the top, in layers
Solve = Callable[[], Field]


def prepare_nanodisort(asked: Asked, streams: int) -> Solve:
    """All of it is done again."""
    return lambda: solve_nanodisort(asked, make_nanodisort_state(asked, streams, ACCURACY))


def make_nanodisort_state(asked: Asked, streams: int, accuracy: float) -> Any:
    """All that it is told: directions in ascending order, as it wants them; "old" is the correction that it has for any
    phase function. ``accuracy``: of the sum over azimuthal orders."""
    import nanodisort

    state = nanodisort.DisortState()
    moments = asked.legendre(max(asked.terms, streams + 1))
    state.nstr, state.nlyr, state.nmom = streams, moments.shape[0], moments.shape[1] - 1
    state.ntau, state.numu, state.nphi = asked.tau.size, asked.mu.size, asked.phi.size
    state.usrtau = state.usrang = state.lamber = state.quiet = True
    state.planck = state.onlyfl = state.spher = False
    state.intensity_correction = state.old_intensity_correction = True
    state.fbeam, state.umu0, state.phi0, state.albedo = asked.flux, asked.mu0, 0.0, asked.base_albedo
    state.accur = accuracy
    state.allocate()
    state.dtauc, state.ssalb, state.pmom = np.diff(asked.depth, prepend=0.0), asked.albedos, moments.T
    state.umu, state.phi, state.utau = np.sort(asked.mu), asked.phi, asked.tau
    return state


def solve_nanodisort(asked: Asked, state: Any) -> Field:
    """Solved, in the order of directions that was asked for."""
    state.solve()
    places = np.argsort(np.argsort(asked.mu))
    found = np.asarray(state.uu)[places].swapaxes(0, 1)  # (mu, tau, phi) there
    return asked.answer(make_unpolarized(found), np.array(state.flup), np.array(state.rfldn))


def prepare_pythonic_disort(asked: Asked, streams: int) -> Solve:
    """All of it is done again."""
    return lambda: solve_pythonic_disort(asked, streams)


def solve_pythonic_disort(asked: Asked, streams: int) -> Field:
    """Solved with as many Fourier orders as streams, or as there are terms."""
    from PythonicDISORT import pydisort
    from PythonicDISORT.subroutines import interpolate

    moments = asked.legendre(max(asked.terms, streams + 1))
    is_cut = asked.terms > streams
    _, flux_up, flux_down, _, intensity = pydisort(
        asked.depth,
        asked.albedos,
        streams,
        moments,
        asked.mu0,
        asked.flux,
        0.0,
        NLeg=streams,
        NFourier=min(streams, asked.terms),
        f_arr=moments[:, streams] if is_cut else 0,
        BDRF_Fourier_modes=[asked.base_albedo] if asked.base_albedo else [],
    )
    along = interpolate(intensity, NT_cor="eval" if is_cut else None)
    shape = asked.mu.size, asked.tau.size, asked.phi.size  # squeezed there
    found = np.asarray(along(asked.mu, asked.tau, np.radians(asked.phi))).reshape(shape).swapaxes(0, 1)
    return asked.answer(make_unpolarized(found), flux_up(asked.tau), flux_down(asked.tau)[0])


def prepare_sasktran2(asked: Asked, streams: int) -> Solve:
    """The engine is kept, the atmosphere made again."""
    engine, *how = make_sasktran2_engine(asked, streams)
    return lambda: solve_sasktran2(asked, engine, make_sasktran2_atmosphere(asked, *how))


def make_sasktran2_engine(asked: Asked, streams: int, orders: int | None = None) -> tuple[Any, Any, Any]:
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


def make_sasktran2_atmosphere(asked: Asked, geometry: Any, config: Any) -> Any:
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


def solve_sasktran2(asked: Asked, engine: Any, atmosphere: Any) -> Field:
    """Solved; light up at the top, and its flux."""
    found = engine.calculate_radiance(atmosphere)
    up, top = asked.mu > 0.0, np.nonzero(asked.tau == 0.0)[0]
    light = found["radiance"].values.reshape(int(up.sum()), asked.phi.size, -1)  # (mu, phi, 1 or 3)
    stokes: Array = np.full((asked.tau.size, asked.mu.size, asked.phi.size, 4), np.nan)
    if asked.is_scalar:
        stokes[..., 1:] = 0.0
    for level in top:
        stokes[level, up, :, : light.shape[-1]] = require_finite(light)
    fluxes = np.full(asked.tau.size, np.nan)
    fluxes[top] = found["upwelling_flux"].values.ravel()[0]
    return asked.answer(stokes, fluxes, np.where(asked.tau == 0.0, 0.0, np.nan))
