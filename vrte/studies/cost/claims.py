"""How the GPU paper, (1), says that the cost of each step grows, axis by axis, and where it says so.

Its steps are homogeneous solution, particular solution, boundary conditions and reconstruction (section 3). Of the
nodes, 4.B.1 says quadratic or cubic, depending on the computation; which of the two is counted from section 3.
"""

from dataclasses import dataclass

TOTAL = "total"
PAPER_STEPS = ("homogeneous", "particular", "boundary", "reconstruction")


@dataclass(frozen=True)
class Claim:
    """An exponent, in words, and the section that states it."""

    text: str
    section: str

    def __str__(self) -> str:
        return f"{self.text} ({self.section})"


CLAIMS: dict[str, dict[str, Claim]] = {
    "nodes": {
        TOTAL: Claim("2 to 3", "4.B.1"),
        "homogeneous": Claim("3", "3.A"),
        "particular": Claim("3", "3.B"),
        "boundary": Claim("2 or 3", "4.B.1"),
        "reconstruction": Claim("2", "3.D"),
    },
    "outgoing": {
        TOTAL: Claim("at most 1, by the reconstruction", "4.B.2"),
        "homogeneous": Claim("0", "4.B.2"),
        "particular": Claim("0", "4.B.2"),
        "boundary": Claim("0", "4.B.2"),
        "reconstruction": Claim("1", "4.B.2"),
    },
    "orders": {name: Claim("1", "4.B.3") for name in (TOTAL, *PAPER_STEPS)},
    "incident": {
        TOTAL: Claim("at most 1, by all but the homogeneous", "4.C"),
        "homogeneous": Claim("0", "4.C"),
        "particular": Claim("1", "4.C"),
        "boundary": Claim("1", "4.C"),
        "reconstruction": Claim("1", "4.C"),
    },
}


def claim(axis: str, step: str) -> Claim | None:
    """What the paper says of a step on an axis; None of a step that it does not have.

    >>> str(claim("nodes", "reconstruction")), claim("nodes", "a step of our own")
    ('2 (3.D)', None)
    """
    return CLAIMS[axis].get(step)
