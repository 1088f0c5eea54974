"""The derivatives of one number, a weighted sum of a BRDF's elements, with all coefficients of all layers at once.

Light that a slab's change sends out is seen as much as light from the eye would meet it: by reciprocity, the fields of
beams that come in along the outgoing directions weigh the changes (the adjoint). What follows is the algebra of
`SlabModes.differentiate`, read backwards; its cost does not depend on how many coefficients there are.
"""

from dataclasses import replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.errors import SceneError
from vrte.basics.memory import BYTES, DERIVATIVE_BYTES
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.differentiate import (
    Routes,
    add_up_all,
    is_mixing_stokes,
    put_bases_in_medium,
    shorten_plan,
)
from vrte.discrete_ordinates.derivatives.semi_infinite import pull_semi_infinite
from vrte.discrete_ordinates.derivatives.slab_stack import Fields
from vrte.discrete_ordinates.execution.carry_out import make_target
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Part, Share, Target
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.invariance import find_allowed_residuals
from vrte.discrete_ordinates.orders.phase_assembly import find_even_shifts
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_slab_paths
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.optics.facets import FacetGeometry
from vrte.optics.truncation import expand_peak
from vrte.scene.boundary import BLACK
from vrte.scene.vary import Variation


@record
class Gradient:
    """Derivatives of one number with all that layers and base are made of, as `Linearized.vjp` finds them.

    Attributes
    ----------
    thickness
        With the optical thickness of each layer, (layer,); 0 for a semi-infinite one.
    albedo
        With the albedo of each layer, (layer,).
    coefficients
        With the expansion coefficients of each layer's phase matrix, (terms, 6) each: a1, a2, a3, a4, b1, b2; 0 for
        a1[0], which is 1 whatever happens, and nan for those that would mix Stokes parameters which the scene keeps
        apart, and which its solve therefore leaves out.
    base_albedo
        With the albedo of a Lambertian base; 0 without one.

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)], vrte.Lambertian(0.2))
    >>> vrte.linearize(haze, mu_i=0.5, mu_o=0.5, nodes=4).vjp(np.ones((1, 1, 1, 4, 4))).coefficients[0].shape
    (3, 6)
    """

    thickness: Array
    albedo: Array
    coefficients: tuple[Array, ...]
    base_albedo: float

    def along(self, variation: Variation) -> float:
        """The derivative with the number that a variation goes with.

        Parameters
        ----------
        variation : Variation
            Of the same scene; its base may be Lambertian ones alone.

        Returns
        -------
        float
            Per unit of the variation's number.

        Raises
        ------
        SceneError
            Where the base of the variation does not reflect evenly, its coefficients are none that the gradient knows,
            or a surface or a medium changes.

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
        >>> found = vrte.linearize(haze, mu_i=0.5, mu_o=0.5, nodes=4).vjp(np.ones((1, 1, 1, 4, 4)))
        >>> bool(found.along(vrte.Variation("depth", 1.0, [1.0], [0.0])) == found.thickness[0])
        True
        """
        if variation.is_outside:
            raise SceneError(f"{variation.name}: a gradient knows no surfaces and no media, jvp does", variation.name)
        total = float(self.thickness @ variation.thickness + self.albedo @ variation.albedo)
        for mine, change in zip(self.coefficients, variation.coefficients, strict=True):
            rows = min(mine.shape[0], change.shape[0])
            own, touched = mine[:rows], change[:rows] != 0.0
            if change[rows:].any() or np.isnan(own[touched]).any():
                words = "it mixes Stokes parameters that the scene keeps apart, or goes beyond its last coefficient"
                raise SceneError(f"{variation.name}: {words}: a gradient does not know it, jvp does", variation.name)
            total += float((own[touched] * change[:rows][touched]).sum())
        for weight, boundary in variation.base:
            if boundary.is_uneven or boundary.mixes_stokes:
                raise SceneError(f"{variation.name}: a gradient knows bases that reflect evenly alone", variation.name)
            total += self.base_albedo * weight * boundary.even_albedo
        return total


