"""Reconstruction on a device: the field at any depth and direction from the modes, (1:36)-(1:38)."""

from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.matrices import make_stack, multiply_stacks, pad_to_strips, upload_stack
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

OF_ORDERS = "lam_re", "lam_im", "c", "zeta", "even", "odd", "decaying"  # arrays of modes, orders first
MOST_DOUBLES = 1 << 26  # doubles of scratch memory for a group of orders, beside the caller's arrays


@stand_in_for(_core.reconstruct)
def reconstruct(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills out (order, n_level, n_rhs, S n_out): radiance times 2 pi for a unit beam, without singly scattered light;
    rows of light going up come first, flipped by D. As many orders are done at once as scratch memory is meant for, and
    none once the crew is stopped."""
    (orders, n_level, n_rhs, rows), (_, layers, n) = given.out.shape, given.lam_re.shape
    doubles = layers * (2 * n * pad_to_strips(rows) + n_rhs * rows) + (n_level + layers) * n_rhs * n
    each = max(1, MOST_DOUBLES // max(1, doubles))
    for first in range(0, orders if given.out.size else 0, each):
        if crew.stop[0]:
            break
        here = slice(first, first + each)
        given.out[here] = reconstruct_orders(session, given, here)


def reconstruct_orders(session: Session, given: Any, here: slice) -> Array:
    """The same of some of the orders."""

    (orders, layers, n), out_shape = given.lam_re[here].shape, given.out[here].shape
    _, n_level, n_rhs, rows = out_shape
    n_in, n_out, n_stop, empty = given.mu0.size, given.mu_out.size, n_level + layers, session.empty
    lit = [make_stack(session, orders * layers, rows, n, bare=True) for _ in range(2)]
    for made, *names in zip(lit, ("G_E", "G_F"), ("X", "Y"), strict=True):
        left, right = (getattr(given, name)[here].reshape(orders * layers, n, -1) for name in names)
        multiply_stacks(session, upload_stack(session, left), upload_stack(session, right), made)
    known = vars(given) | {name: session.upload(getattr(given, name)[here]) for name in OF_ORDERS}
    known["fed"], out, part = empty((orders, n_stop, n_rhs, n)), empty(out_shape), empty((orders, layers, n_rhs, rows))
    session.launch("feed_modes", (n_stop, n_in, orders), known, n_level=n_level)
    size, stokes = (n_out, n_stop if layers > 1 else n_level, orders), rows // n_out
    session.launch("sum_sources", size, known, stokes=stokes, lit_e=lit[0], lit_f=lit[1], out=out, part=part)
    if layers == 1 and (given.base_row < 0).all():
        return session.download(out)
    found, sources = session.download_all([out, part])
    pass_layers(given, here, found, sources)
    return found


def pass_layers(given: Any, here: slice, out: Array, sources: Array) -> None:
    """Adds what enters each layer, attenuated: from the base up through the layers, and from the top down. sources
    (order, layer, n_rhs, rows): what each layer sends to the next one."""
    stokes, rows = out.shape[3] // given.mu_out.size, given.base_row[here]
    mu, lit = np.repeat(given.mu_out, stokes), rows >= 0
    for upward in (True, False):
        part = slice(0, stokes * given.n_up) if upward else slice(stokes * given.n_up, None)
        running = np.zeros_like(out[:, 0, :, part])
        if upward and lit.any():
            running[lit] = given.base_down[here][lit] @ given.base_out[rows[lit]][..., part]
        for layer in range(given.thickness.size)[:: -1 if upward else 1]:
            for t in np.flatnonzero(given.level_layer == layer):
                left = given.thickness[layer] - given.level[t] if upward else given.level[t]
                out[:, t, :, part] += np.exp(-left / mu[part]) * running
            running = np.exp(-given.thickness[layer] / mu[part]) * running + sources[:, layer, :, part]
