"""How many nodes a hemisphere a request needs: an estimate, and a check of it on the mean over azimuth of I alone."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vrte import _core
from vrte.arrays import Array
from vrte.blas import single_threaded
from vrte.discrete_ordinates.choice import THIN
from vrte.discrete_ordinates.discretise import discretise
from vrte.discrete_ordinates.needs import brightness
from vrte.discrete_ordinates.problem import ALL, Problem, Run
from vrte.discrete_ordinates.routes import Doubling, Modes
from vrte.discrete_ordinates.single_scattering import add_base_reflected, paths_in_layers
from vrte.discrete_ordinates.small_angle import Anisotropic
from vrte.discrete_ordinates.truncating import flux_of_the_peak
from vrte.errors import AccuracyError
from vrte.scene import MuellerBase, Scene

FEWEST, MOST = 4, 256
LOWEST = 0.02  # |mu| that accuracy is promised for
AIM, ALLOWED = 0.3, 0.5  # of the accuracy: what the estimate aims at, what the check allows
DISCRETE = 0.5  # of the accuracy: what the discrete problem is solved to
TERM = 0.3  # what a degree that the nodes do not carry changes, over its strength
WIDER = 1.5  # the nodes that a number of nodes is checked with, over that number
SLOWEST, FASTEST = 3.0, 12.0  # powers of the number of nodes that errors fall with
BEAMS, DIRECTIONS, DEPTHS = 3, 5, 6  # of the check, at most
OF_NODES = np.array([LOWEST, 0.1, 0.35, 0.7, 1.0])  # directions of the check where the nodes themselves are asked for
AZIMUTHS = np.array([22.5, 67.5, 112.5, 157.5])  # that a base is averaged over
FINEST = 1e-15  # accuracy of the check's solves
NO_LIGHT = 1e-290
BYTES_A_NODE, CHECKED_BYTES = 64.0, 4e8  # of a layer in the check, over the nodes squared; of all layers, at most

Indicator = Callable[[int], tuple[Array, Array]]


@dataclass(frozen=True)
class NodeChoice:
    """nodes a hemisphere; rule: how they were found; notes: why the accuracy cannot be promised, if it cannot."""

    nodes: int
    rule: str
    notes: tuple[str, ...]


def choose_nodes(
    scene: Scene, mu0: Array, mu: Array | None, phi: Array, tau: Array, accuracy: float, run: Run, peaks: str = "none"
) -> NodeChoice:
    """Nodes for an accuracy of the continuous problem; ``mu`` signed, None for the nodes themselves; ``peaks``: of
    which layers they are taken off."""
    directions = np.concatenate([OF_NODES, -OF_NODES]) if mu is None else mu
    nodes = estimated_nodes(scene, mu0, directions, tau, accuracy)
    if BYTES_A_NODE * len(scene.layers) * (WIDER * nodes) ** 2 > CHECKED_BYTES:
        note = f"so many layers that the estimate of {nodes} nodes is not checked"
        return NodeChoice(nodes, f"estimate {nodes}, not checked", (note,))
    if max(layer.phase_matrix.terms for layer in scene.layers) <= 2 * nodes:
        peaks = "none"
    with single_threaded():
        found = indicator(scene, mu0, directions, phi, tau, run, peaks)
        error = error_of(found, nodes)
        rule = f"estimate {nodes}: mean of I over azimuth right to {error:.1g}"
        if error > ALLOWED * accuracy and nodes < MOST:
            nodes = refined(found, nodes, error, accuracy)
            error = error_of(found, nodes)
            rule += f"; refined to {nodes}: right to {error:.1g}"
    return NodeChoice(nodes, rule, tuple(reasons(scene, mu0, directions, nodes, error, accuracy)))


def estimated_nodes(scene: Scene, mu0: Array, mu: Array, tau: Array, accuracy: float) -> int:
    """The fewest whose relative error, as estimated, is a share of the accuracy."""
    nodes = np.arange(FEWEST, MOST + 1.0)
    lowest = max(LOWEST, min(float(mu0.min()), float(np.abs(mu).min())))
    error = grazing(nodes, lowest) + TERM * unresolved(scene, nodes)
    for length in lengths(scene, tau):
        error = np.maximum(error, thin(nodes, length, lowest))
    enough = np.flatnonzero(error <= AIM * accuracy)
    return int(nodes[enough[0]]) if enough.size else MOST


def grazing(nodes: Array, lowest: float) -> Array:
    """Error by directions of the lowest |mu|: as a function of mu' the light has a pole at -mu and a logarithm at 0."""
    pole = 0.1 * np.exp(-4.0 * nodes * math.asinh(math.sqrt(lowest)))
    logarithm = 20.0 * (LOWEST / lowest) ** 0.7 * nodes**-6.0
    error: Array = pole + logarithm
    return error


