"""Hiding power: how well a film hides what it lies on, from exact solves over a black and a white card.

The contrast ratio Y_black/Y_white is that of ISO 6504-3, the thickness at which it reaches 0.98 that of ISO 6504-1, and
both those of ASTM D2805; opacity is that of ISO 2471 and TAPPI T 425 (ISO 2471 and D2805 from memory). Cards are
Lambertian and lie under the binder, without a surface of their own; they take the place of the scene's base.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.colours import weigh_wavelengths
from vrte.appearance.drawdown import divide_luminances, find_hiding_film, prepare_drawdown, stretch_contrast
from vrte.appearance.even_bases import OverEvenBases, fit_even_bases
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number, check_vector
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, WHITE, TARGET = 0.0, 0.8, 0.98  # albedos of the drawdown card, and the contrast ratio that passes for hidden
PAPER_WHITE = 0.89  # the even white backing of TAPPI's contrast ratio


@dataclass(frozen=True, eq=False)
class Hiding:
    """How well the film of a panel hides black and white cards, as `find_hiding` finds it.

    The hiding curve is exact at ``times``. ``painted`` in the examples is what the example of `vrte.paint` finds.

    Attributes
    ----------
    geometry
        Of light and eye, "45:0".
    illuminant
        The light.
    observer
        Degrees of the standard observer, 2 or 10.
    black
        Albedo of the black card.
    white
        Albedo of the white card.
    target
        The contrast ratio that counts as hidden.
    wavelength_um
        Wavelengths in vacuum [um], (n,).
    over_even_bases
        Reflectance factors (n,) of the film over a card of any albedo: ``over_even_bases.reflect(albedo)``.
    without_end
        Reflectance factors (n,) of a film so thick that nothing below is seen.
    luminance_without_end
        Y of that, where the perfect white has 1.
    times
        Thicknesses of the curve over the film's own, (m,).
    over_black
        Y over the black card, (m,).
    over_white
        Y over the white card, (m,).
    hiding_times
        The thickness of contrast ratio ``target`` over the film's own; None where there is none.
    reason
        Why there is none, in words.
    length_um
        The film's thickness [um]; None where it is given optically.

    Examples
    --------
    >>> round(painted.hiding.contrast_ratio, 3), round(painted.hiding.hiding_times, 2)
    (0.747, 2.29)
    """

    geometry: str
    illuminant: str
    observer: int
    black: float
    white: float
    target: float
    wavelength_um: Array
    over_even_bases: OverEvenBases
    without_end: Array
    luminance_without_end: float
    times: Array
    over_black: Array
    over_white: Array
    hiding_times: float | None
    reason: str
    length_um: float | None

    def __repr__(self) -> str:
        return f"Hiding({self})"

    def __str__(self) -> str:
        film = "" if self.length_um is None else f" at {self.length_um:.4g} um"
        if self.hiding_times is None:
            return f"contrast ratio {self.contrast_ratio:.4f}{film}, {self.target:g} at no thickness: {self.reason}"
        hides = f"{self.hiding_times:.4g} times the film"
        if self.length_um is not None:
            hides = f"{self.hiding_length_um:.4g} um, {self.spreading_rate:.4g} m2 of dry film a litre"
        return f"contrast ratio {self.contrast_ratio:.4f}{film}, {self.target:g} at {hides}"

    @property
    def reflectance_over_black(self) -> Array:
        """The film's reflectance factor (n,) over the black card."""
        return self.over_even_bases.reflect(self.black)

    @property
    def reflectance_over_white(self) -> Array:
        """The film's reflectance factor (n,) over the white card."""
        return self.over_even_bases.reflect(self.white)

    @property
    def contrast_ratio(self) -> float:
        """Y over black over Y over white, of the film itself: ISO 6504-3; ASTM D2805 over white of 0.80."""
        return self.compare_cards(self.black, self.white)

    @property
    def opacity(self) -> float:
        """Y over a black base over Y without end: ISO 2471, where the geometry is diffuse."""
        return float(divide_luminances(self.find_luminance(self.over_even_bases.bare), self.luminance_without_end))

    @property
    def paper_opacity(self) -> float:
        """Y over a black base over Y over one of 0.89: TAPPI T 425's contrast ratio, there 15:di, A, 2 degrees."""
        return self.compare_cards(0.0, PAPER_WHITE)

    @property
    def contrast_ratios(self) -> Array:
        """Contrast ratios of the curve, (m,)."""
        return divide_luminances(self.over_black, self.over_white)

    @property
    def lengths_um(self) -> Array | None:
        """Thicknesses of the curve [um] (m,), None where the film's is given optically."""
        return None if self.length_um is None else self.times * self.length_um

    @property
    def hiding_length_um(self) -> float | None:
        """The thickness at which the contrast ratio is ``target`` [um]; None where none is, or none is known in um."""
        return None if self.length_um is None or self.hiding_times is None else self.hiding_times * self.length_um

    @property
    def spreading_rate(self) -> float | None:
        """Area that a volume of dry film hides at that thickness [m2/l]; None where that is."""
        length = self.hiding_length_um
        return None if length is None else 1000.0 / length if length > 0.0 else math.inf

    def find_luminance(self, reflectance: Array) -> float:
        """Y of a reflectance factor in this light, where the perfect white has 1.

        Parameters
        ----------
        reflectance : ndarray (n,)
            At ``wavelength_um``.

        Returns
        -------
        float
            From 0 to 1 for what does not fluoresce.

        Examples
        --------
        >>> import numpy as np
        >>> round(painted.hiding.find_luminance(np.full(8, 0.5)), 12)
        0.5
        """
        return float(weigh_wavelengths(self.wavelength_um, self.illuminant, self.observer)[1] @ reflectance)

    def compare_cards(self, black: float, white: float) -> float:
        """The contrast ratio of the film itself over even cards of any two albedos, exact as all the rest is.

        Parameters
        ----------
        black, white : float
            Albedos of the darker and the lighter card, 0 to 1.

        Returns
        -------
        float
            Y over the darker over Y over the lighter.

        Examples
        --------
        >>> painted.hiding.compare_cards(0.0, 0.5) > painted.hiding.compare_cards(0.0, 0.8)
        True
        """
        dark, light = (self.find_luminance(self.over_even_bases.reflect(albedo)) for albedo in (black, white))
        return float(divide_luminances(dark, light))

    def interpolate(self, times: Any) -> tuple[Array, Array]:
        """The contrast ratio, and Y over white, at any thicknesses within those of the curve.

        Cubic splines run through the exact values over the logarithm of the thickness, of contrast in a variable in
        which it is close to straight: good to 3e-3.

        Parameters
        ----------
        times : float or array_like (k,)
            Thicknesses over the film's own.

        Returns
        -------
        contrast : ndarray (k,)
            The contrast ratio.
        over_white : ndarray (k,)
            Y over the white card.

        Raises
        ------
        SceneError
            For a thickness beyond the curve.

        Examples
        --------
        >>> painted.hiding.interpolate(1.0)[0].round(3).tolist()
        [0.747]
        """
        from scipy.interpolate import CubicSpline

        at = check_vector("times", times)
        if not ((at >= self.times[0]) & (at <= self.times[-1])).all():
            raise SceneError.of("times", f"must be from {self.times[0]:g} to {self.times[-1]:g}, where the curve ends")
        known = np.log(self.times)
        contrast = -np.expm1(-np.exp(CubicSpline(known, stretch_contrast(self.contrast_ratios))(np.log(at))))
        return contrast, CubicSpline(known, self.over_white)(np.log(at))

    def plot(self) -> "Figure":
        """A figure of the hiding curve, and of Y over both cards.

        Returns
        -------
        matplotlib.figure.Figure
            Its ``savefig`` writes it.

        Raises
        ------
        MissingExtraError
            Without the extra "plot".

        Examples
        --------
        >>> len(painted.hiding.plot().axes) > 0
        True
        """
        from vrte.appearance.hiding_picture import draw_hiding

        return draw_hiding(self)


