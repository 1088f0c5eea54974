"""`vrte tables`: the tables and the cost figures of the GPU paper, measured."""

import argparse
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import made_folder, progress, say_written, told_as_one, whole_number


def add(commands: Any) -> None:
    """`vrte tables`."""
    help_text = "the tables and figures of the GPU paper, measured on this machine"
    command = commands.add_parser("tables", help=help_text, description=f"Computes {help_text}.")
    command.add_argument(
        "--figures", action="store_true", help="figures 2 to 9 instead: how the cost grows, with exponents"
    )
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=Path("tables"), help="made if absent")
    command.add_argument("--quick", action="store_true", help="few small scenes instead of the paper's: seconds")
    command.add_argument("--threads", metavar="N", type=whole_number(1, 1024), default=2, help="of OpenMP; default: 2")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    if options.figures and options.configurations is not None:
        raise SceneError("--configurations goes with the tables, not with --figures")
    (cost_figures if options.figures else paper_tables)(options)


def paper_tables(options: argparse.Namespace) -> None:
    from vrte.studies import tables
    from vrte.studies.cost import OthersClock, require_pictures

    chosen, refused = tables.chosen(options.configurations)
    require_pictures()
    folder, rounds = made_folder(options.output), tables.ROUNDS_QUICK if options.quick else tables.ROUNDS
    with progress() as (phase, tick), tables.started(each.simd for each in chosen) as children:
        others = OthersClock(lambda: sum(child.cpu_seconds for child in children.values()))
        found = tables.measure(
            children, tables.problems(options.quick), chosen, options.threads, rounds, told_as_one(phase, tick)
        )
        facts = tables.facts(children, chosen)
    busy = others.statement()
    print(tables.as_text(found))
    print("".join(f"  {text}\n" for text in [*(f"not measured: {reason}" for reason in refused), busy]))
    settings = f"{'quick, ' if options.quick else ''}{rounds} rounds, OpenMP on {options.threads} threads; {busy}"
    for path in [tables.write_figure(found, folder), *tables.write_page(found, folder, settings, facts, refused)]:
        say_written(path)
    tables.require_all(found)


def cost_figures(options: argparse.Namespace) -> None:
    from vrte.studies import cost

    configurations = cost.configurations(options.threads)
    cost.require_pictures()
    axes, folder = cost.axes(options.quick), made_folder(options.output)
    seconds_a_point = cost.SECONDS_A_POINT_QUICK if options.quick else cost.SECONDS_A_POINT
    with progress() as (phase, tick):
        others = cost.OthersClock()
        measurements = cost.measure(axes, configurations, seconds_a_point, told_as_one(phase, tick))
    busy = others.statement()
    names = [configuration.name for configuration in configurations]
    print(cost.as_text(measurements, axes, names))
    said = "; ".join([busy, *(f"not measured: {reason}" for reason in cost.left_out())])
    print(f"  {said}\n")
    settings = f"{'quick, ' if options.quick else ''}{' against '.join(names)}; {said}"
    written = cost.write_figures(measurements, axes, names, folder)
    for path in [*written, *cost.write_page(measurements, axes, names, folder, settings)]:
        say_written(path)
