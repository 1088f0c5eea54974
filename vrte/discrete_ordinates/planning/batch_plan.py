"""Which scenes, lit and seen along the same directions, are planned and solved together."""

import math
from typing import NamedTuple

import numpy as np

from vrte.basics import cost
from vrte.discrete_ordinates.orders.truncating import has_unpolarized_peak
from vrte.request.backends import Backend
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.scene.scene import Scene


class BatchKey(NamedTuple):
    """What scenes have in common that are solved together: how many layers, which of them share a phase matrix (the
    first of its layers, -1 where nothing scatters), and whether I alone is scattered."""

    layers: int
    shared: tuple[int, ...]
    scalar: bool


def is_shared_request(request: Request) -> bool:
    """Whether what is asked lets scenes be solved together, whatever they are."""
    along_normal = bool((request.mu0 == 1.0).all() or (np.abs(request.mu) == 1.0).all())  # type: ignore[arg-type]
    return (
        request.kind == "brdf"
        and request.method == EXACT
        and not request.verify
        and request.backend in (Backend.OPENMP, Backend.SEQUENTIAL)
        and request.nodes is not None
        and (request.grading or 1) == 1
        and request.algorithm in ("auto", "direct", "modes")
        and request.illuminate == "top"
        and not along_normal
    )


def find_batch_key(scene: Scene, request: Request) -> BatchKey | None:
    """What a scene has in common with those that it is solved together with; None where it is solved by itself: for
    refraction, uneven bases, semi-infinite layers or of no thickness, and truncations that spread light or depend on
    its polarization."""
    nodes = request.nodes or 0
    below = scene.below
    if scene.keeps_beams or below.is_uneven or below.orders_reflected > 1:
        return None
    first: dict[int, int] = {}
    shared, scalar, longest = [], True, 0
    for k, layer in enumerate(scene.layers):
        matrix = layer.phase_matrix
        if not 0.0 < layer.thickness < math.inf:
            return None
        shared.append(first.setdefault(id(matrix), k) if layer.albedo > 0.0 else -1)
        scalar, longest = scalar and matrix.is_scalar, max(longest, matrix.terms)
    if longest > 2 * nodes:
        if (
            (not scalar and has_unpolarized_peak(scene, nodes))
            or request.tau.size > 1
            or request.truncation == "small-angle"
        ):
            return None
        longest = 2 * nodes
    # many unknowns: the orders are counted again on the way, and Python's share is small
    if longest * float(nodes if scalar else 4 * nodes) ** 3 > cost.WORTH_STAGES:
        return None
    return BatchKey(len(shared), tuple(shared), scalar)


def estimate_bytes(request: Request, likeness: BatchKey, terms: int) -> float:
    """Of what is worked with for a scene, and of its result."""
    assert request.nodes is not None
    assert request.mu is not None
    stokes = 1 if likeness.scalar else 4
    n, into, out = stokes * request.nodes, stokes * request.mu0.size, stokes * request.mu.size
    order = 5.0 * n * n + 2.0 * n * (out + into) + 4.0 * n * stokes * into
    result = 16.0 * request.mu0.size * request.mu.size * request.phi.size
    return 8.0 * (likeness.layers * terms * order + result)