def pull_back(plan: Plan, cotangent: Array, run: Run, orders: int | None = None) -> Gradient:
    """The gradient of the sum of ``cotangent`` times the BRDF's ``mueller``, both (n_in, n_out, n_phi, 4, 4);
    ``orders`` as of `differentiate_plan`."""
    scene = plan.request.scene
    count = len(scene.layers)
    unit = np.eye(count)
    finite = [k for k, layer in enumerate(scene.layers) if np.isfinite(layer.thickness)]
    variations = [Variation(f"layer[{k + 1}].thickness", 1.0, unit[k], np.zeros(count)) for k in finite]
    below = scene.below
    even = below.even_albedo > 0.0 and not (below.is_uneven or below.mixes_stokes)
    if even:
        base = ((1.0 / below.even_albedo, below),)
        variations.append(Variation("base.albedo", 1.0, np.zeros(count), np.zeros(count), base=base))
    total, albedo = np.zeros(len(variations)), np.zeros(count)
    tables = np.zeros((count, max(layer.phase_matrix.terms for layer in scene.layers), 6))
    variations = put_bases_in_medium(plan, variations)
    for part in plan.parts or (plan,):
        routes = Routes(shorten_plan(part, orders), variations)
        forward, multiple, single = collect_tables(routes, cotangent, run)
        total += forward
        deeper = np.zeros(count)
        deeper[finite] = forward[: len(finite)]
        for k in range(count):
            more, table = follow_layer(part.problem, part, k, multiple[k], single[k], float(deeper[k]))
            albedo[k] += more
            tables[k, : table.shape[0]] += table
    for k, column in np.ndindex(count, 6):
        if is_left_out(plan, k, column):
            tables[k, :, column] = np.nan
    thickness = np.zeros(count)
    thickness[finite] = total[: len(finite)]
    coefficients = tuple(table[: layer.phase_matrix.terms] for table, layer in zip(tables, scene.layers, strict=True))
    return Gradient(thickness, albedo, coefficients, float(total[-1]) if even else 0.0)


def is_left_out(plan: Plan, k: int, column: int) -> bool:
    """Whether one of the six sequences of layer k would mix Stokes parameters that the plan solves apart."""
    scene = plan.request.scene
    tables = [np.zeros((0, 6)) for _ in scene.layers]
    tables[k] = np.zeros((3, 6))
    tables[k][2, column] = 1.0
    still = np.zeros(len(scene.layers))
    return is_mixing_stokes(plan.problem, scene, Variation("one", 0.0, still, still, tuple(tables)))


def follow_layer(
    problem: Problem, plan: Plan, k: int, multiple: Array, single: Array, thickness: float
) -> tuple[float, Array]:
    """From the derivatives with a truncated layer's albedo times coefficients, ``multiple`` (rows, 6), and with all of
    its coefficients where light is scattered once, ``single`` (terms, 6): those with the layer's albedo and
    coefficients. `change_layer`, read backwards; thickness: the derivative with the layer's own."""
    layer = plan.request.scene.layers[k]
    given, omega, tau = layer.phase_matrix.coefficients, layer.albedo, layer.thickness
    kept = int(problem.terms[k])
    f = float(problem.fraction[k])
    stretch = 1.0 - omega * f
    own, gain = omega * (1.0 - f) / stretch, omega / stretch
    peak = expand_peak(kept)
    cut = (given[:kept] - f * peak) / (1.0 - f) if f > 0.0 else given[:kept]
    of_own = float((multiple[:kept] * cut).sum())
    of_gain = float((single[: given.shape[0]] * given).sum())  # single is of all but the gain
    found = np.zeros_like(given)
    found += gain * single[: given.shape[0]]
    found[:kept] += own * multiple[:kept] / (1.0 - f)
    shortened = thickness / stretch * tau if np.isfinite(tau) else 0.0
    of_albedo = of_own * ((1.0 - f) + own * f) / stretch + of_gain * (1.0 + gain * f) / stretch - shortened * f
    if f > 0.0:
        slope = -peak / (1.0 - f) + (given[:kept] - f * peak) / (1.0 - f) ** 2
        of_f = of_own * (own - 1.0) * omega / stretch + of_gain * gain * omega / stretch - shortened * omega
        of_f += own * float((multiple[:kept] * slope).sum())
        found[kept, 0] += of_f / (2 * kept + 1)
    found[0, 0] = 0.0
    return of_albedo, found


