"""What bounds a stack of layers below: its reflection.

The solver uses the methods of a boundary, never its class. A new one is a class made from `Boundary`, and a scene
takes its objects as base (docs/how_to/extending.md). The matrices of every surface are sums of reflections, and it
gives back no more light than it gets.
"""

import math
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import (
    Array,
    BoolArray,
    check_number,
    check_numbers,
    check_vector,
    check_whole,
    make_readonly,
    put_in_one_line,
)
from vrte.basics.errors import SceneError
from vrte.optics.facets import RoughSurface
from vrte.optics.phase_matrix import NEGATIVE_ALLOWED
from vrte.scene.azimuths import Allowed, Orders, integrate_orders, make_azimuth_rule

LARGEST_BASE = 1e100  # of an element of a base's Mueller matrix [1/sr]
CHECKED_COSINES = make_readonly(np.array([0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0]))  # mu_i of a base's energy
GRAZING = 0.05  # mu_i below which a base may give back more than it gets
ENERGY_ALLOWED = 1e-3  # relative: what quadratures of coarse functions leave
MOST_POINTS = 4096
COARSE = 24  # points of a first look at a base's energy
PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])  # of I, Q, U, V


def find_coherency(mueller: Array) -> NDArray[np.complex128]:
    """H = sum_ij f_ij (sigma_i x sigma_j^*)/4 of Mueller matrices (..., 4, 4), whose eigenvalues are >= 0 for mixtures
    of Jones matrices: (..., 4, 4). Source: Cloude, Optik 75, 26 (1986)."""
    products = 0.25 * np.einsum("iab,jcd->ijacbd", PAULI, PAULI.conj()).reshape(4, 4, 4, 4)
    return np.einsum("...ij,ijab->...ab", mueller, products)


def check_physical(f: Array, mu_i: Array, mu_o: Array, phi_deg: Array) -> None:
    """Whether f (..., 4, 4) at directions (...) is a sum of reflections (coherency). Raises SceneError."""
    lowest, intensity = np.linalg.eigvalsh(find_coherency(f))[..., 0], f[..., 0, 0]
    floor = -NEGATIVE_ALLOWED * intensity - 1e-12 * np.abs(f).max()
    worst = np.unravel_index(np.argmin(lowest - floor), lowest.shape)
    if lowest[worst] < floor[worst]:
        raise SceneError(
            f"base: the Mueller matrix from mu_i {mu_i[worst]:g} to mu_o {mu_o[worst]:g} at phi_deg "
            f"{phi_deg[worst]:g} is not physical: its coherency matrix has the eigenvalue {lowest[worst]:.3g} where "
            f"f_00 is {intensity[worst]:.3g}; at least -{NEGATIVE_ALLOWED:g} f_00 is allowed (check signs and order)"
        )


def make_exit_rule(points: int) -> tuple[Array, Array]:
    """Cosines of exit (points,), dense at the horizon, and weights of the integral of mu_o f dmu_o."""
    root, weight = np.polynomial.legendre.leggauss(check_whole("points", points, 2, MOST_POINTS))
    mu_o = (0.5 * (root + 1.0)) ** 2
    return mu_o, weight * np.sqrt(mu_o) * mu_o


def check_energy(reflectance: Callable[[Array, int], Array]) -> None:
    """Whether a base gives back no more than it gets, by quadratures of ``reflectance``. Raises SceneError."""
    most = (1.0 + ENERGY_ALLOWED) * np.maximum(1.0, GRAZING / CHECKED_COSINES)
    excess = reflectance(CHECKED_COSINES, COARSE) / most
    for index in np.argsort(-excess)[: np.count_nonzero(excess > 1.0)]:  # the worst first
        mu_i, before = CHECKED_COSINES[index : index + 1], np.inf
        for points in (2 * COARSE, 4 * COARSE, 8 * COARSE, 16 * COARSE):
            now = reflectance(mu_i, points)[0]
            if now <= most[index] or abs(now - before) <= ENERGY_ALLOWED * now:
                break
            before = now
        else:
            continue  # too narrow for this quadrature: the solver's own quadrature shows it
        if now > most[index]:
            raise SceneError(
                f"base: it gives back {now:.4g} of the light along mu_i = {mu_i[0]:g}, and at most "
                f"{most[index]:.4g} is allowed there (facets without shadows give back too much near the horizon)"
            )


