"""What light meets: layers of particles, top first, and what bounds them."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Annotated, Any

from vrte.basics.arguments import show_given
from vrte.basics.arrays import check_list, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.facets import RoughSurface
from vrte.optics.phase_matrix import isotropic
from vrte.scene.boundary import BLACK, Boundary
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer

MOST_LAYERS = 10_000
SAME_INDEX = 1e-9  # relative: of two media that are one
LEAST_STEP = 1e-6  # relative, of two that are not: nodes between lie along interfaces, down to the root of it


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """What light meets: layers, and interfaces between them, over a base.

    Parameters
    ----------
    layers : sequence of Layer and Interface
        Top first; one alone will do, none above a base. What follows an interface lies in the medium below it.
    base : None, Lambertian, MuellerBase, Mirror, Facets, TabulatedBase, Brdf or another Boundary
        What lies beneath; None is black, in the medium of what lies above it. What is no Boundary itself is asked for
        one by its method ``as_base()``, as the `vrte.Brdf` of another stack is.
    interfaces : sequence of Interface or None, optional
        Above each layer and below the last, one more than layers, which are then no interfaces themselves: what the
        scene makes of a list with interfaces among its layers. Between two without a layer it puts an empty one of no
        thickness.

    Raises
    ------
    SceneError
        For no layer and no base, for one that is neither, for an infinite layer above another or above an interface,
        for refractive indices of neighbours that differ.

    Examples
    --------
    >>> import vrte
    >>> vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 0.5)], vrte.Lambertian(0.25)).thickness
    0.5
    >>> vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 0.5)]).indices
    (1.5,)
    """

    layers: Annotated[Sequence[Layer], Sequence[Layer | Interface] | Layer | Interface]
    base: Annotated[Boundary | None, Any] = None
    interfaces: Sequence[Interface | None] = ()
    media: tuple[float, ...] = field(init=False)  # refractive indices from top to bottom: above, of each layer, below
    places: tuple[int | None, ...] = field(init=False)  # of each layer in the list given; None for one added here

    def __post_init__(self) -> None:
        alone = isinstance(self.layers, Layer | Interface)
        stack = tuple(check_list("layers", (self.layers,) if alone else self.layers, MOST_LAYERS))
        for position, part in enumerate(stack, 1):
            if not isinstance(part, Layer | Interface):
                given = type(part).__name__
                raise SceneError(f"layer {position} must be a vrte.Layer or a vrte.Interface, not {given}")
            if isinstance(part, Layer) and math.isinf(part.extent) and position < len(stack):
                index = "layer", position - 1, "thickness"
                raise SceneError(f"layer {position}: thickness inf is allowed for the last layer only", *index)
        as_base = getattr(self.base, "as_base", None)
        if as_base is not None and not isinstance(self.base, type):
            object.__setattr__(self, "base", as_base())
        if not isinstance(self.base, Boundary | None):
            raise SceneError(
                "base must be None (black), vrte.Lambertian, vrte.MuellerBase, vrte.Mirror, vrte.Facets, "
                f"vrte.TabulatedBase or a vrte.Brdf, not {show_given('base', self.base)}"
            )
        if not stack and self.base is None:
            raise SceneError("a scene needs at least one layer, or a base")
        surfaces = check_list("interfaces", self.interfaces, MOST_LAYERS + 1)
        if surfaces:
            stack = interleave(stack, surfaces)
        layers, interfaces, indices = sort_stack(stack, self.base is not None)
        if math.isinf(layers[-1].extent) and interfaces[-1] is not None:
            raise SceneError(f"interface {len(layers) + 1}: no light gets there through a semi-infinite layer")
        numbered = tuple(range(len(layers))) if surfaces else indices
        media = find_media(layers, interfaces, numbered, self.base)
        sides = itertools.pairwise(media)
        refracting = tuple(i and i.put_between(*both) for i, both in zip(interfaces, sides, strict=True))
        vars(self).update(layers=layers, places=numbered, media=media, interfaces=refracting)

    @property
    def indices(self) -> tuple[float, ...]:
        """Refractive index of the medium of each layer."""
        return self.media[1:-1]

    @property
    def index_above(self) -> float:
        """Refractive index of what lies above: the light's that comes in and goes out at the top."""
        return self.media[0]

    @property
    def index_below(self) -> float:
        """Refractive index of what the base lies in, or of what lies below without one."""
        return self.media[-1]

    @cached_property
    def has_interfaces(self) -> bool:
        """Whether light is refracted somewhere."""
        return any(self.interfaces)

    @cached_property
    def is_rough(self) -> bool:
        """Whether one of the interfaces is."""
        return any(interface and not interface.is_smooth for interface in self.interfaces)

    @cached_property
    def needs_beam_paths(self) -> bool:
        """Whether a beam is refracted, mirrored by the base or attenuated by flakes on its way."""
        return self.has_interfaces or self.below.keeps_beams or self.has_flakes

    @property
    def facets_on_top(self) -> RoughSurface | None:
        """The rough surface that light meets first, of an interface or a bare base."""
        top = self.interfaces[0]
        if top is None:
            return None if self.thickness else self.below.facets
        return None if top.is_smooth else top.facets

    def without_surface(self) -> "Scene":
        """The scene without the interface on top, seen from the medium below it."""
        first = replace(self.layers[0], host_index=self.indices[0])
        return Scene((first, *self.layers[1:]), self.base, (None, *self.interfaces[1:]))

    def turned(self) -> "Scene":
        """The scene upside down, its interfaces turned with it, without its base."""
        return self._upside_down

    @cached_property
    def _upside_down(self) -> "Scene":
        """Made once: plans are kept by the scene that they are of."""
        turned = tuple(interface and interface.turned for interface in reversed(self.interfaces))
        return Scene(tuple(reversed(self.layers)), None, turned)

    @cached_property
    def thickness(self) -> float:
        """Total optical thickness of particles, plus the area of flakes: what depths count in."""
        return math.fsum(layer.extent for layer in self.layers)

    @cached_property
    def has_flakes(self) -> bool:
        """Whether light meets oriented flakes somewhere."""
        return any(layer.has_flakes for layer in self.layers)

    @property
    def base_is_reached(self) -> bool:
        """False below a semi-infinite layer: the base then plays no part."""
        return math.isfinite(self.thickness)

    @cached_property
    def below(self) -> Boundary:
        """What bounds the stack below, as light meets it: black where none gets there."""
        return self.base.put_in_medium(self.index_below) if self.base is not None and self.base_is_reached else BLACK

    def __repr__(self) -> str:
        count = len(self.layers)
        layers = "1 layer" if count == 1 else f"{count} layers"
        count_refracting = sum(interface is not None for interface in self.interfaces)
        if count_refracting:
            layers += f", {count_refracting} interface{'s'[: count_refracting > 1]}"
        head = f"Scene: {layers}, optical thickness {self.thickness:.6g}, base {self.base_in_words}"
        first = f"\n  top: {self.layers[0].in_words}" if count > 1 else f"\n  {self.layers[0].in_words}"
        between = f" ({count - 2} more above)" if count > 2 else ""
        return head + first + (f"\n  bottom: {self.layers[-1].in_words}{between}" if count > 1 else "")

    @property
    def base_in_words(self) -> str:
        """What lies beneath, or that nothing is seen of it."""
        base = "black" if self.base is None else put_in_one_line(str(self.base), 80)
        return base if self.base_is_reached else f"{base}, which no light reaches"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")


