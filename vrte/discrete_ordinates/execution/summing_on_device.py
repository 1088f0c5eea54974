"""The result of a plan on an OpenCL device: sums over orders and single scattering there, what is left on the host."""

import itertools
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.cl.session import Session
from vrte.cl.sums import (
    Kernels,
    Table,
    add_orders,
    add_scattering,
    upload_azimuths,
    upload_directions,
    upload_entries,
    upload_scatterers,
)
from vrte.discrete_ordinates.execution import on_device
from vrte.discrete_ordinates.execution.on_device import Light, Task, spreads_of
from vrte.discrete_ordinates.execution.summing import Part, column_kinds, make_parts, prepare_spreading
from vrte.discrete_ordinates.orders.single_scattering import add_base_reflected, scatterers
from vrte.discrete_ordinates.planning.azimuths import Azimuths, cos_sin_deg, fold


def fill(opened: Session, task: Task, run: Run) -> list[Array]:
    """The radiance of every part of what is wanted, (n_level, n_in, n_mu, n_phi, 4, n_place)."""
    plan = task.plan
    azimuths = fold(plan.request.phi, plan.problem.leave_out.azimuths)
    spreads = spreads_of(plan)
    parts = make_parts(plan.wanted, plan.mu, spreads, azimuths.phi.size)
    for part in parts:
        for incident in shares_of(opened, part):
            fill_share(opened, task, part, incident, azimuths, run)
    for part in parts:
        finish(task, part, azimuths, run, bool(spreads.any()))
    return [part.values for part in parts]


def shares_of(opened: Session, part: Part) -> Iterator[tuple[int, int]]:
    """Incident directions of a part, as many at once as one allocation holds."""
    n_in = part.values.shape[1]
    count = min(
        n_in, max(1, math.ceil(part.values.nbytes / (on_device.LARGEST_SHARE * opened.device.max_mem_alloc_size)))
    )
    return itertools.pairwise(k * n_in // count for k in range(count + 1))


def fill_share(
    opened: Session, task: Task, part: Part, incident: tuple[int, int], azimuths: Azimuths, run: Run
) -> None:
    """Some incident directions of a part."""
    first, last = incident
    n_level, _, *rest = part.values.shape
    shape = (n_level, last - first, *rest)
    room = opened.zeros(shape)
    table = Table(room.data, shape)
    begin = time.perf_counter()
    angle: Any = azimuths.angle
    where = upload_azimuths(opened, angle, azimuths.sign, azimuths.distinct.size)
    for light in task.lights:
        add_light(opened, task, light, part, incident, azimuths, where, table)
    opened.finish()
    run.book("fourier sum", time.perf_counter() - begin)
    begin = time.perf_counter()
    scatter(opened, task, part, incident, azimuths, where, table)
    opened.finish()
    run.book("single scattering", time.perf_counter() - begin)
    begin = time.perf_counter()
    part.values[:, first:last] += opened.download(room)
    run.book("from the device", time.perf_counter() - begin)
    if run.stop[0]:
        raise KeyboardInterrupt


def add_light(
    opened: Session,
    task: Task,
    light: Light,
    part: Part,
    incident: tuple[int, int],
    azimuths: Azimuths,
    where: Any,
    table: Table,
) -> None:
    """Some orders, added into the table."""
    wanted, upload = task.plan.wanted, opened.constant
    kind: Any = column_kinds(task.plan.problem.columns)[light.columns]
    stokes: Any = light.stokes
    place: Any = wanted.place[light.columns]
    n_place = part.values.shape[5]

    def make() -> Any:
        return upload_entries(opened, stokes, kind, place, n_place, *azimuths.cos_sin(light.orders))

    tables = light.orders, stokes, kind, place, azimuths.distinct
    entries = opened.remembered(("entries", n_place, *(table.tobytes() for table in tables)), make)
    strides, data = light.kernels.strides, light.kernels.data
    kernels = Kernels(data, strides, light.kernels.first + incident[0] * strides[3])
    add_orders(
        opened,
        kernels,
        upload(np.array([light.orders.size], np.int32)),
        entries,
        where,
        upload(levels_of(light, part)),
        upload(part.rows),
        upload(np.ascontiguousarray(wanted.scale[incident[0] : incident[1]])),
        upload(light.factors),
        (0, incident[1] - incident[0]),
        table,
    )


def levels_of(light: Light, part: Part) -> IntArray:
    """Which of the light's levels are the part's: light of the top alone has one."""
    _, per_order, per_level, *_ = light.kernels.strides
    several = per_order > per_level
    return part.levels if several else np.zeros_like(part.levels)


def scatter(
    opened: Session, task: Task, part: Part, incident: tuple[int, int], azimuths: Azimuths, where: Any, table: Table
) -> None:
    """Single scattering in all layers, added into the table, but where small angles are separated."""
    plan, (first, last) = task.plan, incident
    problem, wanted = plan.problem, plan.wanted
    pairs = [
        (series, np.where(part.spreads, 0.0, wanted.scale[:, None] * path)[:, first:last])
        for series, path in scatterers(plan.request.scene.layers, problem, part.levels, part.mu)
    ]
    if not pairs:
        return
    angles = cos_sin_deg(azimuths.distinct)
    columns: Any = problem.columns, column_kinds(problem.columns), wanted.place
    directions = upload_directions(opened, problem.mu0[first:last], part.mu, *angles, *columns)
    add_scattering(opened, upload_scatterers(opened, [pairs]), directions, where, (0, last - first), table)


def finish(task: Task, part: Part, azimuths: Azimuths, run: Run, spreads: bool) -> None:
    """What the host adds: light spread by small angles, and the base's reflection of the beam."""
    plan = task.plan
    problem, wanted, scene = plan.problem, plan.wanted, plan.request.scene
    n_in = part.values.shape[1]
    if spreads:
        kind = column_kinds(problem.columns)
        prepare_spreading(wanted, scene, problem, kind, azimuths, run)(part, 0, n_in)
    begin = time.perf_counter()
    add_base_reflected(
        scene.below, problem, part.levels, part.mu, azimuths.phi, wanted.place, wanted.scale, 0, n_in, part.values
    )
    run.book("single scattering", time.perf_counter() - begin)
