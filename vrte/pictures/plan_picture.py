"""A plan: what each Fourier order costs, and which orders are left out."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.discrete_ordinates.planning.plan import Plan
from vrte.pictures.figures import FAINT, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {
    "modes": "#1f4e79",
    "doubling": "#d98200",
    "invariance": "#2a8f5b",
    "fractions": "#8a3f8f",
    "scatterings": "#b5446e",
}


def draw_plan(plan: Plan, width: float = 9.6, height: float = 3.2) -> "Figure":
    """Predicted operations of each Fourier order, by algorithm, and the orders of multiple scattering left out.

    A panel for each part of the plan, where light that comes in polarized has one of its own. Raises MissingExtraError
    without matplotlib.
    """
    parts = plan.parts or (plan,)
    figure = make_figure(width, height * len(parts))
    panels: Any = figure.subplots(len(parts), 1, squeeze=False)
    names = ("unpolarized light", "polarized light") if plan.parts else ("",)
    for panel, part, name in zip(panels[:, 0], parts, names, strict=True):
        draw_orders(panel, part)
        panel.set_title(f"Plan of {plan.request.kind}{': ' * bool(name)}{name}", fontsize=10)
    panels[-1, 0].set_xlabel("Fourier order", fontsize=9)
    figure.subplots_adjust(left=0.09, right=0.98, bottom=0.17 / len(parts), top=1.0 - 0.1 / len(parts), hspace=0.3)
    return figure


def draw_orders(panel: Any, plan: Plan) -> None:
    """A step an order, blocks of the same order on top of each other; what is left out is hatched."""
    edges = np.arange(plan.orders + 1) - 0.5
    costs = sum_operations_by_order(plan.as_dict())
    base = np.zeros(plan.orders)
    for algorithm, values in costs.items():
        heights = np.array([values.get(order, 0.0) for order in range(plan.orders)])
        colour = COLOURS.get(algorithm, "#7a4fa3")
        panel.stairs(base + heights, edges, baseline=base, fill=True, label=algorithm, color=colour)
        base = base + heights
    last = max(int(plan.problem.terms.max()), plan.orders)
    if last > plan.orders:
        label = f"left out of multiple scattering: {last - plan.orders} of {last}"
        panel.axvspan(plan.orders - 0.5, last - 0.5, facecolor="#eeeeee", edgecolor=FAINT, hatch="//", label=label)
    panel.set_xlim(-0.5, last - 0.5)
    panel.set_ylabel("operations", fontsize=9)
    panel.tick_params(labelsize=8)
    panel.xaxis.get_major_locator().set_params(integer=True)
    panel.legend(fontsize=8, frameon=False)


def sum_operations_by_order(facts: Mapping[str, Any]) -> dict[str, dict[int, float]]:
    """Operations by algorithm and order, from `Plan.as_dict`; a block's are shared out evenly over its orders.

    >>> sum_operations_by_order({"blocks": [{"algorithm": "modes", "orders": [0, 1], "operations": 6.0}]})
    {'modes': {0: 3.0, 1: 3.0}}
    """
    found: dict[str, dict[int, float]] = {}
    for block in facts["blocks"]:
        costs = found.setdefault(block["algorithm"], {})
        for order in block["orders"]:
            costs[order] = costs.get(order, 0.0) + block["operations"] / len(block["orders"])
    return found
