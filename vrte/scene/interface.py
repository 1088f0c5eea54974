"""An interface between two media: where light is refracted and reflected, smooth or rough."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from vrte.basics.arrays import Array, check_cosines, check_fields
from vrte.basics.errors import SceneError
from vrte.optics.facet_energy import share_energy
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth, transmit_smooth

Distribution = Literal["beckmann", "ggx"]
LOWEST_INDEX, HIGHEST_INDEX = 0.1, 10.0
INDEX_ALLOWED = f"a real refractive index from {LOWEST_INDEX:g} to {HIGHEST_INDEX:g}"
LEAST_ROUGHNESS, MOST_ROUGHNESS = ROUGHNESS = 0.001, 1.5  # alpha: below, facets are as good as a smooth interface
ROUGHNESS_ALLOWED = f"0 (smooth) or from {LEAST_ROUGHNESS:g} to {MOST_ROUGHNESS:g}"


@dataclass(frozen=True)
class Interface:
    """Where the refractive index changes, in the list of a scene's layers: on top, between two of them, or below.

    Parameters
    ----------
    index_above : float
        Real refractive index of the medium above, 0.1 to 10.
    index_below : float
        Real refractive index of the medium below, 0.1 to 10.
    roughness : float, optional
        alpha, the root mean square slope of facets times sqrt(2): 0 is smooth, else 0.001 to 1.5.
    distribution : {"beckmann", "ggx"}, optional
        Of the facets' slopes: Gaussian (a sea: alpha^2 = 0.003 + 0.00512 wind [m/s]), or with GGX's long tails.
    shadowing : bool, optional
        Whether facets hide each other (Smith's factors), as they do by default; without, they make light near the
        horizon, as those of published seas do.
    conserving : bool, optional
        Whether what facets hide from each other is given back, so that all light that comes is reflected or let
        through: by default where they hide each other, and only there.

    References
    ----------
    Born and Wolf, Principles of Optics, section 1.5; Walter et al., Microfacet models for refraction (2007).

    Examples
    --------
    >>> import vrte
    >>> vrte.Interface(1.0, 1.5).is_smooth
    True
    """

    index_above: float
    index_below: float
    roughness: float = 0.0
    distribution: Distribution = "beckmann"
    shadowing: bool | None = None
    conserving: bool | None = None

    def __post_init__(self) -> None:
        limits = LOWEST_INDEX, HIGHEST_INDEX, INDEX_ALLOWED
        check_fields("interface: ", self, {"index_above": limits, "index_below": limits})
        check_facets("interface", self)

    @property
    def is_smooth(self) -> bool:
        """Whether light keeps a single direction on either side."""
        return self.roughness == 0.0

    @property
    def facets(self) -> RoughSurface:
        """What light from above meets, where it is rough."""
        how = self.roughness, self.distribution, bool(self.shadowing), bool(self.conserving)
        return RoughSurface(self.index_above, self.index_below, *how)

    def share(self, mu: Any) -> tuple[Array, Array]:
        """Shares of unpolarized light from above that are reflected and let through, (n,) each, at positive cosines in
        the medium above (n,); what both lack of 1 is hidden by other facets."""
        mu = check_cosines("mu", mu)
        if self.is_smooth:
            index = self.index_below / self.index_above
            return reflect_smooth(index, mu)[:, 0, 0], transmit_smooth(index, mu)[:, 0, 0]
        return share_energy(self.facets, mu)

    @property
    def turned(self) -> "Interface":
        """The interface as a scene upside down has it, its media exchanged."""
        return replace(self, index_above=self.index_below, index_below=self.index_above)

    def put_between(self, above: float, below: float) -> "Interface | None":
        """The same surface between media of indices like its own; None where nothing is refracted."""
        if self.index_above == self.index_below:
            return None
        alike = (above, below) == (self.index_above, self.index_below)
        return self if alike else replace(self, index_above=above, index_below=below)

    @property
    def in_words(self) -> str:
        """Both indices, and how rough it is."""
        energy = "" if self.conserving else ", not conserving" if self.shadowing else ", without shadowing"
        rough = "" if self.is_smooth else f", roughness {self.roughness:g} ({self.distribution}{energy})"
        return f"interface, index {self.index_above:g} above and {self.index_below:g} below{rough}"


def check_facets(what: str, given: object) -> None:
    """Settles what is said of the facets of a frozen dataclass, or raises a SceneError that names the field."""
    check_fields(f"{what}: ", given, {"roughness": (0.0, MOST_ROUGHNESS, ROUGHNESS_ALLOWED)})
    alpha = vars(given)["roughness"]
    if 0.0 < alpha < LEAST_ROUGHNESS:
        raise SceneError.of(f"{what}: roughness", f"must be {ROUGHNESS_ALLOWED}, not {alpha:g}")
    usual = alpha > 0.0
    for name in ("shadowing", "conserving"):  # the latter by default as the former
        flag = vars(given)[name]
        usual = usual if flag is None else flag
        object.__setattr__(given, name, usual)
    if alpha == 0.0:
        for name, plain in (("distribution", "beckmann"), ("shadowing", False), ("conserving", False)):
            if vars(given)[name] != plain:
                raise SceneError.of(f"{what}: {name}", "is for facets: give a roughness above 0 as well")
    if vars(given)["conserving"] and not vars(given)["shadowing"]:
        words = "gives back what facets hide from each other, and without shadowing they hide nothing: leave it out"
        raise SceneError.of(f"{what}: conserving", words)
