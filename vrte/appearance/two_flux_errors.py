"""How far two fluxes are off: reflectances that K and S foretell beside exact ones, at other thicknesses."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vrte.appearance.colours import Colour, find_colour, find_difference
from vrte.basics.arrays import Array

BACKGROUNDS = ("black", "white")


@dataclass(frozen=True, eq=False)
class TwoFluxErrors:
    """Films as thick as ``lengths`` (m,) [um, or films]: ``exact`` and ``predicted`` reflectances (2, m, n) over black
    and over white at n wavelengths [um]; ``unit`` of K and S."""

    lengths: Array
    wavelength_um: Array
    unit: str
    exact: Array
    predicted: Array

    @property
    def error(self) -> Array:
        """Predicted less exact reflectance (2, m, n)."""
        return self.predicted - self.exact

    @cached_property
    def colours(self) -> tuple[list[list[Colour]], list[list[Colour]]]:
        """Exact and predicted colours over black and white, [which of both][which film], in D65 for 10 degrees.

        Raises SceneError where there are too few wavelengths, MissingExtraError without the extra "appearance".
        """
        exact, predicted = (
            [[find_colour(self.wavelength_um, film) for film in over] for over in kind]
            for kind in (self.exact, self.predicted)
        )
        return exact, predicted

    @property
    def difference(self) -> Array:
        """Colour differences CIEDE2000 (2, m) between predicted and exact, over black and over white."""
        pairs = zip(*self.colours, strict=True)
        return np.array([[find_difference(*pair) for pair in zip(*over, strict=True)] for over in pairs])

    @property
    def contrast_ratio(self) -> Array:
        """Y over black over Y over white (2, m), exact and predicted."""
        return np.array([[black.Y / white.Y for black, white in zip(*kind, strict=True)] for kind in self.colours])
