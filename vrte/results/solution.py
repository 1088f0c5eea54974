"""What a method finds, before it is shaped into a result."""

from dataclasses import dataclass
from typing import Any

from vrte.basics.arrays import Array

NO_LIGHT = 1e-290  # per unit of incident light: below, numbers lose digits


@dataclass(frozen=True, eq=False)
class Solution:
    """Radiance for each incident Stokes column, and fluxes.

    parts: one array (n_level, n_in, n_mu, n_phi, 4, n_place) for each that was wanted, diffuse, public frame; flux_up,
    flux_down (n_tau, n_in, n_col).
    """

    parts: list[Array]
    flux_up: Array
    flux_down: Array
    diagnostics: dict[str, Any]
