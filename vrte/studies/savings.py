"""What each thing that a plan leaves out saves: `python -m vrte.studies.savings -o FOLDER`."""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.running import run_interruptible, start_run
from vrte.calls.plan import make_request
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.orders.leave_out import EVERYTHING, LeaveOut
from vrte.discrete_ordinates.planning.plan import Plan, make_plan
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.studies import cases
from vrte.studies.pages import list_run_facts, make_markdown_list, make_markdown_table, write_rows, write_text
from vrte.studies.timing import OthersClock

NOTHING = LeaveOut(**{switch.name: False for switch in fields(LeaveOut)})
HEADER = (
    *("left out", "scene", "unknowns", "without it", "1 thread, CPU s", "without it", "times"),
    *("2 threads, s", "without it", "times", "largest difference"),
)
THREADS = (1, 2)
ENOUGH = 1.0  # seconds for the solves of a row: short ones are repeated more often than was asked for


@dataclass(frozen=True)
class Saving:
    """Something to be left out: ``what`` and ``where`` in words, the scene by its name in `cases`, the keywords of the
    call (of vrte.brdf or vrte.radiance), and what is not left out, or otherwise asked for, in the call that it is
    compared with."""

    what: str
    where: str
    scene: str
    keywords: dict[str, Any]
    without: LeaveOut = EVERYTHING
    asked_for: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Measured:
    """Seconds (thread count: with, without), unknowns of all orders and layers, and the largest difference of the
    answers, relative, depth by depth, to the largest Stokes parameter there."""

    saving: Saving
    seconds: dict[int, tuple[float, float]]
    unknowns: tuple[int, int]
    difference: float


def leave_out_all_but(*names: str) -> LeaveOut:
    """All is left out but this."""
    return replace(EVERYTHING, **dict.fromkeys(names, False))


def make_grid_keywords(count: int, nodes: int = 40, azimuths: int = 37, **keywords: Any) -> dict[str, Any]:
    """A square table of directions."""
    mu = np.linspace(0.05, 1.0, count)
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 360.0, azimuths), "nodes": nodes} | keywords


def make_ray_keywords(nodes: int = 40, **keywords: Any) -> dict[str, Any]:
    """A beam seen at the top."""
    return {"mu0": 0.6, "mu": np.linspace(0.05, 1.0, 20), "phi": np.linspace(0.0, 180.0, 19), "nodes": nodes} | keywords


