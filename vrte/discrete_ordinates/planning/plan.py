"""What a scene and a request need, what is left out, and why, before any heavy work."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray, make_readonly, replace_unchecked
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Run
from vrte.basics.views import view
from vrte.discrete_ordinates.orders.discretise import (
    MOST_SURFACE_ORDERS,
    count_flake_orders,
    count_lobe_orders,
    count_surface_orders,
    discretise_scenes,
    sort_up_first,
)
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.skip_flags import EVERYTHING, SkipFlags
from vrte.discrete_ordinates.orders.truncating import (
    Truncation,
    choose_truncation,
    count_terms_carried,
    find_spread_directions,
    has_unpolarized_peak,
    is_scalar,
    keep_unpolarized_peaks,
)
from vrte.discrete_ordinates.planning.azimuths import Azimuths, fold_azimuths
from vrte.discrete_ordinates.planning.blocks import (
    Block,
    are_solved_at_once,
    is_worth_stages,
    make_blocks,
    make_shared_blocks,
)
from vrte.discrete_ordinates.planning.choose_quadrature import (
    DISCRETE,
    NodeChoice,
    choose_first_nodes,
    find_next_count,
    take_given_nodes,
)
from vrte.discrete_ordinates.planning.facet_bounds import (
    CAREFUL_UNDER_FACETS,
    bound_orders_under_facets,
    couples_orders,
)
from vrte.discrete_ordinates.planning.kept_plans import find_plan, keep_plan, name_request
from vrte.discrete_ordinates.planning.order_bounds import (
    CAREFUL,
    OrderBounds,
    choose_stages,
    count_orders_that_matter,
    find_brightness,
    find_order_bounds,
    list_views,
)
from vrte.discrete_ordinates.planning.plan_table import list_plan_facts, write_plan
from vrte.optics.facet_integrals import FINEST as FINEST_OF_FACETS
from vrte.request.how import EXACT
from vrte.request.request import Request, Wanted
from vrte.scene.beams import find_cosines
from vrte.scene.interface import Interface
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNPOLARIZED, POLARIZED = np.diag([1.0, 0.0, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Differentiated:
    """A derivative that is asked for beside the light: by the number of that name, how it is found, and in about how
    many times the operations of the light."""

    name: str
    how: str
    solves: float


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """What the solver will do, and nothing else, as `vrte.plan` makes it; print it for a table.

    Attributes
    ----------
    request
        What was asked for, checked.
    problem
        The scene on its nodes, truncated.
    truncation
        What becomes of phase matrices with more terms than the nodes carry, and why.
    mu
        The signed cosines, as asked, (n_mu,).
    needs
        How much of each order is needed.
    bounds
        Bounds on each Fourier order, (scene, order, n_tau, 1).
    brightest
        The light they are compared with, (scene, n_tau, n_in); under smooth surfaces both of a unit beam within.
    wanted
        What is to be given back.
    orders
        How many Fourier orders there are at most.
    blocks
        How they are solved, a block of orders that are alike each.
    accuracy
        Of the discrete problem.
    choice
        Of the nodes: how many, and by which rule.
    threads
        On how many threads.
    parts
        Plans of light that comes in unpolarized and polarized, where they are carried out instead.
    derivatives
        What is differentiated beside it, and how.
    others
        The other scenes that are planned together with that of the request.
    fits
        For which of several scenes the plan stands, (scene,): see `make_shared_blocks`.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
    >>> vrte.plan("brdf", haze, mu_i=0.5, mu_o=0.5, nodes=8).orders
    3
    """

    request: Request
    problem: Problem
    truncation: Truncation
    mu: Array
    needs: OrderBounds
    bounds: Array
    brightest: Array
    wanted: Wanted
    orders: int
    blocks: tuple[Block, ...]
    accuracy: float
    choice: NodeChoice
    threads: int = 1
    parts: tuple["Plan", ...] = ()
    derivatives: tuple[Differentiated, ...] = ()
    others: tuple[Scene, ...] = ()
    fits: BoolArray | None = None

    def __str__(self) -> str:
        return write_plan(self)

    def __repr__(self) -> str:
        return f"Plan({self.request.kind}, {self.orders} orders at most, {len(self.blocks)} blocks)"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    def plot(self) -> "Figure":
        """A figure of the operations of each Fourier order, and of the orders left out.

        Returns
        -------
        matplotlib.figure.Figure
            Its ``savefig`` writes it.

        Raises
        ------
        MissingExtraError
            Without the extra "plot".

        Examples
        --------
        >>> import vrte
        >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
        >>> len(vrte.plan("brdf", haze, mu_i=0.5, mu_o=0.5, nodes=8).plot().axes) > 0
        True
        """
        return view(self, "plot")

    def as_dict(self) -> dict[str, Any]:
        """The printed table as numbers and strings, for programs.

        Returns
        -------
        dict
            Blocks, what is left out and shared, operations, bytes, by name.

        Examples
        --------
        >>> import vrte
        >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
        >>> vrte.plan("brdf", haze, mu_i=0.5, mu_o=0.5, nodes=8).as_dict()["nodes"]
        8
        """
        return list_plan_facts(self)

    @cached_property
    def azimuths(self) -> Azimuths:
        """Those asked for, folded."""
        return fold_azimuths(self.request.phi, self.problem.skip_flags.azimuths)

    @cached_property
    def spreads(self) -> BoolArray:
        """Towards which directions ``mu`` light of the forward peak stands for single scattering, (n_mu,)."""
        return find_spread_directions(self.truncation, self.problem, self.mu)

    @property
    def notes(self) -> tuple[str, ...]:
        """What cannot be promised of the accuracy, a sentence each."""
        scene, notes = self.request.scene, list(self.choice.notes)
        if scene.is_rough and self.request.accuracy < FINEST_OF_FACETS:
            notes.append(
                f"light of rough interfaces is right to {FINEST_OF_FACETS:g} of the largest I, no finer accuracy"
            )
        if scene.has_flakes:
            orders = count_flake_orders(scene, self.problem.mu0, self.problem.mu_out, self.request.tau, self.accuracy)
            if orders > MOST_SURFACE_ORDERS:
                words = f"lobes of flakes near the horizon have {orders} Fourier orders of light scattered twice"
                notes.append(f"{words}, of which {MOST_SURFACE_ORDERS} are solved for")
        if 0 < count_surface_orders(scene, self.problem.nodes.size) < (orders := count_lobe_orders(scene)):
            words = f"lobes of facets as smooth as these have {orders} Fourier orders between surfaces"
            notes.append(f"{words}, of which {MOST_SURFACE_ORDERS} are solved for")
        return tuple(notes)

    @property
    def base_couples_orders(self) -> bool:
        """Whether the base, or a rough surface, sends back orders or Stokes parameters that no layer scatters."""
        return couples_orders(self.problem, self.request.scene.below)

    @property
    def counts_again(self) -> bool:
        """Whether the orders are counted once more with the light that the first of them found."""
        skips = self.problem.skip_flags.orders and not self.base_couples_orders
        return skips and is_worth_stages(self.problem, self.orders)

    @cached_property
    def is_solved_at_once(self) -> bool:
        """Whether no block comes after such a count."""
        return not self.counts_again or are_solved_at_once([each.orders for each in self.blocks])

    @property
    def scenes(self) -> tuple[Scene, ...]:
        """All scenes that are planned together."""
        return self.request.scene, *self.others

    def diagnostics(self) -> dict[str, Any]:
        """What a result says of how it was made.

        Returns
        -------
        dict
            Method, backend, algorithm, accuracy, nodes, truncation and base, by name.

        Examples
        --------
        >>> import vrte
        >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
        >>> vrte.plan("brdf", haze, mu_i=0.5, mu_o=0.5, nodes=8).diagnostics()["base"]
        'black'
        """
        longest = max(layer.phase_matrix.terms for layer in self.request.scene.layers)
        nodes = self.problem.nodes.size
        names = {block.choice.name: block.choice.reason for block in self.blocks}
        ruled = {"method_rule": self.request.method_rule} if self.request.method_rule else {}
        return {
            "method": EXACT,
            **ruled,
            "backend": self.request.backend.label,
            "algorithm": " and ".join(sorted(names)),
            "algorithm_rule": "; ".join(dict.fromkeys(names.values())),
            "accuracy": self.request.accuracy,
            "nodes": nodes,
            "grading": self.choice.grading,
            "nodes_rule": self.choice.rule,
            "achieved": None,
            "promised": not self.notes,
            "notes": list(self.notes),
            "orders_of_phase_matrix": longest,
            "terms_cut": max(0, longest - count_terms_carried(self.request.scene, nodes)),
            "truncation": self.truncation.name,
            "truncation_rule": self.truncation.reason,
            "peak_fractions": self.problem.fraction.tolist(),
            "base": describe_base(self.request.scene),
            **self.request.scene.below.diagnostics,
            **describe_interfaces(self.request.scene, self.request.mu0),
        }


def describe_base(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    if scene.base is None or scene.base_is_reached:
        return scene.below.name
    return f"{scene.base.name}, not reached below an infinite layer"


@lru_cache(maxsize=64)
def sum_shares(interface: Interface, cosines: bytes) -> Array:
    """R + T of a rough interface along cosines as they lie in memory, (n,): some solves of few nodes take no longer."""
    return make_readonly(np.sum(interface.share(np.frombuffer(cosines)), axis=0))


def describe_interfaces(scene: Scene, mu0: Array) -> dict[str, Any]:
    """What refracts, from the top, and what facets of rough ones make of the beams that reach them: by the interface's
    number, the share R + T (n_in,) that they send on, 1 but for what they lose, or without shadows gain, between them;
    nothing where nothing refracts."""
    there = [(k, interface) for k, interface in enumerate(scene.interfaces) if interface is not None]
    if not there:
        return {}
    cosines = find_cosines(scene.media, scene.index_above, mu0)
    found: dict[str, Any] = {"interfaces": [interface.in_words for _, interface in there]}
    shares = {}
    for number, (k, interface) in enumerate(there, 1):
        lit = cosines[k] > 0.0
        if not interface.is_smooth and lit.any():
            sent = np.full(mu0.size, np.nan)
            sent[lit] = sum_shares(interface, cosines[k][lit].tobytes())
            shares[str(number)] = [None if np.isnan(part) else round(float(part), 6) for part in sent]
    return found | ({"facets_send_on": shares} if shares else {})


def plan_request(request: Request, run: Run) -> Plan:
    """The plan of a request, with those of its parts where polarized incident light wants another truncation."""
    name = name_request(request, run)
    known = find_plan(name, run)
    if known is not None:
        return known
    whole = split_by_polarization(make_plan(request, run), run)
    if not whole.parts:
        keep_plan(name, whole)
    return whole


def split_by_polarization(plan: Plan, run: Run) -> Plan:
    """The plan with those of its parts, where the rule of `choose_truncation` has two answers: for light that arrives
    unpolarized, and for Q, U, V, unless these are scattered nowhere."""
    request, truncation = plan.request, plan.truncation
    columns, scene = request.columns, request.scene
    both = columns[:, 0].any() and columns[:, 1:].any() and (truncation.whole or not is_scalar(scene))
    if not both or truncation.peaks != "all" or not has_unpolarized_peak(scene, plan.choice.nodes):
        return plan
    known = plan.problem.skip_flags, (plan.choice, plan.accuracy)
    pairs = (UNPOLARIZED, truncation), (POLARIZED, keep_unpolarized_peaks(truncation))
    parts = (make_plan(select_incident_part(request, part), run, *known, own) for part, own in pairs)
    return replace_unchecked(plan, parts=tuple(parts))


def select_incident_part(request: Request, part: Array) -> Request:
    """The request for a part (4, 4) of the incident Stokes vectors."""
    columns = request.columns @ part
    kept = columns.any(axis=1)
    wanted = request.wanted
    if wanted is not None:
        wanted = replace(wanted, place=wanted.place[kept])
    return replace(request, columns=columns[kept], wanted=wanted)


def make_plan(
    request: Request,
    run: Run,
    skip_flags: SkipFlags = EVERYTHING,
    known: tuple[NodeChoice, float] | None = None,
    truncation: Truncation | None = None,
    others: Sequence[Scene] = (),
) -> Plan:
    """The plan of a request; ``skip_flags``: all that can be, but in tests; ``known``: the choice of nodes and the
    accuracy of another plan, where they are to be the same, as ``truncation`` may be; ``others``: scenes with the same
    `BatchKey` as the request's, each planned as it would be by itself, by the same rules."""
    if not skip_flags.columns:
        request = split_incident_light(request)
    choice, accuracy = known or converge_on_nodes(request)
    nodes, grading = choice.nodes, choice.grading
    scene, scenes, mu = request.scene, (request.scene, *others), request.mu
    if mu is None:
        points = make_double_gauss(nodes, grading)[0]
        mu = np.concatenate([points, -points])
    rank = sort_up_first(mu.tobytes())[0]
    asked = request.mu0, request.columns, mu, request.tau, nodes, accuracy
    truncations = [truncation or choose_truncation(request.truncation, each, *asked) for each in scenes]
    into = request.mu0, request.columns, mu[rank], stack_depths(request, scenes), nodes
    peaks = [one.peaks for one in truncations]
    problem = discretise_scenes(scenes, *into, peaks, request.under, grading, truncations[0].whole, accuracy)
    if skip_flags != EVERYTHING:
        problem = replace_unchecked(problem, skip_flags=skip_flags)
    uneven = couples_orders(problem, scene.below)
    is_first_alone = request.fluxes_only and skip_flags.fluxes and not uneven
    needs, bounds, brightest = look_at_orders(scenes, problem, mu[: 0 if is_first_alone else None], request, run)
    careful: tuple[float, ...] = CAREFUL
    if scene.is_rough and not uneven and not request.fluxes_only:
        careful = CAREFUL_UNDER_FACETS
        bounds, brightest = bound_orders_under_facets(problem, needs.strength[0])
    counts = np.full(len(scenes), problem.coefficients.shape[1], np.int32)
    stages: tuple[int, ...] = ()
    if is_first_alone:
        counts[:] = 1
    elif skip_flags.orders and not uneven:
        counts = count_orders_that_matter(bounds, brightest, accuracy)
        if not others and is_worth_stages(problem, int(counts[0])):
            stages = choose_stages(bounds, brightest, accuracy, careful)
    asked_of = needs, accuracy, request.algorithm
    if others:
        blocks, fits = make_shared_blocks(problem, [each.below for each in scenes], counts, *asked_of)
        fits &= np.array([one.spread != "all" for one in truncations])
    else:
        eigensolver = request.backend.linear_algebra == "lapack"
        blocks, fits = make_blocks(problem, scene.below, int(counts[0]), stages, *asked_of, eigensolver), None
    wanted = request.wanted or want_everything(request, mu)
    found = needs, bounds, brightest, wanted, int(counts.max()), tuple(blocks), accuracy, choice, run.threads
    return Plan(request, problem, truncations[0], mu, *found, others=tuple(others), fits=fits)


