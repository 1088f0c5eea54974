"""Which scenes, lit and seen along the same directions, are planned and solved together."""

import math
from typing import NamedTuple

import numpy as np

from vrte.basics import cost
from vrte.discrete_ordinates.orders.truncating import count_terms_carried, has_unpolarized_peak
from vrte.request.how import EXACT, Backend
from vrte.request.request import Request, find_under
from vrte.scene.scene import Scene


class BatchKey(NamedTuple):
    """What scenes have in common that are solved together: how many layers, which of them share a phase matrix (the
    first of its layers, -1 where nothing scatters), whether I alone is scattered, and the refractive indices above and
    below the surface on top, where there is one."""

    layers: int
    shared: tuple[int, ...]
    scalar: bool
    indices: tuple[float, ...] = ()


def is_shared_request(request: Request) -> bool:
    """Whether what is asked lets scenes be solved together, whatever they are: light at the top, and of a BRDF also at
    the bottom."""
    return (
        request.mu is not None
        and (request.kind == "brdf" or (not request.tau.any() and bool((request.mu > 0.0).all())))
        and request.method == EXACT
        and not request.verify
        and not request.coherent
        and request.backend in (Backend.OPENMP, Backend.SEQUENTIAL)
        and request.nodes is not None
        and request.algorithm in ("auto", "direct", "modes")
        and request.illuminate == "top"
    )


def find_batch_key(scene: Scene, request: Request) -> BatchKey | None:
    """What a scene has in common with those that it is solved together with; None where it is solved by itself: for
    refraction but fields above a smooth surface on top, uneven bases, semi-infinite layers or of no thickness,
    and truncations that spread light or depend on its polarization."""
    assert request.mu is not None
    nodes = request.nodes or 0
    below, surface = scene.below, scene.interfaces[0]
    if (
        scene.has_flakes
        or below.keeps_beams
        or below.is_uneven
        or below.orders_reflected > 1
        or any(scene.interfaces[1:])
    ):
        return None
    # a BRDF's orders under a surface are counted again on the way
    if surface is not None and (request.kind == "brdf" or not surface.is_smooth or find_under(request).any()):
        return None
    first: dict[int, int] = {}
    shared, scalar, longest = [], True, 0
    for k, layer in enumerate(scene.layers):
        matrix = layer.phase_matrix
        if not 0.0 < layer.thickness < math.inf:
            return None
        shared.append(first.setdefault(id(matrix), k) if layer.albedo > 0.0 else -1)
        scalar, longest = scalar and matrix.is_scalar, max(longest, matrix.terms)
    carried, columns = count_terms_carried(scene, nodes), request.columns
    if longest > carried:
        both = bool(columns[:, 0].any() and columns[:, 1:].any())
        if (
            (both and not scalar and has_unpolarized_peak(scene, nodes))
            or request.tau.size > 1
            or request.truncation == "small-angle"
        ):
            return None
        longest = carried
    # many unknowns: the orders are counted again on the way, and Python's share is small
    large = longest * float(nodes if scalar else 4 * nodes) ** 3 > cost.WORTH_STAGES
    if large and count_orders_at_most(request, longest) == longest:
        return None
    indices = () if surface is None else scene.media[:2]
    return BatchKey(len(shared), tuple(shared), scalar, indices)


def count_orders_at_most(request: Request, terms: int) -> int:
    """How many of so many Fourier orders a request is about: fluxes have one, light along the normal the first."""
    assert request.mu is not None
    along_normal = bool(np.all(request.mu0 == 1.0) or np.all(np.abs(request.mu) == 1.0))
    return 1 if request.fluxes_only else min(terms, 3) if along_normal else terms


def estimate_bytes(request: Request, likeness: BatchKey, terms: int) -> float:
    """Of what is worked with for a scene, and of its result."""
    assert request.nodes is not None
    assert request.mu is not None
    stokes = 1 if likeness.scalar else 4
    n, into, out = stokes * request.nodes, stokes * request.mu0.size, stokes * request.mu.size
    order = 5.0 * n * n + 2.0 * n * (out + into) + 4.0 * n * stokes * into
    result = 16.0 * request.mu0.size * request.mu.size * request.phi.size
    return 8.0 * (likeness.layers * terms * order + result)
