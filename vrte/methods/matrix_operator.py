"""The matrix operator method: slabs as R and T of (2:8) from the eigenvectors of the layer matrix, joined in a star.

R and T are functions of F E, F E = X k^2 X^-1: with the scaling transformation all of them are made of exp(-k h), h the
thickness, and of even powers of k, so that k = 0 (albedo 1) is no case of its own. Beams and directions off the nodes
are nodes of weight zero; what leads into and out of the nodes are divided differences of the same functions, so that
k = 1/mu, the resonance, is none either. Light along a cosine mu is good to 1e-16/mu of the brightest; the transmission
of a slab that conserves light, which falls like 1/h, to 1e-16 h of itself.
"""

import time
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import scipy.linalg

from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.divided_differences import ComplexArray
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base, expand_base
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.responses import Response, shape_response
from vrte.discrete_ordinates.orders.slabs import find_materials, select_materials
from vrte.methods.parts.between_interfaces import join_through_interfaces
from vrte.methods.parts.method import Answer, Method
from vrte.methods.parts.on_nodes import OnNodes, find_distinct_directions
from vrte.methods.parts.operators import Modes, Operator, make_empty_operator
from vrte.methods.parts.task import NODES, Task
from vrte.request.how import MOST_NODES
from vrte.request.request import check_scene
from vrte.scene.scene import Scene

LARGEST_RESIDUAL = 1e-8  # of the eigenvectors
ROUNDING = 1e-13  # of the largest eigenvalue: below zero by no more
THIN = 1.0  # optical thickness
SMALLEST = 1e-150  # of k times a thickness: below, sinh is its argument, and quotients of complex numbers overflow
LARGEST_CONDITION = 1e8  # of T_minus, for the propagator
Field = tuple[Operator, Operator]  # light going up and down that a beam makes


@dataclass(frozen=True, eq=False)
class Slab:
    """What comes out of a slab for what falls in, (2:8): R_minus, T_plus of light from above, R_plus, T_minus of light
    from below; the sources F_minus and F_plus are their columns ``into`` of R_minus and T_plus, for each beam."""

    R_minus: Operator
    T_minus: Operator
    R_plus: Operator
    T_plus: Operator

    def star(self, lower: "Slab") -> "Slab":
        """This slab on top of another; light goes to and fro between them without end."""
        up = (lower.R_minus @ self.R_plus).plus_one(-1.0).solve(lower.T_minus)
        return Slab(
            R_minus=self.over(lower.R_minus),
            T_minus=self.T_minus @ up,
            R_plus=lower.R_plus + lower.T_plus @ self.R_plus @ up,
            T_plus=lower.T_plus @ self.sends_down(lower.R_minus, self.T_plus),
        )

    def over(self, reflection: Operator) -> Operator:
        """R_minus of this slab on top of what reflects."""
        return self.R_minus + self.T_minus @ reflection @ self.sends_down(reflection, self.T_plus)

    def sends_down(self, reflection: Operator, passed: Operator) -> Operator:
        """What leaves the bottom in all, of light that has passed, above what reflects."""
        return (self.R_plus @ reflection).plus_one(-1.0).solve(passed)


@dataclass(frozen=True, eq=False)
class Matter:
    """F of (1:41) with beams and directions off the nodes, and the modes of F E."""

    F: Operator
    modes: Modes

    def slab(self, thickness: float) -> Slab:
        """R and T of a homogeneous slab, the same from both sides; without end, R alone.

        Ze = E tanh(k h/2)/k takes the sum of both hemispheres at the top to their difference where both faces are lit
        alike, Zo = tanh(k h/2)/k F the difference to the sum where they are lit oppositely.
        """
        Ze = self.F.solve(self.modes.function(Fading(thickness, 0.0).slope))
        if np.isinf(thickness):
            R = Ze.plus_one().solve(Ze.plus_one(-1.0))
            return Slab(R, R.times(0.0), R.times(0.0), R.times(0.0))
        Zo = self.modes.function(Fading(thickness, 0.0).odd) @ self.F
        even, odd = Ze.plus_one().solve(Ze.times(0.0).plus_one()), Zo.plus_one()
        T = odd.solve(self.modes.function(Fading(thickness, 0.0).through)) @ even
        # both are R: the first keeps the digits of a thin slab, the second of a thick one, whose Zo is large
        R = odd.solve(Zo - Ze) @ even if thickness < THIN else Ze.plus_one(-1.0) @ even - T
        return Slab(R, T, R, T)

    def inside(self, thickness: float, depth: float, down: Operator, up: Operator) -> Field:
        """Up and down at a depth, from what falls in through both faces: (2:12), the modes that fade from the top and
        those that fade from the bottom."""
        fading = Fading(thickness, depth)
        Ze = self.F.solve(self.modes.function(Fading(thickness, 0.0).slope))
        kappa, slope = self.modes.function(fading.even), self.modes.function(fading.slope)
        if np.isinf(thickness):
            top = Ze.plus_one().solve(down).times(2.0)
            s, d = kappa @ top, self.F.solve(slope @ top)
        else:
            Zo = self.modes.function(Fading(thickness, 0.0).odd) @ self.F
            sum_of_even = Ze.plus_one().solve(down + up)
            slope_of_odd = self.F @ Zo.plus_one().solve(down - up)
            s = kappa @ sum_of_even + self.modes.function(fading.odd) @ slope_of_odd
            d = self.F.solve(slope @ sum_of_even + kappa @ slope_of_odd)
        return (s - d).times(0.5), (s + d).times(0.5)


