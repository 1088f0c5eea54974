"""Oriented flakes: flat mirrors much larger than the wavelength, whose normals are tilted at random from the layer's.

Normals m spread evenly in azimuth with a density Dh [1/sr] over the upper half, int Dh dm = 1. For light along w and a
unit of flake area (one side), w' and w the directions of travel before and after, c = |w'.h|:

    G(w) = int Dh(m) |w.m| dm,    Z(w' -> w) = Dh(|h_z|) M(r_p, r_s at c)/4,    h along w - w'

G is extinction, Z [1/sr] scattering; int Z dw = int Dh |w'.h| R dh, so that a perfect mirror loses nothing. Light that
flakes diffract stays in the beam and is not counted.

Clear plates let light through straight on: their extinction is a matrix, the mean of |w.m| (1 - T) over normals.

Source: Jakob, Arbree, Moon, Bala and Marschner, ACM Trans. Graph. 29, 53 (2010), microflakes without polarization; M
from Jones vectors as for facets (docs/explanation/flakes.md).
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import (
    Array,
    Remembered,
    check_fields,
    check_list,
    check_number,
    check_numbers,
    check_whole,
    freeze_copy,
)
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import find_gauss_legendre
from vrte.optics.facets import make_rotation
from vrte.optics.films import Film, find_amplitudes, find_plate
from vrte.optics.fresnel import lay_out_mueller, list_elements
from vrte.optics.particles import HOST_ALLOWED, LIMITS, SAME_INDEX, find_absorption, find_host_index, find_named_index
from vrte.optics.refractive_index import IndexTable, Material, check_wavelength

MAKE_UPS = tomllib.loads(Path(__file__).with_name("named_flakes.toml").read_text("utf-8"))
USUAL_TILT = 12.0  # sigma [degrees] of flakes that nothing else is said of
TILT_ALLOWED = 0.5, 60.0, "from 0.5 to 60 degrees"
FARTHEST = 8.5  # tilts over sigma: beyond, a Gaussian's density is below the rounding of its largest
POINTS = 16  # of Gauss's rule in a panel: G to 1e-14 in panels a sigma wide
STEPS = 2048  # of a table of tilts that others sample from
MOST_TILTS = 1000  # rows of a table
TABLE_ALLOWED, MOST_COSINES = 1e-9, 20_000  # of what flakes reflect between rows of a table, and its rows
NORMALS = 20  # of Gauss's rule in a panel of tilts, and on either side of the azimuth where flakes are lit edgewise
CLEAR_PLATE = 1e-6  # k of a plate's substrate: at 1 um of mica it takes 2e-5 of the light
BOTH_CORES = "flakes: give either index, of an opaque core, or substrate, of clear plates"
_EXTINGUISHED = Remembered()
MOST_FILMS, THICKEST = 100, 100.0  # [um]
MOST_ORDERS = 10_000  # of Fourier


@dataclass(frozen=True, repr=False)
class Flakes:
    """Flat mirrors or clear plates in a medium, tilted at random: how a unit of their area attenuates and scatters.

    Parameters
    ----------
    index : complex or None
        Refractive index n + ik of their opaque core; None: a perfect mirror, r_p = 1 and r_s = -1.
    tilt_deg : float or None
        sigma [degrees] of a density exp(-tilt^2/(2 sigma^2)) of normals per solid angle, 0.5 to 60; None where
        ``tilt_table`` is given.
    tilt_table : pair of sequences or None, optional
        Tilts [degrees], ascending from 0 to 90 at most, and densities of normals per solid angle in any unit, >= 0:
        linear between, none beyond the last.
    host_index : float, optional
        Refractive index of the medium that they lie in.
    host_absorption : float, optional
        Of that medium [1/um], 4 pi k/wavelength.
    films : sequence of (complex, float), optional
        Refractive index and thickness [um] of thin films on both faces, from the outside in.
    wavelength_um : float or None, optional
        In vacuum [um], needed with films.
    description : str, optional
        In words, what they are and where their refractive indices come from.
    substrate : float or None, optional
        Refractive index of clear plates, which let light through straight on; ``index`` is then None.

    Examples
    --------
    >>> import vrte
    >>> mirrors = vrte.Flakes(None, tilt_deg=8.0)
    >>> mirrors.project([0.0, 1.0]).round(8)
    array([0.10997363, 0.98075558])
    """

    index: Annotated[complex | None, complex | None]
    tilt_deg: float | None = USUAL_TILT
    tilt_table: Annotated[tuple[tuple[float, ...], tuple[float, ...]] | None, Any] = None
    host_index: float = 1.0
    host_absorption: float = 0.0
    films: Annotated[tuple[Film, ...], Any] = ()
    wavelength_um: float | None = None
    description: str = ""
    substrate: float | None = None

    def __post_init__(self) -> None:
        if (self.tilt_deg is None) == (self.tilt_table is None):
            raise SceneError("flakes: give either tilt_deg or tilt_table", "tilt_deg")
        limits = {"tilt_deg": TILT_ALLOWED, "host_index": HOST_ALLOWED, "host_absorption": LIMITS["host_absorption"]}
        check_fields("flakes: ", self, limits | {"substrate": HOST_ALLOWED})
        if self.tilt_table is not None:
            object.__setattr__(self, "tilt_table", check_tilts(self.tilt_table))
        if self.index is not None and self.substrate is not None:
            raise SceneError(BOTH_CORES, "substrate")
        if self.index is not None:
            object.__setattr__(self, "index", find_named_index("index", self.index, 1.0).value)
        if self.wavelength_um is not None:
            object.__setattr__(self, "wavelength_um", check_wavelength(self.wavelength_um))
        object.__setattr__(self, "films", check_stack("films", self.films, self.wavelength_um)[0])
        if self.substrate is not None and not self.films and abs(self.substrate / self.host_index - 1.0) < SAME_INDEX:
            why = f"is that of the medium, {self.host_index:g}: such plates do nothing to light"
            raise SceneError.of("flakes: substrate", why)

    def __repr__(self) -> str:
        return f"Flakes({self.in_words})"

    @property
    def in_words(self) -> str:
        """What they are made of, and how they are tilted."""
        core = "perfect mirrors" if self.index is None else f"index {self.index:.6g}"
        what = self.description or (core if self.substrate is None else f"plates of index {self.substrate:.6g}")
        return f"{what}, " + (f"tilt {self.tilt_deg:g} degrees" if self.tilt_deg is not None else "tilts of a table")

    @property
    def is_conserving(self) -> bool:
        """Whether they absorb nothing: perfect mirrors or clear plates, under films without absorption."""
        return self.index is None and not any(complex(index).imag for index, _ in self.films)

    @property
    def is_transparent(self) -> bool:
        """Whether they are clear plates, which let light through."""
        return self.substrate is not None

    def reflect(self, cosine: Any) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Amplitudes r_p and r_s (...) of opaque flakes at cosines of incidence (...), along theta-hat and phi-hat as
        of a surface."""
        cosine = np.abs(check_cosine("cosine", cosine))
        if self.is_transparent:
            raise SceneError("flakes: plates reflect at both faces, and have no amplitudes")
        return find_amplitudes(self.host_index, self.films, self.index, cosine, self.wavelength_um or 1.0)[:2]

    def list_elements(self, cosine: Any) -> Array:
        """What a flake reflects (0) and lets through (1) at cosines of incidence (...): the elements 11, 12, 33 and 34
        of its Mueller matrices in the plane of incidence, (2, ..., 4)."""
        if self.substrate is not None:
            cosine = np.abs(check_cosine("cosine", cosine))
            return np.stack(find_plate(self.host_index, self.films, self.substrate, cosine, self.wavelength_um or 1.0))
        p, s = self.reflect(cosine)
        found = list_elements(np.abs(p) ** 2, np.abs(s) ** 2, p * s.conj())
        return np.stack([found, np.zeros_like(found)])

    @property
    def width(self) -> float:
        """sigma of tilts [radians], of a table the root of half the mean square."""
        if self.tilt_deg is not None:
            return math.radians(self.tilt_deg)
        tilt, density = self.tilts
        share = np.sin(tilt) * density
        return float(np.sqrt(0.5 * (share @ tilt**2) / share.sum()))

    @cached_property
    def panels(self) -> Array:
        """Edges of panels of tilt [radians] in which the density is smooth, (panel + 1,)."""
        if self.tilt_table is not None:
            return freeze_copy(np.radians(self.tilt_table[0]))
        assert self.tilt_deg is not None
        sigma = math.radians(self.tilt_deg)
        last = min(FARTHEST * sigma, 0.5 * math.pi)
        return freeze_copy(np.linspace(0.0, last, max(3, math.ceil(last / sigma)) + 1))

    def find_density(self, tilt: Any) -> Array:
        """Dh [1/sr] at tilts [radians] (...)."""
        return self._find_shape(check_numbers("tilt", tilt)) / self._norm

    def _find_shape(self, tilt: Array) -> Array:
        """The density before it is normalised, (...)."""
        if self.tilt_table is not None:
            return np.interp(np.degrees(tilt), *self.tilt_table, right=0.0)
        assert self.tilt_deg is not None
        found: Array = np.exp(-0.5 * (tilt / math.radians(self.tilt_deg)) ** 2)
        return found

    @cached_property
    def _norm(self) -> float:
        """The integral of the density over the upper half before it is normalised."""
        x, weights = find_gauss_legendre(POINTS)
        start, size = self.panels[:-1, None], np.diff(self.panels)[:, None]
        tilt = start + 0.5 * (x + 1.0) * size
        return float(math.pi * np.sum(weights * size * np.sin(tilt) * self._find_shape(tilt)))

    @cached_property
    def tilts(self) -> tuple[Array, Array]:
        """Tilts [radians], ascending, and densities Dh [1/sr] there: fine enough to be taken as linear between."""
        tilt = np.union1d(self.panels, np.linspace(0.0, self.panels[-1], STEPS + 1))
        return freeze_copy(tilt), freeze_copy(self.find_density(tilt))

    @cached_property
    def mirror(self) -> Array | None:
        """What flakes reflect, as `list_elements` has it, at even steps of the cosine (cosine, 4), so many that cubics
        between them are right to TABLE_ALLOWED; None where the index of an opaque core is all."""
        if self.index is not None and not self.films:
            return None
        count = 4
        while True:
            table = self.list_elements(np.linspace(0.0, 1.0, 2 * count - 1))[0]
            rows = np.arange(1, count - 2)
            between = (9.0 * (table[2 * rows] + table[2 * rows + 2]) - table[2 * rows - 2] - table[2 * rows + 4]) / 16.0
            if np.abs(between - table[2 * rows + 1]).max() < TABLE_ALLOWED or count > MOST_COSINES:
                return freeze_copy(table)
            count = 2 * count - 1

    def project(self, mu: Any) -> Array:
        """G (...), the area that a unit of flake area turns to light along cosines mu (...) of either sign."""
        mu = np.abs(check_cosine("mu", mu))
        cosine, sine = mu.ravel()[:, None, None], np.sqrt((1.0 - mu) * (1.0 + mu)).ravel()[:, None, None]
        x, weights = find_gauss_legendre(POINTS)
        x, weights = 0.5 * (x + 1.0), 0.5 * weights
        kink = np.arctan2(cosine, sine)  # tilt from which on some flakes are lit from below
        low, high = self.panels[:-1, None], self.panels[1:, None]
        # below the kink int |A + B cos psi| dpsi = 2 pi A
        start, stop = np.minimum(low, kink), np.minimum(high, kink)
        tilt = start + x * (stop - start)
        found = (
            weights * (stop - start) * self.find_density(tilt) * np.sin(tilt) * 2.0 * math.pi * cosine * np.cos(tilt)
        )
        # above it the square of what is integrated over makes the root at the kink smooth
        start, stop = np.sqrt(np.maximum(low - kink, 0.0)), np.sqrt(np.maximum(high - kink, 0.0))
        root = start + x * (stop - start)
        tilt = kink + root * root
        across = np.sqrt(np.sin(root * root) * np.maximum(np.sin(tilt + kink), 0.0))  # sqrt(B^2 - A^2)
        along = cosine * np.cos(tilt)
        around = 4.0 * (along * np.arctan2(along, across) + across)
        found = found + weights * 2.0 * root * (stop - start) * self.find_density(tilt) * np.sin(tilt) * around
        return np.asarray(found.sum(axis=(1, 2)).reshape(mu.shape))

    def _spread_normals(self, along: float) -> tuple[Array, Array, Array]:
        """Points of an integral over the normals that light along a cosine meets, (point,): weights, which add up to G;
        cosines of incidence; cos 2 alpha, alpha from the meridian plane to that of incidence."""
        x, weights = find_gauss_legendre(NORMALS)
        x, weights = 0.5 * (x + 1.0), 0.5 * weights
        along, whole = abs(along), self.project(along)
        sine = math.sqrt((1.0 - along) * (1.0 + along))
        kink = math.atan2(along, sine)  # tilt from which on some flakes are lit from below
        edges = self.panels
        low = np.append(edges[edges < kink], min(kink, edges[-1]))
        high = np.sqrt(np.append(0.0, edges[edges > kink] - kink))  # the square root at the kink becomes smooth
        root, rate = ((high[:-1, None] + x * np.diff(high)[:, None]).ravel(), np.diff(high)[:, None] * weights)
        tilt = np.concatenate([(low[:-1, None] + x * np.diff(low)[:, None]).ravel(), kink + root**2])
        share = np.concatenate([(np.diff(low)[:, None] * weights).ravel(), 2.0 * root * rate.ravel()])
        share *= np.sin(tilt) * self.find_density(tilt)
        upright, across = (each[:, None] for each in (along * np.cos(tilt), sine * np.sin(tilt)))
        edge = np.arccos(np.clip(-upright / np.maximum(across, 1e-300), -1.0, 1.0))
        psi = np.concatenate([edge * x, edge + x * (math.pi - edge)], axis=1)
        part = share[:, None] * np.concatenate([weights * edge, weights * (math.pi - edge)], axis=1)
        c = upright + across * np.cos(psi)
        # the plane of incidence has the share of the normal across the light that lies along theta-hat
        square = (along * np.sin(tilt)[:, None] * np.cos(psi) - sine * np.cos(tilt)[:, None]) ** 2
        turned = 2.0 * square / np.maximum((1.0 - c) * (1.0 + c), 1e-300) - 1.0
        cosine = np.minimum(np.abs(c), 1.0)
        part *= cosine
        return (part * (whole / part.sum())).ravel(), cosine.ravel(), turned.ravel()

    def extinguish(self, mu: Any) -> Array:
        """Extinction matrix (..., 4, 4) of a unit of area, public Stokes frame, at cosines mu (...) of either sign: of
        opaque flakes G; of plates the mean of 1 - T, T what each lets through straight on."""
        mu = check_cosine("mu", mu)
        if not self.is_transparent:
            return self.project(mu)[..., None, None] * np.eye(4)

        def find() -> tuple[Array]:
            found = np.zeros((mu.size, 4, 4))
            for row, one in zip(found, mu.ravel().tolist(), strict=True):
                weights, cosine, turn = self._spread_normals(one)
                a, b, re, im = self.list_elements(cosine)[1].T
                of_u, of_q = a + turn * turn * (re - a), re - turn * turn * (re - a)
                row[[0, 1, 2, 3], [0, 1, 2, 3]] = [weights @ (1.0 - each) for each in (a, of_q, of_u, re)]
                row[0, 1] = row[1, 0] = -weights @ (b * turn)
                row[2, 3], row[3, 2] = -weights @ (im * turn), weights @ (im * turn)
            return (found.reshape(*mu.shape, 4, 4),)

        return _EXTINGUISHED.find((self, mu.shape, mu.tobytes()), find)[0]

    def scatter_flux(self, mu: Any) -> Array:
        """Flux that a unit of area scatters of light along cosines mu (...): of I, and what Q adds to it, (..., 2)."""
        mu = check_cosine("mu", mu)
        if self.is_conserving:
            return self.extinguish(mu)[..., 0, :2]
        found = np.empty((mu.size, 2))
        for row, one in zip(found, mu.ravel().tolist(), strict=True):
            weights, cosine, turned = self._spread_normals(one)
            a, b = self.list_elements(cosine)[0, :, :2].T
            row[:] = weights @ a, weights @ (b * turned)
        return found.reshape(*mu.shape, 2)

    def scatter(self, mu_out: Any, mu_in: Any, phi: Any) -> Array:
        """Z [1/sr] of a unit of area, (..., 4, 4), for signed cosines of travel and phi, out minus in [radians]: public
        Stokes frames, meridian planes of each direction. At w = w' the limit of phi = 0."""
        given = check_cosine("mu_out", mu_out), check_cosine("mu_in", mu_in), 0.5 * check_numbers("phi", phi)
        if not np.isfinite(given[2]).all():
            raise SceneError.of("phi", "must be finite")
        try:
            out, into, half = np.broadcast_arrays(*given)
        except ValueError:
            shapes = ", ".join(str(each.shape) for each in given)
            raise SceneError(f"mu_out, mu_in and phi must have shapes that broadcast, not {shapes}", "phi") from None
        sin_out, sin_in = (np.sqrt((1.0 - mu) * (1.0 + mu)) for mu in (out, into))
        sum_of_sines = sin_out + sin_in
        apart = (into - out) * (into + out) / np.where(sum_of_sines == 0.0, 1.0, sum_of_sines)  # sine out - sine in
        across = np.sqrt(apart**2 + 4.0 * sin_in * sin_out * np.sin(half) ** 2)
        along = np.abs(out - into)
        size = np.hypot(across, along)
        forward = size == 0.0
        tilt = np.where(forward, np.arctan2(np.abs(into), sin_in), np.arctan2(across, along))
        mueller = lay_out_mueller(self.list_elements(0.5 * size)[0])
        turn_in, turn_out = turn_to_mirror(out, into, sin_out, sin_in, half)
        density = 0.25 * self.find_density(tilt)
        return np.asarray(density[..., None, None] * (turn_out.swapaxes(-1, -2) @ mueller @ turn_in))

    def scatter_orders(self, mu_out: Any, mu_in: Any, n_order: int) -> tuple[Array, Array]:
        """Cosine and sine parts of Z of a unit of area, (order, ..., 4, 4) each, for signed cosines (...): Z = sum over
        m of (2 - delta_m0) (cosine part cos m phi + sine part sin m phi)."""
        from vrte.optics.flake_orders import integrate_azimuths  # which integrates what is here

        out, into = np.broadcast_arrays(check_cosine("mu_out", mu_out), check_cosine("mu_in", mu_in))
        count = check_whole("n_order", n_order, 1, MOST_ORDERS)
        orders = integrate_azimuths(self, out.ravel(), into.ravel(), count, 1e-10) / (2.0 * math.pi)
        whole = np.moveaxis(orders.reshape(*out.shape, count, 4, 4), -3, 0)
        block = np.kron(np.eye(2), np.ones((2, 2)))  # what is even in the azimuth
        odd = np.kron([[0.0, -1.0], [1.0, 0.0]], np.ones((2, 2)))
        return whole * block, whole * odd


