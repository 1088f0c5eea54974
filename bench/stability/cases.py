"""The cases of the stability table: axes, layering, directions, depths; what a case asks for, which cases there are.

A `Case` says in words and numbers what it is; phase matrices, cosines and the `vrte.Scene` are made when asked for.
"""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from bench.cases import LOBE_AMPLITUDE, LOBE_MATRIX, LOBE_WIDTH_DEG, Base, Slab, make_scene
from bench.stability.covering import Row, make_covering_array
from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import make_double_gauss, make_refracted_nodes
from vrte.discrete_ordinates.planning.choice import THIN
from vrte.scene.scene import Scene

SIZES = ("1e-3", "1", "30", "200")  # size parameters of the Mie spheres
GROUPS = {
    "isotropic, Rayleigh": ("isotropic", "rayleigh"),
    "haze L": ("haze-L",),
    "Henyey-Greenstein, g = +-0.99": ("HG+0.99", "HG-0.99"),
    "Mie metal": tuple(f"metal-x{size}" for size in SIZES),
    "Mie dielectric": tuple(f"glass-x{size}" for size in SIZES),
}
COSINES = ("1", "1-1e-12", "0.5", "node", "eigenvalue", "1e-3", "1e-8")
BASES: dict[str, Base] = {
    "black": None,
    "white": 1.0,
    "lobe": "lobe",
    "mirror": "mirror",
    "perfect mirror": "perfect mirror",
}
LAYERINGS = ("one", "two", "hundred", "thick-between-thin", "identical-neighbours", "clear-between")
NODES = (1, 2, 8, 16, 40, 128)
AXES: dict[str, tuple[Any, ...]] = {
    "thickness": (1e-10, 1e-6, 1e-2, 1.0, 1e2, 1e4, 1e6, math.inf),
    "albedo": (0.0, 1e-12, 0.5, 0.99, 1.0 - 1e-6, 1.0 - 1e-9, 1.0 - 1e-12, 1.0),
    "phase": tuple(name for names in GROUPS.values() for name in names),
    "sun": COSINES,
    "view": COSINES,
    "base": ("black", "white", "lobe"),
    "layering": LAYERINGS,
    "nodes": NODES,
}
SCENES, SEED = 300, 1917
ORACLE_NODES = 16  # the most for which ball arithmetic is affordable
BEAM = (1.0, 0.3, 0.2, 0.1)  # incident Stokes vector [W m-2]; (I, Q) and (U, V) are told apart in each Fourier order
CLEAR_THICKNESS, THIN_THICKNESS, MANY = 0.5, 1e-2, 100


