"""What bounds a pile of layers above and below: what it reflects, and what it lets through.

A boundary answers for itself, and nobody asks for its class. A new one is a class made from `Boundary`, and a scene
takes its objects as base (docs/how_to/extending.md).
"""

import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import (
    Array,
    BoolArray,
    check_number,
    check_numbers,
    check_vector,
    put_in_one_line,
)
from vrte.basics.errors import SceneError
from vrte.optics.facets import RoughSurface
from vrte.scene.azimuths import Allowed, integrate_orders, make_azimuth_rule
from vrte.scene.base_checks import CHECKED_COSINES, LARGEST_BASE, check_energy, check_physical, make_exit_rule


class Boundary:
    """What lies above or below a pile of layers; by itself it is black: nothing comes back, and nothing gets through.

    A new kind of base is a class made from this one; a scene takes its objects as base.

    Attributes
    ----------
    orders_reflected
        Of how many Fourier orders light comes back: 0 none, 1 evenly, math.inf all.
    mixes_stokes
        Whether light comes back, or gets through, as other Stokes parameters than it came.
    keeps_beams
        Whether a beam comes back as one, as `reflect_beam` says.
    facets
        The rough surface that it is, or None.
    index_above
        Refractive index of the medium that it has to lie in, None for any.

    Examples
    --------
    >>> import numpy as np
    >>> from vrte.scene.boundary import Boundary
    >>> bool(Boundary().transmit_straight(np.array([0.5])).any()), Boundary().name
    (False, 'black')
    """

    orders_reflected: float = 0
    mixes_stokes: bool = False
    keeps_beams: bool = False
    facets: RoughSurface | None = None
    index_above: float | None = None

    @property
    def name(self) -> str:
        """What it is called in diagnostics, and in the lists of boundaries that methods take."""
        return "black" if type(self) is Boundary else type(self).__name__

    @property
    def is_uneven(self) -> bool:
        """Whether light comes back in other ways than evenly and unpolarized."""
        return self.mixes_stokes or self.orders_reflected > 1

    @property
    def told(self) -> dict[str, float]:
        """What the diagnostics of a result say of it beside its name."""
        return {}

    @property
    def even_albedo(self) -> float:
        """The share of light that comes back evenly and unpolarized."""
        return 0.0

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        """Mueller matrices of the diffuse reflection of a beam.

        Parameters
        ----------
        mu_i, mu_o : ndarray
            Positive cosines of incidence and exit, which broadcast with each other and with ``phi_deg``.
        phi_deg : ndarray
            Azimuths [degrees], outgoing minus incident, both along the direction of travel.

        Returns
        -------
        ndarray (..., S, S)
            f [1/sr] of the first S Stokes parameters, which all others leave dark, on a shape that broadcasts with that
            of the directions.

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> vrte.Lambertian(0.3).reflect(np.array(0.5), np.array(0.9), np.array(0.0)).round(6).tolist()
        [[0.095493]]
        """
        return np.zeros((1, 1))

    def reflect_orders(
        self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed
    ) -> tuple[Array, int]:
        """Fourier orders R^m of the reflection of diffuse light.

        Parameters
        ----------
        mu_i : ndarray (n_in,)
            Positive cosines of incidence.
        mu_o : ndarray (n_out,)
            Positive cosines of exit.
        pairs : ndarray of bool (n_in, n_out)
            Which pairs of them are wanted.
        n_order : int
            How many orders there may be.
        allowed : callable
            How far each order may be off, of the size of the light that comes back.

        Returns
        -------
        orders : ndarray (order, n_in, n_out, 4, 4)
            Orders beyond those given back are dark.
        azimuths : int
            How many azimuths it took.

        References
        ----------
        (1:35).

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> cosine, all_pairs = np.array([0.5]), np.ones((1, 1), bool)
        >>> vrte.Lambertian(0.3).reflect_orders(cosine, cosine, all_pairs, 4, lambda size: 1e-9 * size)[0].shape
        (1, 1, 1, 4, 4)
        """
        return np.zeros((0, mu_i.size, mu_o.size, 4, 4)), 0

    def put_in_medium(self, index: float) -> "Boundary":
        """The same boundary as light meets it in another medium.

        Parameters
        ----------
        index : float
            Refractive index of the medium.

        Returns
        -------
        Boundary
            Itself, where that makes no difference.

        Examples
        --------
        >>> import vrte
        >>> vrte.Lambertian(0.3).put_in_medium(1.5)
        Lambertian(albedo=0.3)
        """
        return self

    def reflect_beam(self, index: float, mu: Array) -> Array:
        """Mueller matrices of a beam that comes back as a beam.

        Parameters
        ----------
        index : float
            Refractive index of the medium of the light.
        mu : ndarray (n,)
            Positive cosines of incidence there.

        Returns
        -------
        ndarray (n, 4, 4)
            Shares of the beam's power, without unit.

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> vrte.Lambertian(0.3).reflect_beam(1.0, np.array([0.5])).any().item()
        False
        """
        return np.zeros((mu.size, 4, 4))

    def transmit_straight(self, mu: Array) -> Array:
        """Mueller matrices of light that goes through and keeps its direction.

        Parameters
        ----------
        mu : ndarray (n,)
            Positive cosines of the light.

        Returns
        -------
        ndarray (n, 4, 4)
            Zero for every base.

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> vrte.Lambertian(0.3).transmit_straight(np.array([0.5])).any().item()
        False
        """
        return np.zeros((mu.size, 4, 4))