def thin(nodes: Array, length: float, lowest: float) -> Array:
    """Error by e^(-length/mu), which falls between the lowest nodes where light has a short way to go."""
    way = nodes * math.sqrt(length)
    fall = 0.6 * np.exp(-way) if length >= 3.0 * lowest else 0.04 * np.exp(-1.15 * way)
    error: Array = length * (2.0 * np.exp(-2.5 * way) + fall)
    return error


def unresolved(scene: Scene, nodes: Array) -> Array:
    """The strongest term, omega |B_l|/(2 l + 1), of the degrees l >= 2 N: those that so many nodes do not carry."""
    albedo: dict[int, float] = {}
    matrices = {id(layer.phase_matrix): layer.phase_matrix for layer in scene.layers}
    for layer in scene.layers:
        key = id(layer.phase_matrix)
        albedo[key] = max(albedo.get(key, 0.0), layer.albedo if layer.thickness > 0.0 else 0.0)
    strength = np.zeros(1 + max(matrix.terms for matrix in matrices.values()))
    for key, matrix in matrices.items():
        terms = strongest_terms(matrix.coefficients[None], np.array([albedo[key]]))[0]
        strength[: terms.size] = np.maximum(strength[: terms.size], terms)
    left: Array = strength[np.minimum(2 * nodes, strength.size - 1).astype(int)]
    return left


def strongest_terms(coefficients: Array, albedo: Array) -> Array:
    """The largest omega |B_l|/(2 l + 1) of the degrees l >= m, (layer, m); coefficients (layer, term, 6)."""
    a1, a2, a3, a4, b1, b2 = np.moveaxis(coefficients, -1, 0)
    first = 0.5 * np.abs(a1 + a2) + np.hypot(0.5 * (a1 - a2), b1)
    norm = np.maximum(first, np.maximum(np.abs(a3), np.abs(a4)) + np.abs(b2))
    degree = np.arange(norm.shape[1])
    strength = albedo[:, None] * norm / (2.0 * degree + 1.0)
    kept: Array = np.maximum.accumulate(strength[:, ::-1], axis=1)[:, ::-1]
    return kept


def lengths(scene: Scene, tau: Array) -> list[float]:
    """Short optical ways: the thickness of layers, the distance of depths from the nearest face of a layer."""
    faces = np.concatenate([[0.0], np.cumsum([layer.thickness for layer in scene.layers])])
    ways = np.concatenate([np.diff(faces), np.abs(tau[:, None] - faces).min(axis=1)])
    return sorted({float(way) for way in ways if 0.0 < way < 10.0})


def indicator(scene: Scene, mu0: Array, mu: Array, phi: Array, tau: Array, run: Run, peaks: str = "none") -> Indicator:
    """What solves the mean over azimuth of I, without polarization, for a few of the beams, directions and depths.

    N -> radiance and flux/pi, (n_tau, n_in, ...), relative to the largest I there, or to flux/pi where no light comes
    along the directions. With a base that mixes Stokes parameters they are all kept. Where peaks are taken off, light
    scattered once differs with N as well.
    """
    beams = few(mu0, BEAMS)
    directions = np.concatenate([few(mu[mu > 0.0], DIRECTIONS), few(mu[mu < 0.0], DIRECTIONS)])
    depths = few(tau, DEPTHS)
    base = scene.base if scene.base_is_reached else None
    stokes = ALL if isinstance(base, MuellerBase) else (0,)
    light = np.array([[1.0, 0.0, 0.0, 0.0]])
    single = brightness(scene, discretise(scene, beams, light, directions, depths, FEWEST), directions, phi, run)

    def solve(nodes: int) -> tuple[Array, Array]:
        whole = discretise(scene, beams, light, directions, depths, nodes, peaks)
        problem = replace(whole, stokes=stokes, columns=np.ascontiguousarray(light[:, list(stokes)]))
        thickness = float(problem.thickness[problem.albedo > 0.0].sum())
        route = (Doubling if thickness < THIN else Modes)(problem, base, 1, FINEST)
        result = route.solve(np.zeros(1, np.int32), run)
        for name, residual in result.residuals.items():
            if not residual[0] <= route.allowed[name]:
                raise AccuracyError(f"{name} {residual[0]:.2g}")
        radiance = result.kernels[0, :, :, 0, :, 0]
        size = np.maximum(single, np.abs(radiance).max(axis=2, initial=0.0))[..., None]
        if peaks != "none":
            radiance = radiance + scattered_once(scene, whole, directions)
        down = result.flux_down + flux_of_the_peak(problem, depths)
        flux = np.concatenate([result.flux_up, down], axis=2) / np.pi
        size = np.where(size > 0.0, size, np.abs(flux).max(axis=2, keepdims=True))
        return np.concatenate([radiance, flux], axis=2), np.maximum(size, NO_LIGHT)

    return solve


