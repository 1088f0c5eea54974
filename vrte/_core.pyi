"""Types of the compiled core; shapes and units are in the docstrings of core/*.pxi."""

from collections.abc import Sequence
from typing import Any, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import ThreadTeam

HAS_OPENMP: bool
CPU_VARIANT: str

# core/constants.h
SEMI_INFINITE: float
NO_LIGHT: float
ROUNDING: float
THICK: float
COMPLEMENTED: float
STEEPEST_RATIO: float
MOST_DOUBLINGS: int
MOST_STEPS: int
SERIES: int
MOST_COLUMNS: int
TANH_NUMERATOR: tuple[float, float, float, float]
TANH_DENOMINATOR: tuple[float, float, float, float]

def sphere_coefficients(
    relative_indices: NDArray[np.complex128], sizes: Array, orders: IntArray
) -> NDArray[np.complex128]: ...
def coated_sphere_coefficients(
    core_indices: NDArray[np.complex128],
    shell_indices: NDArray[np.complex128],
    core_sizes: Array,
    sizes: Array,
    orders: IntArray,
) -> NDArray[np.complex128]: ...
def sphere_slopes(relative_index: complex, size: float, orders: int) -> NDArray[np.complex128]: ...
def coated_sphere_slopes(
    core_index: complex, shell_index: complex, core_size: float, size: float, orders: int
) -> NDArray[np.complex128]: ...
def generalized_spherical_functions(m: int, terms: int, mu: ArrayLike) -> Array: ...
def legendre_matrices(functions: Array) -> Array: ...
def phase_matrices(m: int, coefficients: ArrayLike, mu: ArrayLike, mu_from: ArrayLike) -> Array: ...
def series_table(coefficients: Array, apiece: int = ...) -> Array: ...
def balance_flux(
    *,
    stokes: int,
    coefficients: Array,
    albedo: Array,
    directions: Array,
    weights: Array,
    n_out: int,
    E: Array,
    G_E: Array,
    source_d: Array,
) -> None: ...
def result_of(found: dict[str, Any]) -> Any: ...
def count_scratch(stage: str, **sizes: int) -> int: ...
def bounds_at(*, strength: Array, bounds: Array, depth: Array, decays: Array) -> Array: ...
def orders_that_matter(*, bounds: Array, brightest: Array, allowed: float, largest: float) -> IntArray: ...
def nodal_fluxes(
    *,
    lam_re: Array,
    lam_im: Array,
    X: Array,
    Y: Array,
    c: Array,
    zeta: Array,
    even: Array,
    odd: Array,
    decaying: IntArray,
    thickness: Array,
    above: Array,
    mu0: Array,
    nodes: Array,
    weights: Array,
    level: Array,
    level_layer: IntArray,
) -> Array: ...

class Slabs(TypedDict):
    """Fourier orders of slabs, directions and incident columns, and what is found."""

    orders: IntArray
    members: IntArray
    coefficients: Array
    terms: IntArray
    albedo: Array
    thickness: Array
    directions: Array
    weights: Array
    n_out: int
    columns: Array
    out: Array
    residual: Array

def fused_modes(
    crew: ThreadTeam,
    *,
    parts: Sequence[tuple[Any, ...]],
    orders: IntArray,
    part_of: IntArray,
    slab_stack: IntArray,
    twin: IntArray,
    coefficients: Array,
    terms: IntArray,
    albedo: Array,
    directions: Array,
    weights: Array,
    n_up: int,
    n_out: int,
    balanced: bool,
    quick: bool,
    clear: bool,
    clear_layers: IntArray,
    thickness: Array,
    above: Array,
    base_row: IntArray,
    top_row: IntArray,
    level: Array,
    level_layer: IntArray,
    residual: Array,
    spent: Array,
    missed: IntArray,
) -> None: ...

# doubles of scratch memory that a thread needs, and of a matrix with its incident and outgoing directions
def assembly_work(n_all: int, n_term: int, stokes: int) -> int: ...
def flux_work(n: int, n_rhs: int) -> int: ...
def fused_modes_work(
    n: int, n_layer: int, n_rhs: int, rows: int, into: int, n_all: int, n_term: int, stokes: int
) -> int: ...
def homogeneous_work(n: int) -> int: ...
def respond(crew: ThreadTeam, *, lam_re: Array, lam_im: Array, X: Array, Y: Array, c: Array, zeta: Array, G_E: Array,
    G_F: Array, clear: IntArray, material: IntArray, thickness: Array, mu0: Array, mu_out: Array, nodes: Array,
    entering: Array, leaving: Array, passing: Array, residual: Array, info: IntArray) -> None: ...
