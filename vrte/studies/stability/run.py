"""The stability run: one case after another, each finished one put on record, so that a run can be taken up again."""

import hashlib
import json
import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import vrte
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import usable_cpus
from vrte.studies.stability.checks import Check, examine
from vrte.studies.stability.oracle import TABLE, Table, lookup, stored_table
from vrte.studies.stability.scenes import Case
from vrte.studies.stability.solving import Options, is_whole

LOG = "stability.jsonl"
# (pattern of the case's name, pattern of the check's name or "refused", why the target is out of reach): told in the
# table with the figure, and not counted as falling short
NO_ANSWER = (
    "the phase matrix cut at 2 N terms is negative over wide angles, a mode swings instead of fading, and the discrete "
    "problem is next to singular or, without end, has no solution; both algorithms say so"
)
KNOWN: tuple[tuple[str, str, str], ...] = (
    ("HG*", "refused", NO_ANSWER),
    ("g = *", "refused", NO_ANSWER),
    ("*-x200 *", "refused", NO_ANSWER),
)
Tick = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Record:
    """What became of a case: its checks, or ``trouble`` where there was no answer; ``c``, ``oracle`` as in `Examined`.

    ``seconds`` of wall time; ``whole``, whether all Fourier orders were solved.
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

    def worst(self, kind: str) -> float | None:
        """The largest value of one kind of check, NaN if there is one; None without such a check."""
        values = [check.value for check in self.checks if check.kind == kind]
        return max(values, key=lambda value: (value != value, value)) if values else None

    @property
    def shortfalls(self) -> list[str]:
        """What falls short, in words, known reasons left out."""
        return [text for name, text in self._broken() if known_reason(self.name, name) is None]

    @property
    def reasons(self) -> list[str]:
        """What falls short for a known reason, with that reason."""
        found = [(text, known_reason(self.name, name)) for name, text in self._broken()]
        return [f"{text}: {reason}" for text, reason in found if reason is not None]

    def _broken(self) -> list[tuple[str, str]]:
        if self.trouble:
            return [("refused", self.trouble)]
        return [
            (check.name, f"{check.name} {check.value:.1e}, allowed {check.limit:.1e}")
            for check in self.checks
            if not check.holds
        ]


def known_reason(case: str, check: str) -> str | None:
    """Why this check of this case is known to be out of reach, or None."""
    for case_pattern, check_pattern, reason in KNOWN:
        if fnmatchcase(case, case_pattern) and fnmatchcase(check, check_pattern):
            return reason
    return None


def run_cases(
    cases: Sequence[Case],
    folder: str | os.PathLike[str],
    options: Options | None = None,
    fresh: bool = False,
    tick: Tick = lambda done, total, name: None,
) -> list[Record]:
    """Examines the cases and returns their records, in order; ``tick(done, total, name)`` before each.

    Each record goes into ``folder``/stability.jsonl as soon as it is made. Those already there, of the same package,
    oracle table and options, are taken as they are, unless ``fresh``. Raises OSError.

    >>> from vrte.studies.stability import corner_cases
    >>> run_cases(corner_cases()[:1], ".")[0].trouble
    ''
    """
    options = options or Options()
    log, digest = Path(folder) / LOG, fingerprint(options)
    if fresh:
        log.unlink(missing_ok=True)
    known = read_log(log, digest)
    records = []
    with stored_table() as table, open(log, "a", encoding="utf-8") as file:
        for number, case in enumerate(cases):
            tick(number, len(cases), case.name)
            record = known.get((case.name, case.key))
            if record is None:
                record = record_of(case, table, options)
                append(file, {"run": digest, "key": case.key, "record": asdict(record)})
            records.append(record)
    tick(len(cases), len(cases), "")
    return records


def record_of(case: Case, table: Table, options: Options) -> Record:
    """Examines one case; whatever goes wrong becomes part of the record."""
    start = time.perf_counter()
    found: dict[str, Any] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            examined = examine(case, lookup(case, table), options)
            found = {"checks": examined.checks, "c": examined.c, "oracle": examined.oracle}
        except (AccuracyError, SceneError) as error:
            found["trouble"] = f"refused: {error}"
        except Exception as error:
            found["trouble"] = f"{type(error).__name__}: {error}"
    if caught and "checks" in found:
        text = " ".join(str(caught[0].message).split())
        found["checks"].append(Check(f"warnings ({text})", float(len(caught)), 0.0, kind="other"))
    return Record(
        name=case.name,
        group=case.group,
        conditions=case.conditions,
        base=case.base_kind,
        layering=case.layering,
        nodes=case.nodes,
        reason=case.reason,
        whole=is_whole(case),
        seconds=time.perf_counter() - start,
        **found,
    )


def append(file: Any, entry: dict[str, Any]) -> None:
    """One line, on disk before anything else happens."""
    file.write(json.dumps(entry) + "\n")
    file.flush()
    os.fsync(file.fileno())


def read_log(log: Path, digest: str) -> dict[tuple[str, str], Record]:
    """Records of the same run by name and key; a line that was cut off when a run was killed counts for nothing."""
    found: dict[tuple[str, str], Record] = {}
    if not log.is_file():
        return found
    text = log.read_text(encoding="utf-8")
    if text and not text.endswith("\n"):
        with open(log, "a", encoding="utf-8") as file:
            file.write("\n")
    for line in text.splitlines():
        try:
            entry = json.loads(line)
            if entry["run"] == digest:
                fields = entry["record"]
                fields["checks"] = [Check(**check) for check in fields["checks"]]
                found[fields["name"], entry["key"]] = Record(**fields)
        except (ValueError, TypeError, KeyError):
            continue
    return found


def fingerprint(options: Options) -> str:
    """A digest of the package as it stands, compiled core and oracle table included, and of the options."""
    digest = hashlib.sha256(f"{vrte.__version__} {options.algorithm} {options.threads or usable_cpus()}".encode())
    package = Path(vrte.__file__).parent
    for path in sorted({*package.rglob("*.py"), *package.glob("_core*.so"), *package.glob("_core*.pyd"), TABLE}):
        if path.is_file():
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def require_all(records: Sequence[Record]) -> None:
    """Raises AccuracyError, naming the first, where a case falls short."""
    short = [record for record in records if record.shortfalls]
    if short:
        raise AccuracyError(
            f"{len(short)} of {len(records)} scenes fall short, the first: {short[0].name}: {short[0].shortfalls[0]}"
        )
