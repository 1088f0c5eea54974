"""`vrte stability`: stiff and extreme scenes, solved and checked."""

import argparse
from pathlib import Path
from typing import Any

from vrte.commands.common import made_folder, progress, say_written, told_as_one, whole_number
from vrte.request.request import ALGORITHMS


def add(commands: Any) -> None:
    """`vrte stability`."""
    help_text = "stiff and extreme scenes, solved and checked, as a table"
    command = commands.add_parser("stability", help=help_text, description=f"Computes {help_text}.")
    command.add_argument(
        "-o", "--output", metavar="FOLDER", type=Path, default=Path("stability"), help="made if absent"
    )
    command.add_argument("--quick", action="store_true", help="some forty small scenes instead of all")
    command.add_argument("--fresh", action="store_true", help="forget what an earlier run has finished")
    command.add_argument("--algorithm", choices=ALGORITHMS, default="auto", help="of discrete ordinates; default: auto")
    command.add_argument("--cases", metavar="PATTERN", default="*", help='names, such as "rayleigh*N=8"; default: all')
    command.add_argument(
        "--threads", metavar="N", type=whole_number(1, 1024), help="default: all CPUs that may be used"
    )
    command.add_argument(
        "--oracle", metavar="FILE", type=Path, help="answers of ball arithmetic; default: those of the source tree"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from vrte.studies.stability import oracle, table
    from vrte.studies.stability.corners import matching
    from vrte.studies.stability.run import require_all, run_cases
    from vrte.studies.stability.solving import Options

    cases, answers = matching(options.cases, options.quick), oracle.stored_table(options.oracle)
    folder, how = made_folder(options.output), Options(options.algorithm, options.threads)
    with progress() as (phase, tick):
        records = run_cases(cases, folder, answers, how, options.fresh, told_as_one(phase, tick))
    print(table.as_text(records))
    print("" if answers else f"\n  {oracle.MISSING}\n")
    settings = f"{'quick, ' if options.quick else ''}cases {options.cases}, algorithm {options.algorithm}"
    for path in table.write_tables(records, folder, settings if answers else f"{settings}, {oracle.MISSING}"):
        say_written(path)
    require_all(records)
