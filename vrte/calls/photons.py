"""vrte.photons: a scene by photons followed one by one, which share nothing with the solver but the scene."""

import math
import time
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_choice, check_cosines, check_vector, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, run_interruptible, share_progress, start_run
from vrte.monte_carlo.trace import BATCHES, Counted, Places, find_places, trace_beam
from vrte.request.how import complete_docstring
from vrte.request.request import check_depths, check_scene
from vrte.results.photons import Photons
from vrte.scene.illumination import SIDES, mirror_mueller, turn_to_light
from vrte.scene.scene import Scene

MOST_PHOTONS = 10**12
MOST_EDGES = 1001
MU_EDGES, PHI_EDGES = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 180.0, 7)


@complete_docstring
def photons(
    scene: Scene,
    mu_i: Any,
    mu_edges: Any = None,
    phi_edges: Any = None,
    tau: Any = None,
    photons: int = 1_000_000,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
    illuminate: str = "top",
    side: str = "above",
) -> Photons:
    """Photons followed one by one through a scene: fluxes by bins of directions, each with its standard error.

    A Monte Carlo of any scene: particles with their own Mueller matrices, oriented flakes, smooth and rough surfaces,
    all bases. Photons are vectors in space: no Fourier orders, no nodes, no matrices of layers. Each carries the
    Mueller matrix from the incident light to its own, so that four incident Stokes vectors share its path.

    Parameters
    ----------
    {scene, mu_i}
    mu_edges : array_like, optional
        Ascending cosines between bins, 0 to 1, those of light up and of light down; default: 8 bins.
    phi_edges : array_like, optional
        Ascending azimuths between bins [degrees], 0 to 180; default: 6 bins.
    tau : float or sequence of float, optional
        Depths at which light is counted, n_tau; default: the top and, of a finite scene, the bottom.
    photons : int, optional
        Of each beam, rounded up to a multiple of 128: errors are those of the means of so many batches.
    seed : int, optional
        0 to 2^63 - 1. The same seed gives the same bits on any number of threads.
    {threads, progress, illuminate}
    side : {'above', 'below'}, optional
        Of an interface, for depths that lie at one: tau = 0 is outside by default.

    Returns
    -------
    Photons
        ``up`` and ``down`` (n_in, n_tau, n_mu, n_phi, 4, 4) with errors, beams, what is absorbed, and the balance.

    Raises
    ------
    {SceneError}

    Examples
    --------
    >>> import vrte
    >>> black = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.5, thickness=1.0)])
    >>> vrte.photons(black, mu_i=[0.5, 1.0], photons=2000, seed=3)
    Photons(2 mu_i, 2 tau, 8 x 6 bins, 2048 each)
    """
    check_choice("illuminate", illuminate, SIDES)
    check_choice("side", side, ("above", "below"))
    given, lit = check_scene(scene), check_cosines("mu_i", mu_i)
    depths = check_depths([0.0, given.thickness][: 1 + math.isfinite(given.thickness)] if tau is None else tau, given)
    edges = check_edges("mu_edges", mu_edges, MU_EDGES, 1.0), check_edges("phi_edges", phi_edges, PHI_EDGES, 180.0)
    each = -(-check_whole("photons", photons, 1, MOST_PHOTONS) // BATCHES)
    check_whole("seed", seed, 0, 2**63 - 1)
    is_turned, turned = illuminate == "bottom", turn_to_light(illuminate, given)
    own = given.thickness - depths if is_turned else depths
    under = np.full(depths.shape, side == "below")
    under = ~under if is_turned else under
    if tau is None:  # outside at both faces
        under = own > 0.0
    places, run, start = find_places(turned, own, under), start_run(threads), time.perf_counter()

    def trace() -> list[Counted]:
        return [
            trace_beam(turned, mu, places, edges, each, seed, k, run, share_progress(progress, k, lit.size, BATCHES))
            for k, mu in enumerate(lit.tolist())
        ]

    found = run_interruptible(run, trace)
    arrays = gather_arrays(found, places, is_turned)
    diagnostics = {
        "method": "monte-carlo",
        "photons": each * BATCHES,
        "seed": seed,
        "collisions": [float(one.spent[0, 0]) for one in found],
        "given_up": [float(one.spent[0, 1]) for one in found],
        "threads": run.threads,
        "illuminate": illuminate,
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Photons(mu_i=lit, tau=depths, mu_edges=edges[0], phi_edges=edges[1], diagnostics=diagnostics, **arrays)


def check_edges(name: str, given: Any, usual: Array, last: float) -> Array:
    """Ascending edges of bins between 0 and ``last``. Raises SceneError."""
    edges = usual if given is None else check_vector(name, given)
    if not 2 <= edges.size <= MOST_EDGES or not (np.diff(edges) > 0.0).all() or edges[0] < 0.0 or edges[-1] > last:
        raise SceneError.of(name, f"must be 2 to {MOST_EDGES} ascending numbers from 0 to {last:g}")
    return edges


def gather_arrays(found: list[Counted], places: Places, is_turned: bool) -> dict[str, Array]:
    """Arrays of the result: light at the depths asked for, as seen from the side that is lit."""
    flip = mirror_mueller if is_turned else np.asarray
    bins = np.stack([one.bins[:, places.of] for one in found], axis=2)  # (2, n_tau, n_in, 2, ...)
    beams = np.stack([one.beams[:, places.of] for one in found], axis=2)
    arrays: dict[str, Any] = {}
    for name, values in (("", bins), ("beam_", beams)):
        for k, way in enumerate(("down", "up") if is_turned else ("up", "down")):
            mean, error = values[0, :, :, k].swapaxes(0, 1), np.abs(values[1, :, :, k].swapaxes(0, 1))
            arrays |= {f"{name}{way}": flip(mean), f"{name}{way}_error": np.abs(flip(error))}
    kept = np.stack([one.kept[0] for one in found])
    n_layer = kept.shape[1] // 2
    absorbed = kept[:, :n_layer][:, :: -1 if is_turned else 1]
    balance = np.array([one.spent[0, 1:].sum() for one in found]) + kept.sum(axis=1)
    return arrays | {"absorbed": absorbed, "lost": kept[:, n_layer:].sum(axis=1), "balance": balance}