def scattered_once(scene: Scene, problem: Problem, mu: Array) -> Array:
    """The mean over azimuth of I scattered once, or by small angles, or reflected once, (n_tau, n_in, n_mu)."""
    levels = np.arange(problem.level.size, dtype=np.int32)
    light = np.zeros((levels.size, problem.mu0.size, mu.size))
    mean = partial(mean_over_azimuth, problem.mu0)
    for layer, gain, path in zip(scene.layers, problem.gain, paths_in_layers(problem, levels, mu), strict=True):
        if gain > 0.0:
            light += gain / (4.0 * np.pi) * path * mean(layer.phase_matrix.coefficients, mu)
    out = np.zeros((levels.size, problem.mu0.size, mu.size, AZIMUTHS.size, 4, 1))
    place, scale = np.zeros(1, np.int32), np.ones(problem.mu0.size)
    add_base_reflected(scene.base, problem, levels, mu, AZIMUTHS, place, scale, 0, scale.size, out)
    light += out[..., 0, 0].mean(axis=3)
    if problem.fraction.any():
        part = Anisotropic(scene, problem)
        down = np.flatnonzero(mu < 0.0)
        for i, mu0 in enumerate(problem.mu0.tolist()):
            beams = part.beams(mu0)
            for t in levels.tolist():
                for places, tables in part.sources(mu0, beams, t, mu[down]):
                    for o, table in zip(down[places].tolist(), tables, strict=True):
                        light[t, i, o] = mean(table, mu[o : o + 1])[i, 0] / (4.0 * np.pi)
    return light


def mean_over_azimuth(mu0: Array, coefficients: Array, mu: Array) -> Array:
    """Of F11 with coefficients (terms, 6), from mu0 (n_in,), going down, to mu (n_mu,), signed: (n_in, n_mu)."""
    mean: Array = _core.phase_matrices(0, np.ascontiguousarray(coefficients), -mu, mu0.copy())[..., 0, 0].T
    return mean


def few(values: Array, count: int) -> Array:
    """Some of the values, the lowest and the highest among them."""
    ordered = np.unique(values)
    places = np.unique(np.linspace(0, ordered.size - 1, min(count, ordered.size)).round().astype(int))
    return np.ascontiguousarray(ordered[places])


def error_of(found: Indicator, nodes: int) -> float:
    """What so many nodes differ by from more of them; infinite where one of the numbers finds no answer."""
    return gap(found, nodes, math.ceil(WIDER * nodes))


def gap(found: Indicator, nodes: int, more: int) -> float:
    """The largest relative difference that two numbers of nodes make."""
    try:
        (light, _), (better, size) = found(nodes), found(more)
    except AccuracyError:
        return math.inf
    return float((np.abs(light - better) / size).max())


def refined(found: Indicator, nodes: int, error: float, accuracy: float) -> int:
    """Nodes by the rate that the error falls with, from fewer nodes to these."""
    fewer = max(2, math.floor(nodes / WIDER))
    before = gap(found, fewer, nodes)
    if not (math.isfinite(error) and math.isfinite(before)):
        return min(MOST, 2 * nodes)
    rate = math.log(max(before / error, 1.0)) / math.log(nodes / fewer)
    rate = min(max(rate, SLOWEST), FASTEST)
    return min(MOST, math.ceil(nodes * (error / (AIM * accuracy)) ** (1.0 / rate)))


def reasons(scene: Scene, mu0: Array, mu: Array, nodes: int, error: float, accuracy: float) -> Iterator[str]:
    """Why the accuracy cannot be promised."""
    lowest = min(float(mu0.min()), float(np.abs(mu).min()))
    if lowest < LOWEST:
        yield f"accuracy is promised for |mu| >= {LOWEST:g} and mu0 >= {LOWEST:g}, not for {lowest:.2g}"
    left = TERM * float(unresolved(scene, np.array([float(nodes)]))[0])
    if left > accuracy:
        terms = max(layer.phase_matrix.terms for layer in scene.layers)
        yield f"{nodes} nodes do not carry the {terms} terms of the phase matrix: about {left:.1g} may be missing"
    if error > ALLOWED * accuracy:
        yield f"with {nodes} nodes, at most {MOST}, the mean of I over azimuth is right to {error:.1g} only"