def check_cosine(name: str, values: Any) -> Array:
    """Cosines of either sign, of any shape, none beyond 1. Raises SceneError."""
    array = check_numbers(name, values)
    if not (np.abs(array) <= 1.0).all():
        raise SceneError.of(name, "must be cosines from -1 to 1")
    return array


def turn_to_mirror(out: Array, into: Array, sin_out: Array, sin_in: Array, half: Array) -> tuple[Array, Array]:
    """Rotations from the meridian planes of light in and out to the plane of incidence, (..., 4, 4) each, for signed
    cosines, their sines and half the azimuth: s is along w' x w, a and b its parts along l and r of either."""
    between = sin_in * out - into * sin_out
    square, full = np.sin(half) ** 2, np.sin(2.0 * half)
    a_in, a_out = -sin_out * full, -sin_in * full
    b_in, b_out = between + 2.0 * into * sin_out * square, between - 2.0 * sin_in * out * square
    parallel = (a_in**2 + b_in**2 == 0.0) | (a_out**2 + b_out**2 == 0.0)  # any s across will do: r of what comes
    a_in, b_in = np.where(parallel, 0.0, a_in), np.where(parallel, 1.0, b_in)
    a_out, b_out = np.where(parallel, -out * full, a_out), np.where(parallel, 1.0 - 2.0 * square, b_out)
    return make_rotation(a_in, b_in), make_rotation(a_out, b_out)


