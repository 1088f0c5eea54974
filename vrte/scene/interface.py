"""An interface between two media: where light is refracted and reflected, smooth or rough."""

from dataclasses import dataclass
from typing import Literal

from vrte.basics.arrays import check_flag, check_number, show_value
from vrte.basics.errors import SceneError

Distribution = Literal["beckmann", "ggx"]
DISTRIBUTIONS = ("beckmann", "ggx")
LOWEST_INDEX, HIGHEST_INDEX = 0.1, 10.0
LEAST_ROUGHNESS, MOST_ROUGHNESS = 0.01, 1.5  # alpha: below, facets are as good as a smooth interface
ROUGHNESS_ALLOWED = f"0 (smooth) or from {LEAST_ROUGHNESS:g} to {MOST_ROUGHNESS:g}"


@dataclass(frozen=True)
class Interface:
    """Where the refractive index changes, in the list of a scene's layers: on top, between two of them, or below.

    Parameters
    ----------
    index_above, index_below : float
        Real refractive indices of the two media, 0.1 to 10.
    roughness : float, optional
        alpha, the root mean square slope of facets times sqrt(2): 0 is smooth, else 0.01 to 1.5.
    distribution : {"beckmann", "ggx"}, optional
        Of the facets' slopes: Gaussian (a sea: alpha^2 = 0.003 + 0.00512 wind [m/s]), or with GGX's long tails.
    shadowing : bool, optional
        Whether facets hide each other (Smith's factors); without, they reflect too much near the horizon.

    Raises
    ------
    SceneError
        Naming the field.

    Source: Born and Wolf, Principles of Optics, section 1.5; Walter et al., Microfacet models for refraction (2007).

    >>> Interface(1.0, 1.5).is_smooth
    True
    """

    index_above: float
    index_below: float
    roughness: float = 0.0
    distribution: Distribution = "beckmann"
    shadowing: bool = False

    def __post_init__(self) -> None:
        allowed = f"a real refractive index from {LOWEST_INDEX:g} to {HIGHEST_INDEX:g}"
        for name in ("index_above", "index_below"):
            index = check_number(f"interface: {name}", getattr(self, name), LOWEST_INDEX, HIGHEST_INDEX, allowed)
            object.__setattr__(self, name, index)
        check_facets("interface", self)

    @property
    def is_smooth(self) -> bool:
        """Whether light keeps a single direction on either side."""
        return self.roughness == 0.0

    @property
    def turned(self) -> "Interface":
        """The same, upside down."""
        return Interface(self.index_below, self.index_above, self.roughness, self.distribution, self.shadowing)

    @property
    def in_words(self) -> str:
        """Both indices, and how rough it is.

        >>> Interface(1.0, 1.5, roughness=0.1).in_words
        'interface, index 1 above and 1.5 below, roughness 0.1 (beckmann)'
        """
        shadows = ", shadowing" if self.shadowing else ""
        rough = "" if self.is_smooth else f", roughness {self.roughness:g} ({self.distribution}{shadows})"
        return f"interface, index {self.index_above:g} above and {self.index_below:g} below{rough}"


def check_facets(what: str, given: object) -> None:
    """Settles roughness, distribution and shadowing of a frozen dataclass, or raises a SceneError that names them."""
    roughness = vars(given)["roughness"]
    alpha = check_number(f"{what}: roughness", roughness, 0.0, MOST_ROUGHNESS, ROUGHNESS_ALLOWED)
    if 0.0 < alpha < LEAST_ROUGHNESS:
        raise SceneError.of(f"{what}: roughness", f"must be {ROUGHNESS_ALLOWED}, not {alpha:g}")
    object.__setattr__(given, "roughness", alpha)
    distribution = vars(given)["distribution"]
    if distribution not in DISTRIBUTIONS:
        words = f"must be {' or '.join(map(repr, DISTRIBUTIONS))}, not {show_value(distribution)}"
        raise SceneError.of(f"{what}: distribution", words)
    shadowing = check_flag(f"{what}: shadowing", vars(given)["shadowing"])
    object.__setattr__(given, "shadowing", shadowing)
    if alpha == 0.0 and (distribution != "beckmann" or shadowing):
        unused = "shadowing" if shadowing else "distribution"
        raise SceneError.of(f"{what}: {unused}", "is for facets: give a roughness above 0 as well")
