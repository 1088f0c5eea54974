"""`python -m bench.tables`: the tables and figure 1 of the GPU paper, measured."""

import argparse
import sys
from collections.abc import Sequence

from bench.command_line import add_study, make_command, run_command
from vrte.commands.common import join_progress, make_folder, make_option_reader, say_written, show_progress


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the tables; returns the exit code."""
    command = make_command(
        "tables",
        "the tables and figure 1 of the GPU paper, measured on this machine",
        ("python -m bench.tables --quick", "small scenes instead of the paper's: seconds"),
        ('python -m bench.tables --configurations "2,5"', "these alone: one that this machine cannot run is an error"),
    )
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    threads = make_option_reader("threads")
    command.add_argument("--threads", metavar="N", type=threads, default=2, help="of OpenMP; default: 2")
    return run_command(command, measure_paper_tables, arguments)


def measure_paper_tables(options: argparse.Namespace) -> None:
    from bench.tables import configurations, measuring, page, paper, processes
    from bench.timing import OthersClock
    from vrte.pictures.figures import require_pictures

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


if __name__ == "__main__":
    sys.exit(main())
