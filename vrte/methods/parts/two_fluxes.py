"""Two fluxes in closed form: what the two-stream and the diffusion method have in common.

Light going down and up is x(t) and y(t), t from the top of a layer of thickness h, in

    x' = -G x + H y + q e^(-a t),    -y' = -G y + H x + r e^(-a t),    a = 1/mu0,

with G = (F + E)/2, H = (F - E)/2, k = sqrt(E F), E >= 0 and F > 0. With rho = H/(G + k) the part v = y - rho x fades on
its way up and drives x, which fades on its way down:

    v' = k v - w e^(-a t), w = r + rho q,     x' = -k x + H v + q e^(-a t).

No mode grows and nothing is divided by k or by a - k: what is left are divided differences of exponentials, which no
case makes special, E = 0 (an albedo of 1) as little as k = 1/mu0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.basics.divided_differences import divide_exp_once, divide_exp_twice
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import measure_distance
from vrte.discrete_ordinates.orders.small_angle import Ray
from vrte.discrete_ordinates.orders.truncating import (
    Truncation,
    choose_truncation,
    find_peak_flux,
    find_spread_directions,
)
from vrte.methods.parts.method import Answer
from vrte.methods.parts.task import Task, discretise_request, find_cosines
from vrte.request.how import FINEST
from vrte.request.request import Request

CARRIED = 2  # terms of a phase function


def compute_fading(rate: Any, length: float) -> Any:
    """e^(-rate length), nothing at the end of a layer without end."""
    return np.exp(-rate * length) if np.isfinite(length) else 0.0 * np.asarray(rate)


def integrate_fading(rate: Any, length: float) -> Any:
    """Integral of e^(-rate t) from 0 to length, which is finite or rate > 0."""
    if not np.isfinite(length):
        return 1.0 / rate
    return length * divide_exp_once(np.zeros(1), -np.asarray(rate, float) * length)


def integrate_two_fadings(one: Any, other: Any, length: float) -> Any:
    """Integral of e^(-one (length - t)) e^(-other t)."""
    return length * divide_exp_once(-np.asarray(one, float) * length, -np.asarray(other, float) * length)


def integrate_three_fadings(one: Any, other: Any, third: Any, length: float) -> Any:
    """Integral of e^(-one (length - t)) `joined`(other, third, t); ``one`` is 0 where length is infinite."""
    if not np.isfinite(length):
        return 1.0 / (other * third)
    return length**2 * divide_exp_twice(*(-length * np.asarray(rate, float) for rate in (one, other, third)))


@dataclass(frozen=True, eq=False)
class Slab:
    """One layer: ``thickness`` h, E, F, and the beam's q and r (n_in,) at its top; ``rate`` a (n_in,); what comes in,
    x at the top and v at the base (n_in,)."""

    thickness: float
    E: float
    F: float
    rate: Array
    q: Array
    r: Array
    x_top: Any = 0.0
    v_base: Any = 0.0

    @property
    def k(self) -> float:
        """Decay rate."""
        return float(np.sqrt(self.E * self.F))

    @property
    def G(self) -> float:
        """Loss of each flux."""
        return 0.5 * (self.F + self.E)

    @property
    def H(self) -> float:
        """What the other one gets of it."""
        return 0.5 * (self.F - self.E)

    @property
    def rho(self) -> float:
        """Reflectance of such a layer without end."""
        return self.H / (self.G + self.k)

    @property
    def w(self) -> Array:
        """Source of v."""
        return self.r + self.rho * self.q

    def reflectance_transmittance(self) -> tuple[float, float]:
        """Of the layer, from either side."""
        if not np.isfinite(self.thickness):
            return self.rho, 0.0
        fade = float(np.exp(-self.k * self.thickness))
        phi = float(integrate_fading(2.0 * self.k, self.thickness).item())
        below = 0.5 * (1.0 + fade**2) + self.G * phi
        return self.H * phi / below, fade / below

    def emitted(self) -> tuple[Array, Array]:
        """y at the top and x at the base (n_in,) of the beam alone."""
        k, h, a = self.k, self.thickness, self.rate
        upward = self.w * integrate_fading(a + k, h)
        if not np.isfinite(h):
            return upward, np.zeros_like(a)
        scattered = self.H * self.w * integrate_three_fadings(a, k, a + 2.0 * k, h) + self.q * integrate_two_fadings(
            k, a, h
        )
        x_base = scattered / (1.0 + self.H * self.rho * integrate_fading(2.0 * k, h))
        return upward - self.rho * x_base * compute_fading(k, h), x_base

    def fluxes(self, t: float) -> tuple[Array, Array]:
        """x and y at depth t, (n_in,)."""
        k, left, a = self.k, self.thickness - t, self.rate
        back = compute_fading(k, left) * integrate_fading(2.0 * k, t)
        doubly = (integrate_two_fadings(k, a, t) - compute_fading(a, self.thickness) * back) / (a + k)
        x = (
            self.x_top * np.exp(-k * t)
            + self.H * (self.v_base * back + self.w * doubly)
            + self.q * integrate_two_fadings(k, a, t)
        )
        v = self.v_base * compute_fading(k, left) + self.w * np.exp(-a * t) * integrate_fading(a + k, left)
        return x, v + self.rho * x

    def seen(self, ray: Ray, mu: Array) -> tuple[Array, Array]:
        """Integrals of x and of y times e^(-|t - level|/mu) dt/mu over the ray's part of the layer, (n_in, n_mu), as
        seen from the ray's level; mu (n_mu,) > 0."""
        c, a = 1.0 / mu, self.rate[:, None]
        start, back, beam, driven, returned = (
            self._seen_below(ray.top, c, a) if ray.up else self._seen_above(ray.length, c, a)
        )
        constant = self.w / (a[:, 0] + self.k)
        ahead = self.v_base - constant * compute_fading(self.rate, self.thickness)
        x_top, ahead, constant = (
            np.broadcast_to(each, self.rate.shape)[:, None] for each in (self.x_top, ahead, constant)
        )
        x = x_top * start + self.H * ahead * returned + (self.H * constant + self.q[:, None]) * driven
        v = ahead * back + constant * beam
        way = np.exp(-measure_distance(ray.problem, ray.level, ray.layer) / mu)
        return way * c * x, way * c * (v + self.rho * x)

    def _seen_above(self, t: float, c: Array, a: Array) -> tuple[Any, ...]:
        """What comes to depth t from above: of e^(-k t), e^(-k (h - t)), e^(-a t), and of what the beam and v drive."""
        k, left = self.k, self.thickness - t
        return (
            integrate_two_fadings(c, k, t),
            compute_fading(k, left) * integrate_fading(c + k, t),
            integrate_two_fadings(c, a, t),
            integrate_three_fadings(c, k, a, t),
            compute_fading(k, left) * integrate_three_fadings(c + k, 0.0, 2.0 * k, t),
        )

    def _seen_below(self, t: float, c: Array, a: Array) -> tuple[Any, ...]:
        """What comes to depth t from below: of the same."""
        k, left = self.k, self.thickness - t
        ends = bool(np.isfinite(left))
        reach = integrate_fading(c + k, left)
        returned = compute_fading(k, left) * integrate_fading(2.0 * k, t) * reach
        return (
            np.exp(-k * t) * reach,
            integrate_two_fadings(c, k, left) if ends else 0.0,
            np.exp(-a * t) * integrate_fading(c + a, left),
            integrate_two_fadings(k, a, t) * reach + np.exp(-a * t) * integrate_three_fadings(0.0, c + k, c + a, left),
            returned + integrate_three_fadings(k, c, c + 2.0 * k, left) if ends else 0.0,
        )


