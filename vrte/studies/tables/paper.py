"""What the GPU paper prints: its Tables 2 and 3 and the time of its BRDF, by configuration [s].

An Intel Core i7 and an Nvidia GTX 580 in a laptop. Table 3 (called Table 4 in the paper's text): the total of
configuration 6 is as printed; its steps add up to 11.28.
"""

from vrte.studies.tables.problems import BRDF, TABLE_2, TABLE_3

MACHINE = "Intel Core i7 and Nvidia GTX 580"
STEPS = ("homogeneous", "particular", "boundary", "reconstruction")
TOTAL = "total"
LABELS = ("1", "2", "3", "4", "5", "6")


def _row(*seconds: float) -> dict[str, float]:
    return dict(zip(LABELS, seconds, strict=True))


SECONDS: dict[tuple[str, str], dict[str, float]] = {
    (TABLE_2, TOTAL): _row(2.79, 2.74, 2.94, 0.99, 0.97, 1.18),
    (TABLE_3, "homogeneous"): _row(6.50, 6.11, 9.18, 6.07, 5.75, 8.43),
    (TABLE_3, "particular"): _row(0.04, 0.04, 0.07, 0.04, 0.04, 0.07),
    (TABLE_3, "boundary"): _row(0.24, 0.24, 0.25, 0.24, 0.24, 0.25),
    (TABLE_3, "reconstruction"): _row(22.1, 22.0, 22.1, 2.52, 2.51, 2.53),
    (TABLE_3, TOTAL): _row(28.9, 28.4, 31.5, 8.88, 8.56, 11.18),
    (BRDF, TOTAL): {"2": 7200.0, "5": 900.0},  # "close to two hours", "15 minutes"
}


def seconds(problem: str, step: str, label: str) -> float | None:
    """Of a step in a configuration; None where the paper has none.

    >>> seconds("table 3", "total", "5"), seconds("brdf", "total", "1")
    (8.56, None)
    """
    return SECONDS.get((problem, step), {}).get(label)
