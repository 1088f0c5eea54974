"""Scenes, beams and directions drawn by chance, and how far an answer is from another."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import vrte
from bench.cases import find_phase_matrix as phase_matrix_of
from vrte.basics.arrays import Array
from vrte.optics.phase_matrix import PhaseMatrix

NO_LIGHT = 1e-290
LOWEST = 0.02  # cosine
NATURAL, POLARIZED = (1.0, 0.0, 0.0, 0.0), (1.0, 0.4, -0.3, 0.2)


@dataclass(frozen=True)
class Asked:
    """A scene, and the keywords of `vrte.radiance` or of `vrte.brdf`."""

    scene: vrte.Scene
    kind: str
    keywords: dict[str, Any]

    def solved(self, **options: Any) -> "Answer":
        """By some method."""
        if self.kind == "brdf":
            found = vrte.brdf(self.scene, **self.keywords, threads=1, **options)
            fraction = np.array([found.reflectance])
            return Answer(found.mueller.reshape(found.mu_i.size, -1, 4, 4), fraction, found.diagnostics)
        field = vrte.radiance(self.scene, **self.keywords, threads=1, **options)
        incident = field.mu0 * field.incident_stokes[0]
        shares = np.array([field.flux_up, field.flux_down]) / incident
        return Answer(field.stokes.reshape(field.tau.size, -1, 4, 1), shares, field.diagnostics)

    @property
    def lowest(self) -> float:
        """Of the cosines."""
        names = ("mu_i", "mu_o") if self.kind == "brdf" else ("mu0", "mu")
        return float(min(np.abs(self.keywords[name]).min(initial=1.0) for name in names))


@dataclass(frozen=True)
class Answer:
    """light (depth or beam, direction, 4, column), shares of the incident flux, and how it was made."""

    light: Array
    shares: Array
    made: dict[str, Any]

    def error(self, right: "Answer") -> float:
        """The largest of any Stokes parameter over the largest I at its depth or of its beam, and of shares."""
        differences = np.abs(self.light - right.light).max(axis=(1, 2, 3), initial=0.0)
        sizes = np.abs(right.light[:, :, 0, 0]).max(axis=1, initial=0.0)
        light = (differences / np.maximum(sizes, NO_LIGHT)).max()
        return float(max(light, np.abs(self.shares - right.shares).max()))


def phase_matrix(chance: np.random.Generator) -> PhaseMatrix:
    """Isotropic or Rayleigh's, Henyey and Greenstein's down to 1e-12, or of particles."""
    g = float(chance.uniform(-0.5, 0.93))
    terms = min(264, int(math.log(1e-12) / math.log(max(abs(g), 1e-3))) + 2)
    kinds: list[Callable[[], PhaseMatrix]] = [
        vrte.isotropic,
        lambda: vrte.rayleigh(float(chance.choice([0.0, 0.03, 0.3]))),
        lambda: vrte.henyey_greenstein(g, terms),
        *(
            partial(phase_matrix_of, name)
            for name in ("red gold powder", "rutile", "spheroids", "clear spheres", "droplets, scalar")
        ),
    ]
    likely = np.array([1, 1, 3, 1, 1, 1, 0.5, 0.5]) / 9.0
    return kinds[chance.choice(len(kinds), p=likely)]()


def scene(chance: np.random.Generator) -> vrte.Scene:
    """One layer or up to three, conservative, almost so or absorbing, of any thickness, over black or white."""
    layers = []
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        albedo = chance.choice([1.0, 1.0 - 10.0 ** chance.uniform(-4, -1), chance.uniform(0.05, 1.0)])
        layers.append(vrte.Layer(phase_matrix(chance), float(albedo), float(10.0 ** chance.uniform(-3, 2))))
    if chance.random() < 0.15:
        layers[-1] = vrte.Layer(layers[-1].phase_matrix, layers[-1].albedo, math.inf)
    return vrte.Scene(layers, vrte.Lambertian(float(chance.uniform())) if chance.random() < 0.3 else None)


def faint(chance: np.random.Generator) -> vrte.Scene:
    """A layer, nearly isotropic, that is thin or dark."""
    matrices = [vrte.isotropic(), vrte.rayleigh(), vrte.henyey_greenstein(0.15, 14), phase_matrix_of("red gold powder")]
    matrix = matrices[chance.integers(len(matrices))]
    if chance.random() < 0.5:
        return vrte.Scene([vrte.Layer(matrix, float(chance.uniform(0.3, 1.0)), float(10.0 ** chance.uniform(-6, -2)))])
    return vrte.Scene([vrte.Layer(matrix, float(10.0 ** chance.uniform(-5, -1)), float(10.0 ** chance.uniform(-2, 1)))])


def surfaced(chance: np.random.Generator) -> vrte.Scene:
    """Layers of thickness 1e-5 to 1e3 and surfaces: none, a smooth or a rough one on top, a plate, a stack of two, or
    one between layers; over black or white."""
    index, other = (float(value) for value in chance.uniform(1.03, 2.2, 2))
    matrices = [
        vrte.rayleigh(float(chance.choice([0.0, 0.03]))),
        vrte.henyey_greenstein(float(chance.choice([0.3, 0.6])), 40),
        phase_matrix_of("rutile"),
    ]

    def layer(thickest: float = 1.0) -> vrte.Layer:
        matrix, albedo = matrices[chance.integers(3)], float(chance.choice([0.3, 0.9, 0.99, 1.0]))
        return vrte.Layer(matrix, albedo, float(10.0 ** chance.uniform(-5, thickest)))

    base = None if chance.random() < 0.5 else vrte.Lambertian(float(chance.uniform()))
    top = vrte.Interface(1.0, index)
    stacks: dict[str, tuple[float, Callable[[], list[Any]]]] = {  # by kind, its probability
        "none": (0.2, lambda: [layer(3.0), *([layer()] if chance.random() < 0.5 else [])]),
        "smooth": (0.2, lambda: [top, layer(3.0)]),
        "rough": (0.1, lambda: [vrte.Interface(1.0, index, roughness=0.3, shadowing=True, conserving=True), layer()]),
        "plate": (0.2, lambda: [top, layer(), vrte.Interface(index, 1.0)]),
        "stack": (0.15, lambda: [top, layer(), vrte.Interface(index, other), layer()]),
        "between": (0.15, lambda: [layer(), top, layer()]),
    }
    kind = str(chance.choice([*stacks], p=[probability for probability, _ in stacks.values()]))
    return vrte.Scene(stacks[kind][1](), base)


def cosines(chance: np.random.Generator, count: int) -> Array:
    """Evenly spread, some of them grazing."""
    low = 10.0 ** chance.uniform(math.log10(LOWEST), 0.0, count)
    return np.where(chance.random(count) < 0.3, low, chance.uniform(LOWEST, 1.0, count))


def asked(seed: int, draw: Callable[[np.random.Generator], vrte.Scene] = scene) -> Asked:
    """Of a scene, by a number: a field at the faces and perhaps between them, fluxes alone, or a BRDF."""
    chance = np.random.default_rng(seed)
    found, phi = draw(chance), [0.0, 70.0, 150.0, 180.0]
    if chance.random() < 0.25:
        out = cosines(chance, 3)
        return Asked(found, "brdf", {"mu_i": cosines(chance, 2), "mu_o": out, "phi": phi})
    deepest = found.thickness if math.isfinite(found.thickness) else 20.0
    tau = [0.0]
    if math.isfinite(found.thickness):
        tau.append(found.thickness)
    if chance.random() < 0.4:
        tau.append(float(deepest * chance.choice([chance.uniform(), 10.0 ** chance.uniform(-3, 0)])))
    mu = cosines(chance, int(chance.integers(2, 6)))
    mu0 = float(chance.choice([1.0, *cosines(chance, 3)]))
    stokes = NATURAL if chance.random() < 0.6 else POLARIZED
    both = [] if chance.random() < 0.1 else np.concatenate([mu, -mu])
    return Asked(found, "radiance", {"mu0": mu0, "stokes": stokes, "mu": both, "phi": phi, "tau": sorted(tau)})
