"""Photons followed one by one, with next-event estimates along the directions asked for.

A photon carries a Mueller matrix m from incident light to its own. At each collision it adds to every direction the
light that it would send there, Z m/|mu| exp(-t): Z [1/sr] scatters, t is the optical thickness on the way out. A
Lambertian base adds albedo/pi exp(-t) likewise. Fluxes are counted. Source: Marchuk, Mikhailov, Nazaraliev,
Darbinjan, Kargin and Elepov, The Monte Carlo Methods in Atmospheric Optics, Springer 1980: local estimates.
"""

from collections.abc import Iterator

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import share_progress
from vrte.discrete_ordinates.planning.plan import want_everything
from vrte.methods.parts.method import Answer, Task
from vrte.monte_carlo.trace import BATCHES, Counted, find_places, make_views, trace_beam
from vrte.request.request import Request, Wanted, find_under
from vrte.results.result import NO_LIGHT, Solution

EDGES = np.array([0.0, 1.0]), np.array([0.0, 180.0])  # of the one bin that fluxes are counted in
TURNS_FLUX = np.array([1.0, 1.0, 0.0, 0.0])  # incident Stokes parameters that change a flux
A_COLLISION, A_VIEW = 120.0, 90.0  # processor time [ns]


def trace_views(task: Task, each: int) -> list[Counted]:
    """What ``each`` photons of a batch find, beam by beam."""
    request = task.request
    scene, count = request.scene, request.mu0.size
    mu = task.mu[:0] if request.fluxes_only else task.mu
    if mu.size and any(layer.has_flakes and layer.flakes and layer.flakes.is_transparent for layer in scene.layers):
        why = "follows no light along single directions past transparent flakes: vrte.photons has bins"
        raise SceneError.of("method", f"{request.method!r} {why}")
    places = find_places(scene, request.tau, find_under(request))
    views, seed = make_views(scene, places, mu, request.phi), task.settings["seed"]
    return [
        trace_beam(scene, one, places, EDGES, each, seed, k, task.run, share_progress(task.report, k, count), views)
        for k, one in enumerate(request.mu0.tolist())
    ]


def solve_by_monte_carlo(task: Task) -> Answer:
    """Light along the directions asked for, and its standard error, that of the means of 128 batches."""
    request, each = task.request, find_batch_size(task)
    if request.by_photons:
        raise SceneError(f"method {request.method!r} takes no verify: it would compare photons with photons", "method")
    found = trace_views(task, each)
    wanted = request.wanted or want_everything(request, task.mu)
    of = find_places(request.scene, request.tau, find_under(request)).of
    up, down = (np.stack([one.bins[0, of, way, 0, 0, 0] for one in found], axis=1) for way in (0, 1))
    lights, errors = (
        list(add_up(request, wanted, np.stack([one.viewed[k] for one in found]), columns))
        for k, columns in enumerate((request.columns, np.abs(request.columns)))
    )
    turned = request.columns.T * TURNS_FLUX[:, None]
    rise, fall = (flux @ turned * request.mu0[:, None] for flux in (up, down))
    achieved = max(find_noise(light, error) for light, error in zip(lights, errors, strict=True))
    diagnostics = {
        "method": request.method,
        "photons_per_beam": each * BATCHES,
        "seed": task.settings["seed"],
        "collisions": [float(one.spent[0, 0]) for one in found],
        "given_up": [float(one.spent[0, 1]) for one in found],
        "achieved": achieved,
        "standard_error": [error.tolist() for error in errors],
        "promised": False,
        "notes": [f"standard errors are up to {achieved:.1g} of the largest I at the same depth"],
        "threads": task.run.threads,
        "stages": task.run.stages,
        "wall_seconds": task.seconds,
    }
    return task.mu, Solution(lights, rise, fall, diagnostics)


def find_noise(light: Array, error: Array) -> float:
    """The largest standard error over the largest I at the same depth of the same beam."""
    brightest = np.abs(light[..., 0, :]).max(axis=(2, 3, 4), initial=NO_LIGHT)
    return float((error.max(axis=(2, 3, 4, 5), initial=0.0) / brightest).max())


def find_batch_size(task: Task) -> int:
    """How many photons each of the BATCHES has, so that a beam has as many as its settings ask for, or more."""
    return -(-int(task.settings["photons"]) // BATCHES)


def add_up(request: Request, wanted: Wanted, seen: Array, columns: Array) -> Iterator[Array]:
    """Every part of what is wanted (n_level, n_in, n_mu, n_phi, 4, n_place), of Mueller matrices (n_in, n_view, 4, 4)
    and Stokes columns (n_col, 4); of standard errors and absolute columns the most that the error can be."""
    placed = np.zeros((columns.shape[0], int(wanted.place.max()) + 1))
    placed[np.arange(columns.shape[0]), wanted.place] = 1.0
    by_depth = seen.reshape(request.mu0.size, request.tau.size, -1, request.phi.size, 4, 4).swapaxes(0, 1)
    scale = (request.mu0 * wanted.scale)[:, None, None, None, None]
    for levels, directions in wanted.parts:
        yield by_depth[levels][:, :, directions] @ (columns.T @ placed) * scale


def predict_photons(task: Task) -> float:
    """Processor time [ns], by the collisions of 128 photons of each beam."""
    found = trace_views(task, 1)
    views = len(found[0].viewed[0])
    collisions = sum(float(one.spent[0, 0]) for one in found)
    return find_batch_size(task) * BATCHES * (len(found) + collisions) * (A_COLLISION + A_VIEW * views)
