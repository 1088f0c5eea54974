"""What each thing that a plan leaves out saves: `python -m vrte.studies.savings -o FOLDER`."""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import vrte
from vrte.basics.arrays import Array
from vrte.basics.running import interruptible, new_run
from vrte.calls.plan import request_of
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.orders.leave_out import EVERYTHING, LeaveOut
from vrte.discrete_ordinates.planning.plan import Plan, make_plan
from vrte.formats.atomic import atomic_write
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.studies.cost.others import OthersClock
from vrte.studies.pages import made_with, markdown_list, markdown_table, write_rows

NOTHING = LeaveOut(**{switch.name: False for switch in fields(LeaveOut)})
HEADER = (
    "left out",
    "scene",
    "unknowns",
    "without it",
    "1 thread, CPU s",
    "without it",
    "times",
    "2 threads, s",
    "without it",
    "times",
    "largest difference",
)
THREADS = (1, 2)
ENOUGH = 1.0  # seconds for the solves of a row: short ones are repeated more often than was asked for


@dataclass(frozen=True)
class Saving:
    """Something to be left out: ``what`` and ``where`` in words, the call (vrte.brdf or vrte.radiance, its scene and
    keywords), and what is not left out, or otherwise asked for, in the call that it is compared with."""

    what: str
    where: str
    kind: str
    scene: Callable[[], vrte.Scene]
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


def keeping(*names: str) -> LeaveOut:
    """All is left out but this."""
    return replace(EVERYTHING, **dict.fromkeys(names, False))


@cache
def gold() -> vrte.Particles:
    """The GPU paper's: radius 0.6 um at 400 nm."""
    return vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4)


@cache
def droplets() -> vrte.Particles:
    """A polydispersion with b2 != 0 that hardly absorbs."""
    return vrte.spheres(1.33, size=vrte.Gamma(r_eff_um=0.4, v_eff=0.1), wavelength_um=0.7)


def paper(thickness: float = 100.0, base: Any = None) -> vrte.Scene:
    """The paper's layer."""
    return vrte.Scene([vrte.Layer.of(gold(), thickness=thickness)], base)


def scalar() -> vrte.Scene:
    """Henyey and Greenstein's intensity alone."""
    return vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, terms=40), 0.95, 2.0)], vrte.Lambertian(0.2))


def rayleigh() -> vrte.Scene:
    """Molecules over a grey base."""
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 0.5)], vrte.Lambertian(0.2))


def sandwich() -> vrte.Scene:
    """Gold, a clear gap, droplets, over a grey base."""
    layers = [
        vrte.Layer.of(gold(), thickness=1.0),
        vrte.Layer(vrte.isotropic(), 0.0, 0.5),
        vrte.Layer.of(droplets(), thickness=3.0),
    ]
    return vrte.Scene(layers, vrte.Lambertian(0.2))


def pile() -> vrte.Scene:
    """Coats of two paints in turn."""
    coats = [vrte.Layer.of(particles, thickness=0.5) for particles in (gold(), droplets())]
    return vrte.Scene([*coats, *coats, *coats], vrte.Lambertian(0.2))


def deep() -> vrte.Scene:
    """Gold upon droplets: little gets through."""
    return vrte.Scene([vrte.Layer.of(gold(), thickness=30.0), vrte.Layer.of(droplets(), thickness=5.0)])


def grid(count: int, nodes: int = 40, azimuths: int = 37, **keywords: Any) -> dict[str, Any]:
    """A square table of directions."""
    mu = np.linspace(0.05, 1.0, count)
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 360.0, azimuths), "nodes": nodes} | keywords


def ray(nodes: int = 40, **keywords: Any) -> dict[str, Any]:
    """A beam seen at the top."""
    return {"mu0": 0.6, "mu": np.linspace(0.05, 1.0, 20), "phi": np.linspace(0.0, 180.0, 19), "nodes": nodes} | keywords


