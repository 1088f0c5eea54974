"""How many nodes a hemisphere a request needs: an estimate, and a search from there by what I alone shows.

What a number of nodes gets wrong is seen from its difference to more of them, in the mean over azimuth of I; where
terms of a phase matrix stay cut, in a few more Fourier orders, between which the error is taken as a straight line.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.routes import make_route
from vrte.discrete_ordinates.orders.single_scattering import add_base_reflected, integrate_paths
from vrte.discrete_ordinates.orders.small_angle import Anisotropic
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.orders.truncating import count_terms_carried, find_peak_flux
from vrte.discrete_ordinates.planning.choice import THIN
from vrte.discrete_ordinates.planning.needs import find_brightness
from vrte.scene.boundary import Boundary
from vrte.scene.scene import Scene

FEWEST, MOST = 4, 256
LOWEST = 0.02  # |mu| that accuracy is promised for
AIM, DISCRETE = 0.65, 0.35  # of the accuracy: what the nodes may spend, what the discrete problem is solved to
CAREFUL = 0.3  # of the accuracy: what an estimate aims at that nothing checks
TERM = 0.3  # what a degree that the nodes do not carry changes at most, over its strength
SMALL = 0.4  # of what the nodes may spend: what terms that are cut change at most is added, and more is looked into
BELIEF = 0.8  # in that most: its power in the first number of nodes
OF_MEAN = 1.5  # plus the largest asymmetry: error of the whole field over that of the mean over azimuth of I, at most
OF_SURFACES = 3.0  # the same, where light is totally reflected
OF_SUM = 1.2  # the same over that of a sum of Fourier orders of I
STEP = 3  # from one Fourier order that is looked at to the next
WIDE_ENOUGH, WIDER = 1.25, 1.4  # nodes compared with, over those they are compared with: at least, and where solved
LOOKS = 6  # numbers of nodes whose error is looked at, at most
LESS = 0.8  # the next number of nodes, at most, where terms are cut: errors fall less steeply than what they change
CLOSE = 0.95  # of a number of nodes that is enough: as few are worth no other look
FAR = 0.9  # as few are worth one where the solve is not among the smallest
FARTHER = 0.7  # the same where looks take twice as long
BEAMS, DIRECTIONS, DEPTHS = 3, 5, 6  # of the check, at most
OF_NODES = np.array([LOWEST, 0.1, 0.35, 0.7, 1.0])  # directions of the check where the nodes themselves are asked for
AZIMUTHS = np.array([22.5, 67.5, 112.5, 157.5])  # that a base is averaged over
FINEST = 1e-15  # accuracy of the check's solves
NO_LIGHT = 1e-290
BYTES_A_NODE, CHECKED_BYTES = 64.0, 3e8  # of a layer in the check, over the nodes squared; of all layers, at most

Indicator = Callable[[int], tuple[Array, Array]]


@dataclass(frozen=True)
class NodeChoice:
    """nodes a hemisphere; rule: how they were found; notes: why the accuracy cannot be promised, if it cannot."""

    nodes: int
    rule: str
    notes: tuple[str, ...]


def choose_nodes(
    scene: Scene,
    mu0: Array,
    mu: Array | None,
    phi: Array,
    tau: Array,
    accuracy: float,
    run: Run,
    peaks: str = "none",
    under: BoolArray | None = None,
) -> NodeChoice:
    """Nodes for an accuracy of the continuous problem; ``mu`` signed, None for the nodes themselves; ``peaks``: of
    which layers they are taken off."""
    directions = np.concatenate([OF_NODES, -OF_NODES]) if mu is None else mu
    aim = AIM * accuracy
    cut = TERM * find_unresolved_terms(scene, np.arange(FEWEST, MOST + 1.0))
    smooth, estimate = (estimate_errors(scene, mu0, directions, tau, left) for left in (np.zeros_like(cut), cut))
    # not where no term that is cut can matter at all: so many are seldom needed, and the way up is cheaper than down
    nodes = round(find_fewest_nodes(smooth, aim) ** (1.0 - BELIEF) * find_fewest_nodes(estimate, aim) ** BELIEF)
    if count_check_bytes(scene, nodes) > CHECKED_BYTES:
        note = f"so many layers that the estimate of {nodes} nodes is not checked"
        return NodeChoice(nodes, f"estimate {nodes}, not checked", (note,))
    if max(layer.phase_matrix.terms for layer in scene.layers) <= count_terms_carried(scene, FEWEST):
        peaks = "none"
    orders = choose_check_orders(scene, nodes, float(cut[nodes - FEWEST]), aim)
    with keep_to_one_thread():
        search = Search(
            make_indicator(scene, mu0, directions, phi, tau, run, peaks, orders, under), scene, orders, estimate, cut
        )
        nodes, error = search.fewest(nodes, aim)
    return NodeChoice(nodes, search.rule, tuple(list_notes(scene, mu0, directions, nodes, error, accuracy)))


def take_given_nodes(scene: Scene, nodes: int, rule: str) -> NodeChoice:
    """Nodes as somebody gave them: what is solved is not the scene where its phase matrices have more terms."""
    terms = max((layer.phase_matrix.terms for layer in scene.layers if layer.albedo * layer.thickness > 0.0), default=0)
    carried = count_terms_carried(scene, nodes)
    note = f"{nodes} nodes carry {carried} of the {terms} terms of the phase matrix, and what is left has the accuracy"
    return NodeChoice(nodes, rule, (note,) if terms > carried else ())


def choose_check_orders(scene: Scene, nodes: int, cut: float, aim: float) -> IntArray:
    """0 alone, or with a geometric series of others where what is ``cut`` by so many nodes matters. What a Mueller base
    does to others takes too long to find, and of many layers they take too much memory."""
    others = STEP ** np.arange(math.ceil(math.log(2 * nodes, STEP)), dtype=np.int32)
    too_much = scene.below.is_uneven or count_check_bytes(scene, nodes) * others.size > CHECKED_BYTES
    return np.concatenate([np.zeros(1, np.int32), others[: 0 if cut < SMALL * aim or too_much else None]])


def count_check_bytes(scene: Scene, nodes: int) -> float:
    """Of memory that an order takes."""
    return BYTES_A_NODE * len(scene.layers) * (WIDER * nodes) ** 2


def weigh_orders(orders: IntArray) -> Array:
    """What sums over all Fourier orders, twice those but 0, a function that is a straight line between some of them.

    >>> weigh_orders(np.array([0, 1, 3], np.int32))  # f0 + 2 f1 + (f1 + f3) + 2 f3
    array([1., 3., 3.])
    """
    found = np.ones(orders.size)
    if orders.size > 1:
        found[1:] = np.convolve(np.diff(orders[1:]), [1.0, 1.0])
        found[[1, -1]] += 1.0
    return found


@dataclass
class Search:
    """The fewest nodes whose error, as the indicator of a scene shows it in some Fourier orders, is small enough.

    ``estimate``: errors of FEWEST to MOST nodes, whose ratios are believed, and ``cut``, what terms that are cut have
    in them at most; ``errors``: those that were looked at, by the number of nodes; ``known``: what the indicator found,
    None where it found no answer.
    """

    found: Indicator
    scene: Scene
    orders: IntArray
    estimate: Array
    cut: Array
    errors: dict[int, float] = field(default_factory=dict)
    known: dict[int, tuple[Array, Array] | None] = field(default_factory=dict)

    @property
    def rule(self) -> str:
        """How the nodes were found, in words."""
        first, *others = (f"{nodes}: right to {error:.1g}" for nodes, error in self.errors.items())
        seen = "mean of I over azimuth" if self.orders.size == 1 else f"I in {self.orders.size} Fourier orders"
        return "; ".join([f"estimate {first} by the {seen}", *others])

    def fewest(self, nodes: int, aim: float) -> tuple[int, float]:
        """From an estimate: the nodes, and their error, which is above the aim where even MOST nodes are too few."""
        low, high = 0, 0
        while nodes and len(self.errors) < LOOKS:
            if not high and max(self.known, default=0) < WIDE_ENOUGH * nodes:
                self.solve(math.ceil(WIDER * nodes))
            self.errors[nodes] = self.error(nodes)
            if self.errors[nodes] <= aim:
                high = nodes
            else:
                low = nodes
            nodes = self.next_look(low, high, aim)
        return (high or low), self.errors[high or low]

    def next_look(self, low: int, high: int, aim: float) -> int:
        """Nodes to look at next, 0 where it is not worth it; so many were too few and enough, 0: none yet."""
        if low >= MOST:
            return 0
        if low and high:
            share = math.log(self.errors[low] / aim) / math.log(self.errors[low] / max(self.errors[high], NO_LIGHT))
            nodes = math.ceil(low * (high / low) ** share) if math.isfinite(share) else (low + high) // 2
            nodes = max(nodes, low + 1)
        else:
            at = high or low
            wrong = max(self.errors[at], NO_LIGHT) / self.estimate[at - FEWEST]
            nodes = find_fewest_nodes(self.estimate, aim / wrong)
            if not high:
                return min(max(nodes, math.ceil(low / CLOSE)), 2 * low, MOST)
            if self.orders.size > 1:  # the bound on what is cut falls more steeply than the error
                nodes = min(nodes, math.ceil(LESS * high))
            nodes = max(nodes, (high + 1) // 2, FEWEST)
        cubes = count_cubes(self.scene, high)
        saved = cubes - count_cubes(self.scene, nodes)
        # under surfaces a look is two solves
        far = nodes < (FARTHER if self.scene.keeps_beams else FAR) * high and cubes > cost.NOT_SMALLEST
        return nodes if far or (nodes < CLOSE * high and saved > cost.WORTH_LOOK) else 0

    def solve(self, nodes: int) -> tuple[Array, Array] | None:
        """The indicator on so many nodes, once."""
        if nodes not in self.known:
            try:
                self.known[nodes] = self.found(nodes)
            except AccuracyError:
                self.known[nodes] = None
        return self.known[nodes]

    def error(self, nodes: int) -> float:
        """What is to be reckoned with, from the difference to the most nodes that were tried; infinite where one of
        the two finds no answer."""
        few, many = self.solve(nodes), self.solve(max(self.known))
        if few is None or many is None:
            return math.inf
        gap = np.abs(few[0] - many[0]) / many[1]
        forward = max(abs(layer.phase_matrix.asymmetry) for layer in self.scene.layers)
        most = OF_SURFACES if self.scene.keeps_beams else OF_MEAN
        mean = (most + forward) * float(gap[0].max())
        if self.orders.size == 1:
            return mean + float(self.cut[nodes - FEWEST])
        return max(mean, OF_SUM * float(np.tensordot(weigh_orders(self.orders), gap, axes=1).max()))


def count_cubes(scene: Scene, nodes: int) -> float:
    """Cubes of the unknowns of all Fourier orders and layers."""
    scalar = all(layer.phase_matrix.is_scalar for layer in scene.layers)
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    return len(scene.layers) * min(terms, 2 * nodes) * float(nodes if scalar else 4 * nodes) ** 3


def estimate_nodes(scene: Scene, mu0: Array, mu: Array, tau: Array, aim: float) -> int:
    """The fewest whose relative error, as estimated, is no more than this."""
    cut = TERM * find_unresolved_terms(scene, np.arange(FEWEST, MOST + 1.0))
    return find_fewest_nodes(estimate_errors(scene, mu0, mu, tau, cut), aim)


def find_fewest_nodes(errors: Array, aim: float) -> int:
    """The fewest nodes with no larger error, of errors of FEWEST to MOST nodes; MOST where there are none."""
    enough = np.flatnonzero(errors <= aim)
    return FEWEST + int(enough[0]) if enough.size else MOST


def estimate_errors(scene: Scene, mu0: Array, mu: Array, tau: Array, cut: Array) -> Array:
    """Relative, of FEWEST to MOST nodes; ``cut``: by terms that they do not carry."""
    nodes = np.arange(FEWEST, MOST + 1.0)
    lowest = max(LOWEST, min(float(mu0.min()), float(np.abs(mu).min())))
    error = estimate_grazing_error(nodes, lowest) + cut
    for length in list_short_ways(scene, tau):
        error = np.maximum(error, estimate_thin_error(nodes, length, lowest))
    return error


def estimate_grazing_error(nodes: Array, lowest: float) -> Array:
    """Error by directions of the lowest |mu|: as a function of mu' the light has a pole at -mu and a logarithm at 0."""
    pole = 0.1 * np.exp(-4.0 * nodes * math.asinh(math.sqrt(lowest)))
    logarithm = 20.0 * (LOWEST / lowest) ** 0.7 * nodes**-6.0
    error: Array = pole + logarithm
    return error


