"""K and S of a panel from its exact reflectances over black and over white, and how far two fluxes are off elsewhere.

As a laboratory does it: the film's total reflectance over black and over a white is read, the surface is taken off by
Saunderson's formula, K and S follow. Here k1 and k2 of the surface follow from the fluxes right below it, whatever
directions the light there has, where a laboratory guesses k2, 0.6 for even light below a binder or 0.4 because that
fits. The film at any other thickness is solved exactly, beside what K and S predict.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from vrte.appearance import kubelka_munk as km
from vrte.appearance.colours import Colour, find_colour, find_difference
from vrte.appearance.geometries import NODES, Geometry, measure_panel, read_geometry
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number, check_numbers, freeze_copy
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.basics.views import Figure, view
from vrte.calls.brdfs import run_side_by_side
from vrte.calls.radiance import radiance
from vrte.calls.spectrum import name_wavelength
from vrte.results.field import Field
from vrte.scene.boundary import Lambertian
from vrte.scene.illumination import hemisphere
from vrte.scene.interface import Interface

BACKGROUNDS = ("black", "white")
INSIDE = "inside"  # even light in the medium of the film: what K and S are about
GEOMETRY = "8:di"
SHOWN = 1e-3  # difference over black and white below which a film is taken to hide them: ten times the accuracy
FINE = 64  # nodes of the means of R and T of a surface


@dataclass(frozen=True, eq=False)
class TwoFluxErrors:
    """Reflectances over black and white (2, m, n), ``exact`` and by K and S, of films of ``lengths`` (m,)."""

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
    def colours(self) -> list[list[list[Colour]]]:
        """Exact and predicted colours in D65 for 10 degrees, each a list over black and one over white, by film."""
        find = partial(find_colour, self.wavelength_um)
        return [[list(map(find, over)) for over in kind] for kind in (self.exact, self.predicted)]

    @property
    def difference(self) -> Array:
        """Colour differences CIEDE2000 between predicted and exact, over black and over white, (2, m)."""
        pairs = zip(*self.colours, strict=True)
        return np.array([list(map(find_difference, *over)) for over in pairs])

    @property
    def contrast_ratio(self) -> Array:
        """Contrast ratios Y over black over Y over white, exact and predicted, (2, m)."""
        return np.array([[black.Y / white.Y for black, white in zip(*kind, strict=True)] for kind in self.colours])


@dataclass(frozen=True, eq=False)
class KubelkaMunk:
    """K and S (n,) [``unit``] of a film over a ``white`` base; its surface mirrors ``k1`` (n,) and sends back ``k2``
    (n,), the mean of ``k2_over`` (2, n) black and white; ``k2_even`` (n,) of even light."""

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
        """The reflectance (n,) above the surface that K and S predict of a film [um, or films] over a base."""
        return km.add_surface(km.reflect_film(self.K, self.S, length, base), self.k1, self.k2)

    @cached_property
    def transport(self) -> tuple[Array, Array]:
        """(1 - albedo) and albedo (1 - g) times the film's extinction, (n,) each, in the unit of K and S."""
        films = [scene.layers[self.panel.film] for scene in self.panel.scenes]
        extinction = np.array([film.thickness for film in films]) / self.length
        albedo = np.array([film.albedo for film in films])
        g = np.array([film.phase_matrix.asymmetry for film in films])
        return freeze_copy((1.0 - albedo) * extinction), freeze_copy(albedo * (1.0 - g) * extinction)

    @property
    def diffusion(self) -> tuple[Array, Array]:
        """K and S (n,) of diffusion: twice the absorption, 3/4 of the reduced scattering less 1/4 of the absorption."""
        absorbed, turned = self.transport
        return 2.0 * absorbed, 0.75 * turned - 0.25 * absorbed

    @property
    def over_diffusion(self) -> tuple[Array, Array]:
        """K and S (n,) over those of diffusion; NaN where a film does not absorb, or light in it does not diffuse."""
        absorbing, turning = (
            np.divide(found, given, out=np.full_like(found, np.nan), where=given > 1e-9 * self.S)
            for found, given in zip((self.K, self.S), self.diffusion, strict=True)
        )
        return absorbing, turning

    def compare(self, lengths: Any, progress: Progress | None = None) -> TwoFluxErrors:
        """Films of other thicknesses (m,) [um, or films] solved exactly, beside K and S. Raises SceneError."""
        wanted = np.atleast_1d(check_numbers("lengths", lengths))
        exact = np.empty((2, wanted.size, self.wavelength_um.size))
        for index, length in enumerate(wanted):
            panel = self.panel.scale_film(check_number("lengths", length, 5e-324, np.inf, "above 0") / self.length)
            part = share_progress(progress, index, wanted.size)
            exact[:, index] = measure_over_cards(panel, self.geometry, self.white, part)
        found = np.array([[self.predict(length, base) for length in wanted] for base in (0.0, self.white)])
        return TwoFluxErrors(wanted, self.wavelength_um, self.unit, exact, found)

    def plot(self, lengths: Any = None, progress: Progress | None = None) -> Figure:
        """A figure of `compare`, of its colours, and of K and S, by default from an eighth to eight times the film."""
        return view(self, "plot", lengths, progress)

    def __str__(self) -> str:
        """A line a wavelength: K, S, both over what diffusion says, and what the surface mirrors and sends back."""
        head = f"K [{self.unit}]  S [{self.unit}]  K/diffusion  S/diffusion   k1     k2   over black, white   even"
        rows = [f"  [um]  {head}"]
        shares = self.k1, self.k2, *self.k2_over, self.k2_even
        for row in zip(self.wavelength_um, self.K, self.S, *self.over_diffusion, *shares, strict=True):
            formats = ("6.3f", "9.5f", "9.5f", "11.3f", "11.3f", *[".3f"] * len(shares))
            rows.append("  ".join(f"{one:{how}}" for one, how in zip(row, formats, strict=True)))
        return "\n".join(rows)


