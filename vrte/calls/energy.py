"""The balance of light: what goes out, and what is absorbed, against what falls in.

The net flux, down less up, beams included, is known at every depth of a request, and is 0 below all that absorbs
nothing: where it grows on its way down light is made, and where it falls between two depths light is absorbed.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.optics.facet_energy import share_energy
from vrte.request.how import EXACT
from vrte.request.request import Request, find_under
from vrte.results.result import NO_LIGHT, Solution
from vrte.scene.beams import find_cosines, find_direct_light, locate_depths
from vrte.scene.boundary import CHECKED_COSINES
from vrte.scene.scene import Scene

ENERGY = "energy: "  # begins every note
ROUNDING = 1e-12  # of the light that falls in: what sums of fluxes leave
MUCH = 2.0  # times the light that falls on them: facets that send on more are warned of


def defer(request: Request, describe: Callable[[], dict[str, Any]]) -> Callable[[], dict[str, Any]]:
    """What makes the diagnostics of a result when they are read; at once where facets may make light: a warning."""
    may_warn = request.scene.is_rough or request.scene.below.facets is not None
    return partial(dict, describe()) if may_warn else describe


def note_energy(request: Request, solution: Solution) -> dict[str, Any]:
    """The diagnostics of a solution, with a note, and no promise, where its light does not balance."""
    found, notes = solution.diagnostics, list_notes(request, find_net_fluxes(request, solution))
    return found | {"promised": False, "notes": [*found.get("notes", ()), *notes]} if notes else found


def find_net_fluxes(request: Request, solution: Solution) -> Array:
    """Flux down less up, beams included, over the incident one, (n_tau, n_in, n_col); of a field all columns in one."""
    scene, mu0, tau = request.scene, request.mu0, request.tau
    net, columns = solution.flux_down - solution.flux_up, request.columns
    if request.kind != "brdf":
        net, columns = net.sum(axis=-1, keepdims=True), columns.sum(axis=0, keepdims=True)
    if scene.needs_beam_paths:
        beams = find_direct_light(scene, mu0, locate_depths(scene, tau, find_under(request)))[..., 0, :] @ columns.T
        beam = beams[:, :, 1] - beams[:, :, 0]
    else:
        beam = np.exp(-tau[:, None] / mu0)[..., None] * columns[:, 0]
    return (net / mu0[:, None] + beam) / max(float(columns[0, 0]), NO_LIGHT)


def list_notes(request: Request, net: Array) -> list[str]:
    """What does not balance, beyond the accuracy; ``net`` as of `find_net_fluxes`."""
    scene, allowed = request.scene, max(request.accuracy, ROUNDING)
    notes = list(list_facets_that_make_light(scene, request.mu0, allowed))
    if not np.isfinite(net).all():
        return notes
    if balances_at_top(request, net, allowed):
        return notes
    indices, losing = locate_levels(request)
    order = np.argsort(indices)
    edges = [*indices[order].tolist(), float(len(losing))]
    absorbed = net[order]
    absorbed[:-1] -= net[order[1:]]
    made = np.sqrt((absorbed[..., 1:] ** 2).sum(axis=-1)) - absorbed[..., 0]  # of the polarization that gains most
    kept = [not any(losing[int(edges[k]) : int(np.ceil(edges[k + 1]))]) for k in range(len(order))]
    made[kept] = np.abs(absorbed[kept]).max(axis=-1)
    if made.max() > allowed:
        link, beam = np.unravel_index(np.argmax(made), made.shape)
        lost = kept[link] and absorbed[link, beam, 0] > allowed
        words = f"is {'lost where nothing absorbs' if lost else 'made'}: {find_cause(request, allowed)}"
        share = f"{made[link, beam]:.2g} of the light that falls in along mu = {request.mu0[beam]:g}"
        notes.append(f"{ENERGY}{share} {words}")
    return notes


def balances_at_top(request: Request, net: Array, allowed: float) -> bool:
    """Whether the net flux at the top alone shows a balance: layers absorb what is lost, and no column gains."""
    absorbs = any([layer.absorbs for layer in request.scene.layers])
    if request.tau.size > 1 or request.tau[0] != 0.0 or not absorbs:
        return False
    return bool((np.sqrt((net[..., 1:] ** 2).sum(axis=-1)) - net[..., 0]).max() <= allowed)


def locate_levels(request: Request) -> tuple[Array, list[bool]]:
    """Depths (n_tau,) as places in the list of interfaces, layers and base, and which of these may lose light."""
    scene = request.scene
    losing = [False] * (2 * len(scene.layers) + 2)
    for k, layer in enumerate(scene.layers):
        losing[2 * k + 1] = layer.absorbs
    for k, interface in enumerate(scene.interfaces):
        losing[2 * k] = interface is not None and not interface.is_smooth and not interface.conserving
    losing[-1] = scene.base_is_reached and scene.below.even_albedo < 1.0
    depths = locate_depths(scene, request.tau, find_under(request))
    inside = depths.interface < 0
    return np.where(inside, 2.0 * depths.layer + 1.0 + depths.share, 2.0 * depths.interface + depths.under), losing


def list_facets_that_make_light(scene: Scene, mu0: Array, allowed: float) -> Iterator[str]:
    """Facets that, without shadowing, send on more than falls on them along beams; a warning where it is much more."""
    if scene.below.facets is None and not scene.is_rough:
        return
    there = [(k, one) for k, one in enumerate(scene.interfaces) if one]
    surfaces = [(f"interface {number}", k, one.facets) for number, (k, one) in enumerate(there, 1) if not one.is_smooth]
    for name, index, facets in (*surfaces, ("the base", -1, scene.below.facets)):
        if facets is None or facets.shadowing:
            continue
        cosines = find_cosines(scene.media, scene.index_above, mu0)[index]
        lit = cosines > 0.0
        sent = np.sum(share_energy(facets, cosines[lit]), axis=0)
        if sent.max(initial=0.0) <= 1.0 + allowed:
            continue
        worst = int(sent.argmax())
        words = f"{ENERGY}facets of {name} make light without shadowing: along mu = {mu0[lit][worst]:g} they send on"
        note = f"{words} {sent[worst]:.6g} of what falls on them"
        if sent[worst] > MUCH:
            warn_user(f"{note}; give shadowing = True", AccuracyWarning)
        yield note


def find_cause(request: Request, allowed: float) -> str:
    """Who makes or loses light that should balance."""
    base = request.scene.below
    rough = [one.facets for one in request.scene.interfaces if one and not one.is_smooth]
    if any(not facets.shadowing for facets in (*rough, base.facets) if facets is not None):
        return "facets without shadowing make light"
    reflectance = getattr(base, "reflectance", None)
    most = reflectance(CHECKED_COSINES).max() if reflectance else 0.0
    if most > 1.0 + allowed:
        return f"the base gives back up to {most:.6g} of what it gets"
    exact = request.method == EXACT
    return "the nodes are too few to conserve it" if exact else f"method {request.method!r} does not conserve it"
