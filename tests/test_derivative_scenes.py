"""Derivatives of scenes drawn by chance, every phase, absorber, surface and base with every name, against differences."""

import warnings
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.basics.stencils import sample_around
from vrte.calls.derivatives import check_endless
from vrte.scene.vary import list_numbers, vary_scene
from vrte.studies.cases import find_phase_matrix

MU_I, MU_O, PHI = (0.15, 0.6), (0.35, 0.8), (20.0, 140.0)
HG = vrte.henyey_greenstein(0.75, 40)
PHASES = {
    "isotropic": vrte.isotropic(),
    "rayleigh": vrte.rayleigh(),
    "depolarizing": vrte.rayleigh(0.3),
    "scalar": vrte.henyey_greenstein(0.4, 6),
    "scalar, peaked": HG,
    "backward": vrte.henyey_greenstein(-0.6, 30),
    "spheroids": find_phase_matrix("spheroids"),
    "haze, peaked": find_phase_matrix("haze-L"),
    "nearly scalar": vrte.PhaseMatrix(*(HG.coefficients + 1e-5 * (np.arange(40) == 5)[:, None] * np.eye(6)[2]).T),
}
AMOUNTS = ((0.0, 0.5), (0.2, 30.0), (0.9, 0.6), (0.6, 1e-4), (1.0, 0.8), (1.0 - 1e-6, 20.0), (0.95, 3.0))
GLASS = vrte.Interface(1.0, 1.5)


def depolarize(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
    """A base that turns Q, U and V."""
    turned = np.diag([0.3, 0.1, 0.1, 0.05]) + 0.04 * np.eye(4)[[1, 0, 3, 2]] * np.array([1.0, 1.0, 0.5, -0.5])
    return turned * (1.0 + mu_i * mu_o * np.cos(np.radians(phi_deg)))[..., None, None] / np.pi


BASES: tuple[vrte.scene.boundary.Boundary | None, ...] = (
    None,
    vrte.Lambertian(0.0),
    vrte.Lambertian(0.3),
    vrte.Lambertian(1.0),
    vrte.RPV(0.1, 0.8, -0.1),
    vrte.Hapke(0.4),
    vrte.RossLi(0.2, 0.1, 0.0),
    vrte.MuellerBase(depolarize),
    vrte.Mirror((0.2, 3.0)),
    vrte.Facets((1.34, 0.0), 0.4),
    vrte.Facets((0.2, 3.0), 0.3, "ggx", shadowing=True, conserving=True),
)
SURFACES = ("none", "none", "smooth", "between", "plate", "rough", "rough between", "stack")


def draw_scene(chance: np.random.Generator) -> tuple[vrte.Scene, dict[str, Any]]:
    """A scene of one layer to three, and how it is solved."""
    layers: list[Any] = []
    for _ in range(chance.choice([1, 2, 2, 3])):
        albedo, thickness = AMOUNTS[chance.integers(len(AMOUNTS))]
        layers.append(vrte.Layer(PHASES[str(chance.choice(list(PHASES)))], albedo, thickness))
    if chance.random() < 0.15:
        layers[-1] = vrte.Layer(layers[-1].phase_matrix, min(layers[-1].albedo, 0.9), np.inf)
    base = BASES[chance.integers(len(BASES))]
    surface = str(chance.choice(SURFACES))
    how = {"distribution": str(chance.choice(["beckmann", "ggx"])), "shadowing": bool(chance.random() < 0.5)}
    rough = vrte.Interface(1.0, 1.4, roughness=0.3, **how)
    if surface in ("smooth", "stack"):
        layers.insert(0, GLASS)
    if surface in ("between", "stack"):
        layers.insert(1 + (surface == "stack"), vrte.Interface(1.5 if surface == "stack" else 1.0, 1.3))
    if surface == "plate":
        layers, base = [GLASS, *layers, vrte.Interface(1.5, 1.0)], None
    if surface.startswith("rough"):
        layers.insert(int(surface != "rough" and len(layers) > 1), rough)
    asked = {"nodes": 4, "accuracy": 1e-13, "threads": 1, "truncation": str(chance.choice(["auto", "delta-m", "none"]))}
    asked["transmission"] = bool(base is None and np.isfinite(layers[-1].thickness if surface != "plate" else 0.0))
    return vrte.Scene(layers, base), asked