def collect_tables(routes: Routes, cotangent: Array, run: Run) -> tuple[Array, list[Array], list[Array]]:
    """Derivatives with each variation; with each layer's truncated albedo times coefficients, by multiple scattering;
    and with its whole coefficients over its gain, by single scattering."""
    plan, problem, scene = routes.plan, routes.problem, routes.plan.request.scene
    target = replace(make_target(plan), problem=problem)
    cotangent = cotangent[..., : int(plan.wanted.place.max()) + 1]
    rows = problem.coefficients.shape[1]
    forward = np.zeros(len(routes.variations))
    multiple = [np.zeros((rows, 6)) for _ in scene.layers]
    single = [np.zeros((layer.phase_matrix.terms, 6)) for layer in scene.layers]
    with PROCESSOR.at_work():
        for block in plan.blocks:
            orders = block.orders[block.orders < plan.orders]
            if orders.size and block.choice.name == "invariance" and block.problem.media is None:
                orders = pull_block_by_invariance(plan, block, orders, target, cotangent, multiple[0], run)
            if not orders.size:
                continue
            route = routes.make(block, int(orders[-1]))
            step = route.chunk(1)
            for first in range(0, orders.size, step):
                some = orders[first : first + step]
                kernels = [
                    weigh_kernels(target, order, block.stokes, block.columns, cotangent) for order in some.tolist()
                ]
                forward += pull_orders(Fields(route, some, run), np.stack(kernels), multiple, run)
        for k, (values, *_) in enumerate(add_up_all(routes, [[] for _ in routes.variations], run)):
            forward[k] += (values[0] * cotangent[..., : values.shape[-1]]).sum()
        weights = cotangent[..., plan.wanted.place] * plan.wanted.scale[:, None, None, None, None]
        pull_once(BeamPaths(replace(problem, stokes=ALL), BLACK, 1, 1.0), plan.request.phi, weights, single)
    return forward, multiple, single


def pull_block_by_invariance(
    plan: Plan, block: Block, orders: IntArray, target: Target, cotangent: Array, table: Array, run: Run
) -> IntArray:
    """Adds what orders of a semi-infinite layer have; those that invariance does not verify."""
    problem, weights = block.problem, []
    for order in orders.tolist():
        of_kernels = weigh_kernels(target, order, block.stokes, block.columns, cotangent)
        weights.append(np.einsum("oaic,cb,a->iboa", of_kernels, problem.columns, problem.flip / (2.0 * np.pi)))
    shape = orders.size, -1, problem.rows_out
    gradient, residual = pull_semi_infinite(problem, np.reshape(weights, shape), orders, plan.accuracy, run)
    good = residual <= find_allowed_residuals(plan.accuracy)["residual_of_invariance"]
    table[: gradient.shape[1]] += gradient[good].sum(axis=0)
    return orders[~good]


def weigh_kernels(
    target: Target, order: int, stokes: tuple[int, ...], columns: tuple[int, ...], cotangent: Array
) -> Array:
    """What each kernel of an order weighs in the number that is differentiated, (n_out, S, n_in, n_col): azimuths
    summed up as the result sums orders."""
    azimuths, wanted = target.azimuths, target.wanted
    kernels = np.ones((1, 1, 1, len(columns), 1, len(stokes)))
    light = Light(np.array([order], np.int32), np.array(stokes, np.int32), np.array(columns, np.int32), kernels)
    one, zero = replace(wanted, scale=np.ones(1)), np.zeros(1, np.int32)
    values = np.zeros((1, 1, 1, azimuths.phi.size, 4, cotangent.shape[-1]))
    part = Part(zero, zero, zero, np.ones(1), np.zeros(1, bool), values)
    add = PROCESSOR.prepare_orders(replace(target, wanted=one), [light], Run(1))
    add(Share(part, 0, 1))
    factors = part.values[0, 0, 0][:, list(stokes)][..., wanted.place[list(columns)]]  # (n_phi, S, n_col)
    given = cotangent[..., list(stokes), :][..., wanted.place[list(columns)]]
    return np.einsum("iopac,pac,i->oaic", given, factors, wanted.scale)


