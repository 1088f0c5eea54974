"""f(lambda) = tanh(h sqrt(lambda))/sqrt(lambda) of half a slab's thickness h, g = lambda f, c = 1 - f g, and their
divided differences: what a slab's modes turn a change of its matrices into."""

from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array

NEAR = 0.1  # points closer than this fraction of the larger one: f[a, b] by the addition theorem of tanh
THIN = 0.5  # h^2 lambda below which f[a, b] is summed as a series


def list_tanh_series(terms: int) -> list[float]:
    """Coefficients c_k of tanh(sqrt y)/sqrt y = sum c_k y^k, from tan' = 1 + tan^2 with signs that alternate."""
    found = [1.0]
    for k in range(1, terms):
        square = sum(found[i] * found[k - 1 - i] for i in range(k))
        found.append(-square / (2 * k + 1))
    return found


SERIES = list_tanh_series(26)  # 0.5^25 over the radius pi^2/4 to the same power: below rounding


@dataclass(frozen=True)
class Decay:
    """f and g of a slab of half thickness h, inf allowed: then f = 1/sqrt(lambda), g = sqrt(lambda)."""

    half: float

    @property
    def is_semi_infinite(self) -> bool:
        """Whether the slab has no lower end."""
        return bool(np.isinf(self.half))

    def find_f(self, lam: Array) -> Array:
        """f at lam (n,), real or complex, none of them negative."""
        root = np.sqrt(lam)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = 1.0 / root if self.is_semi_infinite else np.tanh(np.minimum(self.half, 1e300) * root) / root
        return np.where(lam == 0.0, self.half, found)

    def find_g(self, lam: Array) -> Array:
        """g at lam (n,)."""
        root = np.sqrt(lam)
        return root if self.is_semi_infinite else root * np.tanh(self.half * root)

    def find_c(self, lam: Array) -> Array:
        """c at lam (n,), sech(h sqrt(lam))^2, to the last digits however small."""
        decay = np.exp(-2.0 * self.half * np.sqrt(lam))
        return 4.0 * decay / (1.0 + decay) ** 2

    def divide(self, rows: Array, columns: Array, with_c: bool = False) -> tuple[Array, Array, Array]:
        """f[a, b], g[a, b] and, ``with_c``, c[a, b] of all pairs of points (order, k) and (order, l), (order, k, l):
        real ones by the core, complex ones here."""
        if not (np.iscomplexobj(rows) or np.iscomplexobj(columns)):
            found = _core.divided_differences(row_points=rows, column_points=columns, half=self.half, with_c=with_c)
            return found["f"], found["g"], found["c_between"]
        x, y = np.broadcast_arrays(rows[:, :, None].astype(complex), columns[:, None])
        if self.is_semi_infinite:
            p, q = np.sqrt(x), np.sqrt(y)
            with np.errstate(divide="ignore", invalid="ignore"):
                f, g = -1.0 / (p * q * (p + q)), 1.0 / (p + q)
            return np.where(p * q == 0.0, 0.0, f), np.where(p + q == 0.0, 0.0, g), f
        at_x, at_y = (np.broadcast_to(self.find_f(each), x.shape) for each in (rows[:, :, None], columns[:, None]))
        f = self.divide_f(x, y, at_x, at_y)
        # from the larger point, where the two terms do not cancel
        return f, np.where(np.abs(x) < np.abs(y), at_y + x * f, at_x + y * f), self.divide_c(x, y)

    def divide_c(self, x: Array, y: Array) -> Array:
        """c[a, b] of pairs of points to its last digits: with p, q = sqrt(a), sqrt(b) and sinc z = sinh(z)/z it is
        -h^2 sinc(h (p - q)) sinc(h (p + q)) sech(h p)^2 sech(h q)^2."""
        p, q = self.half * np.sqrt(x), self.half * np.sqrt(y)
        low, difference = np.where(p.real < q.real, p, q), np.where(p.real < q.real, q - p, p - q)
        near, far = (
            np.where(z == 0.0, 1.0, -np.expm1(-2.0 * z) / np.where(z == 0.0, 1.0, 2.0 * z)) for z in (difference, p + q)
        )
        more = (1.0 + np.exp(-2.0 * p)) * (1.0 + np.exp(-2.0 * q))
        return -((4.0 * self.half / more) ** 2) * near * far * np.exp(-2.0 * low)

    def divide_f(self, x: Array, y: Array, at_x: Array, at_y: Array) -> Array:
        """f[x, y] of pairs of points, from f at them."""
        largest = np.maximum(np.abs(x), np.abs(y))
        thin = self.half**2 * largest < THIN
        near = ~thin & (np.abs(x - y) < NEAR * largest)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.asarray((at_x - at_y) / (x - y))
        if thin.any():
            u, v = self.half**2 * x[thin], self.half**2 * y[thin]
            total, power, term = np.zeros_like(u), np.ones_like(u), np.ones_like(u)
            for c in SERIES[1:]:
                total += c * term
                power = power * u
                term = v * term + power
            found[thin] = self.half**3 * total
        if near.any():  # tanh(h p) - tanh(h q) = tanh(h (p - q)) (1 - tanh(h p) tanh(h q))
            p, q = np.sqrt(x[near]), np.sqrt(y[near])
            one, other, difference = np.tanh(self.half * p), np.tanh(self.half * q), p - q
            slope = np.where(
                difference == 0.0,
                self.half,
                np.tanh(self.half * difference) / np.where(difference == 0.0, 1.0, difference),
            )
            found[near] = (q * (1.0 - one * other) * slope - other) / (p * q * (p + q))
        return found
