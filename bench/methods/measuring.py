"""Every case by every curve: seconds on one thread, errors against the reference; what is done is not done again."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from bench.methods import peers
from bench.methods.knobs import Curve, Options, Setting
from bench.methods.operations import count_operations
from bench.methods.reference import Reference, find_flux_shares, get_reference, solve_case
from bench.methods.rows import FAILED, LEFT_OUT, MEASURED, REFUSED, STOKES, Row
from bench.methods.scenes import Case, find_case
from bench.study import Records, Tick, Times, count_fitting_rounds, make_fingerprint
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, SceneError
from vrte.request.how import AUTO
from vrte.results.field import Field

CSV = "methods.csv"


@dataclass(frozen=True)
class Pace:
    """Rounds of a run: as many as fit into ``seconds``, at least ``fewest`` and at most ``most``, after a first one
    that builds and fills caches; one that takes longer than ``alone`` counts, and is the only one. A curve ends after a
    run of more than ``longest`` seconds."""

    seconds: float = 0.2
    fewest: int = 2
    most: int = 9
    alone: float = 1.0
    longest: float = 2.0


FULL, HASTE = Pace(), Pace(seconds=0.005, fewest=1, most=3)


def measure(
    names: Sequence[str], curves: Sequence[Curve], folder: Path, pace: Pace, told: Tick, fresh: bool = False
) -> list[Row]:
    """All rows, in the order of cases and curves; methods.csv in the folder has them, too. A row there that was made by
    the same settings, sources and machine is taken as it is, unless ``fresh``. Raises OSError."""
    log = Records(Row, folder / CSV)
    known = {} if fresh else log.read()
    runs = [(curve, setting) for curve in curves for setting in curve.settings]
    marks = {name: [make_run_fingerprint(find_case(name), *run) for run in runs] for name in names}
    wanted = {each for of_case in marks.values() for each in of_case}
    # what is stale goes first, so that the file never mixes versions
    log.write([row for row in known.values() if row.fingerprint in wanted])
    rows, total = list[Row](), len(names) * len(runs)
    for name in names:
        told(len(rows), total, f"{name}: reference")
        if all(each in known for each in marks[name]):  # no reference is needed
            rows += [known[each] for each in marks[name]]
            continue
        right = get_reference(find_case(name), folder)
        for curve in curves:
            for row in run_curve(find_case(name), curve, right, pace, known):
                told(len(rows), total, f"{name}: {row.curve}, {row.setting}")
                if row.fingerprint not in known:
                    log.append(row)
                rows.append(row)
    told(total, total, "pages")
    log.write(rows)
    return rows


def make_run_fingerprint(one: Case, curve: Curve, setting: Setting) -> str:
    """The fingerprint of a run."""
    return make_fingerprint(one.fingerprint, curve.key(setting))


def run_curve(one: Case, curve: Curve, right: Reference, pace: Pace, known: dict[str, Row]) -> Iterator[Row]:
    """A curve from its coarse end, as far as it is worth the time."""
    before: Row | None = None
    for setting in curve.settings:
        blank = Row(
            one.name, curve.name, curve.method, setting.label, "", fingerprint=make_run_fingerprint(one, curve, setting)
        )
        if blank.fingerprint in known:
            row = known[blank.fingerprint]
        elif before is not None and before.status.startswith(LEFT_OUT):
            row = replace(blank, status=before.status)
        elif before is not None and before.least > pace.longest:
            row = replace(blank, status=f"{LEFT_OUT}: {before.setting} took {before.least:.1f} s")
        else:
            row = run(one, curve.method, setting, right, pace, blank)
        before = row
        yield row


def run(one: Case, method: str, setting: Setting, right: Reference, pace: Pace, blank: Row) -> Row:
    """A run: refused, failed, or its seconds and errors."""
    try:
        with threadpool_limits(1):
            field, seconds = time_solve(prepare_solve(one, method, setting.options), pace)
    except SceneError as error:
        return replace(blank, status=f"{REFUSED}: {error}")
    except (AccuracyError, ArithmeticError, peers.PeerError) as error:
        return replace(blank, status=f"{FAILED}: {error}")
    taken, times = field.diagnostics["method"] if method == AUTO else method, Times.of(seconds)
    return replace(
        blank,
        method=taken,
        status=MEASURED,
        seconds=times.median,
        least=times.least,
        greatest=times.greatest,
        rounds=times.rounds,
        nodes=int(field.diagnostics.get("nodes", 0)),
        orders=int(field.diagnostics.get("orders", 0)),
        operations=count_operations(one, taken, {"method": method, **setting.options}, field),
        reference_within=right.within,
        **measure_run_errors(one, field, right, blank.is_peer),
    )


def prepare_solve(one: Case, method: str, options: Options) -> Callable[[], Field]:
    """What is timed. Raises SceneError, PeerError where a peer does not get that far."""
    if method in peers.PEERS:
        return peers.prepare_solve(method, one.asked, **options)
    return partial(solve_case, one, method=method, threads=1, **options)


def time_solve(solve: Callable[[], Field], pace: Pace) -> tuple[Field, list[float]]:
    """The field, and the seconds of each round."""
    seconds, rounds = list[float](), 1
    while len(seconds) < rounds:
        start = time.perf_counter()
        field = solve()
        seconds.append(time.perf_counter() - start)
        if len(seconds) == 1 and seconds[0] < pace.alone:
            rounds = 1 + count_fitting_rounds(seconds[0], pace.seconds, pace.fewest, pace.most)
    return field, seconds[1:] or seconds


def measure_run_errors(one: Case, field: Field, right: Reference, is_partial: bool = False) -> dict[str, Any]:
    """Of I, Q, U, V, largest and root mean square over directions (the larger of the depths), and of energy.

    ``is_partial``: what is NaN was not to be found and does not count; otherwise it makes the error NaN.
    """
    light, lost = right.gaps(one, field)
    level = np.nonzero(one.outgoing)[0]
    result = {}
    for place, letter in enumerate(STOKES):
        by_depth = [measure_gap_sizes(light[level == depth, :, place], is_partial) for depth in range(len(one.tau))]
        by_depth = [part for part in by_depth if part.size] or [np.array([np.nan])]
        result[f"{letter}_max"] = float(max(part.max() for part in by_depth))
        result[f"{letter}_rms"] = float(max(np.sqrt(np.mean(part**2)) for part in by_depth))
    if one.is_conservative and not (is_partial and np.isnan(lost).any()):
        return result | {"energy": float(abs(1.0 - find_flux_shares(one, field).sum()))}
    return result | {"energy": float(measure_gap_sizes(lost, is_partial).max())}


def measure_gap_sizes(gaps: Array, is_partial: bool) -> Array:
    """Their sizes, (any,), without those that are NaN where that is no error."""
    sizes = np.abs(gaps)
    return sizes[~np.isnan(sizes)] if is_partial else sizes.ravel()