class Boundary:
    """What lies below a stack of layers; by itself it is black: nothing is reflected.

    A new kind of base is a class made from this one; a scene takes its objects as base.

    Attributes
    ----------
    orders_reflected
        How many Fourier orders are reflected: 0 none, 1 evenly (Lambertian), math.inf all.
    mixes_stokes
        Whether light is reflected as other Stokes parameters than it came.
    keeps_beams
        Whether a beam is reflected as a beam, as `reflect_beam` says.
    facets
        The rough surface that it is, or None.
    index_above
        Refractive index of the medium that it has to lie in, None for any.

    Examples
    --------
    >>> import numpy as np
    >>> from vrte.scene.boundary import Boundary
    >>> bool(Boundary().reflect_beam(1.0, np.array([0.5])).any()), Boundary().name
    (False, 'black')
    """

    orders_reflected: float = 0
    mixes_stokes: bool = False
    keeps_beams: bool = False
    facets: RoughSurface | None = None
    index_above: float | None = None
    LIMITS: ClassVar[Mapping[str, tuple[float, float]]] = {}  # from and to which each of its numbers goes

    def __post_init__(self) -> None:
        """Checks that its numbers are within LIMITS; None passes where it is the default. Raises SceneError."""
        for name, (low, high) in self.LIMITS.items():
            value = getattr(self, name)
            if value is not None or getattr(type(self), name, 0.0) is not None:
                allowed = f"between {low:g} and {high:g}"
                object.__setattr__(self, name, check_number(f"base: {name}", value, low, high, allowed))

    @property
    def name(self) -> str:
        """What it is called in diagnostics, and in the lists of boundaries that methods take."""
        return "black" if type(self) is Boundary else type(self).__name__

    @property
    def is_uneven(self) -> bool:
        """Whether light is reflected otherwise than evenly and unpolarized."""
        return self.mixes_stokes or self.orders_reflected > 1

    @property
    def diagnostics(self) -> dict[str, float]:
        """What the diagnostics of a result hold of it beside its name."""
        return {}

    @property
    def even_albedo(self) -> float:
        """Albedo of its Lambertian part."""
        return 0.0

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        """Mueller matrices f [1/sr] (..., S, S) of diffuse reflection, S the Stokes parameters not left dark; positive
        cosines and azimuth [degrees] (outgoing minus incident, along travel) broadcast."""
        return np.zeros((1, 1))

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        """Fourier orders R^m (order, n_in, n_out, 4, 4) of diffuse reflection, (1:35), below ``n_order``, for the
        ``pairs`` (n_in, n_out) of positive cosines, each off by ``allowed`` at most; and the number of azimuths they
        took."""
        return np.zeros((0, mu_i.size, mu_o.size, 4, 4)), 0

    def put_in_medium(self, index: float) -> "Boundary":
        """The same boundary as light meets it in a medium of that refractive index."""
        return self

    def reflect_beam(self, index: float, mu: Array) -> Array:
        """Mueller matrices (n, 4, 4) of a beam reflected as a beam; positive cosines (n,) in that medium."""
        return np.zeros((mu.size, 4, 4))


BLACK = Boundary()


@dataclass(frozen=True)
class Lambertian(Boundary):
    """A base that reflects evenly and unpolarized, f_00 = albedo/pi, (1:66).

    Parameters
    ----------
    albedo : float
        Reflected over incident flux, 0 to 1; SceneError for another.

    Examples
    --------
    >>> import vrte
    >>> vrte.Lambertian(0.3).albedo
    0.3
    """

    albedo: float

    orders_reflected = 1
    LIMITS: ClassVar = {"albedo": (0.0, 1.0)}

    @property
    def even_albedo(self) -> float:
        return self.albedo

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        return np.array([[self.albedo / np.pi]])

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        orders = np.zeros((1, mu_i.size, mu_o.size, 4, 4))
        orders[..., 0, 0] = 2.0 * self.albedo
        return orders, 0


@dataclass(frozen=True, eq=False)
class WeightedBase(Boundary):
    """What several boundaries reflect, weighted and added up; not checked to be physical."""

    parts: tuple[tuple[float, Boundary], ...]

    def __post_init__(self) -> None:
        members = [part for _, part in self.parts]
        media = [part.index_above for part in members if part.index_above is not None]
        vars(self).update(
            orders_reflected=max(part.orders_reflected for part in members),
            mixes_stokes=any(part.mixes_stokes for part in members),
            keeps_beams=any(part.keeps_beams for part in members),
            index_above=media[0] if media else None,
        )

    @property
    def even_albedo(self) -> float:
        return float(sum(weight * part.even_albedo for weight, part in self.parts))

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        found = [weight * part.reflect(mu_i, mu_o, phi_deg) for weight, part in self.parts]
        shape = np.broadcast_shapes(*(one.shape[:-2] for one in found))
        seen = max(one.shape[-1] for one in found)
        total = np.zeros((*shape, seen, seen))
        for one in found:
            total[..., : one.shape[-1], : one.shape[-1]] += one
        return total

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        found = [part.reflect_orders(mu_i, mu_o, pairs, n_order, allowed) for _, part in self.parts]
        total = np.zeros((max(len(orders) for orders, _ in found), mu_i.size, mu_o.size, 4, 4))
        for (weight, _), (orders, _) in zip(self.parts, found, strict=True):
            total[: len(orders)] += weight * orders
        return total, max(azimuths for _, azimuths in found)

    def put_in_medium(self, index: float) -> "WeightedBase":
        return WeightedBase(tuple((weight, part.put_in_medium(index)) for weight, part in self.parts))

    def reflect_beam(self, index: float, mu: Array) -> Array:
        return sum((weight * part.reflect_beam(index, mu) for weight, part in self.parts), np.zeros((1, 4, 4)))


