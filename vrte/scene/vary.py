"""How a scene changes with one of its numbers: the names of the numbers, what derivatives of its light are made of, and
the scene a step along a variation.

Layers are counted from 1 in the list that the scene was made of, interfaces among them, as in a scene file; interfaces
from 1 from the top.
"""

import itertools
import math
import re
import warnings
from collections.abc import Callable
from dataclasses import Field, dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, freeze_copy, put_in_one_line, show_value
from vrte.basics.differences import SEVEN_POINTS, sample_around
from vrte.basics.errors import SceneError
from vrte.optics.phase_matrix import MOST_TERMS, SEQUENCES, PhaseMatrix
from vrte.scene.boundary import BLACK, CHECKED_COSINES, Boundary, Lambertian, WeightedBase
from vrte.scene.interface import ROUGHNESS_ALLOWED
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene, build_like

TINY = 1e-100  # the step of an imaginary part, whose square is nothing: derivatives come out to all digits


@dataclass(frozen=True, eq=False)
class Variation:
    """How the layers and the base of a scene change with one number p, per unit of p.

    `vrte.SceneFamily` and the names of ``derivatives=`` make them; one's own is a direction in the space of all that
    light meets, such as a phase matrix on its way to another one.

    Attributes
    ----------
    name
        What p is called, such as "particles.gold.radius_um".
    value
        p as it is.
    thickness
        Derivatives of the optical thicknesses, (layer,).
    albedo
        Derivatives of the albedos, (layer,).
    coefficients
        Of the expansion coefficients, for each layer (terms, 6): a1, a2, a3, a4, b1, b2; no rows where none changes.
        a1[0] is 1 whatever p is, so its derivative is 0.
    base
        Weights and boundaries whose weighted sum is the derivative of what the base reflects; empty where it stays.
    scene_at
        The scene as a function of p, where that is known.
    is_outside
        Whether p moves more than layers and base: a refractive index of a medium, a surface. Surfaces, media and base
        are then those of ``scene_at``.

    Raises
    ------
    SceneError
        Where lengths do not agree, a derivative is not finite, a1[0] changes, or ``scene_at`` is missing.

    Examples
    --------
    >>> import vrte
    >>> deeper = vrte.Variation("depth", value=1.0, thickness=[1.0], albedo=[0.0])
    >>> deeper.coefficients[0].shape
    (0, 6)
    """

    name: str
    value: float
    thickness: Array
    albedo: Array
    coefficients: tuple[Array, ...] = ()
    base: tuple[tuple[float, Boundary], ...] = ()
    scene_at: Callable[[float], Scene] | None = None
    is_outside: bool = False

    def __post_init__(self) -> None:
        thickness, albedo = (freeze_copy(np.asarray(part, float)) for part in (self.thickness, self.albedo))
        tables = tuple(freeze_copy(np.asarray(part, float)) for part in self.coefficients)
        tables = tables or (freeze_copy(np.zeros((0, 6))),) * thickness.size
        wrong = ""
        if thickness.ndim != 1 or albedo.shape != thickness.shape or len(tables) != thickness.size:
            wrong = "derivatives of thickness, albedo and coefficients must be one a layer"
        elif any(table.ndim != 2 or table.shape[1] != 6 for table in tables):
            wrong = "derivatives of coefficients must be (terms, 6) in each layer"
        elif not all(np.isfinite(part).all() for part in (thickness, albedo, *tables)):
            wrong = "derivatives must be finite"
        elif any(table.size and table[0, 0] != 0.0 for table in tables):
            wrong = "a1[0] is 1 and cannot change"
        elif self.is_outside and self.scene_at is None:
            wrong = "what moves media or surfaces needs scene_at"
        if wrong:
            raise SceneError(wrong, "derivatives", self.name)
        vars(self).update(thickness=thickness, albedo=albedo, coefficients=tables)

    @property
    def changes_nothing(self) -> bool:
        """Whether no layer and no base change, and nothing outside them."""
        same = not (self.thickness.any() or self.albedo.any() or any(table.any() for table in self.coefficients))
        return same and not any(weight for weight, _ in self.base) and not self.is_outside


