"""Which truncation a request takes, by measured errors (docs/explanation/truncation.md), and what it does."""

from dataclasses import dataclass, replace

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.discrete_ordinates.orders.media import find_beams
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.optics.truncation import Truncated, find_peak_fraction, has_polarized_peak, truncate_layer
from vrte.scene.beams import find_direct_light
from vrte.scene.scene import Scene

# which layers lose their forward peak, and towards which directions the beam spreads by small angles
NAMED = {"none": ("none", "none"), "delta-m": ("all", "none"), "small-angle": ("all", "all")}
ALONE = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # a1 of the six sequences


@dataclass(frozen=True)
class Truncation:
    """The truncation's name and the reason for it; ``peaks``: of which layers they are taken off, "none", "polarized"
    (those that Q, U and V have a part in) or "all"; ``spread``: towards which directions small angles are separated,
    "none", "down" or "all"; ``whole``: the rest has all six sequences where I alone is scattered as well, where all but
    a1 are zero otherwise: for derivatives with the others."""

    name: str
    reason: str
    peaks: str
    spread: str
    whole: bool = False


def count_terms_carried(scene: Scene, nodes: int) -> int:
    """Terms of a phase matrix that so many nodes carry: twice as many of Gauss's, as many of those that several media
    share."""
    return nodes if len(set(scene.media)) > 1 else 2 * nodes


def choose_truncation(
    name: str, scene: Scene, mu0: Array, columns: Array, mu: Array, tau: Array, nodes: int, accuracy: float
) -> Truncation:
    """The truncation asked for, or for "auto" the one that the rule takes.

    mu0 (n_in,); columns (n_col, 4): incident Stokes vectors; mu (n_mu,): signed; tau (n_tau,).
    """
    if name == "auto":
        found = choose_by_rule(scene, mu0, mu, tau, nodes, accuracy)
    else:
        found = Truncation(name, "asked for", *NAMED[name])
    if found.peaks == "all" and not columns[:, 0].any() and has_unpolarized_peak(scene, nodes):
        return keep_unpolarized_peaks(found)
    return found


def choose_by_rule(scene: Scene, mu0: Array, mu: Array, tau: Array, nodes: int, accuracy: float) -> Truncation:
    """That of "auto", for light that comes in unpolarized."""
    longest, carried = max([layer.phase_matrix.terms for layer in scene.layers]), count_terms_carried(scene, nodes)
    if longest <= carried:
        return Truncation("none", f"auto: the nodes carry all of the {longest} terms", *NAMED["none"])
    name, spread = "delta-m", "none"
    reasons = [f"auto: {longest} terms, the nodes carry {carried}"]
    if not scene.needs_beam_paths and (mu < 0.0).any() and is_beam_seen(scene, float(mu0.max()), tau, nodes, accuracy):
        name, spread = f"{name}, small-angle for light going down", "down"
        reasons.append("going up, delta-m is reciprocal and as good; near the beam it is not")
    return Truncation(name, "; ".join(reasons), "all", spread)


def keep_unpolarized_peaks(found: Truncation) -> Truncation:
    """The same for light that comes in as Q, U or V."""
    name, comma, spread = found.name.partition(",")
    return replace(
        found,
        name=f"{name} of polarizing layers{comma}{spread}",
        reason=f"{found.reason}; the others cut, which scatter no Q, U and V straight on",
        peaks="polarized",
    )


def is_beam_seen(scene: Scene, mu0: float, tau: Array, nodes: int, accuracy: float) -> bool:
    """Whether light that the peaks took out of the beam, and not far, matters at one of the depths below the top."""
    longest = 2 * nodes
    peak = max(
        layer.albedo * abs(layer.phase_matrix.a1[longest]) / (2.0 * longest + 1.0)
        if layer.phase_matrix.terms > longest
        else 0.0
        for layer in scene.layers
    )
    below = tau[tau > 0.0]
    return below.size > 0 and peak > accuracy and bool((np.exp(-(1.0 - peak) * below / mu0) > accuracy).any())


def find_spread_directions(truncation: Truncation, problem: Problem, mu: Array) -> BoolArray:
    """Whether the beam spreads by small angles before it scatters into the directions mu (n_mu,), signed."""
    if truncation.spread == "none" or not problem.fraction.any():
        return np.zeros(mu.size, bool)
    return np.ones(mu.size, bool) if truncation.spread == "all" else mu < 0.0


def truncate_layers(scene: Scene, peaks: str, nodes: int, whole: bool = False) -> list[Truncated]:
    """The layers as multiple scattering sees them; ``peaks`` and ``whole`` as of a `Truncation`."""
    carried, scalar = count_terms_carried(scene, nodes), is_scalar(scene) and not whole
    found = []
    for layer in scene.layers:
        off = peaks == "all" or (peaks == "polarized" and has_polarized_peak(layer.phase_matrix, carried))
        name = "delta-m" if off else "none"
        one = truncate_layer(name, layer.phase_matrix, layer.albedo, layer.thickness, carried)
        found.append(replace(one, coefficients=one.coefficients * ALONE) if scalar and one.fraction > 0.0 else one)
    return found


def has_unpolarized_peak(scene: Scene, nodes: int) -> bool:
    """Whether a layer has a forward peak, beyond what the nodes carry, in which Q, U and V have no part."""
    carried = count_terms_carried(scene, nodes)
    return any(
        find_peak_fraction(layer.phase_matrix, carried) > 0.0 and not has_polarized_peak(layer.phase_matrix, carried)
        for layer in scene.layers
    )


def is_scalar(scene: Scene) -> bool:
    """True where polarized light matters nowhere: no layer scatters it and the base does not reflect it."""
    return not (scene.below.mixes_stokes or scene.needs_beam_paths) and all(
        layer.phase_matrix.is_scalar for layer in scene.layers
    )


def find_peak_flux(problem: Problem, tau: Array) -> Array:
    """Light scattered into the forward peaks alone, up and down, (2, n_tau, n_in, n_col): delta-M counts it as direct,
    it is diffuse.

    ``tau`` (n_tau,): the depths in the scene as it is.
    """
    found = np.zeros((2, tau.size, problem.mu0.size, problem.columns.shape[0]))
    if not problem.fraction.any():
        return found
    if problem.media is not None:
        scene, depths = problem.media.scene, problem.media.depths
        cut = problem.media.cut(problem.thickness, problem.level)
        _, beams = find_beams(problem.media, cut, problem.mu0)
        for t, (interface, under) in enumerate(zip(cut.at.tolist(), depths.under.tolist(), strict=True)):
            parts = (beams.rising, beams.entering) if under else (beams.leaving, beams.arriving)
            found[:, t] = (
                np.stack([part[interface, :, 0] for part in parts])[..., list(problem.stokes)] @ problem.columns.T
            )
        true = find_direct_light(scene, problem.mu0, depths)[..., 0, :][..., list(problem.stokes)] @ problem.columns.T
        return (found - np.moveaxis(true, 2, 0)) * problem.mu0[:, None]
    depth = problem.depth[:, None]
    added = np.exp(-depth / problem.mu0) * -np.expm1((depth - tau[:, None]) / problem.mu0) * problem.mu0
    found[1] = np.where(depth < tau[:, None], added, 0.0)[..., None] * problem.columns[:, 0]
    return found