def check_tilts(table: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Tilts [degrees] and densities of a table. Raises SceneError."""
    where = "flakes: tilts"  # tilt_table of the class
    try:
        first, second = table
    except Exception:  # whatever a foreign object raises when it is taken apart
        raise SceneError.of(where, "must be a pair: angles in degrees, and densities per solid angle") from None
    angles, density = check_numbers(where, first).ravel(), check_numbers(where, second).ravel()
    if angles.size != density.size or not 2 <= angles.size <= MOST_TILTS:
        raise SceneError.of(where, f"must be as many angles as densities, 2 to {MOST_TILTS}")
    if not (angles[0] == 0.0 and angles[-1] <= 90.0 and (np.diff(angles) > 0.0).all()):
        raise SceneError.of(where, "must have angles that ascend from 0 to 90 degrees at most")
    if not (np.isfinite(density).all() and (density >= 0.0).all() and density.any()):
        raise SceneError.of(where, "must have densities >= 0, finite and not all 0")
    return tuple(angles.tolist()), tuple((density / density.max()).tolist())


def check_stack(name: str, stack: Any, wavelength_um: float | None) -> tuple[tuple[Film, ...], str]:
    """Films of (material, thickness [um]) from the outside in, and in words what they are. Raises SceneError."""
    films: list[Film] = []
    words = ""
    for row in check_list(f"flakes: {name}", stack, MOST_FILMS):
        try:
            material, thickness = row
        except Exception:  # whatever a foreign object raises when it is taken apart
            raise SceneError.of(f"flakes: {name}", "must be pairs of a material and a thickness [um]") from None
        if wavelength_um is None:
            raise SceneError(f"flakes: a {name} of thin films is that of a wavelength: give wavelength_um", name)
        found = find_named_index(name, material, wavelength_um)
        allowed = f"above 0 and at most {THICKEST:g} um"
        length = check_number(f"flakes: thickness in {name}", thickness, 1e-6, THICKEST, allowed)
        films.append((found.value, length))
        words += f"{length:g} um of index {found.n:.6g} + {found.k:.6g}i ({found.source}), "
    return tuple(films), words


def flakes(
    index: Annotated[Material | None, Any] = None,
    tilt_deg: float | None = None,
    stack: Annotated[Sequence[tuple[Material, float]] | None, Any] = None,
    wavelength_um: float | None = None,
    host_index: Material = 1.0,
    tilts: Annotated[tuple[Sequence[float], Sequence[float]] | None, Any] = None,
    substrate: Annotated[Material | None, Any] = None,
    transparent: bool | None = None,
) -> Flakes:
    """Oriented flakes in a binder: of a metal, of thin films on an opaque core or on clear plates, or perfect mirrors.

    Parameters
    ----------
    index : str, complex, pair, IndexTable or None, optional
        Of their opaque core, all that `refractive_index` takes: a name, a database path, n + i k or (n, k); None: a
        perfect mirror. Or the name of a whole make-up: "coated aluminium" or "fabry-perot".
    tilt_deg : float, optional
        sigma [degrees] of the density exp(-tilt^2/(2 sigma^2)) of normals per solid angle, 0.5 to 60; 12 unless
        ``tilts`` are given.
    stack : sequence of (material, float), optional
        Thin films on both faces, from the outside in: what each consists of, as of ``index``, and its thickness [um].
    wavelength_um : float, optional
        In vacuum [um], needed where an index is a name or a table, and with a stack.
    host_index : str, complex, pair or IndexTable, optional
        Of the binder around them, in the same ways.
    tilts : pair of sequences, optional
        In place of ``tilt_deg``: angles [degrees], ascending from 0, and densities of normals per solid angle in any
        unit, linear between, none beyond the last.
    substrate : str, complex, pair or IndexTable, optional
        Of clear plates in place of an opaque core, in the same ways as ``index``: what passes a plate goes straight on.
        Plates differ in thickness by more than a wavelength: light between their faces is added up without phases.
    transparent : bool, optional
        Whether they let light through: True with a ``substrate`` and False without one, which may be left out.

    Returns
    -------
    Flakes
        What `Layer.of` makes a layer of.

    Raises
    ------
    SceneError
        For a tilt that is not allowed, both of tilt_deg and tilts, or of index and substrate, a name or a stack without
        a wavelength, and a substrate that absorbs.

    References
    ----------
    docs/explanation/flakes.md; of the make-ups by name: vrte/optics/named_flakes.toml.

    Examples
    --------
    >>> import vrte
    >>> gold = vrte.flakes("aluminium", 10.0, [("hematite", 0.03), ("silica", 0.35)], wavelength_um=0.6, host_index=1.5)
    >>> vrte.Layer.of(gold, flake_area=3.0).extent
    3.0
    """
    if tilt_deg is not None and tilts is not None:
        raise SceneError("flakes: give either tilt_deg or tilts", "tilts")
    if transparent is not None and transparent != (substrate is not None):
        why = "needs a substrate" if transparent else "must be True with a substrate, or left out"
        raise SceneError.of("flakes: transparent", why)
    if index is not None and substrate is not None:
        raise SceneError(BOTH_CORES, "substrate")
    words = ""
    if isinstance(index, str) and (named := MAKE_UPS.get(" ".join(index.lower().replace("_", " ").split()))):
        if stack is not None:
            raise SceneError.of("flakes: stack", f"is that of {index!r} already: leave it out, or name the core alone")
        words, index, stack = f"{index}: ", named["core"], named["stack"]
    given = {"index": index, "substrate": substrate, "host_index": host_index}
    named_index = [name for name, one in given.items() if isinstance(one, str | IndexTable)]
    if wavelength_um is None and named_index:
        raise SceneError(f"flakes: {named_index[0]} is that of a wavelength: give wavelength_um", "wavelength_um")
    wavelength = None if wavelength_um is None else check_wavelength(wavelength_um)
    host, core = find_host_index(host_index, wavelength or 1.0), None
    if host.k > 0.0 and wavelength is None:
        raise SceneError("flakes: host_index absorbs, by wavelength: give wavelength_um", "wavelength_um")
    films, over = check_stack("stack", () if stack is None else stack, wavelength)
    what = "perfect mirrors"
    if index is not None:
        found = find_named_index("index", index, wavelength or 1.0)
        core, what = found.value, f"index {found.n:.6g} + {found.k:.6g}i ({found.source})"
    plate = None
    if substrate is not None:
        found = find_named_index("substrate", substrate, wavelength or 1.0)
        plate, what = found.n, f"clear plates of index {found.n:.6g} ({found.source})"
        if found.k > CLEAR_PLATE:
            allowed = f"must be that of a clear plate, k at most {CLEAR_PLATE:g}, not {found.k:.3g}"
            raise SceneError.of("flakes: substrate", allowed)
    return Flakes(
        core,
        USUAL_TILT if tilt_deg is None and tilts is None else tilt_deg,
        None if tilts is None else check_tilts(tilts),
        host.n,
        find_absorption(host, wavelength or 1.0),
        films,
        wavelength,
        f"flakes: {words}{over}{'on ' if over else ''}{what}",
        plate,
    )