def estimate_thin_error(nodes: Array, length: float, lowest: float) -> Array:
    """Error by e^(-length/mu), which falls between the lowest nodes where light has a short way to go."""
    way = nodes * math.sqrt(length)
    fall = 0.6 * np.exp(-way) if length >= 3.0 * lowest else 0.04 * np.exp(-1.15 * way)
    error: Array = length * (2.0 * np.exp(-2.5 * way) + fall)
    return error


def find_unresolved_terms(scene: Scene, nodes: Array) -> Array:
    """The strongest term, omega |B_l|/(2 l + 1), of the degrees l >= 2 N: those that so many nodes do not carry."""
    albedo: dict[int, float] = {}
    matrices = {id(layer.phase_matrix): layer.phase_matrix for layer in scene.layers}
    for layer in scene.layers:
        key = id(layer.phase_matrix)
        albedo[key] = max(albedo.get(key, 0.0), layer.albedo if layer.thickness > 0.0 else 0.0)
    strength = np.zeros(1 + max(matrix.terms for matrix in matrices.values()))
    for key, matrix in matrices.items():
        terms = find_strongest_terms(matrix.coefficients[None], np.array([albedo[key]]))[0]
        strength[: terms.size] = np.maximum(strength[: terms.size], terms)
    left: Array = strength[np.minimum(count_terms_carried(scene, 1) * nodes, strength.size - 1).astype(int)]
    return left