def find_kubelka_munk(
    panel: Panel,
    white: float = 0.8,
    geometry: str = GEOMETRY,
    k1: Any = None,
    k2: Any = None,
    progress: Progress | None = None,
) -> KubelkaMunk:
    """K and S of a panel's film, and Saunderson's k1 and k2 where not given, (n,), from exact reflectances over black
    and ``white`` bases in a ``geometry`` ("8:di", "di:8", "di:di", "inside": diffuse, surface taken off). Raises
    SceneError."""
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
    outer, inner = choose_share("k1", k1, outer), choose_share("k2", k2, over.mean(axis=0))
    if is_inside(panel, known):
        K, S = km.find_slab_coefficients(*solve_film(panel, second), find_length(panel))
    else:
        read = measure_over_cards(panel, known, under, second)
        hidden = read[1] - read[0] < SHOWN
        if hidden.any():
            at = ", ".join(f"{one:g}" for one in panel.wavelength_um[hidden])
            raise SceneError(
                f"the film hides its base at {at} um: reflectances over black and white that are less than {SHOWN:g} "
                "apart tell K/S alone; make it thinner, or take geometry='inside'"
            )
        try:
            dark, bright = km.remove_surface(read, outer, inner)
            K, S = km.find_coefficients(dark, bright, under, find_length(panel))
        except SceneError as error:
            raise error.behind("with this k1 and k2 no film of two fluxes reads so") from error
    return KubelkaMunk(panel, known, under, *(freeze_copy(one) for one in (K, S, outer, inner, over, even)))


def choose_share(name: str, given: Any, found: Array) -> Array:
    """A share of the surface's as given, one for all wavelengths or one each, or else as it was found."""
    if given is None:
        return found
    shares = km.check_share(name, given)
    if shares.shape not in ((), found.shape):
        raise SceneError.of(name, f"must be one number, or one a wavelength, {found.size}, not of shape {shares.shape}")
    return np.broadcast_to(shares, found.shape)


def find_length(panel: Panel) -> float:
    """The thickness of the film [um]; 1 where only its optical thickness is known."""
    known = panel.length_um
    if known is None:
        return 1.0
    return check_number("length_um", known, 5e-324, np.finfo(float).max, "above 0 and finite: K and S are of a film")


def check_film(panel: Panel) -> None:
    """Raises SceneError for other layers and interfaces than one film under a surface."""
    film = panel.film
    for scene in panel.scenes:
        if scene.has_flakes:
            raise SceneError("K and S are of light that is even inside the film, and flakes send it on in lobes")
        others = [layer.thickness > 0.0 for index, layer in enumerate(scene.layers) if index != film]
        if any(others) or any(scene.interfaces[1:]) or not 0.0 < scene.layers[film].thickness < np.inf:
            raise SceneError(
                "K and S are of one film that ends, under one surface or none: no other layer or interface"
            )


