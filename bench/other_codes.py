"""Codes of others that pip installs (extra "bench"), asked for the same light, and what they answer, in vrte's frame.

Nothing of them is imported before it is asked.

nanodisort, the C translation of DISORT: scalar, delta-M, and Nakajima and Tanaka's correction for the peak; albedo 1 it
lowers by itself, by some roundings.

PythonicDISORT, DISORT in NumPy: the same; off its nodes its own barycentric interpolation, with the correction at the
very directions ("eval").

sasktran2's discrete ordinates, plane-parallel: I, Q and U of the light that leaves the top. Its b1, Q and U have the
signs of vrte and its relative azimuth is phi. In plane-parallel geometry it refuses to look up from the bottom, and V
it does not have: those are NaN. Single scattering is left to the discrete ordinates, too: its source "Exact", which
sums along the line of sight, is further off with so few levels.
"""

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bench.study import hash_files
from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.results.field import Field
from vrte.scene.scene import Scene

ACCURACY = 1e-12  # of nanodisort's sum over azimuthal orders
COEFFICIENTS = ("a1", "a2", "a3", "b1")  # that sasktran2 takes
BESIDE = 10.0  # height of sasktran2's observer above the top, in layers
Solve = Callable[[], Field]
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Asked:
    """As `vrte.radiance` takes it: mu0, stokes (4,) of the beam, signed mu (n_mu,), phi (n_phi,) in degrees, tau
    (n_tau,)."""

    scene: Scene
    mu0: float
    stokes: Array
    mu: Array
    phi: Array
    tau: Array

    @property
    def flux(self) -> float:
        """Of the beam, perpendicular to it."""
        return float(self.stokes[0])

    @property
    def depth(self) -> Array:
        """Optical depth below the top of the bottom of each layer, (layer,)."""
        return np.cumsum([layer.thickness for layer in self.scene.layers])

    @property
    def albedos(self) -> Array:
        """Of single scattering, (layer,)."""
        return np.array([layer.albedo for layer in self.scene.layers])

    @property
    def terms(self) -> int:
        """Most terms of a phase matrix."""
        return max(layer.phase_matrix.terms for layer in self.scene.layers)

    @property
    def is_scalar(self) -> bool:
        """Whether no phase matrix polarizes."""
        return all(layer.phase_matrix.is_scalar for layer in self.scene.layers)

    @property
    def base_albedo(self) -> float:
        """Of a Lambertian base, 0 of a black one."""
        return self.scene.below.even_albedo

    def legendre(self, terms: int) -> Array:
        """Moments of the phase functions without the factor 2 l + 1, (layer, terms), zeros behind what there is."""
        found = np.zeros((len(self.scene.layers), terms))
        for moments, layer in zip(found, self.scene.layers, strict=True):
            a1 = layer.phase_matrix.a1[:terms]
            moments[: a1.size] = a1 / (2.0 * np.arange(a1.size) + 1.0)
        return found

    def check(self, name: str, polarization: bool, conservative: bool = True) -> None:
        """Raises SceneError, which names the peer, for what no such code takes, and for polarization and albedo 1 where
        this one does not."""
        if not np.isfinite(self.scene.thickness):
            raise SceneError(f"{name} takes no semi-infinite layer")
        if self.scene.needs_beam_paths:
            raise SceneError(f"{name} takes no refracting or mirroring surface here")
        if self.scene.base is not None and self.scene.base.orders_reflected > 1:
            raise SceneError(f"{name} takes no base {self.scene.base.name} here: black or Lambertian alone")
        if self.stokes[1:].any():
            raise SceneError(f"{name} takes no polarized beam")
        if not (polarization or self.is_scalar):
            raise SceneError(f"{name} takes no polarization: scalar phase functions alone")
        if not conservative and (self.albedos == 1.0).any():
            raise SceneError(f"{name} takes no albedo of 1")

    def answer(self, stokes: Array, flux_up: Array, flux_down: Array) -> Field:
        """What was found: stokes (n_tau, n_mu, n_phi, 4), diffuse fluxes (n_tau,); NaN where the code does not tell."""
        direct = self.mu0 * self.flux * np.exp(-self.tau / self.mu0)
        described = self.tau, self.mu, self.phi, self.mu0, self.stokes
        return Field(stokes, flux_up, flux_down, direct, *described, {})


def make_unpolarized(intensity: Array) -> Array:
    """Stokes vectors (..., 4) of a scalar code's intensity (...). Raises ArithmeticError as `finite` does."""
    stokes: Array = np.zeros((*intensity.shape, 4))
    stokes[..., 0] = require_finite(intensity)
    return stokes


def require_finite(values: Array) -> Array:
    """The values, which have to be numbers. Raises ArithmeticError."""
    if not np.isfinite(values).all():
        raise ArithmeticError("NaN or inf among the radiances")
    return values


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
    indices = np.argsort(np.argsort(asked.mu))
    found = np.asarray(state.uu)[indices].swapaxes(0, 1)  # (mu, tau, phi) there
    return asked.answer(make_unpolarized(found), np.array(state.flup), np.array(state.rfldn))


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


