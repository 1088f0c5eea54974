"""`vrte tables`: the tables and the cost figures of the GPU paper, measured."""

import argparse
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import add_study, made_folder, new_command, progress, say_written, told_as_one, value_of


def add(commands: Any) -> None:
    """`vrte tables`."""
    command = new_command(commands, "tables", run, "the tables and figures of the GPU paper, measured on this machine")
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    command.add_argument(
        "--figures", action="store_true", help="figures 2 to 9 instead: how the cost grows, with exponents"
    )
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    command.add_argument("--threads", metavar="N", type=value_of("threads"), default=2, help="of OpenMP; default: 2")


def run(options: argparse.Namespace) -> None:
    if options.figures and options.configurations is not None:
        raise SceneError("--configurations goes with the tables, not with --figures")
    (cost_figures if options.figures else paper_tables)(options)


def paper_tables(options: argparse.Namespace) -> None:
    from vrte.pictures.figures import require_pictures
    from vrte.studies.tables import configurations, measuring, page, paper, processes
    from vrte.studies.timing import OthersClock

    chosen, refused = configurations.chosen(options.configurations)
    require_pictures()
    folder, rounds = made_folder(options.output), measuring.ROUNDS_QUICK if options.quick else measuring.ROUNDS
    with progress() as (phase, tick), processes.started(each.simd for each in chosen) as children:
        others = OthersClock(lambda: sum(child.cpu_seconds for child in children.values()))
        problems, told = paper.problems(options.quick), told_as_one(phase, tick)
        found = measuring.measure(children, problems, chosen, options.threads, rounds, told)
        facts = processes.facts(children, chosen)
    busy = others.statement()
    print(page.as_text(found))
    print("".join(f"  {text}\n" for text in [*(f"not measured: {reason}" for reason in refused), busy]))
    settings = f"{'quick, ' if options.quick else ''}{rounds} rounds, OpenMP on {options.threads} threads; {busy}"
    for path in page.write_page(found, folder, settings, facts, refused):
        say_written(path)
    measuring.require_all(found)


def cost_figures(options: argparse.Namespace) -> None:
    from vrte.pictures.figures import require_pictures
    from vrte.studies.cost import measuring, page
    from vrte.studies.cost.axes import axes
    from vrte.studies.timing import OthersClock

    configurations, left_out = measuring.configurations(options.threads), measuring.left_out()
    require_pictures()
    varied, folder = axes(options.quick), made_folder(options.output)
    seconds_a_point = measuring.SECONDS_A_POINT_QUICK if options.quick else measuring.SECONDS_A_POINT
    with progress() as (phase, tick):
        others = OthersClock()
        measurements = measuring.measure(varied, configurations, seconds_a_point, told_as_one(phase, tick))
    names = [configuration.name for configuration in configurations]
    print(page.as_text(measurements, varied, names))
    said = "; ".join([others.statement(), *(f"not measured: {reason}" for reason in left_out)])
    print(f"  {said}\n")
    settings = f"{'quick, ' if options.quick else ''}{' against '.join(names)}; {said}"
    for path in page.write_page(measurements, varied, names, folder, settings):
        say_written(path)
