"""Saved timings in bench/history/, and a new run beside the last of them.

``python -m bench.compare save RUN.json`` keeps of a pytest-benchmark file what is compared, ``check RUN.json`` fails
where a case takes more than 1.3 times as much as in the last saved run, both counted from the LAPACK floor measured in
turn with it, the quickest round of each: what the machine does at the moment, and mostly even which machine it is,
cancels out. Of several runs the best of each case counts.
"""

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.study import find_processor_name, make_markdown_table
from vrte.basics.running import count_usable_cpus

HISTORY = Path(__file__).parent / "history"
ALLOWED = 1.3
COMPARED = "least_ratio_to_floor"  # quickest round over quickest floor: medians of equal code differ by a third here
KEPT = ("ratio_to_floor", "least_ratio_to_floor", "floor_seconds", "stage_seconds")


def main(arguments: list[str] | None = None) -> int:
    """The exit code: 0, 1 where a case has become too slow, 2 where there is nothing to compare."""
    parser = argparse.ArgumentParser(prog="bench.compare", description=__doc__)
    parser.add_argument("what", choices=("save", "check"))
    parser.add_argument("run", type=Path, nargs="+", metavar="RUN.json", help="what pytest --benchmark-json wrote")
    parser.add_argument("--history", type=Path, default=HISTORY, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    run = best([summary(json.loads(path.read_text(encoding="utf-8"))) for path in options.run])
    if not run["cases"]:
        return complain(f"{options.run[0]} has no case with a ratio to the floor")
    if options.what == "save":
        print(f"wrote {save(run, options.history)}")
        return 0
    saved = sorted(options.history.glob("*.json"))
    if not saved:
        return complain(f"{options.history.name} is empty: make bench-save writes a run to compare with")
    before = json.loads(saved[-1].read_text(encoding="utf-8"))
    print(f"against {saved[-1].name}, {before['processor']}; now {run['processor']}")
    print(table(before, run))
    slow = slower(before, run)
    for name, factor in slow.items():
        print(f"{name} takes {factor:.2f} times as much as in {saved[-1].name}, allowed {ALLOWED:g}", file=sys.stderr)
    return 1 if slow else 0


def complain(message: str) -> int:
    """One line, and the exit code."""
    print(message, file=sys.stderr)
    return 2


def summary(run: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a pytest-benchmark file: no path and no name of a machine."""
    cases = {
        case["name"]: {"median_seconds": case["stats"]["median"]}
        | {name: case["extra_info"][name] for name in KEPT if name in case["extra_info"]}
        for case in run["benchmarks"]
        if COMPARED in case["extra_info"]
    }
    return {
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "processor": find_processor_name(),
        "cores": count_usable_cpus(),
        "versions": sorted({text for case in run["benchmarks"] for text in case["extra_info"].get("versions", [])}),
        "cases": rounded(cases),
    }


def best(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The first run with each case as the run has it where it was quickest."""
    names = dict.fromkeys(name for run in runs for name in run["cases"])
    found = {name: [run["cases"][name] for run in runs if name in run["cases"]] for name in names}
    return runs[0] | {"cases": {name: min(cases, key=lambda case: case[COMPARED]) for name, cases in found.items()}}


def rounded(value: Any) -> Any:
    """Four digits of every number.

    >>> rounded({"a": [0.123456, 2]})
    {'a': [0.1235, 2]}
    """
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def save(run: dict[str, Any], folder: Path) -> Path:
    """Writes the run behind those that are there: NNNN_DATE.json."""
    folder.mkdir(exist_ok=True)
    last = max((int(path.name.partition("_")[0]) for path in folder.glob("*.json")), default=0)
    path = folder / f"{last + 1:04d}_{run['date']}.json"
    path.write_text(json.dumps(run, indent=1) + "\n", encoding="utf-8")
    return path


def factors(before: dict[str, Any], run: dict[str, Any]) -> dict[str, float]:
    """How many times its former ratio to the floor each case has, of those in both runs."""
    old, new = before["cases"], run["cases"]
    return {name: new[name][COMPARED] / old[name][COMPARED] for name in new if name in old}


def slower(before: dict[str, Any], run: dict[str, Any]) -> dict[str, float]:
    """Those above what is allowed."""
    return {name: factor for name, factor in factors(before, run).items() if not factor <= ALLOWED}


def table(before: dict[str, Any], run: dict[str, Any]) -> str:
    """A row a case of either run."""
    found = factors(before, run)
    rows = []
    for name in dict.fromkeys([*before["cases"], *run["cases"]]):
        both = (each["cases"].get(name) for each in (before, run))
        ratios = ["-" if case is None else f"{case[COMPARED]:.3f}" for case in both]
        rows.append([name, *ratios, f"{found[name]:.2f}" if name in found else "not in both"])
    return make_markdown_table(["case", "over the floor, saved", "now", "factor"], rows)


if __name__ == "__main__":
    sys.exit(main())
