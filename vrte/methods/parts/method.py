"""What a method says of itself: what it takes, what it can be told, what it is for, how it is carried out."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.discrete_ordinates.planning.choose_quadrature import DISCRETE
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.solution import Solution

if TYPE_CHECKING:
    from vrte.methods.parts.task import Task

Taken = Literal["none", "even", "any"]  # boundaries below
REFLECTED: Mapping[Taken, float] = {"none": 0, "even": 1, "any": math.inf}  # Fourier orders that they send back
Settings = Mapping[str, Any]
Answer = tuple[Array, Solution]  # the signed cosines of the result, and the result


@dataclass(frozen=True)
class Setting:
    """A knob: its default, what makes of a value given a right one or raises SceneError, and what it means;
    ``for_accuracy``: its default where an accuracy of the discrete problem is asked for."""

    default: Any
    checked: Callable[[Any], Any]
    meaning: str
    for_accuracy: Callable[[float], Any] | None = None


@dataclass(frozen=True)
class Method:
    """name; solve, which returns the cosines and the solution; purpose and conserves: words for the table of methods;
    source: paper and equations; conserves_energy: whether fluxes balance to rounding where nothing absorbs, which
    is tested; and what it takes: polarization (phase matrices and light with Q, U, V), layers (more than one), base
    (any, even: one that is Lambertian, none), interfaces (none, smooth, any), depths (other than the faces),
    transmission, endless layers, devices, options (of the call). What takes an "accuracy" solves the discrete
    problem to it, on nodes chosen for it; ``finest``: the finest that it keeps; ``operations``: how many a task
    takes, right to a factor of 3, None where closed forms are a matter of seconds whatever is asked."""

    name: str
    solve: Callable[["Task"], Answer]
    purpose: str
    conserves: str
    source: str
    conserves_energy: bool = False
    polarization: bool = True
    layers: bool = True
    base: Taken = "any"
    depths: bool = True
    transmission: bool = True
    endless: bool = True
    interfaces: Literal["none", "smooth", "any"] = "none"
    devices: bool = False
    options: tuple[str, ...] = ("nodes", "backend")
    finest: float = 0.0
    operations: Callable[["Task"], float] | None = None
    settings: Mapping[str, Setting] = field(default_factory=dict)

    def checked(self, request: Request) -> Settings:
        """The settings, all of them. Raises SceneError where the method does not take the request."""
        for obstacle in self.obstacles(request):
            raise SceneError(f"method {self.name!r} takes no {obstacle}: ask for {EXACT!r}", "method")
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
        told = " and ".join(name for name in ("nodes", "accuracy", "truncation") if name in self.options)
        own = f", and its settings {', '.join(self.settings)}" if self.settings else ""
        return f"it goes by {told}{own}; leave that out, or ask for {EXACT!r} or 'auto'"

    def obstacles(self, request: Request) -> list[str]:
        """What the request has and the method does not take, in words."""
        scene, tau = request.scene, request.tau
        polarizes = any(not layer.phase_matrix.is_scalar for layer in scene.layers)
        found = [
            (not self.polarization and polarizes, "phase matrix that polarizes"),
            (not self.layers and len(scene.layers) > 1, "pile of several layers"),
            (
                scene.below.orders_reflected > REFLECTED[self.base],
                "base but a Lambertian one" if self.base == "even" else "base",
            ),
            (not self.depths and bool(((tau > 0.0) & (tau < scene.thickness)).any()), "depth inside a layer"),
            (not self.transmission and bool((tau > 0.0).any()), "light below the top"),
            (self.interfaces == "none" and scene.keeps_beams, "refracting or mirroring surface"),
            (self.interfaces == "smooth" and scene.is_rough, "rough interface"),
            (not self.endless and not np.isfinite(scene.thickness), "layer without end"),
        ]
        return [words for is_there, words in found if is_there]