def join_media(crew: ThreadTeam, *, slabs: list[Array], joints: list[Array | None], kind: IntArray, base_row: IntArray,
    base: Array, stokes: int, light: Array, residual: Array, info: IntArray) -> None: ...
def boundary_work(n: int, n_layer: int, n_rhs: int) -> int: ...
def extended_size(n: int, r: int, o: int) -> int: ...
def reconstruction_work(n: int, rows: int, n_rhs: int, n_layer: int) -> int: ...

class OtherStages(Protocol):
    """The loops of a solve: those of the core, or others that stand in for them."""

    # fmt: off
    def order_bounds(self, crew: ThreadTeam, *, coefficients: Array, terms: IntArray, albedo: Array, directions: Array,
        n_node: int, n_out: int, strength: Array, bounds: Array, slab_stacks: int = ...) -> None: ...
    def assemble(self, crew: ThreadTeam, *, orders: IntArray, members: IntArray, coefficients: Array, terms: IntArray,
        albedo: Array, directions: Array, weights: Array, n_out: int, E: Array, F: Array, G_E: Array, G_F: Array,
        source_s: Array, source_d: Array, slab_stack: IntArray | None = ...) -> None: ...
    def homogeneous(self, crew: ThreadTeam, *, orders: IntArray, conserving: bool, quick: bool, clear: bool,
        albedo: Array, directions: Array, weights: Array, E: Array, F: Array, lam_re: Array, lam_im: Array, X: Array,
        Y: Array, X_lu: Array, X_pivots: IntArray, residual: Array, info: IntArray,
        slab_stack: IntArray | None = ...) -> None: ...
    def particular(self, crew: ThreadTeam, *, F: Array, source_s: Array, source_d: Array, mu0: Array, columns: Array,
        lam_re: Array, lam_im: Array, X: Array, Y: Array, X_lu: Array, X_pivots: IntArray, c: Array,
        zeta: Array) -> None: ...
    def boundary(self, crew: ThreadTeam, *, lam_re: Array, lam_im: Array, X: Array, Y: Array, c: Array, zeta: Array,
        clear: IntArray, thickness: Array, mu0: Array, above: Array, base_row: IntArray, base: Array,
        base_source: Array, top_row: IntArray, top: Array, sent: Array, even: Array, odd: Array, base_down: Array,
        rising: Array, decaying: IntArray, residual: Array, info: IntArray,
        slab_stack: IntArray | None = ...) -> None: ...
    def reconstruct(self, crew: ThreadTeam, *, G_E: Array, G_F: Array, lam_re: Array, lam_im: Array, X: Array, Y: Array,
        c: Array, zeta: Array, even: Array, odd: Array, base_down: Array, decaying: IntArray, base_row: IntArray,
        base_out: Array, thickness: Array, above: Array, mu0: Array, mu_out: Array, n_up: int, level: Array,
        level_layer: IntArray, out: Array, slab_stack: IntArray | None = ...) -> None: ...
    # fmt: on

_others: OtherStages
order_bounds = _others.order_bounds
assemble = _others.assemble
homogeneous = _others.homogeneous
particular = _others.particular
boundary = _others.boundary
reconstruct = _others.reconstruct

