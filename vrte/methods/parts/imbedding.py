"""The matrix Riccati equation of invariant imbedding, in thickness: thin layers added on top.

    dR/dz = b + a R + R a + R b R - R/mu - R/mu'      dT/dz = E (a + b R) + T (a + b R) - T/mu'

with E = exp(-z/mu) of the rows. The decays are taken exactly, what is left is a polynomial through Gauss points of a
step (collocation in exponential form), so that no step is bound by the lowest cosine; it is found by sweeps.
"""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward
from vrte.methods.parts.on_nodes import OnNodes, Scattered

POINTS = 5
MARGIN = 10.0
NO_LIGHT = 1e-290
MOST_SWEEPS = 20
MOST_STEPS = 20_000
LEAST_STEP = 1e-14  # of the layer
SAFETY, GROWTH, SHRINKING = 0.8, 4.0, 0.2


@dataclass(eq=False)
class Count:
    """Steps taken, steps repeated, sweeps in all."""

    steps: int = 0
    repeated: int = 0
    sweeps: int = 0


@dataclass(frozen=True, eq=False)
class State:
    """Reflection and diffuse transmission seen from above in ``both`` (2, r, c), or (1, r, c) without transmission, and
    passed (r,): what is left of light along the rows."""

    both: Array
    passed: Array


def grow(on_nodes: OnNodes, scattered: Scattered, thickness: float, state: State, rtol: float, count: Count) -> State:
    """The state with a layer on top. Raises AccuracyError where steps get too small or too many."""
    done = 0.0
    clear = not (scattered.ahead.any() or scattered.back.any())
    step = thickness if clear else 0.5 * float(min(on_nodes.rows.min(), on_nodes.columns.min()))
    while done < thickness:
        step = min(step, thickness - done)
        found, error = take_step(on_nodes, scattered, step, state, rtol, count)
        if error <= 1.0:
            last = thickness - done <= step
            state = State(found, state.passed * np.exp(-step / on_nodes.rows))
            done = thickness if last else done + step
            count.steps += 1
        else:
            count.repeated += 1
        factor = SAFETY * max(error, 1e-20) ** (-0.5 / POINTS)
        step *= min(GROWTH, max(SHRINKING, factor))
        if step < LEAST_STEP * thickness or count.steps + count.repeated > MOST_STEPS:
            raise AccuracyError(f"invariant imbedding is at its smallest or last step and not at rtol {rtol:g}")
    return state


def take_step(
    on_nodes: OnNodes, scattered: Scattered, step: float, state: State, rtol: float, count: Count
) -> tuple[Array, float]:
    """R and T after a step, and the estimated error over what is allowed; infinite where sweeps do not settle."""
    ways, fades = compute_step_weights(on_nodes, step, len(state.both))
    at_points = np.exp(-step * find_gauss_depths(POINTS)[:, None] / on_nodes.rows) * state.passed
    start = state.both[:, None] * fades  # (R or T, POINTS + 1, r, c)
    allowed = np.maximum(rtol * np.abs(state.both).max(axis=(1, 2)), NO_LIGHT)  # (R or T,)
    now = np.repeat(state.both[:, None], POINTS, axis=1)
    change = np.inf
    for _ in range(MOST_SWEEPS):
        count.sweeps += 1
        sources = compute_growth(scattered, now, at_points, on_nodes.n)
        found = start[:, :-1] + np.einsum("tkjrc,tjrc->tkrc", ways[:, :-1], sources)
        before, change = change, float(np.abs(found - now).max())
        now = found
        allowed = np.maximum(allowed, rtol * np.abs(now).max(axis=(1, 2, 3)))
        if change <= 0.01 * allowed.min() or change >= 2.0 * before:
            break
    sources = compute_growth(scattered, now, at_points, on_nodes.n)
    end = start[:, -1] + np.einsum("tjrc,tjrc->trc", ways[:, -1], sources)
    if change > 0.01 * allowed.min():
        return end, np.inf
    # Gauss points integrate twice as many powers as they resolve: the error is about the square of what the highest
    # resolved one adds
    last = np.einsum("tjrc,jk,tkrc->trc", ways[:, -1], project_highest_degree(POINTS), sources)
    relative = rtol * np.abs(last).max(axis=(1, 2)) / allowed
    return end, float(MARGIN / rtol * relative.max() ** 2)


def compute_growth(scattered: Scattered, both: Array, passed: Array, n: int) -> Array:
    """What makes R and T grow besides their own decay, (R or T, POINTS, r, c)."""
    ahead, back = scattered
    R = both[0]
    down = ahead[:n] + back[:n, :n] @ R[:, :n]
    result = np.empty_like(both)
    result[0] = back + ahead[:, :n] @ R[:, :n] + R[..., :n] @ down
    if len(both) > 1:
        result[1] = passed[..., None] * (ahead + back[:, :n] @ R[:, :n]) + both[1][..., :n] @ down
    return result


def compute_step_weights(on_nodes: OnNodes, step: float, parts: int) -> tuple[Array, Array]:
    """Weights of the sources (R or T, POINTS + 1, POINTS, r, c), and what is left of the state (R or T, POINTS + 1, r,
    c), at the Gauss points of the step and its end."""
    cosines, at = np.unique(np.concatenate([on_nodes.rows, on_nodes.columns]), return_inverse=True)
    rows, columns = at[: on_nodes.rows.size], at[on_nodes.rows.size :]
    once = step / cosines
    rates = np.stack([once[:, None] + once, np.broadcast_to(once, (once.size, once.size))][:parts])
    weights = step * np.moveaxis(weigh_downward(rates, POINTS), 2, 0)
    x = np.append(find_gauss_depths(POINTS), 1.0)[:, None, None]
    fades = np.exp(-x * rates[:, None])
    return weights[..., rows[:, None], columns], fades[..., rows[:, None], columns]


def project_highest_degree(points: int) -> Array:
    """The part of values at the Gauss points that only a polynomial of the highest degree has, (points, points)."""
    x, weights = np.polynomial.legendre.leggauss(points)
    legendre = np.polynomial.legendre.legvander(x, points - 1)[:, -1]
    found: Array = np.outer(legendre, legendre * weights) * (points - 0.5)
    return found
