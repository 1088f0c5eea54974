"""`python -m bench.cost`: figures 2 to 9 of the GPU paper, measured."""

import argparse
import sys
from collections.abc import Sequence

from bench.command_line import add_study, make_command, run_command
from vrte.commands.common import join_progress, make_folder, make_option_reader, say_written, show_progress


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the figures; returns the exit code."""
    command = make_command(
        "cost",
        "figures 2 to 9 of the GPU paper, how the cost grows, with exponents, measured on this machine",
        ("python -m bench.cost --quick", "few small scenes: seconds"),
        ("python -m bench.cost --threads 8", "OpenMP on 8 threads"),
    )
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    threads = make_option_reader("threads")
    command.add_argument("--threads", metavar="N", type=threads, default=2, help="of OpenMP; default: 2")
    return run_command(command, measure_costs, arguments)


def measure_costs(options: argparse.Namespace) -> None:
    from bench.cost import measuring, page
    from bench.cost.axes import list_axes
    from bench.timing import OthersClock
    from vrte.pictures.figures import require_pictures

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


if __name__ == "__main__":
    sys.exit(main())