class Stages(OtherStages, Protocol):
    """The loops of a solve: those of the core, or others that stand in for them."""
    def reflect_semi_infinite(self, crew: ThreadTeam, *, orders: IntArray, members: IntArray, coefficients: Array, terms: IntArray, albedo: Array, directions: Array, weights: Array, out_places: IntArray, in_places: IntArray, columns: Array, tolerance: float, halves: bool, up: Array | None = None, on_nodes: Array | None = None, residual: Array | None = None, steps: IntArray | None = None) -> dict[str, Any]: ...
    def scatter_by_fractions(self, crew: ThreadTeam, *, n_out: int, orders: IntArray, members: IntArray, coefficients: Array, terms: IntArray, albedo: Array, thickness: Array, directions: Array, weights: Array, columns: Array, poles: Array, shares: Array, constant: float, inside: Array, tolerance: float, out: Array | None = None, on_nodes: Array | None = None, out_inside: Array | None = None, on_nodes_inside: Array | None = None, residual: Array | None = None, info: IntArray | None = None) -> dict[str, Any]: ...
    def facet_orders(self, crew: ThreadTeam, *, n_order: int, index: float, absorption: float, roughness: float, is_ggx: bool, shadowing: int, transmitted: bool, mu_i: Array, mu_o: Array, points: Array, point_weights: Array, reach: float, out: Array | None = None) -> Array: ...
    def solve_by_factors(self, lu: Array, pivots: IntArray, b: Array, from_right: bool = False, wide: bool = True, found: Array | None = None) -> Array: ...
    def symmetric_eigenproblem(self, matrix: Array, wide: bool = True, values: Array | None = None, vectors: Array | None = None, info: IntArray | None = None) -> dict[str, Any]: ...
    def real_gains(self, lam: float, whole_layer: float, depth: float, row_mu: Array, row_g: Array, upward: bool, decays: bool, wide: bool = True, gains: Array | None = None) -> Array: ...
    def double_slabs(self, crew: ThreadTeam, *, n_extended: int, orders: IntArray, conserving: bool, clear: bool, converged: bool, material: IntArray, thickness: Array, albedo: Array, asymmetry: Array, nodes: Array, weights: Array, mu0: Array, columns: Array, mu_out: Array, E: Array, F: Array, G_E: Array, G_F: Array, source_s: Array, source_d: Array, R: Array | None = None, T: Array | None = None, lost: Array | None = None, residual: Array | None = None, doublings: IntArray | None = None, info: IntArray | None = None) -> dict[str, Any]: ...
    def join_slabs(self, crew: ThreadTeam, *, n_out: int, orders: IntArray, conserving: bool, slabs: IntArray, above: Array, nodes: Array, weights: Array, mu0: Array, R: Array, T: Array, lost: Array, base_row: IntArray, base: Array, base_source: Array, base_out: Array, interface: IntArray, up: Array | None = None, down: Array | None = None, flux: Array | None = None, residual: Array | None = None, info: IntArray | None = None) -> dict[str, Any]: ...
    def find_spheres(self, indices: NDArray[np.complex128], sizes: Array, degrees: IntArray, n_number: int, n_degree: int, core_indices: NDArray[np.complex128] | None = None, core_sizes: Array | None = None, series: NDArray[np.complex128] | None = None) -> NDArray[np.complex128]: ...
    def spherical_functions(self, order: int, mu: Array, n_term: int, functions: Array | None = None) -> Array: ...
    def fill_series(self, expansions: Array, apiece: int, n_series: int, table: Array | None = None) -> Array: ...
    def sum_elements(self, table: Array, cosine: Array, elements: Array | None = None) -> Array: ...
    def path_integrals(self, above: Array, thickness: Array, level: Array, level_layer: IntArray, chosen: IntArray, mu0: Array, mu: Array, slab_stacks: int = 1, paths: Array | None = None) -> Array: ...
    def azimuthal_sum(self, crew: ThreadTeam, *, kernels: Array, members: IntArray, kind: IntArray, place: IntArray, cosine: Array, sine: Array, angle: IntArray, sign: Array, levels: IntArray, rows: IntArray, scale: Array, first: int, last: int, out: Array | None = None) -> Array: ...
    def add_single_scattering(self, crew: ThreadTeam, *, slab_stacks: int = 1, table: Array, path: Array, mu0: Array, mu: Array, cos_phi: Array, sin_phi: Array, angle: IntArray, sign: Array, columns: Array, kind: IntArray, place: IntArray, first: int, last: int, wide: bool = True, apiece: bool = False, out: Array | None = None) -> Array: ...

_stages: Stages
reflect_semi_infinite = _stages.reflect_semi_infinite
scatter_by_fractions = _stages.scatter_by_fractions
facet_orders = _stages.facet_orders
solve_by_factors = _stages.solve_by_factors
symmetric_eigenproblem = _stages.symmetric_eigenproblem
real_gains = _stages.real_gains
double_slabs = _stages.double_slabs
join_slabs = _stages.join_slabs
find_spheres = _stages.find_spheres
spherical_functions = _stages.spherical_functions
fill_series = _stages.fill_series
sum_elements = _stages.sum_elements
path_integrals = _stages.path_integrals
azimuthal_sum = _stages.azimuthal_sum
add_single_scattering = _stages.add_single_scattering
