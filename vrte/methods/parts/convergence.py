"""A series of orders of scattering: its sum, and when it is long enough."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vrte.methods.parts.method import Settings
from vrte.methods.parts.panels import Light
from vrte.request.how import EXACT


@dataclass(eq=False)
class Convergence:
    """Orders of scattering summed, at most of any Fourier order and of all together; what the last one added, relative
    to the largest light of Fourier order 0, and what those left out would add as a geometric series; whether that is
    little enough."""

    largest: float = 0.0
    used: int = 1
    total: int = 0
    last: float = 0.0
    remainder: float = 0.0
    converged: bool = True

    def remainder_of(self, added: list[float], total: Light, order: int) -> float:
        """What the orders that follow would add, relative to the largest light of Fourier order 0."""
        largest = total.largest if order == 0 else self.largest
        return estimate_remainder(added) / largest if largest > 0.0 else 0.0

    def note(self, added: list[float], total: Light, order: int, tolerance: float) -> None:
        """One Fourier order is done."""
        if order == 0:
            self.largest = total.largest
        remainder = self.remainder_of(added, total, order)
        self.used = max(self.used, len(added))
        self.total += len(added)
        self.last = max(self.last, added[-1] / self.largest if self.largest > 0.0 else 0.0)
        self.remainder = max(self.remainder, remainder)
        self.converged = self.converged and remainder <= tolerance

    def diagnostics(self, settings: Settings) -> dict[str, Any]:
        """In words and numbers."""
        notes = [] if self.converged else [self.told(settings)]
        return {
            "scattering_orders": self.used,
            "scatterings": self.total,
            "last_ratio": self.last,
            "remainder": self.remainder,
            "converged": self.converged,
            "promised": self.converged,
            "notes": notes,
        }

    def told(self, settings: Settings) -> str:
        """What is missing, and what to do about it."""
        return (
            f"method 'successive-orders' has not converged: {settings['orders']} orders of scattering leave out about "
            f"{self.remainder:.1e} of the light, and energy is not conserved to better than that; ask for more by its "
            f"setting 'orders', or for {EXACT!r}"
        )


def estimate_remainder(added: list[float]) -> float:
    """What the orders that follow would add as a geometric series, and no less than what the last one added."""
    before, last = added[-2] if len(added) > 1 else added[-1], added[-1]
    if last == 0.0:
        return 0.0
    return last * max(1.0, last / (before - last)) if last < before else math.inf


def sum_scatterings(
    light: Light, scatter: Callable[[Light], Light], order: int, settings: Settings, convergence: Convergence
) -> tuple[Light, Light | None]:
    """The sum (2:21) of light scattered once and of what ``scatter`` makes of each order in turn, and the same with one
    order fewer, None for none: what the source function of directions off the nodes is made of."""
    lit, total, added = None, light, [light.largest]
    while len(added) < settings["orders"] and convergence.remainder_of(added, total, order) > settings["tolerance"]:
        lit = total
        light = scatter(light)
        total = total + light
        added.append(light.largest)
    convergence.note(added, total, order, settings["tolerance"])
    return total, lit
