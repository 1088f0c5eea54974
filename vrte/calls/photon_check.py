"""verify="photons": light of a solve against photons that share the scene alone, in bins, as standard errors."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.basics.quadrature import find_gauss_legendre
from vrte.basics.running import Progress, run_interruptible, share_progress
from vrte.methods import choose_method, make_run, solve_request
from vrte.methods.parts.refinement import share_steps
from vrte.monte_carlo.trace import BATCHES, find_places, trace_beam
from vrte.request.request import UNIT_COLUMNS, Request, Wanted, find_under
from vrte.results.result import NO_LIGHT

PHOTONS, FEWEST = 1_000_000, 100_000  # of all beams together, of each at least
BINS, POINTS = 4, 6  # bins of cosines and of azimuths, Gauss points in each
MOST = 4.0  # standard errors beyond which light is reported to differ
LEAST = 0.1  # of the error of I in a bin: below, an error is that of a few photons, and not known
NARROW = 0.04  # bins of cosines are wider
LOOKS = 1, 4  # times so many photons: of hundreds of means one is off by chance, and other photons have to confirm it
STOKES = "IQUV"


def note_photons(request: Request, progress: Progress | None = None) -> dict[str, Any]:
    """The entry "photons" of diagnostics: largest differences of I, Q, U, V in standard errors; warns beyond MOST."""
    if not request.by_photons:
        return {}
    start = time.perf_counter()
    found = compare_with_photons(request, progress)
    notes = [
        f"photons find another {name}: {found[name]:.1f} standard errors off, and at most {MOST:g} are expected"
        for name in STOKES
        if found[name] > MOST
    ]
    for note in notes:
        warn_user(note, AccuracyWarning)
    return {"photons": found | {"notes": notes, "wall_seconds": time.perf_counter() - start}}


def share_with_photons(request: Request, progress: Progress | None) -> tuple[Progress | None, Progress | None]:
    """Progress of a solve and of the photons that verify it, half each; all of it is the solve's where none do."""
    if not request.by_photons:
        return progress, None
    return share_progress(progress, 0, 2), share_progress(progress, 1, 2)


def compare_with_photons(request: Request, progress: Progress | None = None) -> dict[str, Any]:
    """The same scene, depths and beams in bins: solved once more on Gauss points of each, and by photons."""
    scene, lit = request.scene, request.mu0
    edges = find_edges(scene.media), np.linspace(0.0, 180.0, BINS + 1)
    (mu, weight), (phi, share) = (spread_points(each) for each in edges)
    levels = np.arange(request.tau.size, dtype=np.int32)
    wanted = Wanted([(levels, np.arange(2 * mu.size, dtype=np.int32))], np.arange(4, dtype=np.int32), 1.0 / lit)
    asked: dict[str, Any] = {
        "kind": "brdf",
        "columns": UNIT_COLUMNS,
        "mu": np.concatenate([mu, -mu]),
        "phi": phi,
        "wanted": wanted,
    }
    again = choose_method(replace(request, **asked, fluxes_only=False, verify=False, by_photons=False))
    run = make_run(again)
    light = run_interruptible(run, lambda: solve_request(again, run)[1]).parts[0]
    shape = levels.size, lit.size, 2, edges[0].size - 1, POINTS, BINS, POINTS, 4, 4
    area = 2.0 * (weight * mu).reshape(-1, POINTS, 1, 1) * np.radians(share).reshape(BINS, POINTS)
    solved = np.einsum("tiwmpfqsj,mpfq->itwmfsj", np.asarray(light).reshape(shape), area)
    places, each = find_places(scene, request.tau, find_under(request)), -(-max(PHOTONS // lit.size, FEWEST) // BATCHES)
    there = ~((places.of[:, None] == 0) & [False, True] | (places.of[:, None] == 1) & [True, False])  # not from outside
    largest = np.maximum(np.abs(solved[..., 0, 0]).max(axis=(3, 4)), NO_LIGHT)  # (n_in, n_tau, 2)
    found: dict[str, Any] = {}
    for seed, more in enumerate(LOOKS):

        def trace(seed: int = seed, each: int = each * more) -> list[Array]:
            part = share_steps(progress, seed)
            return [
                trace_beam(scene, mu, places, edges, each, seed, k, run, share_progress(part, k, lit.size)).bins
                for k, mu in enumerate(lit.tolist())
            ]

        mean, error = np.stack(run_interruptible(run, trace), axis=1)[:, :, places.of]
        sure = np.maximum(error, LEAST * error[..., :1, :1])
        allowed = np.hypot(sure, (again.accuracy * largest)[..., None, None, None, None])
        off = np.abs(mean - solved) / allowed * there[..., None, None, None, None]
        found = {name: float(off[..., k, :].max()) for k, name in enumerate(STOKES)}
        noise = (error[..., 0, 0].max(axis=(3, 4)) / largest * there).max()
        found |= {"noise": float(noise), "photons": each * more * BATCHES, "seed": seed}
        if max(found[name] for name in STOKES) <= MOST:
            break
    return found


def find_edges(media: tuple[float, ...]) -> Array:
    """Cosines between bins, those from which on light is reflected totally among them."""
    ratios = np.divide.outer(media, media)
    critical = np.sqrt(1.0 - ratios[ratios < 1.0] ** 2)
    edges = [0.0, 1.0]
    for each in [*np.unique(critical.round(12)), *np.linspace(0.0, 1.0, BINS + 1)[1:-1]]:
        if np.abs(np.array(edges) - each).min() > NARROW:
            edges.append(each)
    return np.sort(edges)


def spread_points(edges: Array) -> tuple[Array, Array]:
    """Gauss points and weights of all bins, one after another, (bin * POINTS,) both."""
    x, weights = find_gauss_legendre(POINTS)
    size = np.diff(edges)[:, None]
    return (edges[:-1, None] + 0.5 * size * (x + 1.0)).ravel(), (0.5 * size * weights).ravel()