class SampledBase(Boundary):
    """A base that is known by its f of any two directions: made from this class, it has `reflect` and no more."""

    orders_reflected = math.inf

    def reflectance(self, mu_i: Any, points: int = 64) -> Array:
        """The share of unpolarized light that is reflected (n,), of positive cosines (n,); ``points`` of the quadrature
        over mu_o and over half of the azimuths. Source: (1:35), order 0."""
        mu_o, weight = make_exit_rule(points)
        phi, share = make_azimuth_rule(np.arange(1, points), points)
        found = self.reflect(check_vector("mu_i", mu_i)[:, None, None], mu_o[:, None], np.degrees(phi))[..., 0, 0]
        return 2.0 * (found @ share) @ weight

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        found, azimuths = integrate_orders(self.reflect, mu_i, mu_o, pairs, n_order, allowed)
        dark = 0, 4 - found.shape[-1]
        return np.pad(found, ((0, 0), (0, 0), (0, 0), dark, dark)) if dark[1] else found, azimuths


@dataclass(frozen=True)
class MuellerBase(SampledBase):
    """A base with any mirror-symmetric Mueller BRDF.

    Parameters
    ----------
    function : callable
        ``function(mu_i, mu_o, phi_deg)``, called with broadcastable arrays (positive cosines, azimuth in degrees
        relative to the incident light's, both along the direction of travel), returns (..., 4, 4) [1/sr] in the
        meridian planes.

    Raises
    ------
    SceneError
        Where samples are not finite, have the wrong shape, f_00 < 0, break f(-phi) = D f(phi) D, D = diag(1, 1, -1,
        -1), by more than 1e-8 of the largest, are no sum of reflections (a coherency eigenvalue below -1e-4 f_00), or
        give back more than arrives: of light along 8 mu_i from 0.01 to 1, by more than 1e-3, below mu_i = 0.05 more
        than 0.05/mu_i times as much, which facets without shadows do.

    References
    ----------
    (1:35), (1:60).

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> vrte.MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([0.1, 0.0, 0.0, 0.0]))(1.0, [0.5, 1.0], 0.0).shape
    (2, 4, 4)
    """

    function: Callable[[Any, Any, Any], Any]

    mixes_stokes = True

    def __post_init__(self) -> None:
        mu_i, mu_o = CHECKED_COSINES[:, None, None], np.array([0.1, 0.6, 0.95])[:, None]
        phi = np.array([0.0, 20.0, 75.0, 160.0, 180.0])
        there, mirrored = self(mu_i, mu_o, phi), self(mu_i, mu_o, -phi)
        flip = np.array([1.0, 1.0, -1.0, -1.0])
        difference = np.abs(mirrored - flip[:, None] * there * flip).max()
        if difference > 1e-8 * max(np.abs(there).max(), 1e-300):
            raise SceneError(
                "base: f(-phi) must equal D f(phi) D with D = diag(1, 1, -1, -1), as for every "
                f"mirror-symmetric surface; the given function breaks this by {difference:.3g}"
            )
        check_physical(there, *np.broadcast_arrays(mu_i, mu_o, phi))
        check_energy(self.reflectance)

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        return self(mu_i, mu_o, phi_deg)

    def __call__(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Array:
        """f on the broadcast shape of the arguments, checked: (..., 4, 4), 1/sr."""
        named = {"mu_i": mu_i, "mu_o": mu_o, "phi_deg": phi_deg}
        directions = [check_numbers(f"base: {name}", values) for name, values in named.items()]
        try:
            shape = np.broadcast_shapes(*(values.shape for values in directions))
        except ValueError:
            shapes = ", ".join(str(values.shape) for values in directions)
            raise SceneError(f"base: mu_i, mu_o and phi_deg must broadcast, not be of the shapes {shapes}") from None
        try:
            given = self.function(*(values.copy() for values in directions))  # which it may change as it likes
        except Exception as reason:
            error = put_in_one_line(f"{type(reason).__name__}: {reason}", 200)
            words = f"called with arrays that broadcast to {shape}, failed with {error}"
            raise SceneError(f"base: the function, {words}") from reason
        values = check_numbers("base: what the function returns", given)
        try:
            values = np.broadcast_to(values, (*shape, 4, 4))
        except ValueError:
            words = f"the shape {(*shape, 4, 4)} for arguments that broadcast to {shape}, not {values.shape}"
            raise SceneError(f"base: the function must return {words}") from None
        if not np.isfinite(values).all():
            raise SceneError("base: the function must return finite values; NaN or inf was found")
        if np.abs(values).max(initial=0.0) > LARGEST_BASE:
            raise SceneError(f"base: the function must return values of at most {LARGEST_BASE:g} in size")
        if (values[..., 0, 0] < 0.0).any():
            raise SceneError(f"base: f_00 must be >= 0, not {values[..., 0, 0].min():.3g}")
        return values

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            pickle.dumps(self.function)
        except Exception as reason:
            name, error = getattr(self.function, "__qualname__", repr(self.function)), put_in_one_line(str(reason), 200)
            raise SceneError(f"base: the MuellerBase function {name} cannot be pickled: {error}") from reason
        return (MuellerBase, (self.function,))