def list_savings(nodes: int, count: int) -> list[Saving]:
    """Every row of the table, on so many nodes and directions each way."""
    few, large = make_grid_keywords(max(count // 3, 1), nodes), make_grid_keywords(count, nodes)
    one, wide = make_ray_keywords(nodes), make_grid_keywords(count, nodes, azimuths=181)
    through = make_ray_keywords(nodes, mu=np.linspace(-1.0, -0.05, 20), algorithm="doubling", tau=1000.0)
    fluxes, rayleigh, scalar, based = (
        one | {"mu": []},
        "Rayleigh, tau 0.5",
        "scalar, tau 2",
        "gold, tau 1 on Lambertian",
    )
    # what is left out, the scene by its name in cases, what is asked of it in words and in keywords, and what is not
    # left out, or otherwise asked for, in the call that it is compared with
    rows: list[tuple[str, str, str, dict[str, Any], LeaveOut | dict[str, Any]]] = [
        ("Stokes parameters: scalar phase function", scalar, "", few, leave_out_all_but("stokes")),
        ("Stokes parameters: b2 = 0, order 0", rayleigh, "", few, leave_out_all_but("stokes")),
        ("Stokes parameters: order 0", "gold", "fluxes", fluxes, leave_out_all_but("stokes")),
        ("incident light that is zero: k = 2", "gold", "beam", one, leave_out_all_but("columns")),
        ("faint orders of multiple scattering", "gold", "", few, leave_out_all_but("orders")),
        ("faint orders, and nodes not seen", "gold", "", few, leave_out_all_but("orders", "nodes")),
        ("single scattering by orders", "gold", "large table", large, leave_out_all_but("single")),
        ("orders that carry no flux", "gold", "", fluxes, leave_out_all_but("fluxes", "normal")),
        ("orders that the normal does not see", "gold", "mu_i = 1", few | {"mu_i": 1.0}, leave_out_all_but("normal")),
        ("nodes that an order does not see", "gold", "", few, leave_out_all_but("nodes")),
        ("layers and bottoms that no light comes back from", "gold on droplets", "", few, leave_out_all_but("depth")),
        ("eigenproblems without scattering", "gold, gap, droplets", "", few, leave_out_all_but("clear")),
        ("equal layers again", "six coats of two paints", "", few, leave_out_all_but("repeats")),
        (
            *("doublings that change nothing", "absorbing droplets, tau 1000", "light at the bottom"),
            *(through, leave_out_all_but("doublings")),
        ),
        ("base beyond order 0", based, "", few, leave_out_all_but("base")),
        ("mirror images of azimuths", "gold", "181 azimuths", wide, leave_out_all_but("azimuths")),
        ("general eigensolver", rayleigh, "", few, leave_out_all_but("symmetric")),
        ("general eigensolver", scalar, "", few, leave_out_all_but("symmetric")),
        ("halves of symmetric products", "gold", "", few, leave_out_all_but("halves")),
        ("transmission", based, "", large, {"transmission": True}),
        ("all of these", "gold", "", few, NOTHING),
        ("all of these", "gold, gap, droplets", "", few, NOTHING),
        ("all of these", rayleigh, "", few, NOTHING),
    ]
    return [
        Saving(what, ", ".join(filter(None, (scene, words))), scene, keywords, without)
        if isinstance(without, LeaveOut)
        else Saving(what, ", ".join(filter(None, (scene, words))), scene, keywords, asked_for=without)
        for what, scene, words, keywords, without in rows
    ]


def measure_saving(saving: Saving, repeats: int) -> Measured:
    """Both ways, by turns, by one thread and by two; short solves more often."""
    kind = "radiance" if "mu0" in saving.keywords else "brdf"
    ways = [
        (make_request(kind, cases.find_scene(saving.scene), **saving.keywords | more), leave_out)
        for more, leave_out in (({}, EVERYTHING), (saving.asked_for, saving.without))
    ]
    seconds: dict[int, tuple[float, float]] = {}
    for threads in THREADS:
        taken: list[list[float]] = [[], []]
        start = time.perf_counter()
        while len(taken[0]) < repeats or (len(taken[0]) < repeats**2 and time.perf_counter() - start < ENOUGH):
            found = [solve_and_time(*way, threads) for way in ways]
            for times, (_, _, each) in zip(taken, found, strict=True):
                times.append(each)
        seconds[threads] = median(taken[0]), median(taken[1])
    (plan, solution, _), (fuller, expected, _) = found
    return Measured(
        saving, seconds, (count_unknowns(plan), count_unknowns(fuller)), measure_difference(plan, solution, expected)
    )


def solve_and_time(request: Request, leave_out: LeaveOut, threads: int) -> tuple[Plan, Solution, float]:
    """A plan, its solution, and the seconds of both: of the processor for one thread, which others do not change, else
    those of the clock."""
    run, clock = start_run(threads), time.process_time if threads == 1 else time.perf_counter
    start = clock()
    plan = make_plan(request, run, leave_out)
    (solution,) = run_interruptible(run, lambda: carry_out([plan], PROCESSOR, run))
    return plan, solution, clock() - start


def count_unknowns(plan: Plan) -> int:
    """Of all orders and layers."""
    return sum(block.orders.size * block.problem.size * block.problem.albedo.size for block in plan.blocks)


def measure_difference(plan: Plan, solution: Solution, expected: Solution) -> float:
    """The largest of radiance, or of fluxes where they alone are asked for."""
    if plan.request.fluxes_only:
        pairs = [
            (solution.flux_up.sum(-1), expected.flux_up.sum(-1)),
            (solution.flux_down.sum(-1), expected.flux_down.sum(-1)),
        ]
        largest = max(float(np.abs(exact).max()) for _, exact in pairs)
        return max(float(np.abs(values - exact).max()) for values, exact in pairs) / largest
    # what was not asked for has no counterpart
    return max(find_largest_gap(values, exact) for values, exact in zip(solution.parts, expected.parts, strict=False))


def find_largest_gap(values: Array, exact: Array) -> float:
    """Relative to the largest Stokes parameter at each depth; values (n_level, ...)."""
    axes = tuple(range(1, exact.ndim))
    return float((np.abs(values - exact).max(axis=axes) / np.abs(exact).max(axis=axes)).max())


def make_table_row(measured: Measured) -> list[str]:
    """The cells of a table."""
    cells = [measured.saving.what, measured.saving.where, *map(str, measured.unknowns)]
    for threads in THREADS:
        with_it, without = measured.seconds[threads]
        cells += [f"{with_it:.3g}", f"{without:.3g}", f"{without / with_it:.2f}"]
    return [*cells, f"{measured.difference:.0e}"]


def write_savings(folder: Path, found: Sequence[Measured], settings: str) -> None:
    """savings.md and savings.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [make_table_row(measured) for measured in found]
    write_text(
        folder / "savings.md", make_markdown_table(HEADER, rows) + "\n" + make_markdown_list(list_run_facts(settings))
    )
    names = ("left_out", "scene", "unknowns", "unknowns_without")
    timed = [f"seconds{without}_{threads}" for threads in THREADS for without in ("", "_without")]
    write_rows(
        folder / "savings.csv",
        [*names, *timed, "difference"],
        [
            [m.saving.what, m.saving.where, *m.unknowns, *(s for t in THREADS for s in m.seconds[t]), m.difference]
            for m in found
        ],
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures every saving and writes the table of them."""
    parser = argparse.ArgumentParser(prog="python -m vrte.studies.savings", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("savings"), help="folder, default: savings")
    parser.add_argument("--nodes", type=int, default=40, help="of a hemisphere, default: 40")
    parser.add_argument("--directions", type=int, default=30, help="each way in large tables, default: 30")
    parser.add_argument("--repeats", type=int, default=5, help="of every solve at least, default: 5")
    given = parser.parse_args(arguments)
    clock, found = OthersClock(), []
    for saving in list_savings(given.nodes, given.directions):
        found.append(measure_saving(saving, given.repeats))
        print(*make_table_row(found[-1]), sep="  ", flush=True)
    solves = f"{given.nodes} nodes, medians of {given.repeats} to {given.repeats**2} solves each, by turns"
    write_savings(given.output, found, f"{solves}; {clock.statement()}")


if __name__ == "__main__":
    main()
