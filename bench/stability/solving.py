"""All calls of the solver that the stability table makes: one place to say how it is run."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.cases import make_scene
from bench.stability.cases import Case
from vrte.basics.arrays import Array
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyError
from vrte.basics.running import run_interruptible, start_run
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.discrete_ordinates.execution.engines.cpu import solve_orders
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.routes import OTHER
from vrte.discrete_ordinates.planning.choice import choose_algorithms
from vrte.request.how import FINEST
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.scene.scene import Scene

LOBE_ORDERS = 136  # beyond, the lobe's orders are below 1e-17 of the first
WHOLE_UP_TO = 4.0  # seconds that all Fourier orders may be expected to take
SECOND_DIRECTION = 0.35  # incident beside the sun, for reciprocity
EVERYTHING: dict[str, Any] = {"accuracy": FINEST, "truncation": "none"}
FEW = 3  # orders 0, 1, 2 where not all can be had


@dataclass(frozen=True)
class Options:
    """How the scenes are solved: "auto", "modes" or "doubling", on how many threads (None: all)."""

    algorithm: str = "auto"
    threads: int | None = None


def is_whole(case: Case) -> bool:
    """Whether all Fourier orders are solved, from a rough estimate of the time they take on two cores; under surfaces
    they always are.

    >>> from bench.cases import Slab
    >>> is_whole(Case("small", 8, (Slab("rayleigh", 1.0, 1.0),)))
    True
    """
    return bool(case.media) or estimate_seconds(case, min(case.terms, 2 * case.nodes)) <= WHOLE_UP_TO


def estimate_seconds(case: Case, orders: int) -> float:
    """Roughly, on two cores."""
    return 1e-9 * orders * len(case.slabs) * (4 * case.nodes) ** 3


def make_azimuths(case: Case) -> Array:
    """Equal steps [degrees], a multiple of 8, so many that none of ``case.orders`` is mistaken for another: (phi,)."""
    highest = max(case.terms, LOBE_ORDERS if case.base_kind == "lobe" else 0)
    steps = 8 * -(-(highest + max(case.orders) + 2) // 8)
    return np.arange(steps, dtype=np.float64) * (360.0 / steps)


def choose_few_azimuths(phi: Array) -> Array:
    """Places of 0, 45, 180 and 315 degrees among the equal steps."""
    return np.array([0, 1, 4, 7]) * (phi.size // 8)


def solve_field(case: Case, scene: Scene, phi: Array, algorithm: str, threads: int | None) -> Field:
    """What the case asks of a scene, at the given azimuths; where light is refracted at depths twice: on the upper side
    of interfaces, then on the lower."""
    asked: dict[str, Any] = {"mu0": case.mu0, "stokes": case.beam, "mu": case.mu, "phi": phi, "tau": case.tau}
    asked |= EVERYTHING | {"nodes": case.nodes, "algorithm": algorithm, "threads": threads}
    if not scene.has_interfaces:
        return radiance(scene, **asked)
    fields = [radiance(scene, side=side, **asked) for side in ("above", "below")]
    names = ("stokes", "flux_up", "flux_down", "direct", "direct_up", "index", "tau")
    joined: dict[str, Any] = {name: np.concatenate([getattr(field, name) for field in fields]) for name in names}
    return replace(fields[0], **joined)


def solve_brdf(case: Case, options: Options, phi: Array, illuminate: str = "top") -> Brdf:
    """The BRDF and, of a finite scene, BTDF for the sun's direction and the second one, out to all of the case's."""
    directions: dict[str, Any] = {"mu_i": [case.mu0, SECOND_DIRECTION], "mu_o": case.mu[case.mu > 0.0], "phi": phi}
    directions |= {"transmission": math.isfinite(case.thickness)}
    how: dict[str, Any] = {"algorithm": options.algorithm, "threads": options.threads, "illuminate": illuminate}
    return brdf(case.scene, **directions, **EVERYTHING, nodes=case.nodes, **how)


@dataclass(frozen=True, eq=False)
class FewOrders:
    """The lowest Fourier orders of multiply scattered light, the fluxes, and the algorithm they are from.

    kernels (order, n_tau, 2, 4, n_mu, 4): radiance for a unit beam along each of the two incident directions, for
    each of the four Stokes parameters; flux_up, flux_down (n_tau, 2, 4).
    """

    kernels: Array
    flux_up: Array
    flux_down: Array
    algorithm: str


def solve_few_orders(case: Case, scene: Scene, algorithm: str, threads: int | None) -> FewOrders:
    """Orders 0, 1 and 2 alone, by the solver's own stages."""
    mu = np.concatenate([case.mu[case.mu > 0.0], case.mu[case.mu < 0.0]])
    run = start_run(threads)

    def work() -> FewOrders:
        with keep_to_one_thread():
            problem = discretise_scene(
                scene, np.array([case.mu0, SECOND_DIRECTION]), np.eye(4), mu, case.tau, case.nodes
            )
            orders = np.arange(min(FEW, int(problem.terms.max())), dtype=np.int32)
            name = choose_algorithms(algorithm, problem, np.ones(1), FINEST)[0][1].name
            for each in (name, OTHER[name]):
                _, found, doubts = solve_orders(problem, scene.below, orders, each, run, FINEST)
                if found is not None and not doubts:
                    break
            else:
                raise AccuracyError(f"neither algorithm can vouch for Fourier order {min(doubts)}")
        return FewOrders(found.kernels, found.flux_up, found.flux_down, each)

    return run_interruptible(run, work)


def cut_layers_otherwise(case: Case) -> Scene:
    """The same scene with its layers cut otherwise: identical neighbours joined, or the described slab in two."""
    if case.layering == "identical-neighbours":
        whole = math.fsum(slab.thickness for slab in case.slabs)
        return make_scene((replace(case.slabs[0], thickness=whole),), case.base, case.media)
    slab = case.slabs[case.main]
    upper = min(slab.thickness / 2.0, 1.0)
    parts = (replace(slab, thickness=upper), replace(slab, thickness=slab.thickness - upper))
    after = case.main + 1
    media = (*case.media[:after], *case.media[after : after + 1], *case.media[after:])  # the described one's twice
    return make_scene((*case.slabs[: case.main], *parts, *case.slabs[after:]), case.base, media)
