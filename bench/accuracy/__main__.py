"""Runs the sweep and writes accuracy.csv, accuracy.md and accuracy.png; 1 if a request was not kept."""

import argparse
import sys
from collections.abc import Sequence

from bench import accuracy
from bench.accuracy import page, sweep
from vrte.pictures.figures import require_pictures


def main(arguments: Sequence[str] | None = None) -> int:
    """Asks all scenes for their accuracies and writes what came; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.accuracy", description=accuracy.__doc__)
    parser.add_argument("-o", "--output", required=True, metavar="FOLDER", help="an existing folder")
    parser.add_argument("--quick", action="store_true", help="a few small scenes, every third request")
    options = parser.parse_args(arguments)
    require_pictures()
    names = [name for name in sweep.PROBES if not options.quick or name.startswith(sweep.QUICK)]
    step = 3 if options.quick else 1
    outcomes = []
    for given, requests in ((True, sweep.GIVEN), (False, sweep.CHOSEN)):
        for outcome in sweep.measure_outcomes(names, given, requests[::step]):
            outcomes.append(outcome)
            print(page.describe_outcome(outcome), flush=True)
    for path in page.write_pages(outcomes, options.output):
        print(path)
    return 0 if all(outcome.kept for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
