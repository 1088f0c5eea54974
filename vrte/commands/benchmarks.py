"""`vrte benchmarks`: published scenes with surfaces, computed again to the last digit."""

import argparse
from pathlib import Path
from typing import Any

from vrte.commands.common import add_command, add_options, join_progress, make_folder, say_written, show_progress


def add(commands: Any) -> None:
    """Adds `vrte benchmarks`, which computes the benchmarks again, to the commands."""
    command = add_command(
        commands,
        "benchmarks",
        run,
        "ten scenes with surfaces to ten digits, computed again",
        ("vrte benchmarks", "all of them, compared with their tables"),
        ("vrte benchmarks --scene mirror -o again", "one of them, and its table written anew"),
    )
    command.add_argument("--scene", metavar="NAME", help="this one alone")
    command.add_argument("--folder", metavar="FOLDER", type=Path, help="where they are; default: the source tree's")
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, help="writes them there as they come out")
    add_options(command, "threads")


def run(options: argparse.Namespace) -> None:
    from vrte.studies import benchmarks

    paths = benchmarks.find_benchmarks(options.folder, options.scene)
    folder = None if options.output is None else make_folder(options.output)
    with show_progress() as (phase, tick):
        found = benchmarks.compare_benchmarks(paths, options.threads, folder, join_progress(phase, tick))
    print(benchmarks.describe_comparisons(found))
    if folder is not None:
        for path in paths:
            say_written(folder / path.name)
    benchmarks.require_unchanged(found)
