"""`vrte stability`: stiff and extreme scenes, solved and checked."""

import argparse
from pathlib import Path
from typing import Any

from vrte.commands.common import (
    add_command,
    add_options,
    add_study,
    join_progress,
    make_folder,
    say_written,
    show_progress,
)
from vrte.request.how import OPTIONS


def add(commands: Any) -> None:
    """Adds `vrte stability`, which solves and checks stiff and extreme scenes, to the commands."""
    command = add_command(
        commands,
        "stability",
        run,
        "stiff and extreme scenes, solved and checked, as a table",
        ("vrte stability --quick", "some forty small scenes: under a minute"),
        ('vrte stability --cases "rayleigh*N=8" -o rayleigh_cases', "those of one name, into a folder of that name"),
    )
    add_study(command, "some forty small scenes instead of all")
    add_options(command, "algorithm", "threads")
    command.add_argument("--cases", metavar="PATTERN", default="*", help='names, such as "rayleigh*N=8"; default: all')
    command.add_argument(
        "--oracle", metavar="FILE", type=Path, help="answers of ball arithmetic; default: those of the source tree"
    )
    command.set_defaults(algorithm=OPTIONS["algorithm"].default)


def run(options: argparse.Namespace) -> None:
    from vrte.studies.stability import oracle, table
    from vrte.studies.stability.corners import find_matching_cases
    from vrte.studies.stability.run import require_all, run_cases
    from vrte.studies.stability.solving import Options

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
