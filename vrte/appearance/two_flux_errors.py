"""How far two fluxes are off: reflectances that K and S foretell beside exact ones, at other thicknesses."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vrte.appearance.colours import Colour, find_colour, find_difference
from vrte.basics.arrays import Array

BACKGROUNDS = ("black", "white")


@dataclass(frozen=True, eq=False)
class TwoFluxErrors:
    """How far two fluxes are off: reflectances that K and S foretell beside exact ones, at other thicknesses.

    Attributes
    ----------
    lengths
        Thicknesses of the films, (m,) [um, or films].
    wavelength_um
        Wavelengths in vacuum [um], (n,).
    unit
        The unit of K and S.
    exact
        Reflectances solved exactly, over black and over white, (2, m, n).
    predicted
        Reflectances by K and S, (2, m, n).

    Examples
    --------
    >>> import numpy as np
    >>> from vrte.appearance.two_flux_errors import TwoFluxErrors
    >>> exact, predicted = np.full((2, 1, 1), 0.50), np.full((2, 1, 1), 0.52)
    >>> TwoFluxErrors(np.array([1.0]), np.array([0.55]), "1/film", exact, predicted).error.round(9).ravel().tolist()
    [0.02, 0.02]
    """

    lengths: Array
    wavelength_um: Array
    unit: str
    exact: Array
    predicted: Array

    @property
    def error(self) -> Array:
        """Predicted less exact reflectance, (2, m, n)."""
        return self.predicted - self.exact

    @cached_property
    def colours(self) -> tuple[list[list[Colour]], list[list[Colour]]]:
        """Exact and predicted colours in D65 for 10 degrees, each a list over black and one over white, by film."""
        exact, predicted = (
            [[find_colour(self.wavelength_um, film) for film in over] for over in kind]
            for kind in (self.exact, self.predicted)
        )
        return exact, predicted

    @property
    def difference(self) -> Array:
        """Colour differences CIEDE2000 between predicted and exact, over black and over white, (2, m)."""
        pairs = zip(*self.colours, strict=True)
        return np.array([[find_difference(*pair) for pair in zip(*over, strict=True)] for over in pairs])

    @property
    def contrast_ratio(self) -> Array:
        """Contrast ratios Y over black over Y over white, exact and predicted, (2, m)."""
        return np.array([[black.Y / white.Y for black, white in zip(*kind, strict=True)] for kind in self.colours])