def thick() -> vrte.Scene:
    """Droplets that absorb: what comes out below is 1e-100 of what enters, and right."""
    return vrte.Scene([vrte.Layer(droplets().phase_matrix, 0.9, 1000.0)])


def savings(nodes: int, count: int) -> list[Saving]:
    """Every row of the table, on so many nodes and directions each way."""
    few, large = grid(max(count // 3, 1), nodes), grid(count, nodes)
    one, wide = ray(nodes), grid(count, nodes, azimuths=181)
    through = ray(nodes, mu=np.linspace(-1.0, -0.05, 20))
    slow = {"algorithm": "doubling"}
    return [
        Saving("Stokes parameters: scalar phase function", "scalar, tau 2", "brdf", scalar, few, keeping("stokes")),
        Saving("Stokes parameters: b2 = 0, order 0", "Rayleigh, tau 0.5", "brdf", rayleigh, few, keeping("stokes")),
        Saving("Stokes parameters: order 0", "gold, fluxes", "radiance", paper, one | {"mu": []}, keeping("stokes")),
        Saving("incident light that is zero: k = 2", "gold, beam", "radiance", paper, one, keeping("columns")),
        Saving("faint orders of multiple scattering", "gold", "brdf", paper, few, keeping("orders")),
        Saving("faint orders, and nodes not seen", "gold", "brdf", paper, few, keeping("orders", "nodes")),
        Saving("single scattering by orders", "gold, large table", "brdf", paper, large, keeping("single")),
        Saving("orders that carry no flux", "gold", "radiance", paper, one | {"mu": []}, keeping("fluxes", "normal")),
        Saving(
            "orders that the normal does not see",
            "gold, mu_i = 1",
            "brdf",
            paper,
            few | {"mu_i": 1.0},
            keeping("normal"),
        ),
        Saving("nodes that an order does not see", "gold", "brdf", paper, few, keeping("nodes")),
        Saving(
            "layers and bottoms that no light comes back from", "gold on droplets", "brdf", deep, few, keeping("depth")
        ),
        Saving("eigenproblems without scattering", "gold, gap, droplets", "brdf", sandwich, few, keeping("clear")),
        Saving("equal layers again", "six coats of two paints", "brdf", pile, few, keeping("repeats")),
        Saving(
            "doublings that change nothing",
            "absorbing droplets, tau 1000, light at the bottom",
            "radiance",
            thick,
            through | slow | {"tau": 1000.0},
            keeping("doublings"),
        ),
        Saving(
            "base beyond order 0",
            "gold, tau 1 on Lambertian",
            "brdf",
            lambda: paper(1.0, vrte.Lambertian(0.5)),
            few,
            keeping("base"),
        ),
        Saving("mirror images of azimuths", "gold, 181 azimuths", "brdf", paper, wide, keeping("azimuths")),
        Saving("general eigensolver", "Rayleigh, tau 0.5", "brdf", rayleigh, few, keeping("symmetric")),
        Saving("general eigensolver", "scalar, tau 2", "brdf", scalar, few, keeping("symmetric")),
        Saving("halves of symmetric products", "gold", "brdf", paper, few, keeping("halves")),
        Saving(
            "transmission",
            "gold, tau 1 on Lambertian",
            "brdf",
            lambda: paper(1.0, vrte.Lambertian(0.5)),
            large,
            asked_for={"transmission": True},
        ),
        Saving("all of these", "gold", "brdf", paper, few, NOTHING),
        Saving("all of these", "gold, gap, droplets", "brdf", sandwich, few, NOTHING),
        Saving("all of these", "Rayleigh, tau 0.5", "brdf", rayleigh, few, NOTHING),
    ]


def measure(saving: Saving, repeats: int) -> Measured:
    """Both ways, by turns, by one thread and by two; short solves more often."""
    ways = [
        (request_of(saving.kind, saving.scene(), **saving.keywords | more), leave_out)
        for more, leave_out in (({}, EVERYTHING), (saving.asked_for, saving.without))
    ]
    seconds: dict[int, tuple[float, float]] = {}
    for threads in THREADS:
        taken: list[list[float]] = [[], []]
        start = time.perf_counter()
        while len(taken[0]) < repeats or (len(taken[0]) < repeats**2 and time.perf_counter() - start < ENOUGH):
            found = [solved(*way, threads) for way in ways]
            for times, (_, _, each) in zip(taken, found, strict=True):
                times.append(each)
        seconds[threads] = median(taken[0]), median(taken[1])
    (plan, solution, _), (fuller, expected, _) = found
    return Measured(saving, seconds, (unknowns(plan), unknowns(fuller)), difference(plan, solution, expected))


def solved(request: Request, leave_out: LeaveOut, threads: int) -> tuple[Plan, Solution, float]:
    """A plan, its solution, and the seconds of both: of the processor for one thread, which others do not change, else
    those of the clock."""
    run, clock = new_run(threads), time.process_time if threads == 1 else time.perf_counter
    start = clock()
    plan = make_plan(request, run, leave_out)
    (solution,) = interruptible(run, lambda: carry_out([plan], PROCESSOR, run))
    return plan, solution, clock() - start


def unknowns(plan: Plan) -> int:
    """Of all orders and layers."""
    return sum(block.orders.size * block.problem.size * block.problem.albedo.size for block in plan.blocks)


def difference(plan: Plan, solution: Solution, expected: Solution) -> float:
    """The largest of radiance, or of fluxes where they alone are asked for."""
    if plan.request.fluxes_only:
        pairs = [
            (solution.flux_up.sum(-1), expected.flux_up.sum(-1)),
            (solution.flux_down.sum(-1), expected.flux_down.sum(-1)),
        ]
        largest = max(float(np.abs(exact).max()) for _, exact in pairs)
        return max(float(np.abs(values - exact).max()) for values, exact in pairs) / largest
    # what was not asked for has no counterpart
    return max(largest_gap(values, exact) for values, exact in zip(solution.parts, expected.parts, strict=False))


def largest_gap(values: Array, exact: Array) -> float:
    """Relative to the largest Stokes parameter at each depth; values (n_level, ...)."""
    axes = tuple(range(1, exact.ndim))
    return float((np.abs(values - exact).max(axis=axes) / np.abs(exact).max(axis=axes)).max())


def row_of(measured: Measured) -> list[str]:
    """The cells of a table."""
    cells = [measured.saving.what, measured.saving.where, *map(str, measured.unknowns)]
    for threads in THREADS:
        with_it, without = measured.seconds[threads]
        cells += [f"{with_it:.3g}", f"{without:.3g}", f"{without / with_it:.2f}"]
    return [*cells, f"{measured.difference:.0e}"]


def write(folder: Path, found: Sequence[Measured], settings: str) -> None:
    """savings.md and savings.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row_of(measured) for measured in found]
    with atomic_write(folder / "savings.md") as part:
        part.write_text(markdown_table(HEADER, rows) + "\n" + markdown_list(made_with(settings)), encoding="utf-8")
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
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m vrte.studies.savings", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("savings"), help="folder, default: savings")
    parser.add_argument("--nodes", type=int, default=40, help="of a hemisphere, default: 40")
    parser.add_argument("--directions", type=int, default=30, help="each way in large tables, default: 30")
    parser.add_argument("--repeats", type=int, default=5, help="of every solve at least, default: 5")
    given = parser.parse_args(arguments)
    clock, found = OthersClock(), []
    for saving in savings(given.nodes, given.directions):
        found.append(measure(saving, given.repeats))
        print(*row_of(found[-1]), sep="  ", flush=True)
    solves = f"{given.nodes} nodes, medians of {given.repeats} to {given.repeats**2} solves each, by turns"
    write(given.output, found, f"{solves}; {clock.statement()}")


if __name__ == "__main__":
    main()
