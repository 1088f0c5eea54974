"""How the GPU paper, (1), says that the cost of each step grows, axis by axis, and where it says so.

Its steps are homogeneous solution, particular solution, boundary conditions and reconstruction (section 3). On the nodes,
4.B.1 says "quadratically or cubically (depending on the computation)"; which of the two is counted from section 3.
"""

from dataclasses import dataclass

TOTAL = "total"
PAPER_STEPS = ("homogeneous", "particular", "boundary", "reconstruction")


@dataclass(frozen=True)
class Claim:
    """An exponent, in words, the least and the greatest that the words allow, and the section."""

    text: str
    least: float
    greatest: float
    section: str

    def __str__(self) -> str:
        return f"{self.text} ({self.section})"


CUBIC, QUADRATIC = 3.0, 2.0
LINEAR, CONSTANT = 1.0, 0.0

CLAIMS: dict[str, dict[str, Claim]] = {
    "nodes": {
        TOTAL: Claim("2 to 3", QUADRATIC, CUBIC, "4.B.1"),
        "homogeneous": Claim("3", CUBIC, CUBIC, "3.A"),
        "particular": Claim("3", CUBIC, CUBIC, "3.B"),
        "boundary": Claim("2 or 3", QUADRATIC, CUBIC, "4.B.1"),
        "reconstruction": Claim("2", QUADRATIC, QUADRATIC, "3.D"),
    },
    "outgoing": {
        TOTAL: Claim("at most 1, by the reconstruction", CONSTANT, LINEAR, "4.B.2"),
        "homogeneous": Claim("0", CONSTANT, CONSTANT, "4.B.2"),
        "particular": Claim("0", CONSTANT, CONSTANT, "4.B.2"),
        "boundary": Claim("0", CONSTANT, CONSTANT, "4.B.2"),
        "reconstruction": Claim("1", LINEAR, LINEAR, "4.B.2"),
    },
    "orders": {name: Claim("1", LINEAR, LINEAR, "4.B.3") for name in (TOTAL, *PAPER_STEPS)},
    "incident": {
        TOTAL: Claim("at most 1, by all but the homogeneous", CONSTANT, LINEAR, "4.C"),
        "homogeneous": Claim("0", CONSTANT, CONSTANT, "4.C"),
        "particular": Claim("1", LINEAR, LINEAR, "4.C"),
        "boundary": Claim("1", LINEAR, LINEAR, "4.C"),
        "reconstruction": Claim("1", LINEAR, LINEAR, "4.C"),
    },
}


def claim(axis: str, step: str) -> Claim | None:
    """What the paper says of a step on an axis; None of a step that it does not have.

    >>> str(claim("nodes", "reconstruction")), claim("nodes", "a step of our own")
    ('2 (3.D)', None)
    """
    return CLAIMS[axis].get(step)
