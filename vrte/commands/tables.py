"""`vrte tables`: the tables and the cost figures of the GPU paper, measured."""

import argparse
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import (
    add_command,
    add_study,
    join_progress,
    make_folder,
    make_option_reader,
    say_written,
    show_progress,
)


def add(commands: Any) -> None:
    """Adds `vrte tables`, which measures the tables and figures of the GPU paper, to the commands."""
    command = add_command(
        commands,
        "tables",
        run,
        "the tables and figures of the GPU paper, measured on this machine",
        ("vrte tables --quick", "small scenes instead of the paper's: seconds"),
        ("vrte tables --figures --quick -o cost", "how the cost grows, in small"),
    )
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    command.add_argument(
        "--figures", action="store_true", help="figures 2 to 9 instead: how the cost grows, with exponents"
    )
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    command.add_argument(
        "--threads", metavar="N", type=make_option_reader("threads"), default=2, help="of OpenMP; default: 2"
    )


def run(options: argparse.Namespace) -> None:
    if options.figures and options.configurations is not None:
        raise SceneError("--configurations goes with the tables, not with --figures", "tables")
    (measure_costs if options.figures else measure_paper_tables)(options)


def measure_paper_tables(options: argparse.Namespace) -> None:
    from vrte.pictures.figures import require_pictures
    from vrte.studies.tables import configurations, measuring, page, paper, processes
    from vrte.studies.timing import OthersClock

    chosen, refused = configurations.choose_configurations(options.configurations)
    require_pictures()
    folder, rounds = make_folder(options.output), measuring.ROUNDS_QUICK if options.quick else measuring.ROUNDS
    with show_progress() as (phase, tick), processes.start_processes(each.simd for each in chosen) as children:
        others = OthersClock(lambda: sum(child.cpu_seconds for child in children.values()))
        problems, told = paper.list_problems(options.quick), join_progress(phase, tick)
        found = measuring.measure(children, problems, chosen, options.threads, rounds, told)
        facts = processes.describe_processes(children, chosen)
    busy = others.statement()
    print(page.describe_times(found))
    print("".join(f"  {text}\n" for text in [*(f"not measured: {reason}" for reason in refused), busy]))
    settings = f"{'quick, ' if options.quick else ''}{rounds} rounds, OpenMP on {options.threads} threads; {busy}"
    for path in page.write_page(found, folder, settings, facts, refused):
        say_written(path)
    measuring.require_right_answers(found)


def measure_costs(options: argparse.Namespace) -> None:
    from vrte.pictures.figures import require_pictures
    from vrte.studies.cost import measuring, page
    from vrte.studies.cost.axes import list_axes
    from vrte.studies.timing import OthersClock

    configurations, left_out = (
        measuring.list_configurations(options.threads),
        measuring.explain_missing_configurations(),
    )
    require_pictures()
    varied, folder = list_axes(options.quick), make_folder(options.output)
    seconds_a_point = measuring.SECONDS_A_POINT_QUICK if options.quick else measuring.SECONDS_A_POINT
    with show_progress() as (phase, tick):
        others = OthersClock()
        measurements = measuring.measure(varied, configurations, seconds_a_point, join_progress(phase, tick))
    names = [configuration.name for configuration in configurations]
    print(page.describe_exponents(measurements, varied, names))
    said = "; ".join([others.statement(), *(f"not measured: {reason}" for reason in left_out)])
    print(f"  {said}\n")
    settings = f"{'quick, ' if options.quick else ''}{' against '.join(names)}; {said}"
    for path in page.write_page(measurements, varied, names, folder, settings):
        say_written(path)