@dataclass(frozen=True)
class Case:
    """One scene and what is asked of it.

    ``slabs``, top first; ``main``, which of them the axes describe; ``sun`` and ``view``, one of COSINES or a number;
    ``beam``, the incident Stokes vector [W m-2]; ``base_kind``, one of BASES; ``nodes`` a hemisphere; ``orders``, the
    Fourier orders looked at; ``reason``, of a corner: what makes it hard; ``extra_mu``, further signed cosines;
    ``media``, refractive indices above, of every slab and below, and ``pile``, what that is, where light is refracted;
    ``cosines``, mu0 and all of mu as the oracle's table has them, to the last bit.
    """

    name: str
    nodes: int
    slabs: tuple[Slab, ...]
    main: int = 0
    base_kind: str = "black"
    sun: str | float = 0.5
    view: str | float = 0.5
    beam: tuple[float, float, float, float] = BEAM
    orders: tuple[int, ...] = (0, 1)
    extra_mu: tuple[float, ...] = ()
    reason: str = ""
    layering: str = field(default="one", compare=False)
    media: tuple[float, ...] = ()
    pile: str = field(default="", compare=False)
    cosines: tuple[float, ...] = field(default=(), compare=False, repr=False)

    @property
    def layers(self) -> list[tuple[Array, float, float]]:
        """What an oracle needs of each layer: expansion coefficients (terms, 6), albedo, optical thickness."""
        return [(slab.phase_matrix.coefficients, slab.albedo, slab.thickness) for slab in self.slabs]

    @property
    def base(self) -> Base:
        """None (black), the albedo of a Lambertian base, or "lobe"."""
        return BASES[self.base_kind]

    @cached_property
    def scene(self) -> Scene:
        """The scene as a user would write it."""
        return make_scene(self.slabs, self.base, self.media)

    @property
    def thickness(self) -> float:
        """Total optical thickness."""
        return math.fsum(slab.thickness for slab in self.slabs)

    @cached_property
    def mu0(self) -> float:
        """The beam's cosine."""
        return self.cosines[0] if self.cosines else self.cosine(self.sun)

    @cached_property
    def mu(self) -> Array:
        """Signed cosines: the view's, 0.35, 0.9, the sun's, up and then down, and the extra ones."""
        if self.cosines:
            return np.array(self.cosines[1:])
        sizes = dict.fromkeys([self.cosine(self.view), 0.35, 0.9, self.mu0])
        return np.array([*sizes, *(-size for size in sizes), *self.extra_mu])

    def cosine(self, kind: str | float) -> float:
        """The number behind one of COSINES."""
        if kind == "node":
            return float(self.find_nodes()[self.nodes // 2])
        if kind == "eigenvalue":
            return find_eigen_cosine(self.slabs[self.main], self.nodes)
        if kind == "critical":
            return find_critical_cosine(self.media)
        return 1.0 - 1e-12 if kind == "1-1e-12" else float(kind)

    def find_nodes(self) -> Array:
        """The nodes' cosines, (nodes,): of the densest medium, where there are several."""
        if self.media:
            return make_refracted_nodes(self.media, self.nodes).carried(max(self.media))[0]
        return make_double_gauss(self.nodes)[0]

    @property
    def levels(self) -> list[tuple[int, float]]:
        """Depths as (layer, depth below its top): top, first and last interface, one or two inside, bottom."""
        above, last = find_slab_tops(self.slabs), len(self.slabs) - 1
        total = self.thickness
        inside = [0.375 * total] if math.isfinite(total) else [0.1, 1.0]
        found = [(0, 0.0)] + [(k, 0.0) for k in sorted({1, last}) if 1 <= k <= last]
        for tau in inside:
            layer = int(np.searchsorted(above, tau, side="right")) - 1
            found.append((layer, min(float(tau - above[layer]), self.slabs[layer].thickness)))
        if math.isfinite(total):
            found.append((last, self.slabs[last].thickness))
        return sorted(set(found)) if total > 0.0 else [(0, 0.0)]

    @property
    def tau(self) -> Array:
        """The levels as optical depths below the top."""
        above, levels = find_slab_tops(self.slabs), self.levels
        tau = np.array([above[layer] + depth for layer, depth in levels])
        if levels[-1] == (len(self.slabs) - 1, self.slabs[-1].thickness):
            tau[-1] = self.thickness  # the bottom, not a rounding away from it
        return tau

    @property
    def terms(self) -> int:
        """Terms of the longest phase matrix."""
        return max(slab.phase_matrix.terms for slab in self.slabs)

    @property
    def resolved(self) -> bool:
        """Whether the nodes carry all terms, without which the cut phase matrix may be negative somewhere; and, where
        surfaces send it back and forth, the lobe."""
        if self.media:
            return self.terms <= self.nodes and self.base_kind != "lobe"
        return self.terms <= 2 * self.nodes

    @property
    def is_thin(self) -> bool:
        """Whether what scatters is so thin that one of the algorithms is known to lose digits (and is not chosen)."""
        return math.fsum(slab.thickness for slab in self.slabs if slab.albedo > 0.0) < THIN

    @property
    def reflects_everything(self) -> bool:
        """Whether the scene ends in a white base or without end."""
        return self.base_kind == "white" or math.isinf(self.thickness)

    def is_white(self, top: tuple[int, float], bottom: tuple[int, float] | None = None) -> bool:
        """Whether nothing is absorbed from one level to another, by default to the bottom."""
        last, depth = bottom or (len(self.slabs) - 1, self.slabs[-1].thickness)
        return all(slab.albedo == 1.0 for slab in self.slabs[top[0] : last + (depth > 0.0)])

    @property
    def group(self) -> str:
        """The group of phase matrices it counts for."""
        phase = self.slabs[self.main].phase
        return next((title for title, names in GROUPS.items() if phase in names), phase)

    @property
    def conditions(self) -> list[str]:
        """The rows of the table it counts for."""
        known = SURFACE_CONDITIONS if self.media else CONDITIONS
        return [name for name, holds in known.items() if holds(self)] or [ORDINARY]

    @property
    def index(self) -> float:
        """Refractive index of the medium of the slab that the axes describe."""
        return self.media[self.main + 1] if self.media else 1.0

    @cached_property
    def key(self) -> str:
        """A digest of the words and numbers that define the case: what was computed for another key is out of date.

        Phase matrices and cosines enter by name, since what is computed for a name differs in the last bits from one
        processor to another.
        """
        lobe = [LOBE_WIDTH_DEG, LOBE_AMPLITUDE, *LOBE_MATRIX.ravel().tolist()] if self.base_kind == "lobe" else []
        light = self.sun, self.view, self.extra_mu, self.beam, self.orders
        parts = self.slabs, self.main, self.levels, self.base_kind, lobe, *light, self.nodes, self.media
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


ORDINARY = "none of these"
CONDITIONS = {
    "thickness <= 1e-6": lambda case: case.thickness <= 1e-6,
    "thickness 1e4, 1e6": lambda case: 1e4 <= case.thickness < math.inf,
    "infinite": lambda case: math.isinf(case.thickness),
    "omega = 1": lambda case: case.slabs[case.main].albedo == 1.0,
    "1e-12 <= 1 - omega <= 1e-6": lambda case: 1.0 - 2e-6 < case.slabs[case.main].albedo < 1.0,
    "omega <= 1e-12": lambda case: case.slabs[case.main].albedo <= 1e-12,
    "sun or view on a node or eigenvalue": lambda case: {case.sun, case.view} & {"node", "eigenvalue"},
    "sun or view at mu >= 1-1e-12": lambda case: max(case.mu0, case.cosine(case.view)) > 1.0 - 1e-6,
    "sun or view at mu <= 1e-3": lambda case: min(case.mu0, case.cosine(case.view)) <= 1e-3,
}
SURFACE_CONDITIONS = {
    "thickness 1e-6": lambda case: case.slabs[case.main].thickness <= 1e-6,
    "thickness 1e4, 1e6": lambda case: 1e4 <= case.thickness < math.inf,
    "infinite": lambda case: math.isinf(case.thickness),
    "omega = 1": lambda case: case.slabs[case.main].albedo == 1.0,
    "omega = 1, over a mirror": lambda case: (
        case.slabs[case.main].albedo == 1.0 and "mirror" in case.base_kind and math.isfinite(case.thickness)
    ),
    "sun or view at the critical angle": lambda case: "critical" in (case.sun, case.view),
    "sun or view on a node": lambda case: "node" in (case.sun, case.view),
    "sun or view at mu <= 1e-3": lambda case: min(case.mu0, case.cosine(case.view)) <= 1e-3,
    "sun or view at mu = 1": lambda case: max(case.mu0, case.cosine(case.view)) == 1.0,
}


def find_slab_tops(slabs: tuple[Slab, ...]) -> Array:
    """Optical depth of the top of every slab, added up as the solver does: (slab,).

    >>> find_slab_tops((Slab("rayleigh", 0.9, 1.0), Slab("isotropic", 0.9, 2.0))).tolist()
    [0.0, 1.0]
    """
    return np.concatenate([[0.0], np.cumsum([slab.thickness for slab in slabs[:-1]])])


def find_critical_cosine(media: tuple[float, ...]) -> float:
    """The cosine in the densest medium at which the rarest one's light goes along the surface.

    >>> round(find_critical_cosine((1.0, 1.25)), 15)
    0.6
    """
    low, high = min(media), max(media)
    return math.sqrt((high - low) * (high + low)) / high


def find_eigen_cosine(slab: Slab, nodes: int) -> float:
    """1/k of the mode of order 0 that lies in (0.05, 1) farthest from every node; 0.5 where there is none.

    >>> 0.05 < find_eigen_cosine(Slab("rayleigh", 0.9, 1.0), 8) < 1.0
    True
    """
    mu, weights = make_double_gauss(nodes)
    coefficients = slab.phase_matrix.coefficients[: 2 * nodes]
    ahead, back = (_core.phase_matrices(0, coefficients, mu, sign * mu) for sign in (1.0, -1.0))
    ahead, back = ahead[:, :, :2, :2], back[:, :, :2, :2] * FLIP[:2]  # order 0: (I, Q) apart from (U, V)
    size = 2 * nodes
    # (n, n, 2, 2) as (2n, 2n), columns times weights
    squares = (
        (part * weights[:, None, None]).transpose(0, 2, 1, 3).reshape(size, size)
        for part in (ahead + back, ahead - back)
    )
    E, F = ((np.eye(size) - 0.5 * slab.albedo * square) / np.repeat(mu, 2)[:, None] for square in squares)
    rates = np.linalg.eigvals(F @ E)
    real = rates.real[(np.abs(rates.imag) < 1e-9 * np.abs(rates)) & (rates.real > 1.0)]
    cosines = 1.0 / np.sqrt(real)
    cosines = np.sort(cosines[(cosines > 0.05) & (cosines < 0.9999)])
    if cosines.size == 0:
        return 0.5
    return float(cosines[np.abs(cosines[:, None] - mu).min(axis=1).argmax()])


def arrange_slabs(phase: str, albedo: float, thickness: float, layering: str) -> tuple[tuple[Slab, ...], int]:
    """The slabs of one of LAYERINGS, and which of them is the one described; the last one takes an infinite thickness.

    >>> arrange_slabs("haze-L", 1.0, 4.0, "identical-neighbours")[0][1]
    Slab(phase='haze-L', albedo=1.0, thickness=1.0)
    """
    endless = math.isinf(thickness)
    kind = "isotropic" if phase == "rayleigh" else "rayleigh"
    main, other = Slab(phase, albedo, thickness), Slab(kind, 0.9, 1.0)
    if layering == "two":
        return ((other, main), 1) if endless else ((main, other), 0)
    if layering == "hundred":
        each = THIN_THICKNESS if endless else thickness / MANY
        slabs = [Slab(phase if k % 2 == 0 else kind, albedo, each) for k in range(MANY)]
        return (*slabs[:-1], Slab(kind, albedo, thickness) if endless else slabs[-1]), 0
    if layering == "thick-between-thin":
        thin, endless_last = Slab(kind, albedo, THIN_THICKNESS), Slab(kind, albedo, thickness)
        return (thin, Slab(phase, albedo, 100.0) if endless else main, endless_last if endless else thin), 1
    if layering == "identical-neighbours":
        parts = (1.0, 2.0, math.inf) if endless else (thickness / 2.0, thickness / 4.0, thickness / 4.0)
        return tuple(Slab(phase, albedo, part) for part in parts), 0
    if layering == "clear-between":
        upper, lower = (1.0, thickness) if endless else (thickness / 2.0, thickness / 2.0)
        clear = Slab("isotropic", 0.0, CLEAR_THICKNESS)
        return (Slab(phase, albedo, upper), clear, Slab(phase, albedo, lower)), 0
    return (main,), 0


def make_covering_rows() -> list[Row]:
    """The covering array of AXES, as value numbers."""

    def is_costly(row: Row) -> bool:
        """A hundred layers of 128 nodes, a minute each: where a pair needs them."""
        values = dict(zip(AXES, row, strict=True))
        return LAYERINGS[values["layering"]] == "hundred" and NODES[values["nodes"]] == NODES[-1]

    return make_covering_array([len(values) for values in AXES.values()], SCENES, SEED, is_costly)


def make_covering_cases() -> Iterator[Case]:
    """The covering array's cases; their number decides which higher Fourier order is looked at."""
    for number, row in enumerate(make_covering_rows()):
        thickness, albedo, phase, sun, view, base, layering, nodes = (
            choices[place] for choices, place in zip(AXES.values(), row, strict=True)
        )
        slabs, main = arrange_slabs(phase, albedo, thickness, layering)
        yield Case(
            name=f"{phase} w={show_albedo(albedo)} t={thickness:g} {layering} {base} sun={sun} view={view} N={nodes}",
            nodes=nodes,
            slabs=slabs,
            main=main,
            base_kind=base,
            sun=sun,
            view=view,
            orders=(0, 1 + number % 2),
            layering=layering,
        )


def show_albedo(albedo: float) -> str:
    """1-1e-09 for what is close to 1.

    >>> show_albedo(1.0 - 1e-9), show_albedo(0.99)
    ('1-1e-09', '0.99')
    """
    return f"1-{1.0 - albedo:.0e}" if 0.999 < albedo < 1.0 else f"{albedo:g}"
