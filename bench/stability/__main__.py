"""`python -m bench.stability`: stiff and extreme scenes, solved and checked."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bench.study import add_study, make_command, run_command
from vrte.commands.common import add_options, join_progress, make_folder, say_written, show_progress
from vrte.request.how import OPTIONS


def main(arguments: Sequence[str] | None = None) -> int:
    """Solves and checks stiff and extreme scenes; returns the exit code."""
    command = make_command(
        "stability",
        "stiff and extreme scenes, solved and checked, as a table",
        ("python -m bench.stability --quick", "some forty small scenes: under a minute"),
        ('python -m bench.stability --cases "rayleigh*N=8" -o rayleigh', "those of one name, into a folder"),
    )
    add_study(command, "some forty small scenes instead of all")
    add_options(command, "algorithm", "threads")
    command.add_argument("--cases", metavar="PATTERN", default="*", help='names, such as "rayleigh*N=8"; default: all')
    command.add_argument(
        "--oracle", metavar="FILE", type=Path, help="answers of ball arithmetic; default: those of the tests"
    )
    command.set_defaults(algorithm=OPTIONS["algorithm"].default)
    return run_command(command, run, arguments)


def run(options: argparse.Namespace) -> None:
    from bench.stability import oracle, table
    from bench.stability.corners import find_matching_cases
    from bench.stability.run import require_all, run_cases
    from bench.stability.solving import Options

    cases, answers = find_matching_cases(options.cases, options.quick), oracle.read_oracle_table(options.oracle)
    folder, how = make_folder(options.output), Options(options.algorithm, options.threads)
    with show_progress() as (phase, tick):
        records = run_cases(cases, folder, answers, how, options.fresh, join_progress(phase, tick))
    print(table.describe_records(records))
    print("" if answers else f"\n  {oracle.MISSING}\n")
    settings = f"{'quick, ' if options.quick else ''}cases {options.cases}, algorithm {options.algorithm}"
    for path in table.write_tables(records, folder, settings if answers else f"{settings}, {oracle.MISSING}"):
        say_written(path)
    require_all(records)


if __name__ == "__main__":
    sys.exit(main())
