"""Which truncation a request takes, a rule written from measured errors (docs/truncation.md), and what it does."""

import numpy as np
from numpy.typing import NDArray

from vrte.arrays import Array
from vrte.discrete_ordinates.choice import Choice
from vrte.discrete_ordinates.problem import Problem
from vrte.optics.truncation import Truncated, truncated
from vrte.scene import MuellerBase, Scene

BoolArray = NDArray[np.bool_]
DOWN = "delta-m, and small-angle for light going down"


def choose_truncation(name: str, scene: Scene, mu: Array, tau: Array, nodes: int) -> Choice:
    """The truncation asked for, or for "auto" the one that the rule takes; mu (n_mu,) signed, tau (n_tau,)."""
    if name != "auto":
        return Choice(name, "asked for")
    longest = max(layer.phase_matrix.terms for layer in scene.layers)
    if longest <= 2 * nodes:
        return Choice("none", f"auto: the nodes carry all of the {longest} terms")
    why = f"auto: {longest} terms, the nodes carry {2 * nodes}"
    if (mu < 0.0).any() and (tau > 0.0).any():
        return Choice(
            DOWN, f"{why}; delta-m is reciprocal for light going up, and blind near the beam for light going down"
        )
    return Choice("delta-m", f"{why}; no light going down is seen")


def spread_towards(truncation: str, problem: Problem, mu: Array) -> BoolArray:
    """Whether the beam spreads by small angles before it scatters into the directions mu (n_mu,), signed."""
    if not problem.fraction.any():
        return np.zeros(mu.size, bool)
    towards: BoolArray = np.full(mu.size, truncation == "small-angle") | ((mu < 0.0) & (truncation == DOWN))
    return towards


def truncated_layers(scene: Scene, name: str, nodes: int) -> list[Truncated]:
    """The layers as multiple scattering sees them."""
    scalar = is_scalar(scene)
    return [
        truncated(name, layer.phase_matrix, layer.albedo, layer.thickness, 2 * nodes, scalar) for layer in scene.layers
    ]


def is_scalar(scene: Scene) -> bool:
    """True where polarized light matters nowhere: no layer scatters it and the base does not reflect it."""
    return not isinstance(scene.base, MuellerBase) and all(layer.phase_matrix.is_scalar for layer in scene.layers)


def flux_of_the_peak(problem: Problem, tau: Array) -> Array:
    """Light scattered into the forward peaks alone, (n_tau, n_in, n_col): delta-M counts it as direct, it is diffuse.

    ``tau`` (n_tau,): the depths in the scene as it is.
    """
    if not problem.fraction.any():
        return np.zeros((tau.size, problem.mu0.size, problem.columns.shape[0]))
    depth = (problem.above[problem.level_layer] + problem.level)[:, None]
    added = np.exp(-depth / problem.mu0) * -np.expm1((depth - tau[:, None]) / problem.mu0) * problem.mu0
    return np.where(depth < tau[:, None], added, 0.0)[..., None] * problem.columns[:, 0]