@dataclass(frozen=True, eq=False)
class Pile:
    """Layers in place, top first, and x at the base, (n_in,)."""

    slabs: Sequence[Slab]
    x_base: Array


def stack_slabs(slabs: Sequence[Slab], base_albedo: float, direct: Array) -> Pile:
    """The layers over a base that sends ``base_albedo`` (x + direct) back, direct (n_in,): adding, in numbers alone."""
    known = [(*slab.reflectance_transmittance(), *slab.emitted()) for slab in slabs]
    below = [(base_albedo, base_albedo * direct)]  # reflectance and light of all beneath each layer
    for R, T, upward, downward in reversed(known):
        reflectance, light = below[-1]
        between = 1.0 - R * reflectance
        below.append((R + T * reflectance * T / between, upward + T * (light + reflectance * downward) / between))
    placed, x = [], np.zeros_like(direct)
    for slab, (R, T, _, downward), (reflectance, light) in zip(slabs, known, reversed(below[:-1]), strict=True):
        x_below = (T * x + R * light + downward) / (1.0 - R * reflectance)
        v_base = reflectance * x_below + light - slab.rho * x_below
        placed.append(replace(slab, x_top=x, v_base=v_base if np.isfinite(slab.thickness) else np.zeros_like(x)))
        x = x_below
    return Pile(placed, x)


def list_rays(problem: Problem, level: int, up: bool) -> list[Ray]:
    """The parts of layers that light at a level comes through."""
    found = [Ray(problem, level, layer, up) for layer in range(problem.albedo.size)]
    return [ray for ray in found if ray.length > 0.0 and problem.albedo[ray.layer] > 0.0]


