"""The stability run: one case after another, each finished one put on record, so that a run can be taken up again."""

import os
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from bench.stability.cases import Case
from bench.stability.checks import Check, examine_case
from bench.stability.oracle import LEFT_OUT, Table, find_oracle_answer
from bench.stability.solving import Options, is_whole
from bench.study import Records, Tick, hash_files, make_fingerprint
from vrte.basics.errors import AccuracyError, AccuracyWarning, LongSolveWarning, SceneError
from vrte.basics.running import count_usable_cpus

LOG = "stability_records.csv"
# (pattern of the case's name, pattern of the check's name or "refused", why the target is out of reach): told in the
# table with the figure, and not counted as falling short
NO_ANSWER = (
    "the phase matrix cut at 2 N terms is negative over wide angles, a mode swings instead of fading, and the discrete "
    "problem is next to singular or, without end, has no solution; both algorithms say so"
)
TRAPPED = (
    "light that both faces of a plate reflect totally leaves it by being scattered alone, 1e-6 of it a crossing, and "
    "the last places of what is not are rounded: some 2e-16 n^2/thickness of what comes out"
)
KNOWN: tuple[tuple[str, str, str], ...] = (
    ("HG*", "refused", NO_ANSWER),
    ("g = *", "refused", NO_ANSWER),
    ("*-x200 *", "refused", NO_ANSWER),
    *(
        (name, check, TRAPPED)
        for name in (
            "n=* plate: * t=1e-06 *",
            "n=* t=1e-06 perfect mirror *",
            "n=4, trapped *, thin",
            "n=1.5, * thin plate",
        )
        for check in ("BRDF and *", "BTDF and *", "layer cut *", "both algorithms*", "reciprocity*")
    ),
)


@dataclass(frozen=True)
class Record:
    """What became of a case: its checks, or ``trouble`` where there was no answer; ``c``, ``oracle`` as in `Examined`.

    ``seconds`` of wall time; ``whole``, whether all Fourier orders were solved; ``pile``, "" where nothing refracts.
    """

    name: str
    group: str
    conditions: list[str]
    base: str
    layering: str
    nodes: int
    reason: str
    whole: bool
    seconds: float
    oracle: str = "none"
    c: float = 0.0
    checks: list[Check] = field(default_factory=list)
    trouble: str = ""
    pile: str = ""
    index: float = 1.0
    fingerprint: str = ""

    def __post_init__(self) -> None:
        """Checks that come from a file are made ones again."""
        made = [Check(**check) if isinstance(check, dict) else check for check in self.checks]
        object.__setattr__(self, "checks", made)

    def worst(self, kind: str) -> float | None:
        """The largest value of one kind of check, NaN if there is one; None without such a check."""
        values = [check.value for check in self.checks if check.kind == kind]
        return max(values, key=lambda value: (value != value, value)) if values else None

    @property
    def shortfalls(self) -> list[str]:
        """What falls short, in words, known reasons left out."""
        return [text for name, text in self._broken() if find_known_reason(self.name, name) is None]

    @property
    def reasons(self) -> list[str]:
        """What falls short for a known reason, with that reason."""
        found = [(text, find_known_reason(self.name, name)) for name, text in self._broken()]
        return [f"{text}: {reason}" for text, reason in found if reason is not None]

    @property
    def verdict(self) -> str:
        """Whether the case holds, falls short or does so for a known reason, in words."""
        return "falls short" if self.shortfalls else "known" if self.reasons else "holds"

    def _broken(self) -> list[tuple[str, str]]:
        if self.trouble:
            return [("refused", self.trouble)]
        left_out = [("left out", f"the oracle's answer is {self.oracle}")] if self.oracle in LEFT_OUT else []
        return left_out + [
            (check.name, f"{check.name} {check.value:.1e}, allowed {check.limit:.1e}")
            for check in self.checks
            if not check.holds
        ]


def find_known_reason(case: str, check: str) -> str | None:
    """Why this check of this case is known to be out of reach, or None."""
    fits = (reason for names, checks, reason in KNOWN if fnmatchcase(case, names) and fnmatchcase(check, checks))
    return next(fits, None)


def run_cases(
    cases: Sequence[Case],
    folder: str | os.PathLike[str],
    table: Table,
    options: Options | None = None,
    fresh: bool = False,
    tick: Tick = lambda done, total, name: None,
) -> list[Record]:
    """Examines the cases and returns their records, in order; ``tick(done, total, name)`` before each.

    Each record goes into ``folder``/stability_records.csv as soon as it is made. Those already there, of the same
    package, answers of the oracle (``table``) and options, are taken as they are, unless ``fresh``. Raises OSError.

    >>> from bench.stability.corners import CORNERS
    >>> run_cases(CORNERS[:1], ".", {})[0].trouble
    ''
    """
    options, log = options or Options(), Records(Record, Path(folder) / LOG)
    known = {} if fresh else log.read()
    log.write(known.values())  # what was torn, or is of no use any more, goes first
    how = (
        f"{options.algorithm} {options.threads or count_usable_cpus()} {hash_files(Path(__file__).parent.glob('*.py'))}"
    )
    records = []
    for number, case in enumerate(cases):
        tick(number, len(cases), case.name)
        right = find_oracle_answer(case, table)
        mark = make_fingerprint(case.name, case.key, how, right if isinstance(right, str) else "the oracle's")
        if mark not in known:
            known[mark] = record_case(case, table, options, mark)
            log.append(known[mark])
        records.append(known[mark])
    tick(len(cases), len(cases), "")
    return records


def record_case(case: Case, table: Table, options: Options, mark: str = "") -> Record:
    """Examines one case; whatever goes wrong becomes part of the record."""
    start = time.perf_counter()
    found: dict[str, Any] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            examined = examine_case(case, find_oracle_answer(case, table), options)
            found = {"checks": examined.checks, "c": examined.c, "oracle": examined.oracle}
        except (AccuracyError, SceneError) as error:
            found["trouble"] = f"refused: {error}"
        except Exception as error:
            found["trouble"] = f"{type(error).__name__}: {error}"
    # that a solve takes long says nothing of digits; too few nodes for the phase matrix are told, and do not count
    for counts, few in ((True, False), (case.resolved, True)):
        told = [each for each in caught if issubclass(each.category, AccuracyWarning) == few]
        told = [each for each in told if not issubclass(each.category, LongSolveWarning)]
        if told and "checks" in found:
            text = " ".join(str(told[0].message).split())
            found["checks"].append(Check(f"warnings ({text})", float(len(told)), 0.0, counts, "other"))
    return Record(
        name=case.name,
        group=case.group,
        conditions=case.conditions,
        base=case.base_kind,
        layering=case.layering,
        nodes=case.nodes,
        reason=case.reason,
        pile=case.pile,
        index=case.index,
        whole=is_whole(case),
        seconds=time.perf_counter() - start,
        fingerprint=mark,
        **found,
    )


def require_all(records: Sequence[Record]) -> None:
    """Raises AccuracyError, naming the first, where a case falls short."""
    short = [record for record in records if record.shortfalls]
    if short:
        raise AccuracyError(
            f"{len(short)} of {len(records)} scenes fall short, the first: {short[0].name}: {short[0].shortfalls[0]}"
        )
