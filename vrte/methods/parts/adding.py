"""Reflection and transmission of slabs on nodes, and slabs added, as in (2:8): only decaying exponentials."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array


@dataclass(frozen=True, eq=False)
class Slab:
    """Diffuse reflection and transmission of light from above, R, T (r, c), and from below, R_below, T_below (r, n);
    passed_rows (r,), passed (c,): light not scattered, exp(-tau/mu)."""

    R: Array
    T: Array
    R_below: Array
    T_below: Array
    passed_rows: Array
    passed: Array

    @property
    def n(self) -> int:
        """Unknowns of a hemisphere."""
        return int(self.R_below.shape[1])


def make_homogeneous_slab(R: Array, T: Array, tau: float, rows: Array, columns: Array, n: int) -> Slab:
    """A slab that is the same from below, in the flipped frame; rows (r,), columns (c,): cosines, n of them nodes."""
    return Slab(R, T, R[:, :n], T[:, :n], np.exp(-tau / rows), np.exp(-tau / columns))


def make_ground_slab(R: Array, n: int) -> Slab:
    """A base that reflects R (r, c): nothing is below."""
    nothing = np.zeros((R.shape[0], n))
    return Slab(R, np.zeros_like(R), nothing, nothing, np.zeros(R.shape[0]), np.zeros(R.shape[1]))


def find_light_between(upper: Slab, lower: Slab) -> tuple[Array, Array]:
    """Diffuse light up and down where two slabs meet, lit from above, each (r, c)."""
    n = upper.n
    returned = np.eye(n) - lower.R[:n, :n] @ upper.R_below[:n]
    up = np.linalg.solve(returned, lower.R[:n] * upper.passed + lower.R[:n, :n] @ upper.T[:n])
    down = upper.T + upper.R_below @ up
    return lower.R * upper.passed + lower.R[:, :n] @ down[:n], down


def find_light_from_below(upper: Slab, lower: Slab) -> tuple[Array, Array]:
    """The same lit from below along the nodes, each (r, n)."""
    n = upper.n
    passed = lower.passed_rows[:n]
    returned = np.eye(n) - upper.R_below[:n] @ lower.R[:n, :n]
    down = np.linalg.solve(returned, upper.R_below[:n] * passed + upper.R_below[:n] @ lower.T_below[:n])
    up = lower.T_below + lower.R[:, :n] @ down
    return up, upper.R_below * passed + upper.R_below @ up[:n]


def add_slabs(upper: Slab, lower: Slab) -> Slab:
    """One slab on another."""
    n = upper.n
    up, down = find_light_between(upper, lower)
    up_lit, down_lit = find_light_from_below(upper, lower)
    return Slab(
        R=upper.R + upper.passed_rows[:, None] * up + upper.T_below @ up[:n],
        T=lower.passed_rows[:, None] * down + lower.T * upper.passed + lower.T[:, :n] @ down[:n],
        R_below=lower.R_below + lower.passed_rows[:, None] * down_lit + lower.T[:, :n] @ down_lit[:n],
        T_below=upper.passed_rows[:, None] * up_lit
        + upper.T_below * lower.passed_rows[:n]
        + upper.T_below @ up_lit[:n],
        passed_rows=upper.passed_rows * lower.passed_rows,
        passed=upper.passed * lower.passed,
    )


def double_slab(slab: Slab) -> Slab:
    """A homogeneous slab on one like it."""
    n = slab.n
    up, down = find_light_between(slab, slab)
    R = slab.R + slab.passed_rows[:, None] * up + slab.T[:, :n] @ up[:n]
    T = slab.passed_rows[:, None] * down + slab.T * slab.passed + slab.T[:, :n] @ down[:n]
    return Slab(R, T, R[:, :n], T[:, :n], slab.passed_rows**2, slab.passed**2)


def find_light_inside(slabs: list[Slab]) -> tuple[Array, Array]:
    """Diffuse light up and down at the top, between all slabs and below the last, each (place, r, c); the last slab is
    the base or a part without end."""
    below = [slabs[-1]]
    for slab in reversed(slabs[:-1]):
        below.append(add_slabs(slab, below[-1]))
    below.reverse()  # below[k]: from slab k on
    fields = [(below[0].R, np.zeros_like(below[0].T))]
    above = slabs[0]
    for k in range(1, len(slabs)):
        fields.append(find_light_between(above, below[k]))
        if k + 1 < len(slabs):
            above = add_slabs(above, slabs[k])
    return np.stack([up for up, _ in fields]), np.stack([down for _, down in fields])
