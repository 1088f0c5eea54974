"""The top of a semi-infinite layer, by invariance, on a device: `_core.reflect_semi_infinite` for all items at once.

A work-group takes all steps of an item, so that what comes out of one does not depend on which others there are."""

from typing import Any, NamedTuple

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import ThreadTeam
from vrte.cl.assembly import Scattering, compute_parity_columns, multiply_by_coefficients, upload_scattering
from vrte.cl.matrices import STRIP, download_stack, make_stack, multiply_stacks, pad_to_strips
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

V = 3


class SemiInfinite(NamedTuple):
    """up (item, n_in, n_col, S n_out), on_nodes (item, n_in n_col, n), residual and steps, (item,), as of
    `_core.reflect_semi_infinite`."""

    up: Array
    on_nodes: Array
    residual: Array
    steps: IntArray


def reflect_semi_infinite(
    session: Session,
    what: Scattering,
    directions: Array,
    weights: Array,
    out: IntArray,
    into: IntArray,
    columns: Array,
    tolerance: Array,
    stop: IntArray,
) -> SemiInfinite:
    """The light that semi-infinite layers send back, single scattering left out.

    directions: nodes, then off the nodes; out, into: places among the latter; columns (n_col, S); tolerance (item,).
    Once ``stop[0]`` is set nothing that comes out counts."""
    items, n_node, n_off = what.items, weights.size, directions.size - weights.size
    phi, n = compute_parity_columns(session, what, directions, weights, n_off), what.stokes * n_node
    parts = [phi.rows(part, what.stokes * count) for part, count in enumerate((n_node, n_off))]
    H, HC = ([make_stack(session, items, each.rows, each.columns, bare=True) for each in parts] for _ in range(2))
    signs = np.where(np.array(what.members) == V, -1.0, 1.0)
    cosines = [np.outer(mu, signs).ravel() for mu in (directions[:n_node], directions[n_node:])]
    signed_mu = [session.constant(np.pad(mu, (0, pad_to_strips(mu.size) - mu.size), "edge")) for mu in cosines]
    residual, steps = session.zeros((items,)), session.zeros((items,), np.int32)
    known = vars(what) | {"units": session.device.max_compute_units, "most": _core.MOST_STEPS, "n": n}
    known |= {"counts": phi.counts, "column_mu": signed_mu[0], "nodes_H": H[0], "tolerance": tolerance}
    for part in range(2):
        shape = items, n, H[part].ld
        R, led = session.empty(shape), session.empty((3, *shape))
        # the first two steps read by how much steps moved that there were not, and do nothing with it
        own = {"R": R, "steps_led": led, "steps_moved": session.zeros((3, *shape)), "phi": parts[part], "H": H[part]}
        own |= {"HC": HC[part], "row_mu": signed_mu[part], "symmetric": part == 0}
        if not stop[0]:
            session.launch("invariance_converge", (items,), known, **own, residual=residual, steps=steps)
    Ruu, psi = (make_stack(session, items, parts[1].rows, size, bare=True) for size in (parts[1].rows, phi.phi.columns))
    for columns_of, alpha, beta in [(H[1], 1.0, 0.0), (parts[1], -1.0, 1.0)]:
        multiply_by_coefficients(session, what, phi.counts, columns_of, psi, v_sign=-1.0, odd_sign=-1.0)
        multiply_stacks(session, psi, columns_of, Ruu, alpha, beta, True, 2, phi.counts)
    strips, residual_found, steps_found = session.download_all([R, residual, steps])
    Ru = strips.reshape(items, -1, n, STRIP)  # strip by strip, column by column within
    # from off the nodes to off the nodes, over the rates and mu, and to the nodes, Q Ru^T Q
    off, places = cosines[1], np.arange(what.stokes)
    rows_in, rows_out = (what.stokes * each[:, None] + places for each in (into, out))
    from_beams = (
        download_stack(session, Ruu)[:, rows_in] * (0.5 * off / (np.abs(off)[:, None] + np.abs(off))).T[rows_in]
    )
    up = columns @ from_beams[..., rows_out.ravel()]
    to_nodes = Ru[:, rows_in // STRIP, :, rows_in % STRIP].transpose(2, 0, 1, 3)
    on_nodes = (columns * signs) @ to_nodes * np.tile(signs, n_node)
    return SemiInfinite(up, on_nodes.reshape(items, -1, n), residual_found, steps_found)


@stand_in_for(_core.reflect_semi_infinite)
def reflect_semi_infinite_arrays(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills up, on_nodes, residual and steps; halves and coarse play no part: R is made up to its diagonal, from 0."""
    count = given.orders.size
    if not count or crew.stop[0]:
        return
    layer = given.coefficients, given.terms, given.albedo, given.members
    what = upload_scattering(session, given.orders, np.zeros(count), *layer)
    directions = given.directions, given.weights, given.out_places, given.in_places, given.columns
    found = reflect_semi_infinite(session, what, *directions, np.full(count, given.tolerance), crew.stop)
    for name, values in found._asdict().items():
        getattr(given, name)[...] = values