def prepare_nanodisort(asked: Asked, streams: int) -> Solve:
    """All of its arrays are made beforehand."""
    return partial(solve_nanodisort, asked, make_nanodisort_state(asked, streams, ACCURACY))


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


def make_sasktran2_atmosphere(
    asked: Asked, geometry: Any, config: Any, derivatives: bool = False, of_coefficients: bool = True
) -> Any:
    """The scene: levels from the bottom up, each of which fills what is above it; the topmost fills nothing. An engine
    takes atmospheres with ``derivatives``, or without, never both: it crashes."""
    import sasktran2

    how = {"calculate_derivatives": derivatives, "legendre_derivative": of_coefficients}
    atmosphere = sasktran2.Atmosphere(geometry, config, numwavel=1, **how)
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


def list_sasktran2_jacobians(asked: Asked, streams: int) -> dict[str, Array]:
    """Its derivatives of I, Q and U of the light up at the top, (mu, phi, 3), by the names of vrte: thickness, albedo
    and all coefficients of each layer, and the albedo of the base."""
    engine, geometry, config = make_sasktran2_engine(asked, streams)
    atmosphere = make_sasktran2_atmosphere(asked, geometry, config, derivatives=True)
    made = engine.calculate_radiance(atmosphere)
    shape = -1, asked.phi.size, 3
    found = {"base.albedo": made["wf_albedo"].values.reshape(shape)}
    for number, level in enumerate(range(len(asked.scene.layers) - 1, -1, -1), 1):
        keys = {"thickness": "wf_extinction", "albedo": "wf_ssa"}
        for at in range(1, atmosphere.storage.leg_coeff.shape[0]):
            degree, column = divmod(at, len(COEFFICIENTS))
            keys[f"coefficients[{degree}].{COEFFICIENTS[column]}"] = f"wf_leg_coeff_{at}"
        for key, name in keys.items():
            found[f"layer[{number}].{key}"] = made[name].values[level].reshape(shape)
    return found


def prepare_sasktran2(asked: Asked, streams: int) -> Solve:
    """The engine is kept, the atmosphere made again."""
    engine, *how = make_sasktran2_engine(asked, streams)
    return lambda: solve_sasktran2(asked, engine, make_sasktran2_atmosphere(asked, *how))


class PeerError(Exception):
    """A peer failed on what it was thought to take, or gave no number."""


@dataclass(frozen=True)
class Peer:
    """A code, by the name of its package; ``lacks``: what its curve tells of what it does not find; ``prepare``: what
    other scenes of as many layers share, done; what it returns does the rest, and is timed; whether it takes
    polarization, and albedo 1."""

    name: str
    lacks: str
    streams: tuple[int, ...]
    prepare: Callable[[Asked, int], Solve]
    polarization: bool = False
    conservative: bool = True

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return importlib.util.find_spec(self.name) is not None

    @property
    def made_by(self) -> str:
        """Its version and what asks it: another gives other rows."""
        return f"{version(self.name)} {hash_files([Path(__file__)])[:16]}"


UP_TO_64 = (4, 8, 16, 32, 64)
PEERS = {
    peer.name: peer
    for peer in (
        Peer("nanodisort", "", (*UP_TO_64, 128), prepare_nanodisort),
        Peer("PythonicDISORT", "", UP_TO_64, partial(partial, solve_pythonic_disort), conservative=False),
        Peer("sasktran2", " (light up, no V)", UP_TO_64, prepare_sasktran2, polarization=True),
    )
}


def prepare_solve(name: str, asked: Asked, streams: int) -> Solve:
    """What answers, each call anew. Raises SceneError for what the peer does not take, PeerError where it fails,
    MissingExtraError where it is not installed."""
    peer = PEERS[name]
    asked.check(name, peer.polarization, peer.conservative)
    import_peer(name)
    solve = guard_call(name, lambda: peer.prepare(asked, streams))
    return lambda: guard_call(name, solve)


def guard_call(name: str, call: Callable[[], Result]) -> Result:
    """A call of a peer; whatever it raises is a PeerError, and what it warns of is measured anyway."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call()
    except Exception as error:
        raise PeerError(f"{name}: {put_in_one_line(f'{type(error).__name__}: {error}', 200)}") from error


def import_peer(name: str) -> Any:
    """The module of a peer. Raises MissingExtraError where it is not installed."""
    if not PEERS[name].is_installed:
        raise MissingExtraError(f"the comparison with {name}", "bench")
    return importlib.import_module(name)


def list_installed() -> tuple[Peer, ...]:
    """Those that can be asked."""
    return tuple(peer for peer in PEERS.values() if peer.is_installed)


def describe_peers() -> str:
    """Which other codes are drawn, in their versions, and which could be."""
    here = ", ".join(f"{peer.name} {version(peer.name)}" for peer in list_installed())
    absent = ", ".join(peer.name for peer in PEERS.values() if not peer.is_installed)
    texts = [f"other codes: {here or 'none'}", f"not installed: {absent} (pip install 'vrte[bench]')" if absent else ""]
    return "; ".join(text for text in texts if text)
