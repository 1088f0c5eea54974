"""What a method takes: a row of methods.toml; a request as a method gets it, and the result made of what it finds."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from vrte.basics.arrays import Array, BoolArray, check_choice, check_number, check_whole, record
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Target, fill_parts
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.discrete_ordinates.planning.choose_quadrature import DISCRETE, take_given_nodes
from vrte.discrete_ordinates.planning.plan import want_everything
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.result import Solution

NODES = 16  # of a hemisphere, where neither nodes nor an accuracy are asked for
Taken = Literal["none", "even", "any"]  # boundaries below
REFLECTED: Mapping[Taken, float] = {"none": 0, "even": 1, "any": math.inf}  # Fourier orders that they send back
Settings = Mapping[str, Any]
Fluxes = tuple[Array, Array]  # diffuse, up and down, (n_tau, n_in, n_col)
Answer = tuple[Array, Solution]  # the signed cosines of the result, and the result


def find_cosines(request: Request) -> Array:
    """The signed cosines of the result: those asked for, or the nodes."""
    if request.mu is not None:
        return request.mu
    points = make_double_gauss(request.nodes or NODES)[0]
    return np.concatenate([points, -points])


def discretise_request(request: Request, nodes: int | None = None, peaks: Any = "none") -> Problem:
    """The scene on nodes, phase matrices cut to the terms that they carry; light going up comes first."""
    mu = find_cosines(request)
    rank = np.argsort(mu < 0.0, kind="stable")
    return discretise_scene(
        request.scene,
        request.mu0,
        request.columns,
        mu[rank],
        request.tau,
        nodes or request.nodes or NODES,
        peaks,
        under=request.under,
    )


@record
class Task:
    """A request, with all settings of its method, and what it runs on."""

    request: Request
    settings: Settings
    run: Run
    progress: Progress | None = None
    begin: float = field(default_factory=time.perf_counter)

    @cached_property
    def mu(self) -> Array:
        """The signed cosines of the result, (n_mu,)."""
        return find_cosines(self.request)

    @cached_property
    def problem(self) -> Problem:
        """The scene on the request's nodes."""
        return discretise_request(self.request)

    @property
    def seconds(self) -> float:
        """Wall-clock seconds since the task began."""
        return time.perf_counter() - self.begin

    def target_of(self, problem: Problem, spread: bool | BoolArray = False) -> Target:
        """What light is added up into."""
        wanted, spreads = self.request.wanted or want_everything(self.request, self.mu), np.asarray(spread)
        spreads = np.broadcast_to(spreads, self.mu.shape)
        return Target(wanted, [self.request.scene], problem, self.mu, fold_azimuths(self.request.phi), spreads)

    def report(self, done: int, total: int) -> None:
        """Reports how many steps are done. Raises KeyboardInterrupt once the user has stopped the solve."""
        if self.run.stop[0]:
            raise KeyboardInterrupt
        if self.progress is not None:
            self.progress(done, total)

    def solve_orders(self, problem: Problem, solve: Callable[[int], Array]) -> Array:
        """Light of each Fourier order that ``solve`` finds, (order, n_tau, n_in, n_col, n_out, 4), in turn."""
        count, shape = problem.coefficients.shape[1], (problem.level.size, problem.mu0.size, problem.columns.shape[0])
        kernels = np.zeros((count, *shape, problem.mu_out.size, len(ALL)))
        for order in range(count):
            kernels[order][..., list(problem.stokes)] = solve(order)
            self.report(order + 1, count)
        return kernels

    def sum_orders(
        self, problem: Problem, kernels: Array | None = None, spread: bool | BoolArray = False
    ) -> list[Array]:
        """The radiance of every wanted part: Fourier orders of kernels (order, n_tau, n_in, n_col, n_out, 4), single
        scattering, beams off the base; ``spread`` (n_mu,): where small angles stand for single scattering."""
        lights = []
        if kernels is not None:
            orders, columns = (np.arange(kernels.shape[axis], dtype=np.int32) for axis in (0, 3))
            lights = [Light(orders, np.array(ALL, np.int32), columns, kernels)]
        return fill_parts(self.target_of(problem, spread), lights, PROCESSOR, self.run)

    def answer(self, parts: list[Array], fluxes: Fluxes, problem: Problem, **diagnostics: Any) -> Answer:
        """The result: radiance of every part wanted, diffuse fluxes, and ``diagnostics`` of how they were made."""
        diagnostics = {
            "method": self.request.method,
            "nodes": int(problem.nodes.size),
            "terms_cut": problem.terms_cut,
            "threads": self.run.threads,
            **diagnostics,
            "stages": self.run.stages,
            "wall_seconds": self.seconds,
        }
        return self.mu, Solution(parts, *fluxes, diagnostics)

    def answer_on_nodes(self, kernels: Array, fluxes: Fluxes, **facts: Any) -> Answer:
        """The result of what solves the discrete problem order by order, and why no accuracy can be promised."""
        choice = take_given_nodes(self.request, self.problem.nodes.size)
        if "accuracy" in self.request.given:
            promise = {"accuracy": self.request.accuracy, "nodes_rule": choice.rule, "promised": True}
            facts = promise | {"notes": []} | facts
        if choice.notes:
            facts |= {"promised": False, "notes": [*facts.get("notes", ()), *choice.notes]}
        return self.answer(self.sum_orders(self.problem, kernels), fluxes, self.problem, orders=len(kernels), **facts)


