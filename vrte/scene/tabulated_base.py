"""A base from a table: a Mueller BRDF that was measured, or solved for, at a grid of directions."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrte.basics.arrays import (
    Array,
    BoolArray,
    check_cosines,
    check_fields,
    check_numbers,
    check_vector,
    freeze_copy,
    make_readonly,
)
from vrte.basics.errors import SceneError, warn_user
from vrte.basics.polarization import FLIP
from vrte.basics.splines import (
    MIRROR,
    compute_weights,
    extend_over_horizon,
    extend_over_pole,
    repeat_grid,
    stretch_cosines,
)
from vrte.scene.boundary import (
    GRAZING,
    LARGEST_BASE,
    Allowed,
    Boundary,
    Orders,
    check_energy,
    check_physical,
    make_exit_rule,
)
from vrte.scene.interface import HIGHEST_INDEX, INDEX_ALLOWED, LOWEST_INDEX

DEGREE = 5  # of the splines over cosines
FEWEST_COSINES, FEWEST_AZIMUTHS = 2, 3
WIDEST_GAP = 90.0  # largest step between azimuths [degrees], mirror images counted
HOLE = 25.0  # degrees from the normal: a table whose directions begin farther away gets a warning
FEWEST_QUARTERED = 12  # cosines from which on a quarter of them tells an interpolation error
COARSE = 1e-2  # relative interpolation error above which a table gets a warning
SAME_AZIMUTHS = 1e-6  # azimuths closer than this are one [degrees]
SYMMETRIC = 1e-8  # of the largest element, that mirror images may differ by
ROUNDING = 1e-14  # of the largest order: below, an order is dark
DARK = 1e-12  # of the largest element, that f_00 may be below zero
MOST_CHECKED = 4096  # matrices of a table whose coherency is checked
ODD = np.outer(FLIP, FLIP) < 0.0  # elements that are odd in azimuth
ENTRY = 1.0 - 2.0 * (ODD & (np.arange(4)[:, None] < 2))  # sign of their sine: -1 in (I,Q)-(U,V)


class CoarseTableWarning(UserWarning):
    """A table as base does not reach where light is, or is too coarse to interpolate well."""


@dataclass(frozen=True, eq=False, repr=False)
class TabulatedBase(Boundary):
    """A base whose Mueller BRDF is tabulated over directions, measured or solved for.

    Its Fourier orders are those of the table's own azimuths, exact where these are evenly spaced and more than twice as
    many all around as there are orders. Over the cosines splines of degree 5 run in s, theta = 90 degrees sin(pi s/2),
    through f (mu_i + mu_o), over the normal and beyond the horizon as mirror images; what does not depend on direction
    is exact. Below the smallest cosine of the table f is taken for constant.

    Parameters
    ----------
    mu_i : array_like (n_in,)
        Cosines of incidence, above 0 up to 1, at least two, in any order.
    mu_o : array_like (n_out,)
        Cosines of exit, likewise.
    phi_deg : array_like (n_phi,)
        Azimuths [degrees], outgoing minus incident, both along the direction of travel: 0 to 180, or all around. Evenly
        spaced ones are best; through others a periodic cubic spline runs.
    mueller : array_like (n_in, n_out, n_phi, 4, 4)
        f [1/sr], in the meridian planes.
    specular : array_like (n_in, 4, 4), optional
        Mueller matrices of the part of a beam's power that is reflected as a beam, where the table is that of something
        with a smooth surface; interpolated over mu_i alike.
    index_above : float, optional
        Refractive index of the medium that the table was found in, which the base then has to lie in; None for any.
    average_mirrored : bool, optional
        Whether f(phi) and D f(-phi) D, D = diag(1, 1, -1, -1), are averaged where they differ, as measured ones do.

    Raises
    ------
    SceneError
        For wrong shapes, values that are not finite, f_00 < 0, azimuths more than 90 degrees apart, f(-phi) that is not
        D f(phi) D to 1e-8 of the largest element, and what is not physical, as for `vrte.MuellerBase`.

    Warns
    -----
    CoarseTableWarning
        Where the smallest cosine is above 0.05, as the nodes' light falls in below it too, where no direction is within
        25 degrees of the normal, and where ``interpolation_error`` is above 0.01.

    Attributes
    ----------
    interpolation_error : float
        How far f is off between the table's directions, relative: the root of the mean square over both hemispheres,
        weighted by both cosines, estimated from leaving out every other direction, and three of four (of fewer than 12
        cosines every other alone, which tells too much).

    References
    ----------
    (1:35).

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> mu = [0.02, 0.3, 0.6, 1.0]
    >>> f = np.broadcast_to(np.diag([1 / np.pi, 0, 0, 0]), (4, 4, 3, 4, 4))
    >>> white = vrte.TabulatedBase(mu, mu, [0, 90, 180], f)
    >>> white.reflectance([0.5]).round(12).tolist(), white
    ([1.0], TabulatedBase(4 mu_i, 4 mu_o, 1 Fourier order))
    """

    mu_i: Any
    mu_o: Any
    phi_deg: Any
    mueller: Any
    specular: Any = None
    index_above: float | None = 1.0
    average_mirrored: bool = False
    interpolation_error: float = field(init=False)
    _cosines: tuple[Array, Array] = field(init=False)  # descending
    _orders: Array = field(init=False)  # R^m/(2 pi) times the sum of the cosines, (order, in, out, 4, 4)
    _specular: Array | None = field(init=False, default=None)

    orders_reflected = np.inf
    mixes_stokes = True

    def __post_init__(self) -> None:
        mu_i, mu_o = (check_cosines_of(name, getattr(self, name)) for name in ("mu_i", "mu_o"))
        phi_deg = check_vector("base: phi_deg", self.phi_deg)
        mueller = check_matrices_of("mueller", self.mueller, (mu_i.size, mu_o.size, phi_deg.size, 4, 4))
        named: dict[str, Any] = {"mu_i": mu_i, "mu_o": mu_o, "phi_deg": phi_deg, "mueller": mueller}
        into, out = np.argsort(-mu_i), np.argsort(-mu_o)
        if self.specular is not None:
            named["specular"] = check_matrices_of("specular", self.specular, (mu_i.size, 4, 4))
            named["_specular"] = make_readonly(named["specular"][into])
        check_fields("base: ", self, {"index_above": (LOWEST_INDEX, HIGHEST_INDEX, INDEX_ALLOWED)})
        if (mueller[..., 0, 0] < -DARK * np.abs(mueller).max()).any():
            raise SceneError.of("base: mueller", f"must have f_00 >= 0, not {mueller[..., 0, 0].min():.3g}")
        orders, azimuths = expand_azimuths(phi_deg, mueller, self.average_mirrored)
        cosines = mu_i[into], mu_o[out]
        weighted = orders[:, into[:, None], out] * (cosines[0][:, None] + cosines[1])[..., None, None]
        named |= {"_cosines": cosines, "_orders": make_readonly(weighted)}
        named["interpolation_error"] = estimate_error(cosines, weighted, azimuths)
        vars(self).update(named)
        self._check()

    def _check(self) -> None:
        """Raises SceneError for what no surface does, and says what the table does not reach."""
        count = self.mueller[..., 0, 0].size
        sample = np.unravel_index(np.arange(0, count, -(-count // MOST_CHECKED)), self.mueller.shape[:3])
        directions = (axis[index] for axis, index in zip((self.mu_i, self.mu_o, self.phi_deg), sample, strict=True))
        check_physical(self.mueller[sample], *directions)
        check_energy(self.reflectance)
        words = []
        lowest = max(axis.min() for axis in (self.mu_i, self.mu_o))
        if lowest > GRAZING:
            words.append(f"begins at the cosine {lowest:.3g}: what falls in or leaves below is taken for that")
        nearest = np.degrees(np.arccos(min(axis.max() for axis in (self.mu_i, self.mu_o))))
        if nearest > HOLE:
            words.append(f"has no direction nearer to the normal than {nearest:.3g} degrees")
        if self.interpolation_error > COARSE:
            words.append(f"is off by about {self.interpolation_error:.2g} of itself between its directions")
        if words:
            warn_user(f"base: the table {', and '.join(words)}", CoarseTableWarning)

    def __repr__(self) -> str:
        mirrors = ", mirrored beams" if self.keeps_beams else ""
        orders = f"{len(self._orders)} Fourier order{'s'[: len(self._orders) > 1]}"
        return f"TabulatedBase({self.mu_i.size} mu_i, {self.mu_o.size} mu_o, {orders}{mirrors})"

    @property
    def diagnostics(self) -> dict[str, float]:
        return {"base_interpolation_error": self.interpolation_error}

    @property
    def keeps_beams(self) -> bool:  # type: ignore[override]
        return self.specular is not None and bool(self.specular.any())

    def weigh(self, mu_i: Array, mu_o: Array) -> tuple[Array, Array]:
        """Weights of the table's cosines in f at positive mu_i (n_in,) and mu_o (n_out,), of even and odd Fourier
        orders: (2, n_in, rows), (2, n_out, columns); below the smallest cosine as there."""
        return weigh_cosines(self._cosines[0], mu_i), weigh_cosines(self._cosines[1], mu_o)

    def reflectance(self, mu_i: Any, points: int = 64) -> Array:
        """The share of unpolarized light that is reflected (n,), mirrored beams included, of positive cosines (n,);
        ``points`` of the quadrature over mu_o. Source: (1:35), order 0."""
        into = check_cosines("mu_i", mu_i)
        mu_o, weight = make_exit_rule(points)
        even = interpolate_orders(self._cosines, self._orders[:1], *self.weigh(into, mu_o))[0, :, :, 0, 0]
        found: Array = 2.0 * np.pi * even @ weight
        return found + self.reflect_beam(1.0, into)[:, 0, 0]

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        shape = np.broadcast_shapes(mu_i.shape, mu_o.shape, phi_deg.shape)
        if mu_i.shape[-1:] in ((), (1,)) and mu_o.shape[-1:] in ((), (1,)) and phi_deg.ndim:
            directions = [mu_i[..., 0] if mu_i.ndim else mu_i, mu_o[..., 0] if mu_o.ndim else mu_o, phi_deg]
        else:  # each azimuth with a pair of cosines of its own
            directions = [mu_i, mu_o, phi_deg[..., None]]
        pairs = np.broadcast_shapes(directions[0].shape, directions[1].shape, directions[2].shape[:-1])
        into, out = (np.broadcast_to(axis, pairs).ravel() for axis in directions[:2])
        angle = np.radians(np.broadcast_to(directions[2], (*pairs, directions[2].shape[-1])).reshape(into.size, -1))
        m = np.arange(len(self._orders))
        found = np.empty((*angle.shape, 16))
        (mu_in, lit), (mu_out, seen) = (np.unique(axis, return_inverse=True) for axis in (into, out))
        weights = self.weigh(mu_in, mu_out)
        for k in range(mu_in.size):  # one after another: all at once would take a table's memory a pair
            here = np.flatnonzero(lit == k)
            distinct, index = np.unique(seen[here], return_inverse=True)
            given = weights[0][:, k : k + 1], weights[1][:, distinct]
            orders = interpolate_orders(self._cosines, self._orders, *given)[:, 0].reshape(m.size, -1, 16)
            orders = orders.swapaxes(0, 1)
            turns = angle[here, :, None] * m
            twice = np.where(m > 0, 2.0, 1.0)
            even, odd = ((twice * turn(turns)) @ orders[index] for turn in (np.cos, np.sin))
            found[here] = np.where(ODD.ravel(), odd * ENTRY.ravel(), even)
        return found.reshape(*shape, 4, 4)

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        """Fourier orders R^m from the table's own; of the last orders, none that may be left out."""
        found = 2.0 * np.pi * interpolate_orders(self._cosines, self._orders[:n_order], *self.weigh(mu_i, mu_o))
        found[:, ~pairs] = 0.0
        size = np.abs(found).max(axis=(3, 4))
        needed = (size > allowed(size.max(axis=0))).any(axis=(1, 2))
        return found[: 1 + max(np.flatnonzero(needed), default=0)], 0

    def reflect_beam(self, index: float, mu: Array) -> Array:
        if self._specular is None:
            return super().reflect_beam(index, mu)
        return np.tensordot(weigh_cosines(self._cosines[0], mu)[0], self._specular, 1)


