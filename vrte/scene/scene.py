"""What light meets: layers of particles, top first, and what lies beneath."""

import math
import pickle
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, in_one_line, listed, number, numbers, settled, vector
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.phase_matrix import NEGATIVE_ALLOWED, PhaseMatrix
from vrte.optics.spheres import Particles

INDEPENDENT_UP_TO = 0.1  # volume fraction
LARGEST_THICKNESS = 1e12  # of a layer that ends; beyond, one without end is meant
LARGEST_BASE = 1e100  # of an element of a base's Mueller matrix [1/sr]
MOST_LAYERS = 10_000
CHECKED_COSINES = settled(np.array([0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0]))  # mu_i of a base's energy
GRAZING = 0.05  # mu_i below which a base may give back more than it gets
ENERGY_ALLOWED = 1e-3  # relative: what quadratures of coarse functions leave
COARSE = 24  # points of a first look at a base's energy
PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])  # of I, Q, U, V


class IndependentScatteringWarning(UserWarning):
    """The particles are so close that they no longer scatter independently of each other."""


@dataclass(frozen=True, eq=False, repr=False)
class Layer:
    """A homogeneous layer: phase matrix, ``albedo`` (of single scattering, 0..1), optical ``thickness`` >= 0.

    ``math.inf`` is allowed for the last layer of a scene. Raises SceneError naming the field.

    >>> from vrte.optics.phase_matrix import isotropic
    >>> Layer(isotropic(), albedo=0.9, thickness=2.0).thickness
    2.0
    """

    phase_matrix: PhaseMatrix
    albedo: float
    thickness: float

    def __post_init__(self) -> None:
        if not isinstance(self.phase_matrix, PhaseMatrix):
            raise SceneError(f"layer: phase_matrix must be a vrte.PhaseMatrix, not {type(self.phase_matrix).__name__}")
        object.__setattr__(self, "albedo", number("layer: albedo", self.albedo, 0.0, 1.0, "between 0 and 1"))
        allowed = f"an optical thickness >= 0, at most {LARGEST_THICKNESS:g} or inf"
        object.__setattr__(self, "thickness", _extent("layer: thickness", self.thickness, allowed))

    def __repr__(self) -> str:
        return f"Layer({self.in_words})"

    @property
    def in_words(self) -> str:
        """Its optical thickness, albedo, and phase matrix.

        >>> from vrte.optics.phase_matrix import isotropic
        >>> Layer(isotropic(), albedo=0.9, thickness=2.0).in_words
        'optical thickness 2, albedo 0.9, g 0, 1 term, scalar'
        """
        return f"optical thickness {self.thickness:.6g}, albedo {self.albedo:.6g}, {self.phase_matrix.in_words}"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    @staticmethod
    def of(
        particles: Particles,
        thickness: float | None = None,
        *,
        thickness_um: float | None = None,
        volume_fraction: float | None = None,
    ) -> "Layer":
        """A layer of ``particles``: optical ``thickness``, or ``thickness_um`` and ``volume_fraction``.

        The volume fraction lies between 0 and 1; above 0.1 it warns (IndependentScatteringWarning). Raises
        SceneError for both or neither.

        >>> from vrte.optics.phase_matrix import rayleigh
        >>> dust = Particles(rayleigh(), 1.0, 0.0, extinction_um2=0.5, scattering_um2=0.5, volume_um3=0.1)
        >>> Layer.of(dust, thickness_um=20.0, volume_fraction=0.01).thickness
        1.0
        """
        if not isinstance(particles, Particles):
            raise SceneError(f"layer: particles must be vrte.spheres(...) or a mixture, not {type(particles).__name__}")
        geometric = thickness_um is not None or volume_fraction is not None
        if (thickness is not None) == geometric or (geometric and (thickness_um is None or volume_fraction is None)):
            raise SceneError("layer: give either thickness, or thickness_um together with volume_fraction")
        if thickness is None:
            thickness = _optical_thickness(particles, thickness_um, volume_fraction)
        return Layer(particles.phase_matrix, particles.albedo, thickness)


def _extent(name: str, value: Any, allowed: str) -> float:
    """From 0 to LARGEST_THICKNESS, or infinite."""
    extent = number(name, value, 0.0, math.inf, allowed)
    return extent if math.isinf(extent) else number(name, value, 0.0, LARGEST_THICKNESS, allowed)


