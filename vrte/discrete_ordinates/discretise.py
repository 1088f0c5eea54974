"""From a scene and a request to the arrays that every stage works on."""

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.problem import IntArray, Problem
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.scene import Scene

LAST_PLACES = 4.0  # what sums of thicknesses may be off by


def discretise(scene: Scene, mu0: Array, columns: Array, mu: Array, tau: Array, nodes: int) -> Problem:
    """Nodes, cut coefficients and the layer every depth lies in; ``mu`` signed, light going up first."""
    points, weights = double_gauss(nodes)
    terms = np.array([min(layer.phase_matrix.terms, 2 * nodes) for layer in scene.layers], np.int32)
    coefficients = np.zeros((len(scene.layers), int(terms.max()), 6))
    for k, layer in enumerate(scene.layers):
        coefficients[k, : terms[k]] = layer.phase_matrix.coefficients[: terms[k]]
    thickness = np.array([layer.thickness for layer in scene.layers])
    above = np.concatenate([[0.0], np.cumsum(thickness[:-1])])
    level, at = place_levels(tau, above, thickness, scene.thickness)
    return Problem(
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([layer.albedo for layer in scene.layers]),
        thickness=thickness,
        above=above,
        nodes=points,
        weights=weights,
        mu_out=np.abs(mu),
        n_up=int(np.count_nonzero(mu > 0.0)),
        mu0=np.ascontiguousarray(mu0),
        columns=np.ascontiguousarray(columns),
        level=level,
        level_layer=at,
        terms_cut=max(0, max(layer.phase_matrix.terms for layer in scene.layers) - 2 * nodes),
    )


def place_levels(tau: Array, above: Array, thickness: Array, total: float) -> tuple[Array, IntArray]:
    """The depth of each tau below the top of its layer, and the layer.

    What lies within rounding of an interface lies on it: along a cosine of 1e-8 the last place of 1 is a path of 2e-8.
    """
    if thickness[0] > 0.0 and not tau.any():
        return np.zeros(tau.size), np.zeros(tau.size, np.int32)
    at = np.clip(np.searchsorted(above, tau, side="right") - 1, 0, None).astype(np.int32)
    at[tau >= total] = above.size - 1
    level = np.clip(tau - above[at], 0.0, thickness[at])
    rounding = LAST_PLACES * np.finfo(float).eps * tau
    level = np.where(level <= rounding, 0.0, level)
    level = np.where(thickness[at] - level <= rounding, thickness[at], level)
    return np.where(tau >= total, thickness[-1], level), at
