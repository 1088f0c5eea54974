"""A layer of particles."""

import math
from dataclasses import dataclass, replace
from typing import Any

from vrte.basics.arrays import check_fields, check_number
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.crowding import INDEPENDENT, check_packing, pack
from vrte.optics.flakes import Flakes
from vrte.optics.particles import HOST_ALLOWED, SAME_INDEX, Particles, find_absorption, find_host_index
from vrte.optics.phase_matrix import PhaseMatrix, isotropic
from vrte.optics.refractive_index import Material, check_wavelength

CLEAR_HOST = 3.2e-5  # absorption of a medium [1/um] that an optical thickness alone leaves out: k = 1e-6 at 0.4 um
LARGEST_THICKNESS = 1e12  # optical thickness of a finite layer; beyond, a semi-infinite one is meant


@dataclass(frozen=True, eq=False, repr=False)
class Layer:
    """A homogeneous layer of particles, of oriented flakes, or of both.

    Parameters
    ----------
    phase_matrix : PhaseMatrix
        How its particles scatter.
    albedo : float
        Of single scattering, 0 to 1.
    thickness : float
        Optical, >= 0; ``math.inf`` is allowed for the last layer of a scene.
    host_index : float or None, optional
        Refractive index of the medium that its particles lie in; None: that of its flakes, or whatever the scene has
        there.
    flakes : Flakes or None, optional
        Oriented flakes beside its particles (`vrte.flakes`).
    flake_area : float, optional
        Their area, one side, over that of the layer, >= 0; ``math.inf`` for the last layer of a scene, of flakes alone.
        Depths count in optical thickness of particles plus flake area.

    Examples
    --------
    >>> import vrte
    >>> vrte.Layer(vrte.isotropic(), albedo=0.9, thickness=2.0).thickness
    2.0
    """

    phase_matrix: PhaseMatrix
    albedo: float
    thickness: float
    host_index: float | None = None
    flakes: Flakes | None = None
    flake_area: float = 0.0

    def __post_init__(self) -> None:
        check_fields("layer: ", self, {"albedo": (0.0, 1.0, "between 0 and 1"), "host_index": HOST_ALLOWED})
        allowed = f">= 0, at most {LARGEST_THICKNESS:g} or inf"
        for name, words in (("thickness", f"an optical thickness {allowed}"), ("flake_area", f"an area {allowed}")):
            object.__setattr__(self, name, _check_extent(f"layer: {name}", getattr(self, name), words))
        if self.flakes is None:
            if self.flake_area:
                raise SceneError.of("layer: flake_area", "is that of flakes, and the layer has none")
            return
        if math.isinf(self.extent) and self.thickness:
            raise SceneError.of("layer: thickness", "must be 0 in a semi-infinite layer of flakes, flake_area=inf")
        if self.host_index is None:
            object.__setattr__(self, "host_index", self.flakes.host_index)
        if not math.isclose(self.host_index or 0.0, self.flakes.host_index, rel_tol=SAME_INDEX):
            words = f"must be that of the medium of its flakes, {self.flakes.host_index:g}, not {self.host_index:g}"
            raise SceneError.of("layer: host_index", words)

    @property
    def extent(self) -> float:
        """What depths count in: optical thickness of the particles plus flake area."""
        return self.thickness + self.flake_area

    @property
    def has_flakes(self) -> bool:
        """Whether light meets flakes in it."""
        return self.flake_area > 0.0

    @property
    def absorbs(self) -> bool:
        """Whether light gets lost in it."""
        flakes = self.flakes is not None and self.has_flakes and not self.flakes.is_conserving
        return flakes or (self.albedo < 1.0 and self.thickness > 0.0)

    def scale(self, times: float) -> "Layer":
        """The layer ``times`` as thick, >= 0; math.inf: semi-infinite. Raises SceneError for that of flakes beside
        particles."""
        times = check_number("times", times, 0.0, math.inf, "how many times as thick, >= 0")
        if math.isfinite(times):
            return replace(self, thickness=self.thickness * times, flake_area=self.flake_area * times)
        if self.thickness and self.flake_area:
            raise SceneError("layer: particles and flakes side by side cannot be semi-infinite: either alone can")
        return replace(self, flake_area=times) if self.flake_area else replace(self, thickness=times)

    def put_in_medium(self, index: float) -> "Layer":
        """The same layer in a medium of another refractive index; itself where it has none of its own."""
        if self.host_index is None:
            return self
        return replace(self, host_index=index, flakes=self.flakes and replace(self.flakes, host_index=index))

    def __repr__(self) -> str:
        return f"Layer({self.in_words})"

    @property
    def in_words(self) -> str:
        """Its optical thickness, albedo, and phase matrix, and its flakes."""
        particles = f"optical thickness {self.thickness:.6g}, albedo {self.albedo:.6g}, {self.phase_matrix.in_words}"
        if self.flakes is None:
            return particles
        found = f"flake area {self.flake_area:.6g}, {self.flakes.in_words}"
        return f"{found}; {particles}" if self.thickness else found

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    @property
    def transport_mean_free_path(self) -> float:
        """Optical thickness 1/(1 - albedo g) over which light forgets its direction."""
        lost = 1.0 - self.albedo * self.phase_matrix.asymmetry
        return 1.0 / lost if lost > 0.0 else math.inf

    def estimate_peak_width(self, wavelength_um: float, mean_free_path_um: float) -> float:
        """An estimate, good to a factor of 2, of the width [degrees] of the peak of coherent backscattering: wavelength
        over 2 pi transport mean free paths, outside of the layer and near its normal. ``wavelength_um`` is that in
        vacuum, ``mean_free_path_um`` the length of optical thickness 1, thickness_um/thickness."""
        wavelength = check_wavelength(wavelength_um)
        allowed = "a length in micrometres above 0"
        path = check_number("mean_free_path_um", mean_free_path_um, 5e-324, LARGEST_THICKNESS, allowed)
        return math.degrees(wavelength / (2.0 * math.pi * path * self.transport_mean_free_path))

    @staticmethod
    def of(
        particles: Particles | Flakes,
        thickness: float | None = None,
        *,
        thickness_um: float | None = None,
        volume_fraction: float | None = None,
        packing: str = "independent",
        flakes: Flakes | None = None,
        flake_area: float | None = None,
        flake_thickness_um: float | None = None,
    ) -> "Layer":
        """A layer of particles in their host medium, of an optical ``thickness`` (>= 0 or inf), or of a geometrical one
        [um] together with a volume fraction.

        ``volume_fraction`` is the part of the layer that is particles, between 0 and 1. Beside ``thickness`` it is
        needed where the host absorbs more than 3.2e-5 a micrometre (less is left out then) or the packing is not
        independent, else refused. ``packing`` says how their being close is accounted for: not at all ("independent");
        by the structure factor of hard spheres, all sizes of them ("percus-yevick"); or by an effective index of the
        medium around each sphere, Maxwell Garnett's ("effective-medium") or the coherent potential's
        ("coherent-potential"). Each has its domain (docs/how_to/particles.md), outside of which a PackingWarning says
        so: independence up to a volume fraction of 0.1, the others up to 0.3.

        What the host absorbs between the particles counts as extinction without scattering. The layer's ``host_index``
        is that of the host, whatever the packing: surfaces are of binder.

        Oriented flakes take the place of particles, or lie beside them as ``flakes``. ``flake_area`` is their area, one
        side, over that of the layer. Alone they may be given by ``volume_fraction``, ``flake_thickness_um`` and
        ``thickness_um``, an area of volume_fraction/flake_thickness_um thickness_um. Where the host
        absorbs more than 3.2e-5 a micrometre flakes alone need ``thickness_um``; less is left out.
        """
        if isinstance(particles, Flakes):
            if thickness is not None or flakes is not None or packing != INDEPENDENT:
                unused = "flakes" if flakes is not None else "packing" if thickness is None else "thickness"
                raise SceneError.of(f"layer: {unused}", "is that of particles, or beside them: these are flakes alone")
            return _fill_with_flakes(particles, flake_area, volume_fraction, flake_thickness_um, thickness_um)
        if (flakes is None) != (flake_area is None) or flake_thickness_um is not None:
            why = "is for flakes alone: beside particles give flake_area"
            if flake_thickness_um is not None:
                raise SceneError.of("layer: flake_thickness_um", why)
            raise SceneError("layer: give both of flakes and flake_area, or none", "flake_area")
        if flakes is not None and flake_area is not None:
            alone = Layer.of(
                particles, thickness, thickness_um=thickness_um, volume_fraction=volume_fraction, packing=packing
            )
            return replace(alone, flakes=flakes, flake_area=flake_area)
        if (thickness is None) == (thickness_um is None) or (thickness_um is not None and volume_fraction is None):
            raise SceneError("layer: give either thickness, or thickness_um together with volume_fraction")
        check_packing(packing)
        needed = is_fraction_needed(particles, packing)
        if thickness is not None and needed != (volume_fraction is not None):
            why = "is needed beside thickness: the host absorbs, or packing asks for it"
            unused = "is not used beside thickness: the host is clear, and packing independent"
            raise SceneError.of("layer: volume_fraction", why if needed else unused)
        if volume_fraction is None:
            return Layer(particles.phase_matrix, particles.albedo, thickness or 0.0, particles.host_index)
        allowed = "above 0 and below 1"
        fraction = check_number("layer: volume_fraction", volume_fraction, 5e-324, 1.0 - 2.0**-53, allowed)
        packed = pack(particles, fraction, packing)
        number, absorbed = fraction / packed.volume_um3, (1.0 - fraction) * particles.host_absorption
        albedo = packed.albedo
        if absorbed:
            albedo = min(1.0, number * packed.scattering_um2 / (number * packed.extinction_um2 + absorbed))
        if thickness is None:
            allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
            length = _check_extent("layer: thickness_um", thickness_um, allowed)
            thickness = length * fraction / packed.volume_um3 * packed.extinction_um2
            thickness += length * absorbed if absorbed else 0.0
        return Layer(packed.phase_matrix, albedo, thickness, particles.host_index)

    @staticmethod
    def clear(thickness_um: float, host_index: Material, wavelength_um: float) -> "Layer":
        """A layer without particles, clear or tinted: thickness [um] and index n + ik with k up to 0.01 n at a
        wavelength in vacuum [um]; its optical thickness is 4 pi k thickness/wavelength."""
        host = find_host_index(host_index, check_wavelength(wavelength_um))
        allowed = "a length in micrometres >= 0"
        length = check_number("layer: thickness_um", thickness_um, 0.0, LARGEST_THICKNESS, allowed)
        return Layer(isotropic(), 0.0, length * find_absorption(host, wavelength_um), host.n)


