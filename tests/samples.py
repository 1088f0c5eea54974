"""What several test modules compare with or start from."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import SPHEROIDS
from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths

BOTH = pytest.mark.parametrize("algorithm", ["modes", "doubling"])


def slow_but(every: Iterable[Any], *quick: Any) -> list[Any]:
    """Parameters of a test: those not named as quick with the slow tests."""
    return [one if one in quick else pytest.param(one, marks=pytest.mark.slow) for one in every]


def spheroids() -> vrte.PhaseMatrix:
    """Siewert's problem IIA: b2 != 0."""
    return vrte.PhaseMatrix(*np.array(SPHEROIDS).T)


def largest_gap(a: np.ndarray, b: np.ndarray) -> float:
    """Relative to the largest."""
    return float(np.abs(a - b).max() / np.abs(b).max())


def scattered(
    coefficients: np.ndarray,
    path: np.ndarray,
    mu0: np.ndarray,
    mu: np.ndarray,
    phi: np.ndarray,
    columns: np.ndarray,
    index: Sequence[int],
    out: np.ndarray,
    threads: int = 2,
    wide: bool = True,
) -> None:
    """Adds single scattering in closed form to out (n_level, n_in, n_mu, n_phi, 4, n_place), phi in degrees, in two
    pieces of the incident directions. ``coefficients``: (terms, 6), or of each outgoing direction (mu, terms, 6)."""
    apiece = coefficients.ndim == 3
    table = _core.series_table(coefficients.reshape(-1, 6), mu.size) if apiece else _core.series_table(coefficients)
    azimuths = fold_azimuths(phi)
    kind = columns[:, 2:].any(axis=1).astype(np.int32)
    for first, last in ((0, 1), (1, mu0.size)):
        _core.add_single_scattering(
            ThreadTeam(threads, np.zeros(threads), np.zeros(1, np.int32)),
            table=table,
            path=path,
            mu0=mu0,
            mu=mu,
            **azimuths.arguments,
            columns=columns,
            kind=kind,
            place=np.array(index, np.int32),
            first=first,
            last=last,
            out=out,
            wide=wide,
            apiece=apiece,
        )


def rough_mirror(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    """f of a mirror-symmetric surface with elements of all sixteen kinds."""
    c, s = np.cos(np.radians(phi_deg)), np.sin(np.radians(phi_deg))
    f = np.zeros((*np.broadcast_shapes(np.shape(mu_i), np.shape(mu_o), np.shape(phi_deg)), 4, 4))
    f[..., 0, 0] = 0.2 + 0.1 * mu_i * mu_o * c
    f[..., 0, 1] = f[..., 1, 0] = 0.02 * c
    f[..., 0, 2], f[..., 2, 0] = 0.03 * s, -0.03 * s
    f[..., 1, 1] = f[..., 2, 2] = f[..., 3, 3] = 0.05
    f[..., 2, 3] = 0.01 * c
    return f