def stack_depths(request: Request, scenes: Sequence[Scene]) -> Array:
    """The depths asked for, (scene, n_tau): of several scenes the top and, with transmission, the bottom of each."""
    if len(scenes) == 1:
        return request.tau[None]
    return np.array([[0.0, scene.thickness][: request.tau.size] for scene in scenes])


def look_at_orders(
    scenes: Sequence[Scene], problem: Problem, mu: Array, request: Request, run: Run
) -> tuple[OrderBounds, Array, Array]:
    """What multiple scattering of each order can do, in all and at each depth, (scene, order, n_tau, 1), whichever
    medium it is scattered in, and the light there, (scene, n_tau, n_in); along the directions ``mu``, 0 without any."""
    brightest = np.zeros((problem.scenes, problem.level_layer.size, problem.mu0.size))
    if problem.media is None:
        if mu.size:
            brightest = find_brightness(scenes, problem, mu, request.phi, run)
        return *find_order_bounds(problem, run, problem.depth), brightest
    views = list_views(problem, mu)
    out, into = (np.concatenate(parts) for parts in zip(*((one.mu_out, one.mu0) for one, _, _ in views), strict=True))
    straight = replace_unchecked(problem, mu_out=out, mu0=into)
    needs, bounds = find_order_bounds(straight, run, 0.0 * problem.level)  # mirrored light does not decay with depth
    for inside, seen, levels in views if mu.size else ():  # the densest medium last: its light stays
        brightest[:, levels] = find_brightness(scenes, inside, seen, request.phi, run)[:, levels]
    return needs, bounds, brightest