def build_like(
    scene: Scene, layers: Sequence[Layer], base: Boundary | None, interfaces: Sequence[Interface | None]
) -> Scene:
    """A scene of as many layers as another, which are counted as they are there: by the list that it was made of."""
    found = Scene(layers, base, interfaces)
    object.__setattr__(found, "places", scene.places)
    return found


def interleave(
    layers: Sequence[Layer | Interface], interfaces: Sequence[Interface | None]
) -> tuple[Layer | Interface, ...]:
    """Layers with the interfaces above each of them and below the last. Raises SceneError where these do not fit."""
    fit = len(interfaces) == len(layers) + 1 and all(isinstance(layer, Layer) for layer in layers)
    if not fit or not all(isinstance(interface, Interface | None) for interface in interfaces):
        words = f"one more than the {len(layers)} layers, each a vrte.Interface or None, and none among the layers"
        raise SceneError(f"interfaces must be {words}")
    mixed = [part for pair in zip(interfaces, layers, strict=False) for part in pair]
    return tuple(part for part in (*mixed, interfaces[-1]) if part is not None)


@cache
def make_empty_layer() -> Layer:
    """A non-scattering layer of no thickness."""
    return Layer(isotropic(), 0.0, 0.0)


def sort_stack(
    stack: Sequence[Layer | Interface], has_base: bool
) -> tuple[tuple[Layer, ...], tuple[Interface | None, ...], tuple[int | None, ...]]:
    """Layers, interfaces above each and below the last or None, places in the list; clear layers where none are."""
    clear = make_empty_layer()
    placed: list[tuple[Layer, int | None]] = []
    interfaces: list[Interface | None] = []
    for index, part in enumerate(stack):
        if isinstance(part, Interface):
            if len(interfaces) > len(placed):
                placed.append((clear, None))
            interfaces.append(part)
        else:
            if len(interfaces) == len(placed):
                interfaces.append(None)
            placed.append((part, index))
    if not placed or (has_base and len(interfaces) > len(placed)):
        placed.append((clear, None))
    interfaces += [None] * (len(placed) + 1 - len(interfaces))
    layers, indices = zip(*placed, strict=True)
    return layers, tuple(interfaces), indices


