"""Which truncation a request takes, by measured errors (docs/explanation/truncation.md), and what it does."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.discrete_ordinates.orders.media import cut_pieces, find_beams
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.optics.truncation import Truncated, truncate_layer
from vrte.scene.beams import find_direct_light
from vrte.scene.scene import Scene

# which layers lose their forward peak, and towards which directions the beam spreads by small angles
NAMED = {"none": ("none", "none"), "delta-m": ("all", "none"), "small-angle": ("all", "all")}


@dataclass(frozen=True)
class Truncation:
    """The truncation's name and the reason for it; ``peaks``: of which layers they are taken off, "none", "polarizing"
    or "all"; ``spread``: towards which directions small angles are separated, "none", "down" or "all"."""

    name: str
    reason: str
    peaks: str
    spread: str


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
    if name != "auto":
        return Truncation(name, "asked for", *NAMED[name])
    longest = max((layer.phase_matrix.terms for layer in scene.layers if layer.albedo > 0.0), default=0)
    carried = count_terms_carried(scene, nodes)
    if longest <= carried:
        why = f"the nodes carry all of the {longest} terms" if longest else "nothing scatters"
        return Truncation("none", f"auto: {why}", *NAMED["none"])
    name, peaks, spread = "delta-m", "all", "none"
    reasons = [f"auto: {longest} terms, the nodes carry {carried}"]
    if not columns[:, 0].any() and has_scalar_among_polarizing(scene):
        name, peaks = "delta-m of polarizing layers", "polarizing"
        reasons.append("the others cut, which scatter no Q, U and V but by their peak")
    if not scene.keeps_beams and (mu < 0.0).any() and is_beam_seen(scene, float(mu0.max()), tau, nodes, accuracy):
        name, spread = f"{name}, small-angle for light going down", "down"
        reasons.append("going up, delta-m is reciprocal and as good; near the beam it is not")
    return Truncation(name, "; ".join(reasons), peaks, spread)


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
    towards: BoolArray = np.ones(mu.size, bool) if truncation.spread == "all" else mu < 0.0
    return towards


def truncate_layers(scene: Scene, peaks: str, nodes: int) -> list[Truncated]:
    """The layers as multiple scattering sees them; ``peaks`` as of a `Truncation`."""
    scalar, carried = is_scalar(scene), count_terms_carried(scene, nodes)
    found = []
    for layer in scene.layers:
        off = peaks == "all" or (peaks == "polarizing" and not layer.phase_matrix.is_scalar)
        name = "delta-m" if off else "none"
        found.append(truncate_layer(name, layer.phase_matrix, layer.albedo, layer.thickness, carried, scalar))
    return found


def has_scalar_among_polarizing(scene: Scene) -> bool:
    """Whether polarized light matters, but not to every layer."""
    scalar = any(layer.phase_matrix.is_scalar for layer in scene.layers if layer.albedo > 0.0)
    return scalar and not is_scalar(scene)


def is_scalar(scene: Scene) -> bool:
    """True where polarized light matters nowhere: no layer scatters it and the base does not reflect it."""
    return not (scene.below.mixes_stokes or scene.keeps_beams) and all(
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
        cut = cut_pieces(depths, problem.thickness, problem.level)
        _, beams = find_beams(problem.media, cut, problem.mu0)
        for t, (joint, under) in enumerate(zip(cut.at.tolist(), depths.under.tolist(), strict=True)):
            parts = (beams.rising, beams.entering) if under else (beams.leaving, beams.arriving)
            found[:, t] = np.stack([part[joint, :, 0] for part in parts])[..., list(problem.stokes)] @ problem.columns.T
        true = find_direct_light(scene, problem.mu0, depths)[..., 0, :][..., list(problem.stokes)] @ problem.columns.T
        return (found - np.moveaxis(true, 2, 0)) * problem.mu0[:, None]
    depth = problem.depth[:, None]
    added = np.exp(-depth / problem.mu0) * -np.expm1((depth - tau[:, None]) / problem.mu0) * problem.mu0
    found[1] = np.where(depth < tau[:, None], added, 0.0)[..., None] * problem.columns[:, 0]
    return found