def find_strongest_terms(coefficients: Array, albedo: Array) -> Array:
    """The largest omega |B_l|/(2 l + 1) of the degrees l >= m, (layer, m); coefficients (layer, term, 6)."""
    a1, a2, a3, a4, b1, b2 = np.moveaxis(coefficients, -1, 0)
    first = 0.5 * np.abs(a1 + a2) + np.hypot(0.5 * (a1 - a2), b1)
    norm = np.maximum(first, np.maximum(np.abs(a3), np.abs(a4)) + np.abs(b2))
    degree = np.arange(norm.shape[1])
    strength = albedo[:, None] * norm / (2.0 * degree + 1.0)
    kept: Array = np.maximum.accumulate(strength[:, ::-1], axis=1)[:, ::-1]
    return kept


def list_short_ways(scene: Scene, tau: Array) -> list[float]:
    """Short optical ways: the thickness of layers, the distance of depths from the nearest face of a layer."""
    faces = np.concatenate([[0.0], np.cumsum([layer.thickness for layer in scene.layers])])
    ways = np.concatenate([np.diff(faces), np.abs(tau[:, None] - faces).min(axis=1)])
    return sorted({float(way) for way in ways if 0.0 < way < 10.0})


def make_indicator(
    scene: Scene,
    mu0: Array,
    mu: Array,
    phi: Array,
    tau: Array,
    run: Run,
    peaks: str,
    orders: IntArray,
    under: BoolArray | None = None,
) -> Indicator:
    """What solves some Fourier orders of I, without polarization, for a few of the beams, directions and depths.

    N -> radiance and, in order 0, flux/pi, (order, n_tau, n_in, ...), and what they are relative to: the largest I
    there, or flux/pi where no light comes along the directions, (n_tau, n_in, 1). With a base that mixes Stokes
    parameters they are all kept. Where peaks are taken off, light scattered once differs with N as well.
    """
    beams = pick_few(mu0, BEAMS)
    directions = np.concatenate([pick_few(mu[mu > 0.0], DIRECTIONS), pick_few(mu[mu < 0.0], DIRECTIONS)])
    depths = pick_few(tau, DEPTHS)
    if scene.keeps_beams:  # which side of an interface they lie on
        places = np.unique(np.linspace(0, tau.size - 1, min(DEPTHS, tau.size)).round().astype(int))
        depths, under = tau[places], None if under is None else under[places]
    base = scene.below
    stokes = ALL if base.mixes_stokes or scene.is_rough else (0, 1) if scene.keeps_beams else (0,)
    light = np.array([[1.0, 0.0, 0.0, 0.0]])
    single = find_brightness(
        scene, discretise_scene(scene, beams, light, directions, depths, FEWEST, under=under), directions, phi, run
    )
    # total reflection turns U to V, which I does not show; what mixes all of them shows it
    circular = stokes == (0, 1) and any(layer.phase_matrix.coefficients[:, 3].any() for layer in scene.layers)
    weights, ahead = weigh_orders(orders), not (phi % 360.0).all()
    once = None if peaks == "none" else ScatteredOnce(scene, beams, directions, depths, orders)

    def solve(nodes: int) -> tuple[Array, Array]:
        whole = discretise_scene(scene, beams, light, directions, depths, nodes, peaks, under)
        problem = replace(whole, stokes=stokes, columns=np.ascontiguousarray(light[:, list(stokes)]))
        thickness = float(problem.thickness[problem.albedo > 0.0].sum())
        carried = orders[orders < problem.terms.max()]
        name = "doubling" if thickness < THIN else "modes"
        result = solve_checked(name, problem, base, carried, run)
        radiance = np.zeros((orders.size, depths.size, beams.size, directions.size))
        radiance[: carried.size] = result.kernels[:, :, :, 0, :, 0]
        brightest = np.maximum(single, np.abs(radiance[0]).max(axis=2, initial=0.0))
        if once is not None:
            radiance += once.light(whole)
        if ahead:  # at azimuth 0 the orders simply add up
            brightest = np.maximum(brightest, np.tensordot(weights, radiance, axes=1).max(axis=2, initial=0.0))
        flux = np.zeros((orders.size, depths.size, beams.size, 2))
        peaks_up, peaks_down = find_peak_flux(problem, depths)
        flux[0] = np.concatenate([result.flux_up + peaks_up, result.flux_down + peaks_down], axis=2) / np.pi
        size = brightest[..., None]
        size = np.where(size > 0.0, size, np.abs(flux[0]).max(axis=2, keepdims=True))
        found = [radiance, flux]
        if circular:
            turned = replace(whole, stokes=(2, 3), columns=np.array([[0.0, 1.0]]))
            found.append(solve_checked(name, turned, base, carried[:1], run).kernels[:, :, :, 0, :, 1])
            found[-1] = np.concatenate([found[-1], np.zeros((orders.size - 1, *found[-1].shape[1:]))])
        return np.concatenate(found, axis=3), np.maximum(size, NO_LIGHT)

    return solve


