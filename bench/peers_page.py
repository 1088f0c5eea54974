"""The page of docs/ that carries the comparison with the peers."""

from collections.abc import Sequence
from importlib.metadata import version

from bench.peers import ACCURACY, REFERENCE_STREAMS, ROUNDS, Problem, Row, shortfalls, wanted_keywords
from bench.study import describe_load, list_run_facts, make_markdown_list, make_markdown_table, show_two_digits

COLUMNS = ("scene", "streams", "code", "cold [ms]", "over vrte", "warm [ms]", "over vrte", "target")
ERRORS = ("error I", "error Q", "error U")
CHECKED_WITH = {"nanodisort": "vrte on 256 streams", "sasktran2": "nine numbers of Siewert's tables, of six digits"}

INTRODUCTION = """# Beside other codes

vrte and the two solvers of its kind that pip installs (extra `bench`):
[nanodisort](https://pypi.org/project/nanodisort/), scalar, the C translation of DISORT, and
[sasktran2](https://pypi.org/project/sasktran2/) (Zawada et al., Atmos. Meas. Tech. 8, 2609, 2015), whose discrete
ordinates carry I, Q and U. On Linux (x86-64) both come as wheels for Python 3.11 to 3.14. `make bench-peers` prints
this page, `python -m bench.peers -o docs/reference/peers.md` writes it.
"""

METHOD = f"""## What is compared

- One homogeneous layer over black ground, mu0 0.6, streams = 2 x nodes, one thread each, BLAS and OpenMP included.
  All codes get the same expansion coefficients and return the same radiances.
- Henyey-Greenstein, albedo 0.99, 128 terms (g 0.75) and 384 (g 0.9): I at the top and at the bottom, 20 cosines up and
  down (0.1 to 1), 5 azimuths. nanodisort does delta-M and its Nakajima-Tanaka correction; its sum over azimuthal
  orders may stop at {ACCURACY:g} (`accur`).
- Siewert's problem IIA: I, Q, U leaving the top, 10 cosines (0.1 to 1), azimuths 0, 90 and 180; vrte carries V as well.
  sasktran2 is plane-parallel with one layer and makes no derivatives; it finds the flux up at the top, too. Its single
  scattering comes from its discrete ordinates: its "exact" source sums along the line of sight and with one layer is
  off by 0.18 of the largest I. Its b1, Q and U have the signs of vrte and its relative azimuth is phi: no sign is
  changed. The row "12 orders" tells it how many azimuthal orders there are (`num_forced_azimuth`), which it does not
  see by itself; that row has no target.
- Times are CPU times of the process, medians of {ROUNDS[0]} to {ROUNDS[1]} calls, the codes in turn. **Cold** is all
  that a scene never seen takes, from its coefficients on: vrte makes the scene, its plan and the solve, nanodisort its
  arrays and the solve, sasktran2 its engine, its atmosphere and the solve. **Warm** is the same scene solved again:
  vrte keeps its plan, nanodisort its arrays, sasktran2 its engine and atmosphere. The targets are of warm solves.
- Errors are the largest over all directions and depths, relative to the largest I. They are counted from nanodisort's
  own answer on {REFERENCE_STREAMS} streams, for Siewert's scene from vrte's on as many by doubling, which is not the
  algorithm timed.
- What a feature costs stands in the last rows, over the plain solve of the same scene by vrte: a Mueller BRDF at
  accuracy 1e-6, one thread. Their cold time is the first call. The surface has the index 1.5, the rough one the
  roughness 0.2. Derivatives are those with thickness, albedo and one coefficient.
"""


def page(comparisons: Sequence[list[Row]], checks: dict[Problem, float], load_before: str) -> str:
    """Markdown: with what it was made, the table, what falls short, and what is compared."""
    short = [text for rows in comparisons for text in shortfalls(rows)]
    references = [
        f"- reference of {problem.name}: within {show_two_digits(difference)} of {CHECKED_WITH[problem.peer]}\n"
        for problem, difference in checks.items()
    ]
    blocks = [
        INTRODUCTION,
        made_with(load_before) + "".join(references),
        table([row for rows in comparisons for row in rows]),
        "## What falls short\n",
        "".join(f"- {text}\n" for text in short) or "Nothing.\n",
        METHOD,
    ]
    return "\n".join(blocks)


def table(rows: Sequence[Row]) -> str:
    """All rows as one Markdown table."""
    return make_markdown_table([*COLUMNS, *ERRORS], [cells(row) for row in rows])


def cells(row: Row) -> list[str]:
    """One row as text."""
    times = [f"{value:.2f}" for value in (row.cold_ms, row.cold_ratio, row.solve_ms, row.ratio)]
    errors = [show_two_digits(error) for error in row.errors]
    return [
        *(row.problem, "chosen" if row.streams is None else str(row.streams), row.code, *times),
        f"{'<=' if row.at_most else '>='} {row.target:g}" if row.target else "",
        *errors,
        *[""] * (len(ERRORS) - len(errors)),
    ]


def made_with(load_before: str) -> str:
    """Date, machine, load and versions, as a Markdown list."""
    codes = ", ".join(f"{name} {version(name)}" for name in ("nanodisort", "sasktran2"))
    wanted = ", ".join(f"{name}={value!r}" for name, value in wanted_keywords().items())
    reported = f"load (1, 5, 15 minutes) {load_before} before, {describe_load()} after"
    keywords = f"keywords of vrte.radiance: {wanted or 'none beyond nodes and threads'}"
    return make_markdown_list([*list_run_facts(reported), codes, keywords])
