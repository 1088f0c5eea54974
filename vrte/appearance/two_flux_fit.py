"""K and S of a panel from its exact reflectances over black and over white, and how far two fluxes are off elsewhere.

As a laboratory does it: the film's total reflectance over black and over a white is read, the surface is taken off by
Saunderson's formula, K and S follow. Here k1 and k2 of the surface are computed instead of guessed, and the film at
any other thickness is solved exactly, beside what K and S say of it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.geometries import Geometry, read_geometry
from vrte.appearance.kubelka_munk import (
    add_surface,
    check_share,
    find_coefficients,
    find_slab_coefficients,
    reflect_film,
    reflect_thick_film,
    remove_surface,
)
from vrte.appearance.panel import Panel
from vrte.appearance.surface_shares import find_surface_shares
from vrte.appearance.two_flux_errors import TwoFluxErrors
from vrte.appearance.two_flux_readings import check_film, find_length, is_inside, measure_panel, solve_film
from vrte.basics.arrays import Array, check_number, check_numbers, freeze_copy
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INSIDE = "inside"  # even light in the medium of the film: what K and S are about
GEOMETRY = "8:di"
SHOWN = 1e-3  # difference over black and white below which a film is taken to hide them: ten times the accuracy


@dataclass(frozen=True, eq=False)
class KubelkaMunk:
    """K and S of a film, and its surface: all that Kubelka and Munk know of a panel.

    Attributes
    ----------
    panel
        The panel, at n wavelengths.
    geometry
        How reflectance was read.
    white
        Albedo of the white base.
    K
        Absorption, (n,) [``unit``: 1/um, or one over the film's own thickness where that is optical].
    S
        Scattering, (n,), in the same unit.
    k1
        What the surface mirrors of the light that falls in, (n,).
    k2
        What it sends back of the light that comes up, (n,), the mean of ``k2_over``.
    k2_over
        What it really sends back over black and over white, (2, n).
    k2_even
        What it would send back of even light, (n,).

    Examples
    --------
    >>> from vrte.appearance.two_flux_fit import find_kubelka_munk
    >>> from vrte.appearance.panel import make_panel
    >>> film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
    >>> found = find_kubelka_munk(make_panel({"layer": [film]}, [0.5], nodes=8), geometry="inside")
    >>> found.predict_thick().round(2).tolist()
    [0.48]
    """

    panel: Panel
    geometry: Geometry
    white: float
    K: Array
    S: Array
    k1: Array
    k2: Array
    k2_over: Array
    k2_even: Array

    @property
    def wavelength_um(self) -> Array:
        """The wavelengths in vacuum (n,) [um]."""
        return self.panel.wavelength_um

    @property
    def unit(self) -> str:
        """What K and S are counted by: 1/um, or 1/film where the thickness is not known as a length."""
        return "1/um" if self.panel.length_um is not None else "1/film"

    @property
    def length(self) -> float:
        """The thickness of the film, in um or films."""
        return find_length(self.panel)

    def predict(self, length: Any, base: Any = 0.0) -> Array:
        """The reflectance that K and S foretell of a film of any thickness over a base.

        Parameters
        ----------
        length : float
            Thickness [um, or films].
        base : float, optional
            Albedo of the Lambertian base, 0 to 1.

        Returns
        -------
        ndarray (n,)
            Above the surface.

        Raises
        ------
        SceneError
            Naming the argument.

        Examples
        --------
        >>> from vrte.appearance.two_flux_fit import find_kubelka_munk
        >>> from vrte.appearance.panel import make_panel
        >>> film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
        >>> found = find_kubelka_munk(make_panel({"layer": [film]}, [0.5], nodes=8), geometry="inside")
        >>> found.predict(0.0, base=0.5).round(12).tolist()
        [0.5]
        """
        return add_surface(reflect_film(self.K, self.S, length, base), self.k1, self.k2)

    def predict_thick(self) -> Array:
        """The reflectance that K/S foretells of a film without end.

        Returns
        -------
        ndarray (n,)
            Above the surface.

        Examples
        --------
        >>> from vrte.appearance.two_flux_fit import find_kubelka_munk
        >>> from vrte.appearance.panel import make_panel
        >>> film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
        >>> found = find_kubelka_munk(make_panel({"layer": [film]}, [0.5], nodes=8), geometry="inside")
        >>> bool(abs(found.predict_thick() - found.predict(1000.0)) < 1e-9)
        True
        """
        return add_surface(reflect_thick_film(self.K, self.S), self.k1, self.k2)

    @cached_property
    def transport(self) -> tuple[Array, Array]:
        """Absorption and reduced scattering coefficients of the film, (n,) each, in the unit of K and S.

        They are (1 - albedo) and albedo (1 - g) times its extinction.
        """
        films = [scene.layers[self.panel.film] for scene in self.panel.scenes]
        extinction = np.array([film.thickness for film in films]) / self.length
        albedo = np.array([film.albedo for film in films])
        g = np.array([film.phase_matrix.asymmetry for film in films])
        return freeze_copy((1.0 - albedo) * extinction), freeze_copy(albedo * (1.0 - g) * extinction)

    @property
    def diffusion(self) -> tuple[Array, Array]:
        """K and S, (n,) each, by which two fluxes fade as diffuse light does.

        They are twice the absorption, and 3/4 of the reduced scattering less 1/4 of the absorption. S < 0 says that
        light does not diffuse at all.
        """
        absorbed, turned = self.transport
        return 2.0 * absorbed, 0.75 * turned - 0.25 * absorbed

    @property
    def over_diffusion(self) -> tuple[Array, Array]:
        """K and S (n,) over those of diffusion; NaN where a film does not absorb, or light in it does not diffuse."""
        absorbing, turning = (
            np.divide(found, said, out=np.full_like(found, np.nan), where=said > 1e-9 * self.S)
            for found, said in zip((self.K, self.S), self.diffusion, strict=True)
        )
        return absorbing, turning

    def compare(self, lengths: Any, progress: Progress | None = None) -> TwoFluxErrors:
        """The panel solved exactly with films of other thicknesses, beside what K and S foretell.

        Parameters
        ----------
        lengths : float or array_like (m,)
            Thicknesses [um, or films], above 0; math.inf is without end.
        progress : callable, optional
            Called with (steps done, steps).

        Returns
        -------
        TwoFluxErrors
            Over black and over white.

        Raises
        ------
        SceneError
            Naming the argument.

        Examples
        --------
        >>> from vrte.appearance.two_flux_fit import find_kubelka_munk
        >>> from vrte.appearance.panel import make_panel
        >>> film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
        >>> found = find_kubelka_munk(make_panel({"layer": [film]}, [0.5], nodes=8), geometry="inside")
        >>> bool(abs(found.compare(1.0).error).max() < 1e-9)  # at the film's own thickness
        True
        """
        wanted = np.atleast_1d(check_numbers("lengths", lengths))
        exact = np.empty((2, wanted.size, self.wavelength_um.size))
        for place, length in enumerate(wanted):
            panel = self.panel.scale_film(check_number("lengths", length, 5e-324, np.inf, "above 0") / self.length)
            part = share_progress(progress, place, wanted.size)
            exact[:, place] = measure_panel(panel, self.geometry, self.white, part)
        found = np.array([[self.predict(length, base) for length in wanted] for base in (0.0, self.white)])
        return TwoFluxErrors(wanted, self.wavelength_um, self.unit, exact, found)

    def plot(self, lengths: Any = None, progress: Progress | None = None) -> "Figure":
        """A figure of `compare`: reflectance against thickness, exact and foretold, and how far it is off.

        Beside it that as a colour difference, and K and S beside those of diffusion.

        Parameters
        ----------
        lengths : array_like (m,), optional
            Thicknesses [um, or films]; default: from an eighth of the film's own to eight times.
        progress : callable, optional
            Called with (steps done, steps).

        Returns
        -------
        matplotlib.figure.Figure
            Its ``savefig`` writes it.

        Raises
        ------
        SceneError
            As `compare` does.
        MissingExtraError
            Without the extras "plot" and "appearance".

        Examples
        --------
        >>> len(painted.two_fluxes.plot([0.5, 1.0]).axes) > 0  # as `vrte.paint` finds it in its example
        True
        """
        from vrte.appearance.two_flux_picture import draw_two_fluxes

        usual = self.length * 2.0 ** np.arange(-3.0, 3.5, 0.5)
        return draw_two_fluxes(self, self.compare(usual if lengths is None else lengths, progress))

    def __str__(self) -> str:
        """A line a wavelength: K, S, both over what diffusion says, and what the surface mirrors and sends back."""
        rows = [
            f"  [um]  K [{self.unit}]  S [{self.unit}]  K/diffusion  S/diffusion   k1     k2   over black, white   even"
        ]
        columns = (
            self.wavelength_um,
            self.K,
            self.S,
            *self.over_diffusion,
            self.k1,
            self.k2,
            *self.k2_over,
            self.k2_even,
        )
        for at, K, S, absorbed, turned, *shares in zip(*columns, strict=True):
            rows.append(
                f"{at:6.3f}  {K:9.5f}  {S:9.5f}  {absorbed:11.3f}  {turned:11.3f}  "
                + "  ".join(f"{one:.3f}" for one in shares)
            )
        return "\n".join(rows)


def find_kubelka_munk(
    panel: Panel,
    white: float = 0.8,
    geometry: str = GEOMETRY,
    k1: Any = None,
    k2: Any = None,
    progress: Progress | None = None,
) -> KubelkaMunk:
    """K and S of a panel's film from its exact reflectances over black and over white, and Saunderson's k1 and k2.

    Parameters
    ----------
    panel : Panel
        One film, with or without a surface on top; what lies below it is replaced by black and by white.
    white : float, optional
        Albedo of the white, Lambertian base in the medium of the film.
    geometry : str, optional
        How reflectance is read: all light of one direction, "8:di" (or "di:8", which reads the same), or of all,
        "di:di". "inside": evenly diffuse light in the medium of the film, its surface taken off, which is the case that
        K and S are made for; they then come from reflectance and transmittance, also where a film hides its base.
    k1, k2 : float or array_like (n,), optional
        In place of those computed: what a laboratory takes for granted.
    progress : callable, optional
        Called with (steps done, steps).

    Returns
    -------
    KubelkaMunk
        k1 is what the surface mirrors of the light that falls in; k2 the share that it sends back of the light that
        comes up, by the directions that this light has over black and over white, the mean of both.

    Raises
    ------
    SceneError
        For other layers or interfaces than one film under a surface, another geometry, a film that hides its base
        at a wavelength, or one of which two fluxes know no K and S.

    Examples
    --------
    >>> from vrte.appearance.two_flux_fit import find_kubelka_munk
    >>> from vrte.appearance.panel import make_panel
    >>> film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
    >>> found = find_kubelka_munk(make_panel({"layer": [film]}, [0.5], nodes=8), geometry="inside")
    >>> found.unit, found.K.round(2).tolist(), found.S.round(2).tolist()
    ('1/film', [0.38], [1.36])
    """
    check_film(panel)
    under = check_number("white", white, 5e-324, 1.0, "an albedo above 0, up to 1")
    if geometry == INSIDE:
        panel, geometry = panel.take_off_surface(), "di:di"
    known = read_geometry(geometry)
    if known.angle_o is not None or known.excluded:
        raise SceneError.of("geometry", f"must collect all light, '8:di', 'di:di' or 'inside', not {known.name!r}")
    if not any(panel.surface) and not (k1 is None and k2 is None):
        raise SceneError("k1 and k2 are of a surface, and here is none", "k1" if k2 is None else "k2")
    first, second = (share_progress(progress, half, 2) for half in (0, 1))
    outer, over, even = find_surface_shares(panel, known, under, first)
    outer, inner = settle_share("k1", k1, outer), settle_share("k2", k2, over.mean(axis=0))
    if is_inside(panel, known):
        K, S = find_slab_coefficients(*solve_film(panel, second), find_length(panel))
    else:
        read = measure_panel(panel, known, under, second)
        hidden = read[1] - read[0] < SHOWN
        if hidden.any():
            at = ", ".join(f"{one:g}" for one in panel.wavelength_um[hidden])
            raise SceneError(
                f"the film hides its base at {at} um: reflectances over black and white that are less than {SHOWN:g} "
                "apart tell K/S alone; make it thinner, or take geometry='inside'"
            )
        try:
            dark, bright = remove_surface(read, outer, inner)
            K, S = find_coefficients(dark, bright, under, find_length(panel))
        except SceneError as error:
            raise error.behind("with this k1 and k2 no film of two fluxes reads so") from error
    return KubelkaMunk(panel, known, under, *(freeze_copy(one) for one in (K, S, outer, inner, over, even)))


def settle_share(name: str, said: Any, found: Array) -> Array:
    """A share of the surface's as somebody said it, one for all wavelengths or one each, or else as it was found."""
    if said is None:
        return found
    shares = check_share(name, said)
    if shares.shape not in ((), found.shape):
        raise SceneError.of(name, f"must be one number, or one a wavelength, {found.size}, not of shape {shares.shape}")
    return np.broadcast_to(shares, found.shape)
