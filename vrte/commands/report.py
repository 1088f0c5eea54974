"""`vrte report`: error against run time, and the figures of the radiance-factor paper."""

import argparse
from typing import Any

from vrte.commands.common import add_study, made_folder, new_command, progress, say_written, told_as_one


def add(commands: Any) -> None:
    """`vrte report`."""
    command = new_command(commands, "report", run, "error against run time of every method, measured on this machine")
    add_study(command, "three small scenes instead of all: seconds")
    command.add_argument(
        "--figures", action="store_true", help="figures 1 and 2 of the radiance-factor paper instead: seconds"
    )
    command.add_argument("--scenes", metavar="PATTERN", default="*", help='names, such as "Rayleigh*"; default: all')


def run(options: argparse.Namespace) -> None:
    (radiance_factor_figures if options.figures else report_on_methods)(options)


def report_on_methods(options: argparse.Namespace) -> None:
    from vrte.studies.methods import measuring, page
    from vrte.studies.methods.knobs import curves
    from vrte.studies.methods.scenes import matching
    from vrte.studies.timing import OthersClock

    names, lines = matching(options.scenes, options.quick), curves(options.quick)
    page.require_page()
    folder, pace = made_folder(options.output), measuring.HASTE if options.quick else measuring.FULL
    with progress() as (phase, tick):
        others = OthersClock()
        rows = measuring.measure(names, lines, folder, pace, told_as_one(phase, tick), options.fresh)
    print(page.as_text(rows))
    settings = f"{'quick, ' if options.quick else ''}one thread; {others.statement()}"
    for path in [folder / measuring.CSV, *page.write_page(rows, folder, settings)]:
        say_written(path)


def radiance_factor_figures(options: argparse.Namespace) -> None:
    from vrte.studies import radiance_factor

    for path in radiance_factor.write_figures(made_folder(options.output)):
        say_written(path)
