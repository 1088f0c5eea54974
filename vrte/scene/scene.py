"""What light meets: layers of particles, top first, and what bounds them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vrte.basics.arrays import check_list, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.scene.boundary import BLACK, TRANSPARENT, Boundary
from vrte.scene.layer import Layer

MOST_LAYERS = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """What light meets: layers over a base.

    Parameters
    ----------
    layers : sequence of Layer
        Top first; one alone will do.
    base : None, Lambertian, MuellerBase or another Boundary
        What lies beneath; None is black.

    Raises
    ------
    SceneError
        For no layers, for one that is no Layer, and for an infinite layer above another.

    >>> import vrte
    >>> Scene([Layer(vrte.rayleigh(), 1.0, 0.5)], vrte.Lambertian(0.25)).thickness
    0.5
    """

    layers: Sequence[Layer]
    base: Boundary | None = None

    def __post_init__(self) -> None:
        given = (self.layers,) if isinstance(self.layers, Layer) else self.layers
        layers = tuple(check_list("layers", given, MOST_LAYERS))
        object.__setattr__(self, "layers", layers)
        if not layers:
            raise SceneError("a scene needs at least one layer, not an empty list")
        for position, layer in enumerate(layers, 1):
            if not isinstance(layer, Layer):
                raise SceneError(f"layer {position} must be a vrte.Layer, not {type(layer).__name__}")
            if math.isinf(layer.thickness) and position < len(layers):
                place = "layer", position - 1, "thickness"
                raise SceneError(f"layer {position}: thickness inf is allowed for the last layer only", *place)
        if not isinstance(self.base, Boundary | None):
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

    @property
    def below(self) -> Boundary:
        """What bounds the pile below, as light meets it: black where none gets there."""
        return self.base if self.base is not None and self.base_is_reached else BLACK

    @property
    def above(self) -> Boundary:
        """What bounds the pile above: nothing."""
        return TRANSPARENT

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
        base = "black" if self.base is None else put_in_one_line(str(self.base), 80)
        return base if self.base_is_reached else f"{base}, which no light reaches"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")
