"""Regenerates the oracle's answers that bench.stability compares with: python -m tests.oracle_table [--fresh].

About an hour on two cores; what the table holds already and still fits its scene is kept.
"""

import math
import multiprocessing
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from bench.cases import LOBE_AMPLITUDE, LOBE_MATRIX, LOBE_WIDTH_DEG
from bench.stability import TABLE, restore_case, store_case
from bench.stability_cases import Case, list_oracle_cases
from vrte.formats.atomic import write_atomically

from .ball_oracle import DoubtfulError, Layer, Request, field_order, mueller_lobe_orders, sensitivity

SAVE_EVERY = 60.0  # seconds
Arrays = dict[str, np.ndarray]


def request_of(case: Case, order: int) -> Request:
    """A case of the stability table as the oracle takes it."""
    lobe = mueller_lobe_orders(LOBE_WIDTH_DEG, LOBE_AMPLITUDE, LOBE_MATRIX)
    return Request(
        order=order,
        layers=tuple(Layer(*layer) for layer in case.layers),
        base=lobe if case.base == "lobe" else case.base,
        mu0=(case.mu0,),
        mu=tuple(case.mu),
        levels=tuple(case.levels),
        nodes=case.nodes,
    )


def answers(case: Case) -> Arrays:
    """The case's answers by key; a case without a stable answer has its hash alone."""
    found: Arrays = {f"{case.name}/hash": np.array(case.key)}
    requests = {m: request_of(case, m) for m in case.orders}
    try:
        orders = {m: field_order(request) for m, request in requests.items()}
        size = np.max([np.abs(answer.radiance[..., 0]).max(axis=(0, 2)) for answer in orders.values()], axis=0)
        c = {m: sensitivity(requests[m], answer, size) for m, answer in orders.items()}
    except DoubtfulError:
        return found
    for m, answer in orders.items():
        found[f"{case.name}/{m}/radiance"] = answer.radiance
        found[f"{case.name}/{m}/c"] = np.array(c[m])
    found[f"{case.name}/flux_up"], found[f"{case.name}/flux_down"] = orders[0].flux_up, orders[0].flux_down
    return found


def effort(case: Case) -> float:
    """Roughly proportional to the time it takes: cheap cases first."""
    bits = 3.0 if math.isinf(case.thickness) and any(slab.albedo == 1.0 for slab in case.slabs) else 1.0
    kinds = len({(slab.phase, slab.albedo, slab.thickness) for slab in case.slabs})
    return bits * kinds * (case.nodes + 4.0) ** 3


def stored(path: Path, cases: Iterable[Case]) -> Arrays:
    """What the table holds for these cases as they are now, and the phase matrices of all."""
    if not path.is_file():
        return {}
    with np.load(path) as table:
        everything = dict(table)
    kept = ["phase", *(case.name for case in cases if str(everything.get(f"{case.name}/hash")) == case.key)]
    return {key: values for key, values in everything.items() if key.split("/")[0] in kept}


def save(path: Path, table: Arrays) -> None:
    """All of it or nothing."""
    with write_atomically(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **table)


def main(fresh: bool = False, path: Path = TABLE) -> None:
    """Works out what is missing, two cases at a time."""
    cases = list_oracle_cases()
    table = {} if fresh else stored(path, cases)
    missing = sorted((case for case in cases if f"{case.name}/hash" not in table), key=effort)
    for case in missing:
        table = store_case(case) | table
    missing = [restore_case(case, table) for case in missing]
    print(f"{len(cases)} cases, {len(missing)} to do", flush=True)
    saved = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for done, found in enumerate(pool.imap_unordered(answers, missing), 1):
            table.update(found)
            if time.monotonic() - saved > SAVE_EVERY:
                save(path, table)
                saved = time.monotonic()
                print(f"{done} of {len(missing)}", flush=True)
    save(path, table)


if __name__ == "__main__":
    main("--fresh" in sys.argv[1:])