def solve_checked(name: str, problem: Problem, base: Boundary, orders: IntArray, run: Run) -> Orders:
    """Some orders by the named route. Raises AccuracyError where it cannot vouch for them."""
    route = make_route(name, problem, base, int(orders[-1]) + 1, FINEST)
    result = route.solve(orders, run)
    for kind, residual in result.residuals.items():
        if not residual.max() <= route.allowed[kind]:
            raise AccuracyError(f"{kind} {residual.max():.2g}")
    return result


@dataclass(frozen=True, eq=False)
class ScatteredOnce:
    """Fourier orders of I scattered once, or by small angles, and the mean of what is reflected once, from cosines mu0
    (n_in,) to mu (n_mu,), signed, at depths tau."""

    scene: Scene
    mu0: Array
    mu: Array
    tau: Array
    orders: IntArray

    @cached_property
    def functions(self) -> Array:
        """P_l^m of the downward cosines that light goes to and comes from, (order, l, n_mu + n_in)."""
        terms = max(layer.phase_matrix.terms for layer in self.scene.layers)
        down = np.concatenate([-self.mu, self.mu0])
        return np.array([_core.generalized_spherical_functions(m, terms, down)[..., 0] for m in self.orders.tolist()])

    @cached_property
    def scattered(self) -> dict[int, Array]:
        """Orders of F11 of each phase matrix by its id, (order, n_in, n_mu)."""
        found = {}
        for layer in self.scene.layers:
            if id(layer.phase_matrix) not in found:
                a1 = layer.phase_matrix.a1
                to, into = np.split(self.functions[:, : a1.size], [self.mu.size], axis=2)
                found[id(layer.phase_matrix)] = np.swapaxes(into * a1[:, None], 1, 2) @ to
        return found

    def light(self, problem: Problem) -> Array:
        """Of a problem, (order, n_tau, n_in, n_mu)."""
        levels = np.arange(self.tau.size, dtype=np.int32)
        light = np.zeros((self.orders.size, levels.size, self.mu0.size, self.mu.size))
        spread = (self.mu < 0.0) & problem.fraction.any()
        for layer, gain, path in zip(
            self.scene.layers, problem.gain, integrate_paths(problem, levels, self.mu), strict=True
        ):
            light += gain / (4.0 * np.pi) * path * self.scattered[id(layer.phase_matrix)][:, None]
        light[..., spread] = 0.0
        out = np.zeros((levels.size, self.mu0.size, self.mu.size, AZIMUTHS.size, 4, 1))
        place, scale = np.zeros(1, np.int32), np.ones(self.mu0.size)
        add_base_reflected(self.scene.below, problem, levels, self.mu, AZIMUTHS, place, scale, 0, scale.size, out)
        light[0] += out[..., 0, 0].mean(axis=3)
        if spread.any():
            self.add_spread(problem, np.flatnonzero(spread), light)
        return light

    def add_spread(self, problem: Problem, down: Any, light: Array) -> None:
        """Adds what the beam, spread by small angles, scatters into the directions ``down``."""
        part = Anisotropic(self.scene, problem)
        for i, mu0 in enumerate(self.mu0.tolist()):
            beams, into = part.beams(mu0), self.functions[..., self.mu.size + i]
            for t in range(self.tau.size):
                for places, tables in part.sources(mu0, beams, t, self.mu[down]):
                    to = self.functions[..., down[places]]
                    light[:, t, i, down[places]] = np.einsum("ml,ol,mlo->mo", into, tables[..., 0], to) / (4.0 * np.pi)


def pick_few(values: Array, count: int) -> Array:
    """Some of the values, the lowest and the highest among them."""
    ordered = np.unique(values)
    places = np.unique(np.linspace(0, ordered.size - 1, min(count, ordered.size)).round().astype(int))
    return np.ascontiguousarray(ordered[places])


def list_notes(scene: Scene, mu0: Array, mu: Array, nodes: int, error: float, accuracy: float) -> Iterator[str]:
    """Why the accuracy cannot be promised."""
    lowest = min(float(mu0.min()), float(np.abs(mu).min()))
    if lowest < LOWEST:
        yield f"accuracy is promised for |mu| >= {LOWEST:g} and mu0 >= {LOWEST:g}, not for {lowest:.2g}"
    if error > AIM * accuracy:
        terms = max(layer.phase_matrix.terms for layer in scene.layers)
        cut = (
            f" do not carry the {terms} terms of the phase matrix and"
            if terms > count_terms_carried(scene, nodes)
            else ""
        )
        yield f"{nodes} nodes, of at most {MOST},{cut} are right to {error:.1g} only"