def sum_over_rays(problem: Problem, integral: Callable[[Ray, Array], Array]) -> Array:
    """The sum over rays at every depth and direction, (n_tau, n_in, n_out); ``integral``(ray, mu (n_mu,) > 0) gives
    (n_in, n_mu)."""
    total = np.zeros((problem.level.size, problem.mu0.size, problem.mu_out.size))
    for up, part in ((True, slice(0, problem.n_up)), (False, slice(problem.n_up, None))):
        mu = problem.mu_out[part]
        for level in range(problem.level.size if mu.size else 0):
            for ray in list_rays(problem, level, up):
                total[level, :, part] += integral(ray, mu)
    return total


def compute_base_light(problem: Problem, radiance: Array) -> Array:
    """Light of the base, ``radiance`` (n_in,) into every direction up, at every depth: (n_tau, n_in, n_out)."""
    total = np.zeros((problem.level.size, problem.mu0.size, problem.mu_out.size))
    if radiance.any():
        mu, bottom = problem.mu_out[: problem.n_up], problem.albedo.size
        way = np.array([np.exp(-measure_distance(problem, level, bottom) / mu) for level in range(problem.level.size)])
        total[..., : problem.n_up] = radiance[:, None] * way.reshape(problem.level.size, 1, -1)
    return total


def compute_level_fluxes(problem: Problem, pile: Pile) -> tuple[Array, Array]:
    """x and y at every depth, (n_tau, n_in)."""
    places = zip(problem.level_layer.tolist(), problem.level.tolist(), strict=True)
    pairs = [pile.slabs[layer].fluxes(level) for layer, level in places]
    down, up = np.array([x for x, _ in pairs]), np.array([y for _, y in pairs])
    return down, up


def cut_to_two(request: Request) -> Problem:
    """The scene with two terms of each phase function: longer ones are cut or lose their forward peak, as discrete
    ordinates with one node would have it."""
    return discretise_request(request, CARRIED // 2, find_truncation(request, find_cosines(request)).peaks)


def find_truncation(request: Request, mu: Array) -> Truncation:
    """What discrete ordinates with one node would take, light near the beam counting wherever there is any."""
    given = request.scene, request.mu0, request.columns, mu, request.tau
    return choose_truncation(request.truncation, *given, CARRIED // 2, FINEST)


def choose_spread(request: Request, problem: Problem, mu: Array) -> BoolArray:
    """Towards which directions, (n_mu,), the beam spreads by small angles before it scatters once."""
    return find_spread_directions(find_truncation(request, mu), problem, mu)


def list_asymmetries(problem: Problem) -> Array:
    """g of each layer, (layer,), as it was cut."""
    if problem.coefficients.shape[1] < CARRIED:
        return np.zeros(problem.albedo.size)
    found: Array = problem.coefficients[:, 1, 0] / 3.0
    return found


def compute_direct_beam(problem: Problem, base_albedo: float) -> Array:
    """mu0 exp(-thickness/mu0), (n_in,); nothing where no base sends it back."""
    total = problem.above[-1] + problem.thickness[-1]
    return problem.mu0 * np.exp(-total / problem.mu0) if base_albedo > 0.0 else np.zeros_like(problem.mu0)


def find_base_albedo(request: Request) -> float:
    """Of the base, 0 for none and for one that light does not reach."""
    return request.scene.below.even_albedo


def convert_to_kernels(problem: Problem, orders: Sequence[Array]) -> Array:
    """Orders (n_tau, n_in, n_out) of I for unit light as `Task.sum_orders` takes them, (order, n_tau, n_in, n_col,
    n_out, 4)."""
    unit = np.stack(orders)[:, :, :, None, :] * problem.columns[:, 0][:, None]
    kernels = np.zeros((*unit.shape, 4))
    kernels[..., 0] = unit
    return kernels


def answer_two_fluxes(task: Task, problem: Problem, orders: Sequence[Array], fluxes: tuple[Array, Array]) -> Answer:
    """The result of orders (n_tau, n_in, n_out) and fluxes down and up (n_tau, n_in) of the layers as they were cut."""
    request, mu = task.request, task.mu
    parts = task.sum_orders(problem, convert_to_kernels(problem, orders), choose_spread(request, problem, mu))
    down, up = (flux[..., None] * problem.columns[:, 0] for flux in fluxes)
    down = down + find_peak_flux(problem, request.tau)[1]
    return task.answer(parts, (up, down), problem, orders=len(orders), truncation=find_truncation(request, mu).name)