def find_media(
    layers: Sequence[Layer],
    interfaces: Sequence[Interface | None],
    indices: Sequence[int | None],
    base: Boundary | None = None,
) -> tuple[float, ...]:
    """Refractive indices: above the top, of each layer, below the last. Raises SceneError naming a layer."""
    media: list[float | None] = [None, *(layer.host_index for layer in layers), None]
    between = ["the medium between two interfaces" if place is None else f"layer {place + 1}" for place in indices]
    base_index = None if base is None else base.index_above
    if base_index is not None and indices[-1] is None:
        between[-1] = "the medium above it"
    names = ["the medium above", *between, "the medium below" if base_index is None else "the base"]

    def assign(place: int, index: float | None, source: str) -> None:
        known = media[place]
        if index is None:
            return
        if known is not None and not math.isclose(known, index, rel_tol=SAME_INDEX):
            listed = [None, *indices, None][place]
            words = f"{names[place]} has the refractive index {known:g}, and {source} has {index:g}"
            raise SceneError(words, *(() if listed is None else ("layer", listed)))
        media[place] = known if known is not None else index

    for k, interface in enumerate(interfaces):
        if interface is not None:
            assign(k, interface.index_above, "the interface below it")
            assign(k + 1, interface.index_below, "the interface above it")
    assign(len(media) - 1, base_index, "what the base was found in")
    for k in (*range(len(interfaces)), *range(len(interfaces) - 1, -1, -1)):  # down, then up
        if interfaces[k] is None:
            assign(k + 1, media[k], f"{names[k]}, without an interface between,")
            assign(k, media[k + 1], f"{names[k + 1]}, without an interface between,")
    media_found = tuple(1.0 if index is None else index for index in media)
    for low, high in itertools.pairwise(sorted(set(media_found))):
        if high - low < LEAST_STEP * high:
            raise SceneError(
                f"media of the refractive indices {low:.12g} and {high:.12g} are too much alike to tell apart: give "
                f"them one index, or indices that differ by {LEAST_STEP:g} of themselves"
            )
    return media_found