def _optical_thickness(particles: Particles, thickness_um: Any, volume_fraction: Any) -> float:
    """Extinction cross section times number density (volume fraction over particle volume) times length."""
    allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
    length = _extent("layer: thickness_um", thickness_um, allowed)
    fraction = number("layer: volume_fraction", volume_fraction, 5e-324, 1.0 - 2.0**-53, "above 0 and below 1")
    if fraction > INDEPENDENT_UP_TO:
        warnings.warn(
            f"layer: a volume_fraction of {fraction:g} is above {INDEPENDENT_UP_TO}: independent scattering, "
            "which is assumed here, is doubtful",
            IndependentScatteringWarning,
            stacklevel=3,
        )
    return length * fraction / particles.volume_um3 * particles.extinction_um2


@dataclass(frozen=True)
class Lambertian:
    """A base that reflects ``albedo`` (0..1) of the light evenly and unpolarized, f_00 = albedo/pi, (1:66).

    Raises SceneError for an albedo outside.

    >>> Lambertian(0.3).albedo
    0.3
    """

    albedo: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "albedo", number("base: albedo", self.albedo, 0.0, 1.0, "between 0 and 1"))


@dataclass(frozen=True)
class MuellerBase:
    """A base with any mirror-symmetric Mueller BRDF.

    ``function(mu_i, mu_o, phi_deg)`` is called with broadcastable arrays (positive cosines, azimuth in
    degrees relative to the incident light's, both along the direction of travel) and returns (..., 4, 4),
    unit 1/sr, in the meridian planes. Raises SceneError where samples are not finite, have the wrong shape,
    f_00 < 0, break f(-phi) = D f(phi) D, D = diag(1, 1, -1, -1), by more than 1e-8 of the largest, are no
    sum of reflections (a coherency eigenvalue below -1e-4 f_00), or give back more than arrives: of light
    along 8 mu_i from 0.01 to 1, by more than 1e-3, below mu_i = 0.05 more than 0.05/mu_i times as much, which
    facets without shadows do. Source: (1:35), (1:60).

    >>> MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([0.1, 0.0, 0.0, 0.0]))(1.0, [0.5, 1.0], 0.0).shape
    (2, 4, 4)
    """

    function: Callable[[Any, Any, Any], Any]

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise SceneError(f"base: function must be callable, not {type(self.function).__name__}")
        mu_i, mu_o = CHECKED_COSINES[:, None, None], np.array([0.1, 0.6, 0.95])[:, None]
        phi = np.array([0.0, 20.0, 75.0, 160.0, 180.0])
        there, mirrored = self(mu_i, mu_o, phi), self(mu_i, mu_o, -phi)
        flip = np.array([1.0, 1.0, -1.0, -1.0])
        gap = np.abs(mirrored - flip[:, None] * there * flip).max()
        if gap > 1e-8 * max(np.abs(there).max(), 1e-300):
            raise SceneError(
                "base: f(-phi) must equal D f(phi) D with D = diag(1, 1, -1, -1), as for every "
                f"mirror-symmetric surface; the given function breaks this by {gap:.3g}"
            )
        self._check_physical(there, *np.broadcast_arrays(mu_i, mu_o, phi))
        self._check_energy()

    def _check_physical(self, f: Array, mu_i: Array, mu_o: Array, phi: Array) -> None:
        """Sums of what single reflections do to the field have coherency matrices without negative eigenvalues."""
        lowest, intensity = np.linalg.eigvalsh(coherency(f))[..., 0], f[..., 0, 0]
        floor = -NEGATIVE_ALLOWED * intensity - 1e-12 * np.abs(f).max()
        worst = np.unravel_index(np.argmin(lowest - floor), lowest.shape)
        if lowest[worst] < floor[worst]:
            raise SceneError(
                f"base: the Mueller matrix from mu_i {mu_i[worst]:g} to mu_o {mu_o[worst]:g} at phi_deg {phi[worst]:g} "
                f"is not physical: its coherency matrix has the eigenvalue {lowest[worst]:.3g} where f_00 is "
                f"{intensity[worst]:.3g}; at least -{NEGATIVE_ALLOWED:g} f_00 is allowed (check signs and order)"
            )

    def _check_energy(self) -> None:
        """Looks closer, until the quadrature settles, only at what seems to be too much."""
        most = (1.0 + ENERGY_ALLOWED) * np.maximum(1.0, GRAZING / CHECKED_COSINES)
        excess = self.reflectance(CHECKED_COSINES, COARSE) / most
        for place in np.argsort(-excess)[: np.count_nonzero(excess > 1.0)]:  # the worst first
            mu_i, before = CHECKED_COSINES[place : place + 1], np.inf
            for points in (2 * COARSE, 4 * COARSE, 8 * COARSE, 16 * COARSE):
                now = self.reflectance(mu_i, points)[0]
                if now <= most[place] or abs(now - before) <= ENERGY_ALLOWED * now:
                    break
                before = now
            else:
                continue  # too narrow for this quadrature: the solver's own will tell
            if now > most[place]:
                raise SceneError(
                    f"base: the function gives back {now:.4g} of the light that comes along mu_i = {mu_i[0]:g}, and "
                    f"at most {most[place]:.4g} is allowed there (facets without shadows give back too much near the "
                    "horizon)"
                )

    def reflectance(self, mu_i: Any, points: int = 64) -> Array:
        """Share of unpolarized light along ``mu_i`` (n,) that comes back into all directions, (n,).

        Parameters: ``points``, of the quadrature over mu_o and over half of the azimuths. Source: (1:35), order 0.

        >>> MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([0.1, 0.0, 0.0, 0.0])).reflectance([0.5]).round(12) / np.pi
        array([0.1])
        """
        root, weight = np.polynomial.legendre.leggauss(points)
        mu_o = (0.5 * (root + 1.0)) ** 2  # dense at the horizon, where lobes of grazing light are
        phi, share = azimuth_rule(np.arange(1, points), points)
        found = self(vector("mu_i", mu_i)[:, None, None], mu_o[:, None], np.degrees(phi))[..., 0, 0]
        total: Array = 2.0 * (found @ share) @ (weight * np.sqrt(mu_o) * mu_o)
        return total

    def __call__(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Array:
        """f on the broadcast shape of the arguments, checked: (..., 4, 4), 1/sr."""
        named = {"mu_i": mu_i, "mu_o": mu_o, "phi_deg": phi_deg}
        directions = [numbers(f"base: {name}", values) for name, values in named.items()]
        try:
            shape = np.broadcast_shapes(*(values.shape for values in directions))
        except ValueError:
            shapes = ", ".join(str(values.shape) for values in directions)
            raise SceneError(f"base: mu_i, mu_o and phi_deg must broadcast, not be of the shapes {shapes}") from None
        values = numbers("base: what the function returns", self._called(directions, shape))
        try:
            values = np.broadcast_to(values, (*shape, 4, 4))
        except ValueError:
            raise SceneError(
                f"base: the function must return the shape {(*shape, 4, 4)} for arguments that broadcast to "
                f"{shape}, not {values.shape}"
            ) from None
        if not np.isfinite(values).all():
            raise SceneError("base: the function must return finite values; NaN or inf was found")
        if np.abs(values).max(initial=0.0) > LARGEST_BASE:
            raise SceneError(f"base: the function must return values of at most {LARGEST_BASE:g} in size")
        if (values[..., 0, 0] < 0.0).any():
            raise SceneError(f"base: f_00 must be >= 0, not {values[..., 0, 0].min():.3g}")
        return values

    def _called(self, directions: list[Array], shape: tuple[int, ...]) -> Any:
        """What the function makes of copies, which it may change as it likes."""
        try:
            return self.function(*(values.copy() for values in directions))
        except Exception as reason:
            raise SceneError(
                f"base: the function, called with arrays that broadcast to {shape}, failed with "
                f"{in_one_line(f'{type(reason).__name__}: {reason}', 200)}"
            ) from reason

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            pickle.dumps(self.function)
        except Exception as reason:
            name = getattr(self.function, "__qualname__", repr(self.function))
            raise SceneError(
                f"base: the MuellerBase function {name} cannot be pickled: {in_one_line(str(reason), 200)}"
            ) from reason
        return (MuellerBase, (self.function,))


def coherency(mueller: Array) -> NDArray[np.complex128]:
    """H = sum_ij f_ij (sigma_i x sigma_j^*)/4 of Mueller matrices (..., 4, 4), Hermitian, of trace f_00: (..., 4, 4).

    What a mixture of Jones matrices does has eigenvalues >= 0. Source: Cloude, Optik 75, 26 (1986).

    >>> np.linalg.eigvalsh(coherency(np.eye(4))).round(12).tolist()  # one Jones matrix, that changes nothing
    [0.0, 0.0, 0.0, 1.0]
    """
    products = 0.25 * np.einsum("iab,jcd->ijacbd", PAULI, PAULI.conj()).reshape(4, 4, 4, 4)
    found: NDArray[np.complex128] = np.einsum("...ij,ijab->...ab", mueller, products)
    return found


def azimuth_rule(steps: NDArray[np.int64], count: int) -> tuple[Array, Array]:
    """Azimuths from 0 to pi [rad] and weights of the trapezoidal rule in t, phi = t - sin(2 t)/2, t = pi steps/count.

    Dense at both ends, where surfaces have their lobes, narrow at grazing angles, and their cusps, of which t leaves
    little. The ends themselves, steps 0 and ``count``, weigh nothing.

    >>> round(float(azimuth_rule(np.arange(1, 4), 4)[1].sum()), 12)
    3.14159265359
    """
    t = np.pi * steps / count
    return t - 0.5 * np.sin(2.0 * t), 2.0 * np.pi / count * np.sin(t) ** 2


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Layers, top first, over a ``base``: None (black), Lambertian or MuellerBase.

    Raises SceneError for no layers, for one that is no Layer, and for an infinite layer above another.

    >>> from vrte.optics.phase_matrix import rayleigh
    >>> Scene([Layer(rayleigh(), 1.0, 0.5)], Lambertian(0.25)).thickness
    0.5
    """

    layers: Sequence[Layer]
    base: Lambertian | MuellerBase | None = None

    def __post_init__(self) -> None:
        given = (self.layers,) if isinstance(self.layers, Layer) else self.layers
        layers = tuple(listed("layers", given, MOST_LAYERS))
        object.__setattr__(self, "layers", layers)
        if not layers:
            raise SceneError("a scene needs at least one layer, not an empty list")
        for position, layer in enumerate(layers, 1):
            if not isinstance(layer, Layer):
                raise SceneError(f"layer {position} must be a vrte.Layer, not {type(layer).__name__}")
            if math.isinf(layer.thickness) and position < len(layers):
                raise SceneError(f"layer {position}: thickness inf is allowed for the last layer only")
        if not isinstance(self.base, (Lambertian, MuellerBase, type(None))):
            raise SceneError(
                f"base must be None (black), vrte.Lambertian or vrte.MuellerBase, not {type(self.base).__name__}"
            )

    @property
    def thickness(self) -> float:
        """Total optical thickness."""
        return math.fsum(layer.thickness for layer in self.layers)

    @property
    def base_is_reached(self) -> bool:
        """False below a layer without end: the base then plays no part."""
        return math.isfinite(self.thickness)

    def __repr__(self) -> str:
        count = len(self.layers)
        layers = "1 layer" if count == 1 else f"{count} layers"
        head = f"Scene: {layers}, optical thickness {self.thickness:.6g}, base {self.base_in_words}"
        first = f"\n  top: {self.layers[0].in_words}" if count > 1 else f"\n  {self.layers[0].in_words}"
        between = f" ({count - 2} more above)" if count > 2 else ""
        return head + first + (f"\n  bottom: {self.layers[-1].in_words}{between}" if count > 1 else "")

    @property
    def base_in_words(self) -> str:
        """What lies beneath, or that nothing is seen of it.

        >>> from vrte.optics.phase_matrix import isotropic
        >>> Scene([Layer(isotropic(), albedo=0.9, thickness=2.0)]).base_in_words
        'black'
        """
        base = "black" if self.base is None else in_one_line(str(self.base), 80)
        return base if self.base_is_reached else f"{base}, which no light reaches"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")


Base = Lambertian | MuellerBase | None
