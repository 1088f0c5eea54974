"""Successive orders of scattering, (2:21)-(2:27): light scattered s times from light scattered s - 1 times.

Each order is light that was reflected and refracted as often as light is, to and fro along its direction, before it is
scattered or reflected by a base again.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.basics.running import keep_to_one_thread
from vrte.discrete_ordinates.planning.order_bounds import find_order_bounds
from vrte.methods.parts.method import Answer, Fluxes, Settings, Task
from vrte.methods.parts.sections import POINTS, Light, Order, Sections, divide_into_panels, find_panel_scale
from vrte.methods.parts.slab import connect_media, count_sizes
from vrte.request.how import EXACT

LEFT_OUT = 30.0  # what the orders left out add, over their estimate: 13 was seen
BY_ACCURACY = {"tolerance": lambda accuracy: accuracy / LEFT_OUT}


def solve_by_successive_orders(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn, (2:21)-(2:23)."""
    problem, convergence = connect_media(task.request, task.problem), Convergence(task.settings)

    shape = problem.level.size, problem.mu0.size, problem.columns.shape[0]
    fluxes: list[Fluxes] = []

    def solve(m: int) -> Array:
        order = Order(stack, m)
        total, lit = convergence.sum(order)
        if m == 0:
            light = (stack.scale * total.edges)[[3, 0, 1, 2]].transpose(
                1, 0, 3, 2
            )  # rising, arriving, leaving, entering
            up, down = stack.beam_paths.sum_fluxes(light)
            fluxes.append((up.reshape(shape), down.reshape(shape)))
        return np.zeros((*shape, problem.mu_out.size, len(problem.stokes))) if lit is None else order.view(lit)

    with keep_to_one_thread():
        stack = Sections(problem, task.request.scene.below, task.settings["levels"])
        kernels = task.solve_orders(problem, solve)
    more = {"levels": int(stack.panels * POINTS), **convergence.diagnostics}
    for note in () if "orders" in task.request.settings else more["notes"]:  # who says how many knows what they are
        warn_user(note, AccuracyWarning)
    return task.answer_on_nodes(kernels, fluxes[0], **more)


@dataclass(eq=False)
class Convergence:
    """Orders of scattering: most of any Fourier order and of all together; what the last one added, relative to the
    largest light of Fourier order 0, and what those left out would add as a geometric series."""

    settings: Settings
    largest: float = 0.0
    used: int = 1
    total: int = 0
    last: float = 0.0
    remainder: float = 0.0

    def sum(self, order: Order) -> tuple[Light, Light | None]:
        """The sum (2:21) of all orders of scattering, and without the last one, None for none."""
        light = total = order.once
        lit, added = None, [light.largest]
        while True:
            if order.order == 0:
                self.largest = total.largest
            left = estimate_remainder(added) / self.largest if self.largest > 0.0 else 0.0
            if len(added) >= self.settings["orders"] or left <= self.settings["tolerance"]:
                break
            lit = total
            light = order.scatter(light)
            total = total + light
            added.append(light.largest)
        self.used, self.total = max(self.used, len(added)), self.total + len(added)
        self.last = max(self.last, added[-1] / self.largest if self.largest > 0.0 else 0.0)
        self.remainder = max(self.remainder, left)
        return total, lit

    @property
    def diagnostics(self) -> dict[str, Any]:
        """The number of orders, the light they leave out, and a note where that is too much."""
        converged = self.remainder <= self.settings["tolerance"]
        note = (
            f"method 'successive-orders' has not converged: {self.settings['orders']} orders of scattering leave out "
            f"about {self.remainder:.1e} of the light, and energy is not conserved to better than that; ask for more "
            f"by its setting 'orders', or for {EXACT!r}"
        )
        report = {"scattering_orders": self.used, "scatterings": self.total, "last_ratio": self.last}
        report |= {"remainder": self.remainder, "converged": converged, "promised": converged}
        return report | {"notes": [] if converged else [note]}


def estimate_remainder(added: list[float]) -> float:
    """What the orders that follow would add as a geometric series, and no less than what the last one added."""
    before, last = added[-2] if len(added) > 1 else added[-1], added[-1]
    if last == 0.0:
        return 0.0
    return last * max(1.0, last / (before - last)) if last < before else math.inf


def predict_operations(task: Task) -> float:
    """Operations of all orders; their number follows from how much a Fourier order scatters and how much leaves."""
    problem, settings, scale = task.problem, task.settings, find_panel_scale([task.problem])
    n, _, _ = count_sizes(task.request, task.problem)
    panels = sum(divide_into_panels(each, scale, settings["levels"]).size - 1 for each in problem.thickness.tolist())
    levels, depth = panels * POINTS, float(problem.thickness.sum())
    media = task.request.scene.media
    # of what comes to a surface from within, about so much gets out
    kept = 1.0 - min(0.5, math.pi**2 / (3.0 * (depth + 1.42) ** 2)) * (min(media) / max(media)) ** 2
    ratio = np.clip(find_order_bounds(problem, task.run)[0].strength[0] * kept, 1e-6, 1.0 - 1e-9)
    scatterings = np.minimum(settings["orders"], 1.0 + math.log(settings["tolerance"]) / np.log(ratio)).sum()
    a_row = levels * (8.0 * n + 4.0 * (POINTS + 1)) * problem.n_rhs
    return float(scatterings) * (n * a_row * 2.0 + levels / POINTS * cost.OVERHEAD / 30.0)