def _fill_with_flakes(
    flakes: Flakes, area: float | None, fraction: float | None, flake_um: float | None, length_um: float | None
) -> Layer:
    """A layer of flakes alone, of an area, or of a volume fraction, their thickness and the layer's [um]."""
    by_volume = fraction is not None or flake_um is not None
    if by_volume == (area is not None) or (by_volume and None in (fraction, flake_um, length_um)):
        instead = "volume_fraction, flake_thickness_um and thickness_um"
        raise SceneError.of("layer: flake_area", f"of flakes alone is needed, or {instead} in its place, not both")
    length = 0.0
    if length_um is not None:
        allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
        length = _check_extent("layer: thickness_um", length_um, allowed)
    if by_volume:
        allowed = "above 0 and below 1"
        part = check_number("layer: volume_fraction", fraction, 5e-324, 1.0 - 2.0**-53, allowed)
        plate = check_number("layer: flake_thickness_um", flake_um, 1e-4, 1e4, "from 1e-4 to 1e4 um")
        area = part / plate * length
    elif (flakes.host_absorption > CLEAR_HOST) != (length_um is not None):
        why = "is needed beside flake_area: the host absorbs" if length_um is None else "is not used: the host is clear"
        raise SceneError.of("layer: thickness_um", why)
    absorbed = length * flakes.host_absorption if flakes.host_absorption > CLEAR_HOST else 0.0
    return Layer(isotropic(), 0.0, absorbed, None, flakes, area)  # type: ignore[arg-type]  # checked there


def is_fraction_needed(particles: Particles, packing: str) -> bool:
    """Whether a layer of given optical thickness depends on its volume fraction: absorbing host, or packing."""
    return packing != INDEPENDENT or particles.host_absorption > CLEAR_HOST


def _check_extent(name: str, value: Any, allowed: str) -> float:
    """Raises SceneError unless a thickness is from 0 to LARGEST_THICKNESS, or infinite."""
    extent = check_number(name, value, 0.0, math.inf, allowed)
    return extent if math.isinf(extent) else check_number(name, value, 0.0, LARGEST_THICKNESS, allowed)