def is_inside(panel: Panel, geometry: Geometry) -> bool:
    """Whether light is evenly diffuse where it enters the film: no surface, and even light."""
    return geometry.angle_i is None and not any(panel.surface)


def measure_over_cards(panel: Panel, geometry: Geometry, white: float, progress: Progress | None = None) -> Array:
    """Exact reflectances (2, n) over black and over a white Lambertian base."""
    if is_inside(panel, geometry):
        alone, through = solve_film(panel, progress)
        return np.stack([alone, km.put_film_over(alone, through, white)])
    bases = enumerate((None, Lambertian(white)))
    return np.stack([measure_panel(panel.put_over(one), geometry, share_progress(progress, k, 2)) for k, one in bases])


def solve_film(panel: Panel, progress: Progress | None = None) -> tuple[Array, Array]:
    """Reflectance and transmittance (n,) of a film without surface and base under even light."""
    mu, weights = hemisphere(NODES)
    fields = solve_fluxes(panel.put_over(None), mu, "above", progress)
    alone = np.array([2.0 * weights @ one.flux_up[:, 0] for one in fields])
    down = ((one.flux_down + one.direct)[:, -1] if one.tau.size > 1 else 0.0 * weights for one in fields)
    return alone, np.array([2.0 * weights @ one for one in down])


def find_surface_shares(
    panel: Panel, geometry: Geometry, white: float, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """k1 (n,), k2 over black and white (2, n), and of even light (n,), of the surface; by fluxes below it."""
    outer, even = np.zeros((2, len(panel)))
    returned = np.zeros((2, len(panel)))  # over black, over white
    mu, weights = find_beams(geometry)
    for part, (base, inner) in enumerate(zip((None, Lambertian(white)), returned, strict=True)):
        lit = [index for index, surface in enumerate(panel.surface) if surface is not None]
        over = panel.put_over(base)
        over = replace(over, wavelength_um=panel.wavelength_um[lit], scenes=tuple(over.scenes[index] for index in lit))
        fields = solve_fluxes(over, mu, "below", share_progress(progress, part, 2))
        for index, scene, field in zip(lit, over.scenes, fields, strict=True):
            surface = scene.interfaces[0]
            assert surface is not None
            mirrored, through = surface.share(mu)
            outer[index], even[index] = weights @ (mu * mirrored), find_even_share(surface)
            assert field.direct_up is not None
            down, up = field.flux_down + field.direct, field.flux_up + field.direct_up
            risen = weights @ up[:, 0]
            # where no light comes up, any share will do
            inner[index] = weights @ (down[:, 0] - mu * through) / risen if risen > 0.0 else even[index]
    return outer, returned, even


def find_beams(geometry: Geometry) -> tuple[Array, Array]:
    """Cosines of what falls in and weights (n_in,) that add up beams to a flux of 1."""
    mu = geometry.directions[0]
    return mu, 2.0 * hemisphere(NODES)[1] if geometry.angle_i is None else 1.0 / mu


def find_even_share(surface: Interface) -> float:
    """What a surface sends back of even light from below it, r_i, by 1 - (1 - r_e)/n^2 where denser below."""
    mu, weights = hemisphere(FINE)
    ratio = surface.index_below / surface.index_above
    if surface.is_smooth and ratio > 1.0:
        return float(1.0 - 2.0 * (weights * mu) @ surface.share(mu)[1] / ratio**2)
    return float(2.0 * (weights * mu) @ surface.turned.share(mu)[0])


def solve_fluxes(panel: Panel, mu0: Array, side: str, progress: Progress | None = None) -> list[Field]:
    """Fluxes at the top, and above the bottom where there is one, of beams mu0, a field a wavelength."""

    def solve(index: int) -> Field:
        scene = panel.scenes[index]
        tau = [0.0, scene.thickness] if side == "above" and scene.base_is_reached else [0.0]
        with name_wavelength(panel.wavelength_um[index]):
            return radiance(scene, mu0, mu=[], tau=tau, side=side, threads=1, **panel.asked)

    return run_side_by_side([partial(solve, index) for index in range(len(panel))], progress)