def converge_on_nodes(request: Request) -> tuple[NodeChoice, float]:
    """The nodes, as given or as a search for them would start, and the accuracy that the discrete problem is solved
    to."""
    if request.nodes is not None:
        fraction = DISCRETE if request.refined else 1.0
        return take_given_nodes(request, request.nodes), fraction * request.accuracy
    first = choose_first_nodes(request)
    nodes = find_next_count(request.scene, first.nodes) or first.nodes
    rule = f"estimate {nodes}, which the solve compares with {first.nodes}"
    return replace(first, nodes=nodes, rule=rule), DISCRETE * request.accuracy


def want_everything(request: Request, mu: Array) -> Wanted:
    """All depths and directions ``mu`` of every beam, its columns added up; none where fluxes alone are asked for."""
    n_tau, n_mu, n_col = request.tau.size, 0 if request.fluxes_only else mu.size, request.columns.shape[0]
    part = np.arange(n_tau, dtype=np.int32), np.arange(n_mu, dtype=np.int32)
    return Wanted([part], np.zeros(n_col, np.int32), np.ones(request.mu0.size))


def split_incident_light(request: Request) -> Request:
    """The request with its incident light in (I, Q) and in (U, V), one of which may be dark."""
    if request.columns.shape[0] != 1:
        return request
    total = request.columns[0]
    return replace(request, columns=np.array([total * [1, 1, 0, 0], total * [0, 0, 1, 1]]))