@dataclass(frozen=True)
class Fading:
    """Functions of lambda = k^2 in a slab of thickness h at a depth t, by decaying exponentials only."""

    thickness: float
    depth: float

    def exponentials(self, k: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """exp(-k t), exp(-k (h - t)), exp(-k h)."""
        if np.isinf(self.thickness):
            none = np.zeros_like(k)
            return np.exp(-k * self.depth), none, none
        return np.exp(-k * self.depth), np.exp(-k * (self.thickness - self.depth)), np.exp(-k * self.thickness)

    def sine(self, k: ComplexArray) -> tuple[float, ComplexArray]:
        """g = h - 2 t, and sinh(k g/2)/cosh(k h/2) over g/2 k, which is 1 for a thin slab."""
        gap = self.thickness - 2.0 * self.depth
        short = self.depth if gap >= 0.0 else self.thickness - self.depth
        length = k * abs(gap)
        small = np.abs(length) < SMALLEST
        share = np.where(small, -1.0, np.expm1(-length) / np.where(small, 1.0, length))
        return gap, np.asarray(-2.0 * np.exp(-k * short) * share / (1.0 + np.exp(-k * self.thickness)))

    def even(self, lam: ComplexArray) -> ComplexArray:
        """cosh(k (h/2 - t))/cosh(k h/2)."""
        above, below, whole = self.exponentials(np.sqrt(lam))
        return np.asarray((above + below) / (1.0 + whole))

    def slope(self, lam: ComplexArray) -> ComplexArray:
        """k sinh(k (h/2 - t))/cosh(k h/2)."""
        if np.isinf(self.thickness):
            k = np.sqrt(lam)
            return np.asarray(k * np.exp(-k * self.depth))
        gap, sine = self.sine(np.sqrt(lam))
        return np.asarray(0.5 * gap * lam * sine)

    def odd(self, lam: ComplexArray) -> ComplexArray:
        """sinh(k (h/2 - t))/(k cosh(k h/2)), h/2 - t at k = 0."""
        gap, sine = self.sine(np.sqrt(lam))
        return np.asarray(0.5 * gap * sine)

    def through(self, lam: ComplexArray) -> ComplexArray:
        """1/cosh(k h/2)^2."""
        whole = np.exp(-np.sqrt(lam) * self.thickness)
        return np.asarray(4.0 * whole / (1.0 + whole) ** 2)


def build_matter(problem: Problem, matrices: Assembled, place: int, order: int, material: int) -> Matter:
    """E and F of one order and material of the problem, and their modes; ``place``: of the order in the matrices."""
    at = place, material
    E = extend_matrix(problem, matrices.E[at], matrices.G_E[at], matrices.source_d[at])
    F = extend_matrix(problem, matrices.F[at], matrices.G_F[at], matrices.source_s[at])
    return Matter(F, find_modes(problem, E, F, order, float(problem.albedo[material])))


def extend_matrix(problem: Problem, square: Array, rows: Array, sources: Array) -> Operator:
    """E or F with its rows out of the nodes and its beams; light scattered once goes straight, in closed form, and is
    left out here."""
    stokes, n_out = len(problem.stokes), problem.mu_out.size
    out = np.repeat(1.0 / problem.mu_out, stokes)
    beam = np.repeat(1.0 / problem.mu0, problem.columns.shape[0])
    nothing = make_empty_operator(beam.size, problem.size, stokes * n_out)
    leaving = -out[:, None] * rows.T
    return replace(
        nothing,
        beam=beam,
        nodes=square.T,
        into=-combine_stokes_sources(problem, sources),
        out=out,
        leaving=leaving,
    )


def combine_stokes_sources(problem: Problem, sources: Array) -> Array:
    """From sources (S n_in, n) of single Stokes parameters to (n, n_in n_col), of the incident Stokes columns."""
    each = sources.reshape(problem.mu0.size, len(problem.stokes), problem.size)
    beams: Array = np.einsum("isn,cs->nic", each, problem.columns)
    return beams.reshape(problem.size, problem.n_rhs)


def find_modes(problem: Problem, E: Operator, F: Operator, order: int, albedo: float) -> Modes:
    """Eigenvectors of F E, (1:43), for those of the layer matrix in (2:5)-(2:8). Raises AccuracyError if they fail."""
    product = F @ E
    lam, right = (np.asarray(values, complex) for values in scipy.linalg.eig(product.nodes))
    left = np.linalg.inv(right)
    if order == 0 and problem.conserves:
        lam, right, left = refine_slowest_mode(problem, E.nodes, F.nodes, albedo, lam, right, left)
    if lam.real.min() < -ROUNDING * np.abs(lam).max():
        raise AccuracyError(
            f"method {METHOD.name!r}: light of order {order} would swing instead of fading: ask for more nodes"
        )
    lam = np.where(lam.real < 0.0, 0.0, lam)
    residual = np.abs(product.nodes @ right - right * lam).max() / np.abs(product.nodes).max()
    residual = max(residual, np.abs(left @ right - np.eye(lam.size)).max())
    if not residual <= LARGEST_RESIDUAL:
        raise AccuracyError(
            f"method {METHOD.name!r}: the eigenvectors of order {order} leave a residual of {residual:.1e}: "
            "ask for 'discrete-ordinates'"
        )
    return Modes(product, lam, right, left, len(problem.stokes))


def refine_slowest_mode(
    problem: Problem, E: Array, F: Array, albedo: float, lam: ComplexArray, right: ComplexArray, left: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Modes of order 0 with the slowest put right, whose lambda is known to 1e-16 of the largest only.

    A thick layer that conserves light, or nearly so, sees that. E takes isotropic light v to (1 - omega)/mu v exactly,
    so that lambda = left F (E (right - v) + (1 - omega)/mu v) keeps its digits, right being nearly v.
    """
    stokes = len(problem.stokes)
    isotropic = np.zeros(problem.size)
    isotropic[::stokes] = np.sqrt(problem.weights * problem.nodes)
    lost = (1.0 - albedo) / np.repeat(problem.nodes, stokes) * isotropic
    slow = int(np.abs(lam).argmin())
    if albedo == 1.0:
        right[:, slow], lam[slow] = isotropic, 0.0
        return lam, right, np.asarray(np.linalg.inv(right), complex)
    size = (isotropic @ right[:, slow]) / (isotropic @ isotropic)
    right[:, slow] /= size
    left[slow] *= size
    lam[slow] = left[slow] @ F @ (E @ (right[:, slow] - isotropic) + lost)
    return lam, right, left


def make_ground_operator(problem: Problem, base: Base, order: int) -> Operator:
    """What the base sends up again; the beam that it reflects is left to its closed form."""
    nothing = make_empty_operator(problem.n_rhs, problem.size, problem.rows_out)
    row = int(base.row[order])
    if row < 0:
        return nothing
    return replace(nothing, nodes=base.matrix[row].T, into=base.source[row].T, leaving=base.out[row].T)


def compute_fields(problem: Problem, matters: list[Matter], kinds: IntArray, ground: Operator) -> list[Field]:
    """Light going up and down at every level, for each beam: F+ and F- of (2:8) are its columns."""
    slabs = [matters[kind].slab(float(h)) for kind, h in zip(kinds, problem.thickness, strict=True)]
    reflection = [ground]
    for slab in reversed(slabs):
        reflection.insert(0, slab.over(reflection[0]))
    falling, above = make_beam_operator(problem), slabs[0]
    faces = [(reflection[0] @ falling, falling)]
    for place, beneath in enumerate(reflection[1:], 1):
        down = above.sends_down(beneath, above.T_plus @ falling)
        faces.append((beneath @ down, down))
        if place < len(slabs):
            above = above.star(slabs[place])
    found = []
    for depth, layer in zip(problem.level.tolist(), problem.level_layer.tolist(), strict=True):
        thickness = float(problem.thickness[layer])
        if depth in (0.0, thickness):
            found.append(faces[layer + (depth > 0.0)])
        else:
            down, up = faces[layer][1], faces[layer + 1][0]
            found.append(matters[kinds[layer]].inside(thickness, depth, down, up))
    return found


def make_beam_operator(problem: Problem) -> Operator:
    """The beams alone: no columns for light that falls in along the nodes."""
    one = make_empty_operator(problem.n_rhs, problem.size, problem.rows_out).plus_one()
    return replace(one, nodes=one.nodes[:, :0], leaving=one.leaving[:, :0])


def select_working_stokes(problem: Problem, polarizing_base: bool) -> tuple[Problem, IntArray]:
    """The problem for the Stokes parameters at work and each outgoing cosine once, and where each of them went."""
    stokes = (0,) if problem.is_scalar and not polarizing_base else ALL
    distinct, out = find_distinct_directions(problem)
    columns = np.ascontiguousarray(problem.columns[:, list(stokes)])
    return replace(distinct, columns=columns, stokes=stokes), out


def convert_to_public_frame(problem: Problem, n_up: int, out: IntArray, fields: list[Field]) -> Array:
    """Kernels of an order, (n_tau, n_in, n_col, n_out, 4), radiance for a unit beam in the public frame."""
    beams = problem.mu0.size, problem.columns.shape[0]
    stokes = list(problem.stokes)
    kernels = np.zeros((len(fields), *beams, out.size, 4))
    for level, pair in enumerate(fields):
        up, down = (side.through.T.reshape(*beams, problem.mu_out.size, len(stokes)) for side in pair)
        kernels[level][..., :n_up, stokes] = up[..., out[:n_up], :] * problem.flip
        kernels[level][..., n_up:, stokes] = down[..., out[n_up:], :]
    return kernels / (2.0 * np.pi)


def compute_fluxes(problem: Problem, fields: list[Field]) -> tuple[Array, Array]:
    """Diffuse flux up and down (n_tau, n_in, n_col) from order 0 on the nodes."""
    weights = np.sqrt(problem.weights * problem.nodes)
    shape = (problem.mu0.size, problem.columns.shape[0])
    up, down = (
        np.array([(weights @ field[side].into[:: len(problem.stokes)]).reshape(shape) for field in fields])
        for side in (0, 1)
    )
    return up, down


def solve_by_matrix_operators(task: Task) -> Answer:
    """Every Fourier order that the nodes carry, one after another."""
    if task.problem.media is not None:
        with keep_to_one_thread():
            return task.answer_on_nodes(*join_through_interfaces(task, respond_by_operators))
    below, full, run = task.request.scene.below, task.problem, task.run
    problem, out = select_working_stokes(full, below.mixes_stokes)
    materials, kinds = find_materials(problem)
    orders = np.arange(int(problem.terms.max()), dtype=np.int32)
    with keep_to_one_thread():
        base = expand_base(below, problem, orders.size)
        distinct = select_materials(problem, materials)
        matrices = assemble(distinct, orders, run)
        kernels = []
        for order in orders.tolist():
            begin = time.perf_counter()
            fields = solve_order(problem, distinct, matrices, kinds, base, order)
            kernels.append(convert_to_public_frame(problem, full.n_up, out, fields))
            if order == 0:
                fluxes = compute_fluxes(problem, fields)
            run.book("matrix operators", time.perf_counter() - begin)
            task.tell(order + 1, orders.size)
    return task.answer_on_nodes(np.array(kernels), fluxes)


def solve_order(
    problem: Problem, materials: Problem, matrices: Assembled, kinds: IntArray, base: Base, order: int
) -> list[Field]:
    """Light at every level; raises AccuracyError where a joint or a slab is singular. ``materials``: the problem with
    those as its layers, whose kinds (layer,) the layers are."""
    try:
        matters = [build_matter(materials, matrices, order, order, kind) for kind in range(materials.albedo.size)]
        return compute_fields(problem, matters, kinds, make_ground_operator(problem, base, order))
    except np.linalg.LinAlgError as reason:
        raise AccuracyError(f"method {METHOD.name!r}: a matrix of order {order} has no inverse: {reason}") from None


def respond_by_operators(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run
) -> list[Response]:
    """R and T of slabs (slab,) in one medium at the first of the orders. Raises AccuracyError where one has none."""
    order = int(orders[0])
    matrices = assemble(problem, orders, run)
    begin, found = time.perf_counter(), []
    try:
        matters = [build_matter(problem, matrices, 0, order, kind) for kind in range(problem.albedo.size)]
        for kind, length in zip(material.tolist(), thickness.tolist(), strict=True):
            slab = matters[kind].slab(length)
            both = [np.stack(pair)[None] for pair in zip(slab.R_minus.blocks, slab.T_plus.blocks, strict=True)]
            _, nodes, into, _, leaving, through = both
            found.append(shape_response(problem, nodes, into, leaving, through, {}))
    except np.linalg.LinAlgError as reason:
        raise AccuracyError(f"method {METHOD.name!r}: a matrix of order {order} has no inverse: {reason}") from None
    run.book("matrix operators", time.perf_counter() - begin)
    return found


def propagator(scene: Scene, order: int = 0, nodes: int = NODES) -> Array:
    """The matrix of (2:9) that takes a Fourier order's radiance at the top of a scene to that at its bottom.

    Parameters: a ``scene`` without a base; Fourier ``order``; ``nodes`` a hemisphere. Returns (2, nodes, 4, 2, nodes,
    4): hemisphere (0: up, 1: down), node and Stokes parameter at the bottom, then at the top, in the public frame.
    From R and T of (2:8), and refused with AccuracyError where T_minus, its energy scaled by sqrt(weight * mu), has a
    condition number above 1e8: (2:8) itself has no such limit. SceneError for a base, a layer without end or bad input.

    >>> from vrte import Layer, Scene, isotropic
    >>> propagator(Scene([Layer(isotropic(), albedo=0.5, thickness=0.01)]), nodes=2).shape
    (2, 2, 4, 2, 2, 4)
    """
    scene = check_scene(scene)
    order, nodes = check_whole("order", order, 0, 2 * MOST_NODES), check_whole("nodes", nodes, 1, MOST_NODES)
    if scene.base is not None or np.isinf(scene.thickness):
        raise SceneError("the propagator (2:9) is that of layers which end, without a base")
    if scene.keeps_beams:
        raise SceneError("the propagator (2:9) is that of layers in one medium, without interfaces")
    problem = discretise_scene(scene, np.ones(1), np.eye(4), np.ones(1), np.zeros(1), nodes)
    slab = join_layers(problem, order)
    R_minus, T_minus, R_plus, T_plus = (part.nodes for part in (slab.R_minus, slab.T_minus, slab.R_plus, slab.T_plus))
    condition = np.linalg.cond(T_minus)
    if not condition <= LARGEST_CONDITION:
        raise AccuracyError(
            f"the propagator (2:9) of this scene is of no use: the condition number of T_minus is {condition:.1e}, "
            f"above {LARGEST_CONDITION:.0e}; R and T of (2:8), method 'matrix-operator', have no such limit"
        )
    up = np.linalg.solve(T_minus, np.concatenate([np.eye(problem.size), -R_minus], axis=1))
    down = R_plus @ up
    down[:, problem.size :] += T_plus
    scale = np.repeat(np.sqrt(problem.weights * problem.nodes), 4)
    frame = np.concatenate([np.tile(FLIP, nodes) / scale, 1.0 / scale])
    whole_matrix: Array = np.concatenate([up, down]) * frame[:, None] / frame
    return whole_matrix.reshape(2, nodes, 4, 2, nodes, 4)


def join_layers(problem: Problem, order: int) -> Slab:
    """All layers of one order as one slab."""
    matrices = assemble(problem, np.array([order], np.int32), Run(1))
    slabs = [
        build_matter(problem, matrices, 0, order, layer).slab(float(thickness))
        for layer, thickness in enumerate(problem.thickness)
    ]
    return reduce(Slab.star, slabs)


def predict_operations(task: Task) -> float:
    """Modes of each layer, functions of them, and what goes from beams by way of modes into directions."""
    on_nodes = OnNodes(find_distinct_directions(task.problem)[0], task.request.scene.below)
    n, r, c = on_nodes.sizes
    differences = cost.A_DIFFERENCE * n * (c - n) * max(1.0, (r - n) / 4.0)
    each = cost.COMPLEX_MODES * n**3 + differences + cost.A_LAYER_OF_MODES
    return on_nodes.n_order * (task.problem.albedo.size + task.problem.level.size) * each


METHOD = Method(
    name="matrix-operator",
    solve=solve_by_matrix_operators,
    purpose="slabs as matrices, to be joined and looked at; as exact as discrete ordinates on the same nodes",
    conserves="energy and reciprocity, to rounding",
    source="(2:6)-(2:9), (2:10)-(2:15)",
    conserves_energy=True,
    interfaces="smooth",
    options=("nodes", "accuracy", "backend"),
    finest=1e-12,
    operations=predict_operations,
)