@dataclass(frozen=True)
class Setting:
    """A knob: default, limits (whole where they are) or choices, meaning, and default ``for_accuracy``."""

    name: str
    meaning: str
    default: Any = None
    least: float = -math.inf
    most: float = math.inf
    choices: Sequence[str] = ()
    for_accuracy: Callable[[float], Any] | None = None

    def checked(self, value: Any) -> Any:
        """A value as the method takes it, None where that is the default. Raises SceneError."""
        if self.choices:
            return check_choice(self.name, value, tuple(self.choices))
        if value is None and self.default is None:
            return None
        if isinstance(self.least, int):
            return check_whole(self.name, value, self.least, int(self.most))
        return check_number(self.name, value, self.least, self.most, f"between {self.least:g} and {self.most:g}")


@dataclass(frozen=True)
class Method:
    """A method: what it takes, words and source for the table of methods, whether it conserves energy to rounding;
    ``finest`` of its accuracies, ``operations`` of a task (factor 3; None: seconds at most)."""

    name: str
    solve: Callable[[Task], Answer]
    purpose: str
    conserves: str
    source: str
    conserves_energy: bool = False
    polarization: bool = True
    base: Taken = "any"
    depths: bool = True
    semi_infinite: bool = True
    interfaces: Literal["none", "smooth", "any"] = "none"
    flakes: bool = False
    devices: bool = False
    options: Sequence[str] = ("nodes", "backend")
    finest: float = 0.0
    operations: Callable[[Task], float] | None = None
    settings: Mapping[str, Setting] = field(default_factory=dict)

    def checked(self, request: Request) -> Settings:
        """The settings, all of them. Raises SceneError where the method does not take the request."""
        for obstacle in self.obstacles(request):
            instead = "" if self.name == EXACT else f": ask for {EXACT!r}"
            raise SceneError(f"method {self.name!r} takes no {obstacle}{instead}", "method")
        unused = ", ".join(sorted(request.given - {*self.options}))
        if unused:
            raise SceneError(f"method {self.name!r} takes no {unused}: {self.instead()}", "method")
        if "accuracy" in request.given and request.accuracy < self.finest:
            kept = f"keeps an accuracy of {self.finest:g} at best, not of {request.accuracy:g}"
            raise SceneError(f"method {self.name!r} {kept}: ask for {EXACT!r}", "accuracy")
        if request.backend.needs_device and not self.devices:
            raise SceneError(
                f"method {self.name!r} takes no backend {request.backend.label!r}: it is at home on the processor, "
                "backend 'openmp' or 'sequential'",
                "method",
            )
        unknown = [name for name in request.settings if name not in self.settings]
        if unknown:
            known = ", ".join(map(repr, self.settings)) or "none"
            raise SceneError(f"method {self.name!r} has no setting {unknown[0]!r}: there are {known}", "method")
        accuracy = request.accuracy * (DISCRETE if request.nodes is None else 1.0)
        found = {}
        for name, setting in self.settings.items():
            by_accuracy = setting.for_accuracy if "accuracy" in request.given else None
            found[name] = by_accuracy(accuracy) if by_accuracy else setting.default
        for name, value in request.settings.items():
            try:
                found[name] = self.settings[name].checked(value)
            except SceneError as error:
                raise SceneError(str(error), "settings", name) from error
        return found

    def instead(self) -> str:
        """What it goes by in place of the options that it does not take."""
        ways = [" and ".join(name for name in ("nodes", "accuracy", "truncation") if name in self.options)]
        ways.append(f"its settings {', '.join(self.settings)}" if self.settings else "")
        return f"it goes by {', and '.join(filter(None, ways))}; leave that out, or ask for {EXACT!r} or 'auto'"

    def obstacles(self, request: Request) -> list[str]:
        """What the request has and the method does not take, in words."""
        scene, tau = request.scene, request.tau
        has_surfaces = scene.has_interfaces or scene.below.keeps_beams
        polarizes = any(not layer.phase_matrix.is_scalar for layer in scene.layers)
        found = [
            (not self.polarization and polarizes, "phase matrix that polarizes"),
            (
                scene.below.orders_reflected > REFLECTED[self.base],
                "base but a Lambertian one" if self.base == "even" else "base",
            ),
            (not self.depths and bool(((tau > 0.0) & (tau < scene.thickness)).any()), "depth inside a layer"),
            (not self.flakes and scene.has_flakes, "oriented flakes"),
            (self.interfaces == "none" and has_surfaces, "refracting or mirroring surface"),
            (self.interfaces == "smooth" and scene.is_rough, "rough interface"),
            (not self.semi_infinite and not np.isfinite(scene.thickness), "semi-infinite layer"),
        ]
        return [words for is_there, words in found if is_there]