@dataclass(frozen=True, eq=False)
class Filling:
    """What `vrte.Layer.of` makes a layer of, or its change: ``shares`` (kinds,), cross sections [um2], volumes [um3],
    coefficients (kinds, terms, 6), host ``absorption`` [1/um], ``fraction`` of volume, ``extent`` (optical or [um])."""

    shares: Array
    extinction: Array
    scattering: Array
    volume: Array
    coefficients: Array
    absorption: Array
    fraction: Array
    extent: Array


def vary_filling(filling: Filling, change: Filling, by_volume: bool, is_length: bool) -> tuple[float, float, Array]:
    """Derivatives of thickness, albedo and coefficients (terms, 6), by a complex step: SIAM Review 40, 110 (1998)."""
    pairs = zip(vars(filling).values(), vars(change).values(), strict=True)
    stepped = Filling(*(value + 1j * TINY * slope for value, slope in pairs))
    thickness, albedo, coefficients = assemble_layer(stepped, by_volume, is_length)
    slopes = np.asarray(coefficients).imag / TINY
    slopes[0, 0] = 0.0  # of a1[0], which is 1, but for rounding
    return float(thickness.imag / TINY), float(albedo.imag / TINY), slopes


def assemble_layer(filling: Filling, by_volume: bool, is_length: bool) -> tuple[Array, Array, Array]:
    """Optical thickness, albedo, coefficients by `vrte.mixture` and `vrte.Layer.of`, real or complex, unchecked."""
    shares = filling.shares / filling.volume if by_volume else filling.shares
    shares = shares / shares.sum()
    extinction, scattering, volume = (
        shares @ each for each in (filling.extinction, filling.scattering, filling.volume)
    )
    coefficients = np.tensordot(shares * filling.scattering, filling.coefficients, 1) / scattering
    if filling.fraction == 0.0:
        return filling.extent, scattering / extinction, coefficients
    scattered, extinguished = filling.fraction / volume * scattering, filling.fraction / volume * extinction
    extinguished = extinguished + (1.0 - filling.fraction) * filling.absorption
    return filling.extent * (extinguished if is_length else 1.0), scattered / extinguished, coefficients


BASE_STEP = 2.0**-8  # of a number of a base, differences of sixth order
LEAST_SCALE = 0.01  # of a number of a base that is near 0: what it changes by is no smaller
LEAST_DEGREE = {"a1": 1, "a2": 2, "a3": 2, "a4": 0, "b1": 2, "b2": 2}  # below, nothing changes, or a1 its norm
KNOWN = (
    "layer[1].thickness, layer[1].albedo, layer[1].index, layer[1].flake_area, layer[1].tilt_deg, "
    "layer[1].coefficients[2].a1, base.albedo or another number of the base, interface[1].index, interface[1].roughness"
)
Weighted = tuple[tuple[float, Boundary], ...]
LAYER = re.compile(
    r"layer\[(\d+)\]\.(?:(thickness|albedo|index|flake_area|tilt_deg)|coefficients\[(\d+)\]\.(a[1-4]|b[12]))"
)
BASE = re.compile(r"base\.(\w+)(?:\.([nk]))?")
INTERFACE = re.compile(r"interface\[(\d+)\]\.(index|roughness)")


def vary_scene(scene: Scene, name: str) -> Variation:
    """How a scene changes with the number of that name. Raises SceneError for one unknown or without effect."""
    if not isinstance(name, str):
        raise SceneError(f"derivatives must be names or vrte.Variation, not {show_value(name)}", "derivatives")
    if found := BASE.fullmatch(name):
        return vary_base_number(scene, name, found[1], found[2])
    if found := LAYER.fullmatch(name):
        index, key = find_layer(scene, name, int(found[1])), found[2]
        if key is None:
            return vary_coefficient(scene, name, index, int(found[3]), found[4])
        if key in ("flake_area", "tilt_deg"):
            return vary_flakes(scene, name, index, key)
        return vary_medium(scene, name, index + 1) if key == "index" else vary_layer(scene, name, index, key)
    if found := INTERFACE.fullmatch(name):
        indices = [k for k, one in enumerate(scene.interfaces) if one is not None]
        if not 1 <= int(found[1]) <= len(indices):
            raise complain_of(name, f"the scene has {len(indices)} interfaces that refract")
        index = indices[int(found[1]) - 1]
        return vary_medium(scene, name, index + 1) if found[2] == "index" else vary_roughness(scene, name, index)
    raise complain_of(name, f"no number of a scene is called so: there are {KNOWN}")


