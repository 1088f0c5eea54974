"""The rule table of method="auto" against the runs of a report: `python -m bench.rules METHODS.csv`.

Prints what each rule would take, and every disagreement: a run that is named as evidence and was not good enough or not
quicker, nodes that were not enough, a scene where another method than the last rule's was the quickest. After a new
report: run it, and where it disagrees change vrte/methods/parts/auto.py.
"""

import csv
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from bench.methods import CASES, EXPONENTS, PHI, Case, Row, find_case, group_rows
from bench.methods_page import HEADER, TARGETS, find_quickest_candidate, find_reference_uncertainty, make_score_rows
from bench.study import Records, make_markdown_table
from vrte.calls.plan import make_request
from vrte.methods.parts.auto import RULES, Rule, find_rule
from vrte.request.how import AUTO, EXACT, METHODS
from vrte.request.request import Request

BY_HAND, BY_ACCURACY = f"{EXACT}, modes", f"{EXACT}, accuracy"


def read_report_rows(path: Path) -> list[Row]:
    """The rows of any version's report: columns are found by name, those that it does not have stay empty. Raises
    OSError, ValueError."""
    readers = Records(Row, path).readers
    with open(path, encoding="utf-8", newline="") as file:
        return [
            Row(**{name: readers[name](text) for name, text in line.items() if name in readers})
            for line in csv.DictReader(file)
        ]


def make_case_request(one: Case, accuracy: float, method: str = AUTO) -> Request:
    """The report's request, with the method that auto takes, or another."""
    keywords = {"accuracy": accuracy, "method": method}
    return make_request("radiance", one.scene, one.mu0, one.stokes, one.signed_mu, PHI, one.tau, **keywords)


def find_case_rule(one: Case, accuracy: float) -> Rule:
    """The rule that auto follows there."""
    return find_rule(make_case_request(one, accuracy, EXACT))[1]


def find_disagreements(rows: Sequence[Row]) -> list[str]:
    """All of them, in words; none where the table is right."""
    named = (text for rule in RULES for each in rule.evidence for text in check_rule_evidence(rows, rule, *each))
    scenes = {name: some for name, some in group_rows(rows).items() if name in CASES}
    return [
        *named,
        *(text for name in CASES if name in scenes for text in check_rule_choices(scenes[name], find_case(name))),
    ]


def check_rule_evidence(
    rows: Sequence[Row], rule: Rule, scene: str, curve: str, setting: str, accuracy: float
) -> list[str]:
    """A run named: good enough, by the rule's method, and quicker than the exact one that looks for its nodes."""
    run = f"rule {rule.name!r}: {scene}, {curve}, {setting}"
    some = [row for row in rows if row.scene == scene]
    found = [row for row in some if (row.curve, row.setting) == (curve, setting) and row.is_measured]
    if not found:
        return [f"{run} is not in the report"]
    (row,) = found
    other = find_quickest_candidate([row for row in some if row.curve == BY_ACCURACY], accuracy)
    checks = [
        (row.method != rule.method, f"is by {row.method}"),
        (row.worst > accuracy, f"has an error of {row.worst:.0e}, not {accuracy:.0e}"),
        (other is not None and other.seconds <= row.seconds, "takes no less time than the exact method by accuracy"),
    ]
    return [f"{run} {words}" for is_wrong, words in checks if is_wrong]


def check_rule_choices(rows: Sequence[Row], one: Case) -> list[str]:
    """Nodes that the table takes and that were too few, and another method than the exact one where that is taken."""
    found = []
    for accuracy in (float(f"1e-{exponent}") for exponent in EXPONENTS):
        request = make_case_request(one, accuracy)
        more = [
            row for row in rows if row.curve == BY_HAND and row.is_measured and row.nodes >= (request.nodes or 4096)
        ]
        if (
            find_reference_uncertainty(rows) <= accuracy
            and more
            and request.method == EXACT
            and more[0].worst > accuracy
        ):
            found.append(f"{one.name} at {accuracy:.0e}: {request.nodes} nodes, but {more[0].nodes} were too few")
        best = find_quickest_candidate([row for row in rows if row.method in METHODS], accuracy)
        if accuracy in TARGETS and best is not None and best.method != request.method:
            found.append(f"{one.name} at {accuracy:.0e}: {best.method} is the quickest, not {request.method}")
    return found


def describe_rule_use() -> str:
    """How often each rule is taken, a line an accuracy."""
    lines = []
    for exponent in EXPONENTS:
        names = Counter(find_case_rule(find_case(name), float(f"1e-{exponent}")).name for name in CASES)
        lines.append(f"1e-{exponent}: " + ", ".join(f"{name} {count}" for name, count in names.items()))
    return "\n".join(lines)


def main(path: Path) -> int:
    """Prints all of it; 1 where there is a disagreement."""
    rows = read_report_rows(path)
    wrong = find_disagreements(rows)
    print("Rules taken on the scenes of the report:", describe_rule_use(), sep="\n")
    print(
        make_markdown_table(HEADER, make_score_rows(rows))
        if any(row.curve == AUTO for row in rows)
        else "No runs of auto in this report."
    )
    print("\n".join(wrong) or "The table agrees with the report.")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