def check_cosines_of(name: str, values: Any) -> Array:
    """Different cosines (n,), at least two. Raises SceneError."""
    found = check_vector(f"base: {name}", values)
    if found.size < FEWEST_COSINES or not ((found > 0.0) & (found <= 1.0)).all() or np.unique(found).size < found.size:
        raise SceneError.of(f"base: {name}", "must be at least two different cosines above 0, up to 1")
    return found


def check_matrices_of(name: str, values: Any, shape: tuple[int, ...]) -> Array:
    """Finite matrices of that shape, read-only. Raises SceneError."""
    found = freeze_copy(check_numbers(f"base: {name}", values))
    if found.shape != shape:
        raise SceneError.of(f"base: {name}", f"must have the shape {shape} to fit its directions, not {found.shape}")
    if not np.isfinite(found).all() or np.abs(found).max() > LARGEST_BASE:
        raise SceneError.of(f"base: {name}", f"must be finite, at most {LARGEST_BASE:g} in size")
    return found


def expand_azimuths(phi_deg: Array, mueller: Array, average_mirrored: bool) -> tuple[Array, int]:
    """R^m/(2 pi) of a table, (order, in, out, 4, 4), and its number of azimuths all around. Raises SceneError."""
    both = np.round(np.concatenate([phi_deg, -phi_deg]) % 360.0, 6) % 360.0
    azimuths, index, count = np.unique(both, return_inverse=True, return_counts=True)
    differences = np.diff(azimuths, append=azimuths[0] + 360.0)
    if differences.max() > WIDEST_GAP + SAME_AZIMUTHS or phi_deg.size < FEWEST_AZIMUTHS:
        words = (
            f"at least {FEWEST_AZIMUTHS} azimuths, from 0 to 180 or all around, at most {WIDEST_GAP:g} degrees apart"
        )
        raise SceneError.of("base: phi_deg", f"must be {words}, mirror images counted, not {differences.max():.4g}")
    together, starts = np.argsort(index, kind="stable"), np.concatenate([[0], np.cumsum(count)[:-1]])
    even = np.ptp(differences) < 2 * SAME_AZIMUTHS
    onto = None if even else interpolate_azimuths(azimuths)
    total = azimuths.size if onto is None else len(onto)
    m = np.arange(total // 2 + 1)
    phase = np.exp(-1j * m * np.radians(azimuths[0] if even else 0.0)) / total
    phase[2 * m == total] *= 0.5
    found = np.empty((m.size, *mueller.shape[:2], 4, 4))
    difference = 0.0
    for k, one in enumerate(mueller):
        images = np.concatenate([one, one * MIRROR], axis=1)[:, together]
        mean = np.add.reduceat(images, starts, axis=1) / count[:, None, None]
        difference = max(difference, 2.0 * np.abs(images - mean[:, index[together]]).max())
        around = mean if onto is None else np.tensordot(onto, mean, (1, 1)).swapaxes(0, 1)
        terms = np.fft.rfft(around, axis=1).swapaxes(0, 1) * phase[:, None, None, None]
        found[:, k] = np.where(ODD, -ENTRY * terms.imag, terms.real)
    largest = np.abs(mueller).max()
    if difference > SYMMETRIC * largest and not average_mirrored:
        raise SceneError(
            "base: f(-phi) must equal D f(phi) D with D = diag(1, 1, -1, -1), as for every mirror-symmetric surface; "
            f"the table breaks this by {difference:.3g} (average_mirrored takes the mean)"
        )
    size = np.abs(found).max(axis=(1, 2, 3, 4))
    kept = 1 + max(np.flatnonzero(size > ROUNDING * size.max()), default=0)
    return found[:kept], azimuths.size


def interpolate_azimuths(azimuths: Array) -> Array:
    """Weights (2 n, n) of a periodic cubic spline from azimuths (n,) [degrees] to even steps from 0 on."""
    grid, index = repeat_grid(azimuths, 360.0)
    weights = compute_weights(grid, np.linspace(0.0, 360.0, 2 * azimuths.size, endpoint=False))
    found = np.zeros((len(weights), azimuths.size))
    np.add.at(found.T, index, weights.T)
    return found


def weigh_cosines(grid: Array, mu: Array) -> Array:
    """Weights (2, n_mu, n) from descending cosines (n,) to mu (n_mu,), of even Fourier orders and of odd ones."""
    s, at = stretch_cosines(grid), stretch_cosines(np.maximum(mu, grid[-1]))
    unit = np.eye(grid.size)
    found = []
    for sign in (1.0, -1.0):
        extended, values = extend_over_horizon(*extend_over_pole(s, unit, sign * unit))
        found.append(compute_weights(extended, at, DEGREE) @ values)
    return np.stack(found)


def interpolate_orders(cosines: tuple[Array, Array], weighted: Array, into: Array, out: Array) -> Array:
    """R^m/(2 pi), (order, in, out, 4, 4), from ``weighted``: that of a table at descending ``cosines`` of both, times
    their sum; ``into`` and ``out`` are the weights of those, (2, in, n_in) and (2, out, n_out)."""
    n_order, n_in, n_out = weighted.shape[:3]
    lit, seen = into.shape[1], out.shape[1]
    found = np.empty((n_order, lit, seen, 16))
    for odd in (0, 1):
        there = into[odd] @ weighted[odd::2].reshape(-1, n_in, n_out * 16)
        found[odd::2] = out[odd] @ there.reshape(-1, lit, n_out, 16)
    # the sum of the cosines as the splines have it: what is even in all directions then stays so to the last place
    found /= ((into[0] @ cosines[0])[:, None] + out[0] @ cosines[1])[:, :, None]
    return found.reshape(n_order, lit, seen, 4, 4)


def estimate_error(cosines: tuple[Array, Array], weighted: Array, azimuths: int) -> float:
    """About how far a table is off between its directions, relative, root of mean square over both hemispheres."""
    both = (cosines[0][:, None] + cosines[1])[..., None, None]
    into, out = (axis * np.abs(np.gradient(axis)) for axis in cosines)
    twice = np.where(np.arange(len(weighted)) > 0, 2.0, 1.0)[:, None, None, None, None]
    scale = np.sqrt(twice * (into[:, None] * out)[..., None, None]) / both
    size, between, beyond = float(np.linalg.norm(scale * weighted)), [], []
    for step in (2, 4):
        kept = [np.flatnonzero(np.arange(axis.size - 1, -1, -1) % step == 0) for axis in cosines]
        fewer = cosines[0][kept[0]], cosines[1][kept[1]]
        weights = (weigh_cosines(some, every) for some, every in zip(fewer, cosines, strict=True))
        found = interpolate_orders(fewer, weighted[:, kept[0][:, None], kept[1]], *weights)
        between.append(float(np.linalg.norm((found * both - weighted) * scale)))
        beyond.append(float(np.linalg.norm((scale * weighted)[azimuths // (2 * step) + 1 :])))
    few = min(into.size, out.size) < FEWEST_QUARTERED  # a quarter of them says nothing
    lost = (between[0] if few else extrapolate_error(*between)) + extrapolate_error(*beyond)
    return lost / size if size > 0.0 else 0.0


def extrapolate_error(halved: float, quartered: float) -> float:
    """The error that a sequence leads to, of every fourth point and every other: falling on at the same rate."""
    return float(halved * min(1.0, halved / quartered)) if quartered > 0.0 else 0.0