def complain_of(name: str, why: str) -> SceneError:
    """The error of a name of derivatives."""
    return SceneError(f"derivatives: {put_in_one_line(name)}: {why}", "derivatives", put_in_one_line(name))


def find_layer(scene: Scene, name: str, number: int) -> int:
    """The place among a scene's layers of that number in the list it was made of."""
    indices = list(scene.places)
    if number - 1 not in indices:
        there = [str(index + 1) for index in indices if index is not None]
        words = f"layer{'s'[: len(there) > 1]} {', '.join(there)}" if there else "no layer"
        raise complain_of(name, f"there is no such layer; the scene has {words}")
    return indices.index(number - 1)


def vary_layer(scene: Scene, name: str, index: int, key: str) -> Variation:
    """The change with the optical thickness or the albedo of a layer."""
    layer, unit = scene.layers[index], np.eye(len(scene.layers))[index]
    if key == "thickness" and math.isinf(layer.thickness):
        raise complain_of(name, "a semi-infinite layer has no thickness to change")
    if key == "albedo" and layer.thickness == 0.0:
        raise complain_of(name, "it does nothing: the layer has no thickness")
    changes: dict[str, Any] = {"thickness": 0.0 * unit, "albedo": 0.0 * unit, key: unit}
    changes["scene_at"] = lambda now: replace_layer(scene, index, replace(layer, **{key: now}))
    return Variation(name, getattr(layer, key), **changes)


def vary_flakes(scene: Scene, name: str, index: int, key: str) -> Variation:
    """The change with the area of a layer's flakes or their tilt [degrees], by differences of solves."""
    layer = scene.layers[index]
    if layer.flakes is None or not layer.has_flakes or (math.isinf(layer.flake_area) and key == "flake_area"):
        raise complain_of(
            name, "a semi-infinite layer has no area to change" if layer.has_flakes else "it has no flakes"
        )
    if key == "tilt_deg" and layer.flakes.tilt_deg is None:
        raise complain_of(name, "the tilts of its flakes are a table")
    flakes, value = layer.flakes, layer.flake_area if key == "flake_area" else layer.flakes.tilt_deg

    def scene_at(now: float) -> Scene:
        changed = {key: now} if key == "flake_area" else {"flakes": replace(flakes, tilt_deg=now)}
        return replace_layer(scene, index, replace(layer, **changed))

    return vary_beside_layers(scene, name, float(value or 0.0), scene_at, is_outside=True)


def vary_coefficient(scene: Scene, name: str, index: int, degree: int, column: str) -> Variation:
    """The change with an expansion coefficient of a layer's phase matrix."""
    layer = scene.layers[index]
    if degree < LEAST_DEGREE[column]:
        why = "a1[0] is 1 and cannot change" if column == "a1" else f"what stands below l = 2 of {column} does nothing"
        raise complain_of(name, why)
    if degree >= MOST_TERMS:
        raise complain_of(name, f"there are at most {MOST_TERMS} degrees, from 0 on")
    if layer.thickness == 0.0 or layer.albedo == 0.0:
        raise complain_of(name, f"it does nothing: the layer {'scatters nothing' if layer.thickness else 'is empty'}")
    unit = np.zeros((degree + 1, len(SEQUENCES)))
    unit[degree, SEQUENCES.index(column)] = 1.0
    tables = [unit[: unit.shape[0] * (k == index)] for k in range(len(scene.layers))]
    matrix = layer.phase_matrix
    value = float(getattr(matrix, column)[degree]) if degree < matrix.terms else 0.0

    def scene_at(now: float) -> Scene:
        return replace_layer(scene, index, replace(layer, phase_matrix=add_coefficients(matrix, (now - value) * unit)))

    return vary_beside_layers(scene, name, value, scene_at, coefficients=tuple(tables))


