"""Reconstruction on a device against that of the compiled core, on the same modes."""

from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.cl import reconstruction
from vrte.discrete_ordinates.base import expand_base
from vrte.discrete_ordinates.boundary import boundary
from vrte.discrete_ordinates.discretise import discretise
from vrte.discrete_ordinates.homogeneous import homogeneous
from vrte.discrete_ordinates.particular import particular
from vrte.discrete_ordinates.phase_assembly import assemble
from vrte.discrete_ordinates.problem import Run

from .test_discrete_ordinates import spheroids

DOWN_AND_UP = np.array([1.0, 0.6, 0.07, -0.3, -0.77])
GOLD = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.4).phase_matrix


class Solved:
    """A problem solved by modes up to its reconstruction."""

    def __init__(
        self,
        scene: vrte.Scene,
        mu0: list[float],
        tau: list[float],
        mu: np.ndarray = DOWN_AND_UP,
        columns: np.ndarray | None = None,
        nodes: int = 5,
        orders: tuple[int, ...] = (0, 1, 3),
        stokes: tuple[int, ...] = (0, 1, 2, 3),
    ) -> None:
        columns = np.eye(4) if columns is None else columns
        self.problem = discretise(scene, np.array(mu0), columns, mu, np.array(tau), nodes)
        object.__setattr__(self.problem, "stokes", stokes)
        self.orders, run = np.array(orders, np.int32), Run(1)
        self.matrices = assemble(self.problem, self.orders, run)
        self.modes = homogeneous(self.problem, self.orders, self.matrices, run)
        self.beam = particular(self.problem, self.matrices, self.modes, run)
        self.base = expand_base(scene.base, self.problem, self.orders.max() + 1)
        self.amplitudes = boundary(self.problem, self.orders, self.modes, self.beam, self.base, run)
        shape = (self.orders.size, self.problem.level.size, self.problem.n_rhs, self.problem.rows_out)
        self.shape = shape

    def arguments(self, out: np.ndarray) -> tuple[Any, ...]:
        """Those of `reconstruct`."""
        p, n_layer = self.problem, self.problem.albedo.size
        doubles = _core.reconstruction_work(p.size, p.rows_out, p.n_rhs, n_layer)
        return (
            self.matrices.G_E,
            self.matrices.G_F,
            self.modes.lam_re,
            self.modes.lam_im,
            self.modes.X,
            self.modes.Y,
            self.beam.c,
            self.beam.zeta,
            self.amplitudes.even,
            self.amplitudes.odd,
            self.amplitudes.base_down,
            self.base.row[self.orders],
            self.base.out,
            p.thickness,
            p.above,
            p.mu0,
            p.mu_out,
            p.n_up,
            p.level,
            p.level_layer,
            out,
            1,
            np.empty((1, doubles)),
            np.zeros(1),
            np.zeros(1, np.int32),
        )