def find_contrast(
    panel: Panel,
    black: float = BLACK,
    white: float = WHITE,
    geometry: str = "45:0",
    illuminant: str = "D65",
    observer: int = 10,
    progress: Progress | None = None,
) -> float:
    """The contrast ratio Y_black/Y_white of a panel's film over a black and a white card: two solves a wavelength.

    Parameters
    ----------
    panel : Panel
        Its base is left out: the cards take its place.
    black, white : float, optional
        Albedos of the cards under the binder, 0 to 1, black below white.
    geometry, illuminant, observer
        As for `find_reflectance` and `weigh_wavelengths`.
    progress : callable, optional
        Called with (solves done, solves).

    Returns
    -------
    float
        1 where the film hides the card.

    Raises
    ------
    SceneError
        For bad input.

    Examples
    --------
    >>> from vrte.appearance.hiding import find_contrast
    >>> from vrte.appearance.panel import make_panel
    >>> grey = {"phase": "isotropic", "albedo": 0.5, "thickness": 0.0}
    >>> panel = make_panel({"layer": [grey]}, [0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68])
    >>> round(find_contrast(panel, black=0.2, white=0.8), 12)  # of the bare cards
    0.25
    """
    return prepare_drawdown(panel, black, white, geometry, illuminant, observer, progress, expected=2).find_contrast(
        1.0
    )


