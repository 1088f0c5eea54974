"""`python -m bench.report`: error against run time, and the figures of the radiance-factor paper."""

import argparse
import sys
from collections.abc import Sequence

from bench.study import add_study, make_command, run_command
from vrte.commands.common import join_progress, make_folder, say_written, show_progress


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures error against run time; returns the exit code."""
    command = make_command(
        "report",
        "error against run time of every method, measured on this machine",
        ("python -m bench.report --quick", "three small scenes: seconds"),
        ('python -m bench.report --scenes "Rayleigh*" -o rayleigh', "of some scenes, an HTML page and pictures"),
    )
    add_study(command, "three small scenes instead of all: seconds")
    command.add_argument(
        "--figures", action="store_true", help="figures 1 and 2 of the radiance-factor paper instead: seconds"
    )
    command.add_argument("--scenes", metavar="PATTERN", default="*", help='names, such as "Rayleigh*"; default: all')
    return run_command(command, run, arguments)


def run(options: argparse.Namespace) -> None:
    (draw_radiance_factor if options.figures else report_on_methods)(options)


def report_on_methods(options: argparse.Namespace) -> None:
    from bench.methods import measuring, page
    from bench.methods.knobs import list_curves
    from bench.methods.scenes import find_matching_scenes
    from bench.study import OthersClock

    names, lines = find_matching_scenes(options.scenes, options.quick), list_curves(options.quick)
    page.require_page()
    folder, pace = make_folder(options.output), measuring.HASTE if options.quick else measuring.FULL
    with show_progress() as (phase, tick):
        others = OthersClock()
        rows = measuring.measure(names, lines, folder, pace, join_progress(phase, tick), options.fresh)
    print(page.describe_report(rows))
    settings = f"{'quick, ' if options.quick else ''}one thread; {others.statement()}"
    for path in [folder / measuring.CSV, *page.write_page(rows, folder, settings)]:
        say_written(path)


def draw_radiance_factor(options: argparse.Namespace) -> None:
    from bench import radiance_factor

    for path in radiance_factor.write_figures(make_folder(options.output)):
        say_written(path)


if __name__ == "__main__":
    sys.exit(main())
