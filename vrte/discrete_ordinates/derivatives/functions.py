"""f(lambda) = tanh(h sqrt(lambda))/sqrt(lambda) of half a slab's thickness h, g = lambda f, and their divided
differences: what a slab's modes turn a change of its matrices into."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array

NEAR = 0.1  # of the larger point: f[a, b] is an integral of f' from here on
THIN = 0.5  # of h^2 lambda: f[a, b] is a series below
POINTS, WEIGHTS = (part / 2.0 for part in np.polynomial.legendre.leggauss(7))


def list_tanh_series(terms: int) -> list[float]:
    """Coefficients c_k of tanh(sqrt y)/sqrt y = sum c_k y^k, from tan' = 1 + tan^2 with signs that alternate."""
    found = [1.0]
    for k in range(1, terms):
        square = sum(found[i] * found[k - 1 - i] for i in range(k))
        found.append(-square / (2 * k + 1))
    return found


SERIES = list_tanh_series(26)  # 0.5^25 over the radius pi^2/4 to the same power: below rounding


@dataclass(frozen=True)
class Fading:
    """f and g of a slab of half thickness h, inf allowed: then f = 1/sqrt(lambda), g = sqrt(lambda)."""

    half: float

    @property
    def is_endless(self) -> bool:
        """Whether the slab has no lower end."""
        return bool(np.isinf(self.half))

    def find_f(self, lam: Array) -> Array:
        """f at lam (n,), real or complex, none of them negative."""
        root = np.sqrt(lam)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = 1.0 / root if self.is_endless else np.tanh(np.minimum(self.half, 1e300) * root) / root
        return np.where(lam == 0.0, self.half, found)

    def find_g(self, lam: Array) -> Array:
        """g at lam (n,)."""
        root = np.sqrt(lam)
        found: Array = root if self.is_endless else root * np.tanh(self.half * root)
        return found

    def divide(self, a: Array, b: Array) -> tuple[Array, Array]:
        """f[a, b] and g[a, b], (n_a, n_b)."""
        kind = np.result_type(a, b)
        x, y = np.broadcast_arrays(a[:, None].astype(kind), b.astype(kind))
        if self.is_endless:
            p, q = np.sqrt(x), np.sqrt(y)
            with np.errstate(divide="ignore", invalid="ignore"):
                return -1.0 / (p * q * (p + q)), 1.0 / (p + q)
        f = self.divide_f(x, y)
        small = np.abs(x) < np.abs(y)
        fa, fb = self.find_f(a)[:, None], self.find_f(b)
        # from the larger point, where the two terms do not cancel
        return f, np.where(small, fb + x * f, fa + y * f)

    def divide_f(self, x: Array, y: Array) -> Array:
        """f[x, y], element by element."""
        largest = np.maximum(np.abs(x), np.abs(y))
        thin = self.half**2 * largest < THIN
        near = ~thin & (np.abs(x - y) < NEAR * largest)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.asarray((self.find_f(x) - self.find_f(y)) / (x - y))
        if thin.any():
            u, v = self.half**2 * x[thin], self.half**2 * y[thin]
            total, power, term = np.zeros_like(u), np.ones_like(u), np.ones_like(u)
            for c in SERIES[1:]:
                total += c * term
                power = power * u
                term = v * term + power
            found[thin] = self.half**3 * total
        if near.any():
            u, v = x[near], y[near]
            found[near] = sum(
                weight * self.find_slope(0.5 * (u + v) + point * (u - v))
                for point, weight in zip(POINTS.tolist(), WEIGHTS.tolist(), strict=True)
            )
        return found

    def find_slope(self, lam: Array) -> Array:
        """f' away from 0."""
        root = np.sqrt(lam)
        e = np.exp(-2.0 * self.half * root)
        slope: Array = (4.0 * self.half * e / (1.0 + e) ** 2 - (1.0 - e) / (1.0 + e) / root) / (2.0 * lam)
        return slope
