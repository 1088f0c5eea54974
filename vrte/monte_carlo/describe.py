"""A scene as photons meet it: tables of scattering angles, flakes and surfaces, as `_core.trace_photons` takes them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.quadrature import find_gap
from vrte.optics.facet_energy import find_lost, find_strengths
from vrte.optics.facets import RoughSurface
from vrte.optics.flakes import Flakes
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

OPEN, SMOOTH, ROUGH, LAMBERTIAN, ROUGH_BASE, PARKING, DEEP = range(7)  # kinds of surfaces, as in core/photons.h
A_TERM, FEWEST, MOST = 32, 2048, 65_536  # angles of a table: for a term of the phase matrix, and limits
TILTS, COSINES, LOSSES = 2048, 4096, 1025  # entries of tables of tilts, amplitudes and of what facets lose
DEEP_ENOUGH = 20.0  # transport mean free paths below which light in a conservative semi-infinite layer is even
FORCED = 0.5  # least chance of a beam to collide in a thin scene


@dataclass(frozen=True, eq=False)
class Described:
    """``arrays`` of a scene for the core, by name; whether its base is left to Python, ``parks``."""

    arrays: dict[str, Any]
    parks: bool


def describe_scene(scene: Scene, mu_i: float, deepest: float) -> Described:
    """What photons along mu_i meet; ``deepest``: the depth of the deepest level in the last layer."""
    layers = scene.layers
    matrices = list({id(layer.phase_matrix): layer.phase_matrix for layer in layers}.values())
    tables = [tabulate_angles(matrix) for matrix in matrices]
    kinds = list({id(layer.flakes): layer.flakes for layer in layers if layer.flakes is not None}.values())
    extent = np.array([layer.extent for layer in layers])
    kind, numbers = np.zeros(len(layers) + 1, np.int32), np.zeros((len(layers) + 1, 8))
    lost = np.zeros((len(layers) + 1, 2, 3, LOSSES))
    for k, interface in enumerate(scene.interfaces):
        if interface is not None and interface.is_smooth:
            kind[k], numbers[k, 0] = SMOOTH, interface.index_below / interface.index_above
        elif interface is not None:
            kind[k] = ROUGH
            numbers[k], lost[k] = describe_facets(interface.facets)
    below, last = scene.below, layers[-1]
    if math.isinf(scene.thickness):
        if last.albedo == 1.0 and (last.flakes is None or last.flakes.is_conserving):
            kind[-1], extent[-1] = DEEP, deepest + DEEP_ENOUGH / (1.0 - last.phase_matrix.asymmetry)
    elif scene.base is not None:
        if not below.is_uneven and not below.keeps_beams:
            kind[-1], numbers[-1, 0] = LAMBERTIAN, below.even_albedo
        elif below.facets is not None:
            kind[-1] = ROUGH_BASE
            numbers[-1], lost[-1] = describe_facets(below.facets)
        else:
            kind[-1] = PARKING
    arrays = {
        "mu_beam": mu_i,
        "extent": extent,
        "albedo": np.array([layer.albedo for layer in layers]),
        "table_of": np.array([[m is layer.phase_matrix for m in matrices].index(True) for layer in layers], np.int32),
        "table_first": np.cumsum([0] + [len(table["gaps"]) for table in tables], dtype=np.int32),
        **{name: np.concatenate([table[name] for table in tables]) for name in tables[0]},
        "flake_of": np.array(
            [[f is layer.flakes for f in [*kinds, layer.flakes]].index(True) for layer in layers], np.int32
        ),
        "flake_share": np.array([find_flake_share(layer) for layer in layers]),
        "tilts": np.array([tabulate_tilts(one) for one in kinds]).reshape(-1, 3, TILTS),
        "mirrors": np.array([tabulate_mirror(one) for one in kinds]).reshape(-1, COSINES, 8),
        "surface_kind": kind,
        "surface_numbers": numbers,
        "lost": lost,
        "forced": FORCED / len(layers) if scene.thickness < mu_i else 0.0,
    }
    return Described(arrays, bool(kind[-1] == PARKING))


def find_flake_share(layer: Layer) -> float:
    """The part of flakes in the extent of a layer."""
    if layer.flake_area == math.inf:
        return 1.0
    return layer.flake_area / layer.extent if layer.extent else 0.0


def find_rates(scene: Scene, mu: Array) -> Array:
    """Extinction along signed cosines (n,) per unit of depth in each layer, (layer, n)."""
    rates = np.empty((len(scene.layers), mu.size))
    for rate, layer in zip(rates, scene.layers, strict=True):
        hidden = 0.0 if layer.flakes is None else 1.0 - layer.flakes.project(mu)
        rate[:] = (1.0 - find_flake_share(layer) * hidden) / np.abs(mu)
    return rates


def tabulate_angles(matrix: PhaseMatrix) -> dict[str, Array]:
    """The scattering matrix over the angle, as the core takes it: angles ascend evenly, F is linear in the cosine
    between them."""
    count = min(max(A_TERM * matrix.terms, FEWEST), MOST)
    angle = np.linspace(0.0, np.pi, count + 1)
    gaps = 2.0 * np.sin(0.5 * angle) ** 2
    elements = matrix.compute_elements(np.cos(angle[::-1]), find_gap(angle[::-1]))[:, ::-1].T.copy()
    elements[:, 0] = np.maximum(elements[:, 0], 1e-12)
    cells = 0.5 * (elements[1:, 0] + elements[:-1, 0]) * np.diff(gaps)
    sums = np.append(0.0, np.cumsum(cells))
    sums /= sums[-1]
    guide = np.maximum(np.searchsorted(sums, np.arange(sums.size) / sums.size, "right") - 1, 0).astype(np.int32)
    return {"gaps": gaps, "sums_to": sums, "elements": elements, "guide": guide}


def tabulate_tilts(flakes: Flakes) -> Array:
    """Cosines of tilts, the chances of lesser tilts, and densities [1/sr], (3, TILTS)."""
    tilt = np.linspace(0.0, flakes.tilts[0][-1], TILTS)
    cosine, density = np.cos(tilt), np.interp(tilt, *flakes.tilts)
    sums = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * -np.diff(cosine)))
    return np.stack([cosine, sums / sums[-1], density])


def tabulate_mirror(flakes: Flakes) -> Array:
    """What a flake reflects and lets through at evenly spaced cosines, (COSINES, 8), as of `Flakes.list_elements`."""
    return np.concatenate(flakes.list_elements(np.linspace(0.0, 1.0, COSINES)), axis=-1)


def describe_facets(surface: RoughSurface) -> tuple[Array, Array]:
    """Numbers (8,) of a rough surface, and tables (2, 3, LOSSES) of what its facets lose on either side."""
    sides = [surface, surface.turned] if surface.is_clear else [surface]
    ratio, lost, chances = complex(surface.ratio), np.zeros((2, 3, LOSSES)), [0.0, 0.0]
    if surface.conserving:
        mu = np.linspace(0.0, 1.0, LOSSES) ** 2
        for k, side in enumerate(sides):
            chances[k] = find_strengths(side)[0] * find_lost(side).total
            lost[k] = tabulate_lost(mu, find_lost(side).find(np.maximum(mu, mu[1])))
    flags = surface.distribution == "ggx", surface.shadowing, surface.conserving
    return np.array([ratio.real, ratio.imag, surface.roughness, *flags, *chances]), lost


def tabulate_lost(mu: Array, lost: Array) -> Array:
    """Cosines, chances of lesser ones by l(mu) mu, and Q over I, of l (n, 2) of I and Q: (3, n)."""
    weight = np.maximum(lost[:, 0], 0.0) * mu
    sums = np.append(0.0, np.cumsum(0.5 * (weight[1:] + weight[:-1]) * np.diff(mu)))
    total = sums[-1] if sums[-1] > 0.0 else 1.0
    ratio = np.divide(lost[:, 1], lost[:, 0], out=np.zeros_like(mu), where=lost[:, 0] > 0.0)
    return np.stack([mu, sums / total, np.clip(ratio, -1.0, 1.0)])