def pull_orders(fields: Fields, weights: Array, multiple: list[Array], run: Run) -> Array:
    """Adds what orders have of the derivatives with the layers' scattering; those with the variations, (variation,);
    weights (order, n_out, S, n_in, n_col)."""
    route = fields.route
    given = np.zeros((len(weights), fields.weights.shape[3], fields.light.shape[3]))
    given[:, : route.weighing.shape[-1]] = weights.reshape(len(weights), route.weighing.shape[-1], -1)
    for piece in route.pieces:
        if route.media.scene.layers[piece.layer].albedo == 0.0 and not route.problem.coefficients[piece.layer].any():
            continue
        one, table = route.each[piece.medium].problem, multiple[piece.layer]
        for some, modes, terms in fields.modes_of(piece):
            E, F = modes.pull(terms, given[some])
            with run.timed("derivatives") as crew:
                found = _core.pull_scattering(
                    crew,
                    orders=fields.orders[some],
                    members=one.members,
                    directions=one.directions,
                    weights=one.weights,
                    n_out=one.mu_out.size,
                    shifts=find_even_shifts(one, len(table)),
                    pulled_E=E,
                    pulled_F=F,
                )
            table += found.sum(axis=0)
    return np.array([(fields.change(change, k, {}) * given).sum() for k, change in enumerate(route.changes)])


def pull_once(beam_paths: BeamPaths, phi: Array, weights: Array, single: list[Array]) -> None:
    """Adds the derivatives with each layer's coefficients, over its gain, of light that is scattered once: all orders
    in closed form. `make_scatterer` read backwards; weights (n_in, n_out, n_phi, 4, n_col)."""
    cut, sights, index = beam_paths.cut, beam_paths.sights, beam_paths.sights.place[0]
    escapes = beam_paths.escapes[0] * (beam_paths.problem.flip * sights.index[0] ** 2)[..., None, None]
    for k, layer in enumerate(cut.layer.tolist()):
        medium = 1 + layer
        into, out = beam_paths.into[medium], sights.cosines[medium]
        mu_in, mu_out = np.where(into > 0.0, into, 1.0), np.where(out > 0.0, out, 1.0)
        paths = integrate_slab_paths(cut.thickness[k : k + 1], mu_in, mu_out)[:, 0].swapaxes(1, 2) * (
            (out > 0.0)[:, None] & (into > 0.0)
        )
        paths /= 4.0 * np.pi * beam_paths.media.scene.media[medium] ** 2 * mu_in
        for side, end in np.ndindex(2, 2):
            way, power = int(end != side), (beam_paths.falling, beam_paths.mirrored)[side][k]
            sent = escapes[:, :, 2 * k + end] if way else escapes[:, :, 2 * k + end] * FLIP
            lit = np.flatnonzero(power.any(axis=(1, 2)) & sent.any())
            if lit.size:
                seen = sent.swapaxes(1, 2)[:, None] @ (weights[lit] @ power[lit, None, None].swapaxes(-1, -2))
                seen *= paths[way][index][:, lit].T[:, :, None, None, None]  # (n_in, n_out, n_phi, 4, 4)
                single[layer] += pull_matrix(mu_in[lit], mu_out[index], phi, seen, not way, single[layer].shape[0])


def pull_matrix(mu_in: Array, mu_out: Array, phi: Array, weights: Array, upward: bool, terms: int) -> Array:
    """Derivatives with coefficients (terms, 6) from those with the phase matrix for light going down mu_in (n_in,) and
    then up or down mu_out (n_out,), at azimuths phi (n_phi,) [degrees]: weights (n_in, n_out, n_phi, 4, 4)."""
    geometry = FacetGeometry(mu_in[:, None, None], mu_out[:, None], phi, upward)
    across = geometry.sine_i * geometry.sine_o * np.cos(np.radians(phi))
    straight = geometry.mu_i * geometry.mu_o
    cosine = np.clip(across + (-straight if upward else straight), -1.0, 1.0).ravel()
    w = geometry.turn_back(weights).reshape(-1, 4, 4)
    found = np.zeros((terms, 6))
    step = max(1, int(DERIVATIVE_BYTES / 16 / (6 * BYTES * terms)))
    for first in range(0, cosine.size, step):
        some = slice(first, first + step)
        f, x = w[some].transpose(1, 2, 0), cosine[some]
        p = _core.spherical_functions(0, x, terms)[:, 0]
        q, r, t = _core.spherical_functions(2, x, terms).transpose(1, 0, 2)
        found[:, 0] += p @ f[0, 0]
        found[:, 1] += r @ f[1, 1] + t @ f[2, 2]
        found[:, 2] += t @ f[1, 1] + r @ f[2, 2]
        found[:, 3] += p @ f[3, 3]
        found[:, 4] -= q @ (f[0, 1] + f[1, 0])
        found[:, 5] -= q @ (f[2, 3] - f[3, 2])
    return found