def vary_beside_layers(
    scene: Scene, name: str, value: float, scene_at: Callable[[float], Scene], **more: Any
) -> Variation:
    """A variation in which no layer's thickness and albedo change."""
    none = np.zeros(len(scene.layers))
    return Variation(name, value, none, none, scene_at=scene_at, **more)


def vary_base_number(scene: Scene, name: str, key: str, part: str | None) -> Variation:
    """The change with a number of the base: in closed form if Lambertian, else by differences of its reflection."""
    base = scene.base
    if base is None:
        raise complain_of(name, "the scene has no base: it is black below")
    if not scene.base_is_reached:
        raise complain_of(name, "it does nothing: no light reaches the base below a semi-infinite layer")
    numbers = list_numbers(base)
    word = key if part is None else f"{key}.{part}"
    if word not in numbers:
        known = ", ".join(f"base.{one}" for one in numbers) or "none"
        raise complain_of(name, f"no number of a base that is {base.name}, whose numbers are {known}")
    value, whole = numbers[word], getattr(base, key)

    def base_at(now: float) -> Boundary:
        given = now if part is None else complex(now, whole.imag) if part == "n" else complex(whole.real, now)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of the base were given
            return replace(base, **{key: given})  # type: ignore[type-var]  # a dataclass: it has fields

    try:
        pairs = vary_base(base_at, value, BASE_STEP * max(abs(value), LEAST_SCALE))
    except SceneError as error:
        raise complain_of(name, f"it cannot change by a little: {error}") from error

    def scene_at(now: float) -> Scene:
        return build_like(scene, scene.layers, base_at(now), scene.interfaces)

    return vary_beside_layers(scene, name, value, scene_at, base=pairs)


def vary_base(base_at: Callable[[float], Boundary | None], value: float, step: float) -> Weighted:
    """Weights and boundaries of a base's derivative over a number, (); of a Lambertian one white. Raises SceneError."""
    pairs = [(weight, base or BLACK) for weight, base in sample_around(base_at, value, step, SEVEN_POINTS)]
    if all(base == pairs[0][1] for _, base in pairs):
        return ()
    if all(isinstance(base, Lambertian) for _, base in pairs):
        return ((sum(weight * base.even_albedo for weight, base in pairs), Lambertian(1.0)),)
    return tuple(pairs)


def list_numbers(base: Boundary) -> dict[str, float]:
    """The numbers of a base by name, n and k of complex ones."""
    found: dict[str, float] = {}
    known: tuple[Field[Any], ...] = fields(base) if is_dataclass(base) else ()
    for one in known:
        value = getattr(base, one.name)
        if not one.init or isinstance(value, bool) or one.name == "index_above":
            continue
        if isinstance(value, complex):
            found |= {f"{one.name}.n": value.real, f"{one.name}.k": value.imag}
        elif isinstance(value, int | float):
            found[one.name] = float(value)
    return found


def vary_medium(scene: Scene, name: str, place: int) -> Variation:
    """The change of a medium's refractive index, counted from the one above the scene, up to the next interfaces."""
    if not scene.has_interfaces and not scene.below.keeps_beams and scene.below.facets is None:
        raise complain_of(name, "it does nothing: light is refracted nowhere")
    first, last = place, place  # of the media that are one, no surface between them
    while first > 0 and scene.interfaces[first - 1] is None:
        first -= 1
    while last <= len(scene.layers) and scene.interfaces[last] is None:
        last += 1
    if last > len(scene.layers) and scene.base is not None and scene.base.index_above is not None:
        raise complain_of(name, "the base was found in a medium of this index, which cannot change")

    def scene_at(index: float) -> Scene:
        media = [index if first <= k <= last else known for k, known in enumerate(scene.media)]
        surfaces = [
            surface and replace(surface, index_above=above, index_below=below)
            for surface, (above, below) in zip(scene.interfaces, itertools.pairwise(media), strict=True)
        ]
        layers = [layer.put_in_medium(medium) for layer, medium in zip(scene.layers, media[1:-1], strict=True)]
        return build_like(scene, layers, scene.base, surfaces)

    return vary_beside_layers(scene, name, scene.media[place], scene_at, is_outside=True)


