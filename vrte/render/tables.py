"""A BRDF between the directions in which it is solved: splines over angles, and values that are linear between them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, extend_azimuths, make_spline_matrix, repeat_grid
from vrte.optics.facets import RoughSurface
from vrte.render.sky import make_horizon_angles
from vrte.results.brdf import Brdf
from vrte.results.facets import leave_out_facets

STEEPEST = 1e-3  # smallest cosine of a BRDF's table; light that grazes even more is given the value there
ANGLES, AZIMUTHS = 64, 121  # of the values between which a BRDF is linear


@dataclass(frozen=True)
class Resolution:
    """Numbers of directions for an error of about 1e-3 of a picture's largest value (docs/how_to/render.md).

    ``angles`` and ``azimuths``: the BRDF's table. ``around``: normals on a ring, there is a ring for each ``angles``.
    ``along``, ``across``: nodes of the quadrature over a lune of the sky, and over one of the ground.
    """

    angles: int = 32
    azimuths: int = 120
    around: int = 48
    along: int = 24
    across: int = 16

    @property
    def theta(self) -> Array:
        """Angles [rad] from the normal of the BRDF's table, incoming and outgoing."""
        return make_horizon_angles(self.angles, STEEPEST)

    @property
    def mu(self) -> Array:
        """Cosines of these angles."""
        return np.clip(np.cos(self.theta), STEEPEST, 1.0)

    @property
    def phi(self) -> Array:
        """Azimuths [deg] of the table: half a turn, the other half is its mirror image."""
        return np.asarray(np.arange(self.azimuths // 2 + 1) * (360.0 / self.azimuths), dtype=np.float64)

    @property
    def turn(self) -> Array:
        """The table's azimuths [rad] once around, and beyond both ends."""
        return repeat_grid(np.arange(self.azimuths, dtype=np.float64) * (2.0 * np.pi / self.azimuths))[0]


@dataclass(frozen=True, eq=False)
class BrdfTable:
    """A BRDF over `Resolution.theta` twice and azimuths all around: ``splines`` (theta_i, theta_o, phi, 16).

    What is splined is f over a slab's reflection of single scattering at this optical ``thickness``,
    (1 - exp(-thickness (1/mu_i + 1/mu_o)))/(mu_i + mu_o): that is steep where light grazes, and most of it.
    ``specular`` (theta, 16): splines of the fraction that is reflected as a beam, None where none is; ``facets``: the
    rough surface on top, whose own reflection is not in ``splines``.
    """

    splines: Array
    thickness: float
    resolution: Resolution
    specular: Array | None = None
    facets: RoughSurface | None = None

    def slab(self, mu_i: Array, mu_o: Array) -> Array:
        """(1 - exp(-thickness (1/mu_i + 1/mu_o)))/(mu_i + mu_o), of single scattering; 1/(mu_i + mu_o) for a base."""
        fraction = -np.expm1(-self.thickness * (1.0 / mu_i + 1.0 / mu_o)) if self.thickness else 1.0
        return np.asarray(fraction / (mu_i + mu_o))

    def rows(self, mu_i: Array, mu_o: Array, phi: Array) -> Any:
        """The matrix from the flat splines to directions (n,), phi in radians."""
        grids = self.resolution.theta, self.resolution.theta, self.resolution.turn
        return make_spline_matrix(grids, (np.arccos(mu_i), np.arccos(mu_o), phi % (2.0 * np.pi)))

    def mueller(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """f (n, 4, 4) [1/sr] in directions (n,), phi in radians."""
        found: Array = self.rows(mu_i, mu_o, phi) @ self.splines.reshape(-1, 16)
        return (found * self.slab(mu_i, mu_o)[:, None]).reshape(-1, 4, 4)

    def mirror(self, mu: Array) -> Array:
        """The fraction (n, 4, 4) of light along mu (n,) that is reflected as a beam."""
        found: Array = make_spline_matrix((self.resolution.theta,), (np.arccos(mu),)) @ self.specular
        return found.reshape(-1, 4, 4)


def tabulate_brdf(brdf: Brdf, resolution: Resolution, facets: RoughSurface | None = None) -> BrdfTable:
    """The table of a BRDF for the directions of ``resolution``, without the reflection of ``facets``."""
    assert brdf.direct_transmittance is not None
    thickness = float(-np.log(brdf.direct_transmittance[0])) if brdf.direct_transmittance[0] else np.inf
    plain = BrdfTable(np.empty(0), thickness, resolution)
    half = leave_out_facets(brdf, facets) / plain.slab(brdf.mu_i[:, None], brdf.mu_o)[:, :, None, None, None]
    _, full = extend_azimuths(brdf.phi, half)
    grids = resolution.theta, resolution.theta, resolution.turn
    splines = compute_coefficients(grids, full.reshape(*full.shape[:3], 16))
    beams = brdf.specular
    specular = None if beams is None else compute_coefficients(grids[:1], beams.reshape(-1, 16))
    return replace(plain, splines=splines, specular=specular, facets=facets)


@dataclass(frozen=True, eq=False)
class Lookup:
    """BRDFs at some wavelengths: ``values`` (places, wavelength, 4, 3) without the last column, for light that is not
    circularly polarized. ``find_rows`` takes mu_i, mu_o, phi (n,), phi from 0 to 2 pi, to the matrix from the places to
    these directions, and to a mask of those whose mirror image is meant.
    """

    values: Any
    tables: Sequence[BrdfTable]
    find_rows: Callable[[Array, Array, Array], tuple[Any, Any]]

    @classmethod
    def between_splines(cls, tables: Sequence[BrdfTable]) -> "Lookup":
        """The splines themselves, to the accuracy of the tables."""
        values = np.stack([table.splines.reshape(-1, 4, 4)[..., :3] for table in tables], axis=1)
        return cls(values, tables, lambda *to: (tables[0].rows(*to), np.zeros(to[0].size, bool)))

    @classmethod
    def between_values(cls, tables: Sequence[BrdfTable]) -> "Lookup":
        """Values in single precision, linear between directions of half a turn: quick for very many directions."""
        theta, turn = tables[0].resolution.theta, tables[0].resolution.turn
        grid = make_horizon_angles(ANGLES, STEEPEST)
        fine = make_spline_matrix((theta,), (grid,)).toarray()
        half = np.linspace(0.0, np.pi, AZIMUTHS)
        around = make_spline_matrix((turn,), (half,)).toarray()
        values = np.empty((ANGLES * ANGLES * AZIMUTHS, len(tables), 4, 3), dtype=np.float32)
        for index, table in enumerate(tables):
            splines = table.splines.reshape(*table.splines.shape[:3], 4, 4)[..., :3]
            found = np.einsum("ai,bo,cp,iopst->abcst", fine, fine, around, splines, optimize=True)
            values[:, index] = found.reshape(-1, 4, 3)

        def find_rows(mu_i: Array, mu_o: Array, phi: Array) -> tuple[Any, Any]:
            mirrored = phi > np.pi
            points = np.arccos(mu_i), np.arccos(mu_o), np.where(mirrored, 2.0 * np.pi - phi, phi)
            return make_spline_matrix((grid, grid, half), points, degree=1).astype(np.float32), mirrored

        return cls(values, tables, find_rows)

    def at_outgoing(self, index: int) -> "Lookup":
        """The splines at one of the tables' own outgoing angles, by its index."""
        resolution = self.tables[0].resolution
        theta, turn = resolution.theta, resolution.turn
        weight = make_spline_matrix((theta,), (theta[index : index + 1],)).toarray()[0]
        near = slice(int(np.flatnonzero(weight)[0]), int(np.flatnonzero(weight)[-1]) + 1)
        splines = self.values.reshape(theta.size, theta.size, turn.size, -1)[:, near]
        values = np.einsum("o,iopx->ipx", weight[near], splines).reshape(-1, *self.values.shape[1:])

        def find_rows(mu_i: Array, _: Array, phi: Array) -> tuple[Any, Any]:
            return make_spline_matrix((theta, turn), (np.arccos(mu_i), phi)), np.zeros(phi.size, bool)

        return Lookup(values, self.tables, find_rows)

    @cached_property
    def of_sunlight(self) -> Array:
        """The first column, for unpolarized light: (places, wavelength 4)."""
        return np.ascontiguousarray(self.values[..., 0]).reshape(len(self.values), -1)

    def rows(self, mu_i: Array, mu_o: Array, phi: Array) -> tuple[Any, Any]:
        """The matrix from the places to directions (n,), phi in radians, and where its mirror image is meant."""
        return self.find_rows(np.clip(mu_i, STEEPEST, 1.0), np.clip(mu_o, STEEPEST, 1.0), phi % (2.0 * np.pi))

    def slabs(self, mu_i: Array, mu_o: Array) -> Array:
        """The factors (n, wavelength) that are not in the tables' splines."""
        mu_i = np.clip(mu_i, STEEPEST, 1.0)
        found: dict[float, Array] = {}
        for table in self.tables:
            if table.thickness not in found:
                found[table.thickness] = table.slab(mu_i, mu_o)
        return np.stack([found[table.thickness] for table in self.tables], axis=1)