def find_hiding(
    panel: Panel,
    black: float = BLACK,
    white: float = WHITE,
    geometry: str = "45:0",
    illuminant: str = "D65",
    observer: int = 10,
    target: float = TARGET,
    progress: Progress | None = None,
) -> Hiding:
    """How well a panel's film hides black and white cards, and how thick it has to be for that.

    Parameters
    ----------
    panel, black, white, geometry, illuminant, observer
        As for `find_contrast`.
    target : float, optional
        The contrast ratio that counts as hidden, above 0 and below 1.
    progress : callable, optional
        Called with (solves done, solves), whose number is a guess until the end.

    Returns
    -------
    Hiding
        The thickness that hides is found by exact solves, to 1e-3 of itself.

    Raises
    ------
    SceneError
        For bad input, and for a film without end or without thickness.

    Examples
    --------
    >>> from vrte.appearance.hiding import find_hiding
    >>> from vrte.appearance.panel import make_panel
    >>> white = {"phase": "isotropic", "albedo": 1.0, "thickness": 10.0}
    >>> print(find_hiding(make_panel({"layer": [white]}, [0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68], nodes=4)))
    contrast ratio 0.9470, 0.98 at 1.818 times the film
    """
    target = check_number("target", target, 1e-6, 1.0 - 1e-6, "a contrast ratio above 0 and below 1")
    thickness = max(scene.layers[panel.film].thickness for scene in panel.scenes)
    if not 0.0 < thickness < math.inf:
        how = "without end, and hides everything" if thickness > 0.0 else "without thickness"
        raise SceneError(f"hiding: the film is {how}: give it a thickness to begin with, above 0 and not inf", "layer")
    drawdown = prepare_drawdown(panel, black, white, geometry, illuminant, observer, progress)
    without_end = drawdown.read(math.inf, 0.0)
    limit = float(drawdown.weights @ without_end)
    even = fit_even_bases(*(drawdown.read(1.0, albedo) for albedo in (0.0, 0.5, 1.0)))
    dark, light = (float(drawdown.weights @ even.reflect(albedo)) for albedo in drawdown.cards)
    drawdown.found[1.0] = dark, light
    hiding, reason = find_hiding_film(drawdown, target, limit)
    times = drawdown.list_curve(hiding or 1.0)
    curve = np.array([drawdown.measure(each) for each in times])
    if progress is not None:
        progress(drawdown.solves, drawdown.solves)
    return Hiding(
        geometry=drawdown.geometry.name,
        illuminant=illuminant,
        observer=observer,
        black=drawdown.cards[0],
        white=drawdown.cards[1],
        target=target,
        wavelength_um=panel.wavelength_um,
        over_even_bases=even,
        without_end=without_end,
        luminance_without_end=limit,
        times=np.array(times),
        over_black=curve[:, 0],
        over_white=curve[:, 1],
        hiding_times=hiding,
        reason=reason,
        length_um=panel.length_um,
    )