def vary_roughness(scene: Scene, name: str, index: int) -> Variation:
    """The change with an interface's roughness. Raises SceneError for a smooth one: roughness begins far from 0."""
    surface = scene.interfaces[index]
    assert surface is not None
    if surface.is_smooth:
        words = "a smooth interface has no derivative with its roughness"
        raise complain_of(name, f"{words}, which is {ROUGHNESS_ALLOWED}")

    def scene_at(roughness: float) -> Scene:
        rougher = replace(surface, roughness=roughness)
        surfaces = [*scene.interfaces[:index], rougher, *scene.interfaces[index + 1 :]]
        return build_like(scene, scene.layers, scene.base, surfaces)

    return vary_beside_layers(scene, name, surface.roughness, scene_at, is_outside=True)


def replace_layer(scene: Scene, index: int, layer: Layer) -> Scene:
    """The scene with another layer in the place of one."""
    return build_like(scene, [*scene.layers[:index], layer, *scene.layers[index + 1 :]], scene.base, scene.interfaces)


def add_coefficients(matrix: PhaseMatrix, change: Array) -> PhaseMatrix:
    """A phase matrix with coefficients (terms, 6) added, which may leave it a little less than physical."""
    table = np.zeros((max(matrix.terms, len(change)), len(SEQUENCES)))
    table[: matrix.terms] = matrix.coefficients
    table[: len(change)] += change
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a step out of what particles can be, and back in the difference
        return PhaseMatrix(*table.T, tolerance=1.0)


def move_scene(scene: Scene, variation: Variation, step: float) -> Scene:
    """The scene a step along a variation, of layers and base. Raises SceneError where that is not allowed."""
    layers = []
    changes = zip(variation.thickness.tolist(), variation.albedo.tolist(), variation.coefficients, strict=True)
    for layer, (thickness, albedo, table) in zip(scene.layers, changes, strict=True):
        matrix = add_coefficients(layer.phase_matrix, step * table) if table.any() else layer.phase_matrix
        moved = {"albedo": layer.albedo + step * albedo, "thickness": layer.thickness + step * thickness}
        layers.append(replace(layer, phase_matrix=matrix, **moved))
    base = scene.base
    if variation.base:
        parts = ((step * weight, part) for weight, part in variation.base)
        base = WeightedBase(((1.0, base or BLACK), *parts))
    return build_like(scene, layers, base, scene.interfaces)


def measure_base_rate(scene: Scene, variation: Variation) -> float:
    """About how much of what the base can do changes with a unit of p: of even light, and of beams."""
    if not variation.base:
        return 0.0
    mu_i, mu_o, phi = CHECKED_COSINES[:, None, None], CHECKED_COSINES[:, None], np.array([0.0, 60.0, 180.0])
    change = WeightedBase(variation.base)
    even = np.pi * np.abs(change.reflect(mu_i, mu_o, phi)).max() if change.orders_reflected else 0.0
    size = np.pi * np.abs(scene.below.reflect(mu_i, mu_o, phi)).max() if scene.below.orders_reflected else 0.0
    beams = np.abs(change.reflect_beam(scene.index_below, CHECKED_COSINES)).max()
    return float(even / max(size, 1.0) + beams)


def turn_variation(variation: Variation) -> Variation:
    """The same variation of the scene upside down, which has no base. Raises SceneError where it changes one."""
    if variation.base:
        raise SceneError("illuminate='bottom' is for scenes without a base: none can change", "derivatives")
    at: Callable[[float], Scene] | None = variation.scene_at
    return replace(
        variation,
        thickness=variation.thickness[::-1],
        albedo=variation.albedo[::-1],
        coefficients=variation.coefficients[::-1],
        scene_at=None if at is None else lambda value: at(value).turned(),
    )