class Transparent(Boundary):
    """Nothing at all: light leaves as it comes, and none comes back. It lies above every pile.

    >>> TRANSPARENT.transmit_straight(np.array([0.5]))[0].diagonal().tolist()
    [1.0, 1.0, 1.0, 1.0]
    """

    @property
    def name(self) -> str:
        return "transparent"

    def transmit_straight(self, mu: Array) -> Array:
        return np.broadcast_to(np.eye(4), (mu.size, 4, 4))


BLACK, TRANSPARENT = Boundary(), Transparent()


@dataclass(frozen=True)
class Lambertian(Boundary):
    """A base that reflects evenly and unpolarized, f_00 = albedo/pi, (1:66).

    Parameters
    ----------
    albedo : float
        The share of the light that comes back, 0 to 1; SceneError for another.

    Examples
    --------
    >>> import vrte
    >>> vrte.Lambertian(0.3).albedo
    0.3
    """

    albedo: float

    orders_reflected = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "albedo", check_number("base: albedo", self.albedo, 0.0, 1.0, "between 0 and 1"))

    @property
    def even_albedo(self) -> float:
        return self.albedo

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        return np.array([[self.albedo / np.pi]])

    def reflect_orders(
        self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed
    ) -> tuple[Array, int]:
        orders = np.zeros((1, mu_i.size, mu_o.size, 4, 4))
        orders[..., 0, 0] = 2.0 * self.albedo
        return orders, 0


class SampledBase(Boundary):
    """A base that is known by its f of any two directions: made from this class, it has `reflect` and no more.

    Examples
    --------
    >>> import numpy as np
    >>> from vrte.scene.boundary import SampledBase
    >>> class Chalk(SampledBase):
    ...     def reflect(self, mu_i, mu_o, phi_deg):
    ...         return (0.2 + 0.0 * (mu_i + mu_o + phi_deg))[..., None, None]
    >>> chalk, cosine = Chalk(), np.array([0.5])
    >>> orders, azimuths = chalk.reflect_orders(cosine, cosine, np.ones((1, 1), bool), 2, lambda size: 1e-9 * size)
    >>> (orders[:, 0, 0, 0, 0] / np.pi).round(12) + 0.0
    array([0.4, 0. ])
    """

    orders_reflected = math.inf

    def reflectance(self, mu_i: Any, points: int = 64) -> Array:
        """The share of unpolarized light that comes back into all directions.

        Parameters
        ----------
        mu_i : float or array_like (n,)
            Positive cosines of incidence.
        points : int, optional
            Of the quadrature over mu_o and over half of the azimuths.

        Returns
        -------
        ndarray (n,)
            From 0 to 1.

        References
        ----------
        (1:35), order 0.

        Examples
        --------
        >>> import numpy as np
        >>> import vrte
        >>> grey = vrte.MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([0.1, 0.0, 0.0, 0.0]))
        >>> grey.reflectance([0.5]).round(12) / np.pi
        array([0.1])
        """
        mu_o, weight = make_exit_rule(points)
        phi, share = make_azimuth_rule(np.arange(1, points), points)
        found = self.reflect(check_vector("mu_i", mu_i)[:, None, None], mu_o[:, None], np.degrees(phi))[..., 0, 0]
        total: Array = 2.0 * (found @ share) @ weight
        return total

    def reflect_orders(
        self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed
    ) -> tuple[Array, int]:
        found, azimuths = integrate_orders(self.reflect, mu_i, mu_o, pairs, n_order, allowed)
        seen = found.shape[-1]
        if seen == 4:
            return found, azimuths
        orders = np.zeros((*found.shape[:3], 4, 4))
        orders[..., :seen, :seen] = found
        return orders, azimuths


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
        gap = np.abs(mirrored - flip[:, None] * there * flip).max()
        if gap > 1e-8 * max(np.abs(there).max(), 1e-300):
            raise SceneError(
                "base: f(-phi) must equal D f(phi) D with D = diag(1, 1, -1, -1), as for every "
                f"mirror-symmetric surface; the given function breaks this by {gap:.3g}"
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
        values = check_numbers("base: what the function returns", self._called(directions, shape))
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
                f"{put_in_one_line(f'{type(reason).__name__}: {reason}', 200)}"
            ) from reason

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            pickle.dumps(self.function)
        except Exception as reason:
            name = getattr(self.function, "__qualname__", repr(self.function))
            raise SceneError(
                f"base: the MuellerBase function {name} cannot be pickled: {put_in_one_line(str(reason), 200)}"
            ) from reason
        return (MuellerBase, (self.function,))
