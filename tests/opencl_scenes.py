"""Scenes that the loops on a device and those of `_core` are compared on."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

import vrte
from vrte import _core
from vrte.cl.session import Session
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import ALL, Problem

from .samples import spheroids

layer, mixed = vrte.Layer, spheroids()
SCENES = {  # b2 or none, thin, thick, semi-infinite and non-scattering layers, a white and no base
    "one layer": vrte.Scene([layer(mixed, 0.9, 2.0)]),
    "over a base": vrte.Scene([layer(mixed, 0.9, 2.0)], vrte.Lambertian(0.7)),
    "conservative over white": vrte.Scene([layer(mixed, 1.0, 50.0)], vrte.Lambertian(1.0)),
    "semi-infinite": vrte.Scene([layer(mixed, 1.0, np.inf)]),
    "semi-infinite and dark": vrte.Scene([layer(mixed, 0.3, np.inf)]),
    "thin": vrte.Scene([layer(vrte.rayleigh(), 1.0, 1e-6)]),
    "thick": vrte.Scene([layer(vrte.rayleigh(), 1.0, 1e4)]),
    "three kinds": vrte.Scene(
        [layer(mixed, 0.97, 1e-3), layer(mixed, 0.0, 0.5), layer(vrte.rayleigh(), 0.3, 300.0)], vrte.Lambertian(0.3)
    ),
    "repeated": vrte.Scene([layer(mixed, 0.9, 0.3), layer(vrte.rayleigh(), 0.5, 0.2)] * 2 + [layer(mixed, 0.9, 9.0)]),
}


def problem_of(scene: vrte.Scene, nodes: int, stokes: tuple[int, ...] = ALL) -> Problem:
    """Two beams, three directions, three depths."""
    depth = min(scene.thickness, 5.0)
    tau = np.array([0.0, 0.3 * depth, depth])
    problem = discretise_scene(scene, np.array([0.45, 0.2]), np.eye(4), np.array([0.7, 0.1, -0.3]), tau, nodes)
    chosen = list(stokes)
    return replace(problem, stokes=stokes, columns=np.ascontiguousarray(problem.columns[np.ix_(chosen, chosen)]))


def kernels_with(session: Session, **stages: Any) -> Any:
    """`_core` with some of its stages on a device."""
    found = SimpleNamespace(**{name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")})
    for name, stage in stages.items():
        setattr(found, name, partial(stage, session))
    return found
