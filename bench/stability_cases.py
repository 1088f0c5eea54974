"""The cases of the study of stability: what a case asks for, covering arrays of all axes, and corners known to be hard.

A `Case` says in words and numbers what it is; phase matrices, cosines and the `vrte.Scene` are made when asked for. The
covering arrays hold every pair of values of two axes; each corner has what makes it hard.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bench.cases import LOBE_AMPLITUDE, LOBE_MATRIX, LOBE_WIDTH_DEG, Base, Slab, make_scene
from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
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
ORACLE_NODES = 16  # the most for which ball arithmetic is affordable
BEAM = (1.0, 0.3, 0.2, 0.1)  # incident Stokes vector [W m-2]; (I, Q) and (U, V) are told apart in each Fourier order
CLEAR_THICKNESS, THIN_THICKNESS, MANY = 0.5, 1e-2, 100


@dataclass(frozen=True)
class Case:
    """One scene and what is asked of it.

    ``slabs``, top first; ``main``, which of them the axes describe; ``sun`` and ``view``, one of COSINES or a number;
    ``beam``, the incident Stokes vector [W m-2]; ``base_kind``, one of BASES; ``nodes`` a hemisphere; ``orders``, the
    Fourier orders looked at; ``reason``, of a corner: what makes it hard; ``extra_mu``, further signed cosines;
    ``media``, refractive indices above, of every slab and below, and ``stack``, what that is, where light is refracted;
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
    stack: str = field(default="", compare=False)
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
            return make_refracted_nodes(self.media, self.nodes, layers=self.media[1:-1]).carried(max(self.media))[0]
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
        """Whether the scene ends in a white base or a semi-infinite layer."""
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
    """1/k of the mode of order 0 that lies in (0.05, 1) farthest from every node, to nine digits, the lowest of equal
    ones; 0.5 where there is none.

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
    return float(cosines[np.abs(cosines[:, None] - mu).min(axis=1).round(9).argmax()])


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


@cache
def read_covering_rows(name: str) -> list[tuple[int, ...]]:
    """A covering array of covering.json, as value numbers: every pair of values of two axes occurs in a row, and most
    triples do."""
    rows = json.loads(Path(__file__).with_name("covering.json").read_text())[name]
    return [tuple(int(digit, 16) for digit in row) for row in rows]


def make_covering_cases(name: str) -> Iterator[Case]:
    """The covering array's cases; their number decides which higher Fourier order is looked at."""
    axes = SURFACE_AXES if name == "under surfaces" else AXES
    for number, row in enumerate(read_covering_rows(name)):
        of = {axis: choices[index] for (axis, choices), index in zip(axes.items(), row, strict=True)}
        scatters = f"{of['phase']} w={show_albedo(of['albedo'])} t={of['thickness']:g}"
        asked = f"{of['base']} sun={of['sun']} view={of['view']} N={of['nodes']}"
        media: tuple[float, ...] = ()
        if axes is AXES:
            slabs, main = arrange_slabs(of["phase"], of["albedo"], of["thickness"], of["layering"])
            title = f"{scatters} {of['layering']} {asked}"
        else:
            slab = Slab(of["phase"], of["albedo"], of["thickness"])
            slabs, main, media = arrange_pile(slab, of["stack"], of["index"])
            title = f"n={of['index']:.5g} {of['stack']}: {scatters} {asked}"
        yield Case(
            title,
            *(of["nodes"], slabs, main, of["base"], of["sun"], of["view"]),
            orders=(0, 1 + number % 2),
            layering=of.get("layering", ""),
            media=media,
            stack=of.get("stack", ""),
        )


def show_albedo(albedo: float) -> str:
    """1-1e-09 for what is close to 1.

    >>> show_albedo(1.0 - 1e-9), show_albedo(0.99)
    ('1-1e-09', '0.99')
    """
    return f"1-{1.0 - albedo:.0e}" if 0.999 < albedo < 1.0 else f"{albedo:g}"


SURFACE_COSINES = ("1", "0.5", "critical", "node", "1e-3", "1e-8")
PILES = ("under a surface", "plate", "below the air", "coated")
SURFACE_AXES: dict[str, tuple[Any, ...]] = {
    "thickness": (1e-6, 1e-2, 1.0, 1e2, 1e4, 1e6, math.inf),
    "albedo": (0.0, 0.5, 1.0 - 1e-6, 1.0 - 1e-12, 1.0),
    "phase": ("isotropic", "rayleigh", "glass-x1", "metal-x1", "spheroids"),
    "sun": SURFACE_COSINES,
    "view": SURFACE_COSINES,
    "base": ("black", "white", "mirror", "perfect mirror", "lobe"),
    "stack": PILES,
    "index": (1.0001, 1.33, 1.5, 2.7, 4.0, 1.0 / 1.5),
    "nodes": (6, 12, 24),
}
AIR, COAT = Slab("rayleigh", 0.9, 0.2), Slab("isotropic", 0.0, 0.1)


def arrange_pile(slab: Slab, stack: str, index: float) -> tuple[tuple[Slab, ...], int, tuple[float, ...]]:
    """The slabs of one of PILES, which of them is the one given, and the refractive indices above, of each and below.

    A semi-infinite plate has a single surface.

    >>> arrange_pile(Slab("rayleigh", 1.0, 1.0), "plate", 1.5)[1:]
    (0, (1.0, 1.5, 1.0))
    """
    if stack == "below the air":
        return (AIR, slab), 1, (1.0, 1.0, index, index)
    if stack == "coated":
        return (COAT, slab), 1, (1.0, math.sqrt(index), index, index)
    last = 1.0 if stack == "plate" and math.isfinite(slab.thickness) else index
    return (slab,), 0, (1.0, index, last)


QUICK_SCENES = 24  # of the covering array, beside the corners
QUICK_SURFACES = ("n=4, trapped over a perfect mirror", "n=1.5, view at the critical cosine")


def define(
    name: str,
    reason: str,
    phase: str = "rayleigh",
    albedo: float = 1.0,
    thickness: float = 1.0,
    layering: str = "one",
    slabs: tuple[Slab, ...] = (),
    base: str = "black",
    media: tuple[float, ...] = (),
    **asked: Any,
) -> Case:
    """A `Case` in short: of slabs, or of a stack of one phase matrix; ``media``: where light is refracted."""
    slabs, main = (slabs, 0) if slabs else arrange_slabs(phase, albedo, thickness, layering)
    asked = {"nodes": 12 if media else 8, "sun": 0.6} | asked
    if media:
        asked = {"media": media, "stack": "corner"} | asked
        layering = ""
    return Case(name, slabs=slabs, main=main, base_kind=base, layering=layering, reason=reason, **asked)


INF = math.inf
NEARLY = 1.0 - 1e-12
# fmt: off
CORNERS: tuple[Case, ...] = (
    define("sun on a node", "the particular solution has the node's own decay rate", sun="node", phase="glass-x1"),
    define("sun and view on a node", "the same pole twice, and a direction that is a node", sun="node", view="node"),
    define("sun on an eigenvalue", "the textbook's particular solution is singular",
           albedo=0.9, sun="eigenvalue", phase="glass-x1"),
    define("sun and view on an eigenvalue", "a double pole in the reconstruction",
           albedo=0.9, thickness=5.0, sun="eigenvalue", view="eigenvalue", phase="metal-x1"),
    define("sun on an eigenvalue, thick", "resonance and decoupled boundaries at once",
           albedo=0.9, thickness=1e4, sun="eigenvalue", view="eigenvalue"),
    define("sun beside a node", "differences of nearly equal exponentials", sun=0.5917173212478249 * (1 + 1e-9)),
    define("mu equals mu0", "transmission along the beam divides by 1/mu - 1/mu0", sun=0.5, view=0.5, albedo=0.99),
    define("mu beside mu0", "the same quotient, 1e-14 away from 0/0", sun=0.5, view=0.5 + 1e-14, albedo=0.99),
    define("normal, conservative, thick", "the sun overhead, T of 1e-6 and a zero eigenvalue",
           thickness=1e6, sun="1", view="1"),
    define("conservative, thickness 100", "a double zero eigenvalue", thickness=1e2),
    define("conservative, thickness 1e4", "T is 1e-4 of R", thickness=1e4, phase="glass-x1"),
    define("conservative, thickness 1e6", "an error of 1e-15 in a1[0] would change T by 1e-3", thickness=1e6),
    define("conservative metal, thickness 1e6", "the same with b2 != 0: eigenvalues in complex pairs",
           thickness=1e6, phase="metal-x1"),
    define("1 - omega = 1e-12, thickness 1e6", "the smallest eigenvalue is 1e-6 of the next, and matters",
           albedo=NEARLY, thickness=1e6),
    define("1 - omega = 1e-9, thickness 1e4", "neither conservative nor absorbing", albedo=1.0 - 1e-9, thickness=1e4),
    define("infinite, conservative", "reflects everything; R converges only as 1/thickness", thickness=INF),
    define("infinite, conservative, under a layer", "everything comes back through the layer above",
           slabs=(Slab("glass-x1", 1.0, 1.0), Slab("rayleigh", 1.0, INF))),
    define("infinite, conservative, over a white base", "the base is never reached", thickness=INF, base="white"),
    define("infinite, 1 - omega = 1e-12", "R differs from 1 by 1e-6", albedo=NEARLY, thickness=INF),
    define("infinite, absorbing", "scaled steps in place of plain doublings",
           albedo=0.5, thickness=INF, phase="metal-x1"),
    define("infinite, grazing", "source and view within 1e-8 of the surface", thickness=INF, sun="1e-8", view="1e-8"),
    define("grazing in and out", "1/mu is 1e8 beside 1", sun="1e-8", view="1e-8", albedo=0.99),
    define("grazing in and out, thin", "thickness/mu is 100 while the layer is 1e-6",
           sun="1e-8", view="1e-8", albedo=0.99, thickness=1e-6),
    define("grazing sun, conservative, thick", "all light starts within 1e-8 of the top", sun="1e-8", thickness=1e6),
    define("thickness 0", "nothing is there", thickness=0.0),
    define("thickness 0 over a white base", "the base as it stands", thickness=0.0, base="white"),
    define("thickness 0 over a lobe", "the lobe's Fourier orders alone", thickness=0.0, base="lobe", view=0.6),
    define("thickness 1e-10", "reflection is 1e-10 of the light: 1 - E keeps 6 digits",
           thickness=1e-10, phase="metal-x1"),
    define("thickness 1e-10 over a white base", "a change of 1e-10 in a reflectance of 1",
           thickness=1e-10, base="white"),
    define("white base under a white slab", "a closed box with one opening", thickness=1e2, base="white"),
    define("white base under a white slab, thick", "light that is never lost, 1e6 deep", thickness=1e6, base="white"),
    define("lobe under a thin layer", "a lobe of more orders than the layer has terms",
           thickness=1e-2, base="lobe", view=0.6),
    define("lobe under a white slab", "polarized light sent back and forth", thickness=10.0, base="lobe"),
    define("g = 0.99 on 1 node", "1500 terms where 2 are carried; order 1 creates energy",
           phase="HG+0.99", albedo=0.99, nodes=1),
    define("g = 0.99 on 16 nodes, conservative", "the peak is far narrower than the nodes", phase="HG+0.99", nodes=16),
    define("g = -0.99 on 16 nodes", "every layer hands the light straight back", phase="HG-0.99", albedo=0.5, nodes=16),
    define("g = 0.99 on 40 nodes, thick", "a peak and diffusion", phase="HG+0.99", albedo=1.0, thickness=1e4, nodes=40),
    define("g = 0.99 on 128 nodes", "256 orders, 128 nodes", phase="HG+0.99", albedo=0.99, nodes=128),
    define("isotropic on 1 node", "the smallest system there is", phase="isotropic", nodes=1),
    define("isotropic on 1 node, thick", "two streams, 1e6 deep", phase="isotropic", nodes=1, thickness=1e6),
    define("thick between thin", "decay rates times thickness from 1e-2 to 1e6 in one system",
           thickness=1e6, layering="thick-between-thin"),
    define("thick between thin, absorbing", "the lower layers are dark to the last bit",
           albedo=0.5, thickness=1e4, layering="thick-between-thin", base="white"),
    define("clear layer between", "a layer whose every mode is a node's", layering="clear-between"),
    define("clear layer between, conservative, thick", "absorption without scattering inside a white slab",
           thickness=1e4, layering="clear-between"),
    define("clear layer alone", "no multiple scattering at all", albedo=0.0, base="white"),
    define("identical neighbours, conservative, thick", "joins of layers that are one layer",
           thickness=1e6, layering="identical-neighbours"),
    define("hundred layers, conservative, thick", "99 additions of slabs that transmit little",
           thickness=1e6, layering="hundred"),
    define("hundred thin layers", "99 additions of slabs that do nothing",
           thickness=1e-6, layering="hundred", albedo=0.99),
    define("transmission near 1e-80", "relative digits of light that is nearly gone", albedo=0.5, thickness=1e2),
    define("transmission that underflows", "e^-8000: below the smallest number there is", albedo=0.5, thickness=1e4),
    define("transmission that underflows onto a lobe", "nothing comes back from below",
           albedo=0.5, thickness=1e4, base="lobe"),
    define("omega = 1e-12", "multiple scattering is 1e-12 of single scattering", albedo=1e-12),
    define("mu = 1 off the plane of incidence", "at the pole the meridian plane is the azimuth's", sun="1", view="1",
           orders=(0, 2), phase="metal-x1"),
    define("1e-12 from the normal", "sqrt(1 - mu^2) keeps 6 digits", sun="1-1e-12", view="1-1e-12", orders=(0, 2)),
    define("the same direction many times", "duplicates must not make a system singular",
           extra_mu=(0.35, 0.35, -0.35, 0.5, 0.6)),
    define("circular light", "V alone carries polarization", beam=(1.0, 0.0, 0.0, 1.0), phase="metal-x1"),
    define("linear light at 45 degrees", "U alone carries polarization", beam=(1.0, 0.0, 1.0, 0.0), phase="metal-x1"),
    define("a metal sphere's order 20", "an order far above those that diffuse", phase="metal-x30", albedo=0.94,
           thickness=1e2, nodes=16, orders=(0, 20)),
    define("large glass spheres on 16 nodes", "487 terms where 32 are carried",
           phase="glass-x200", albedo=0.5, nodes=16),
    define("haze L, conservative, thick", "a forward peak, 1e4 deep", phase="haze-L", thickness=1e4, nodes=16),
)
GLASS, DENSE = (1.0, 1.5, 1.5), (1.0, 4.0, 4.0)  # media: under a surface
CRITICAL = find_critical_cosine(GLASS)
SURFACE_CORNERS: tuple[Case, ...] = (
    define("n=4, trapped over a perfect mirror", "15 of 16 parts of the light are turned back, none is lost",
           media=DENSE, base="perfect mirror", phase="metal-x1"),
    define("n=4, trapped over a perfect mirror, thin", "no place where light is scattered out of the trap but 1e-6",
           media=DENSE, base="perfect mirror", thickness=1e-6),
    define("n=4, trapped over a perfect mirror, thick", "it finds its way out from 1e6 deep",
           media=DENSE, base="perfect mirror", thickness=1e6),
    define("n=4, trapped over a metal", "every way back to the surface passes an absorbing mirror",
           media=DENSE, base="mirror", phase="spheroids"),
    define("n=4, a closed box", "a white base under a white slab, and a surface that hardly opens",
           media=DENSE, base="white", phase="spheroids", thickness=1e2),
    define("n=4, infinite, conservative", "everything comes out again, sooner or later", media=DENSE, thickness=INF),
    define("n=4, plate between mirrors of itself", "both faces reflect totally below the same cosine",
           media=(1.0, 4.0, 1.0), phase="glass-x1"),
    define("n=1.5, view at the critical cosine", "T of the surface has a square-root edge, hit to the last bit",
           media=GLASS, view="critical",
           extra_mu=(math.nextafter(CRITICAL, 1.0), -math.nextafter(CRITICAL, 1.0), math.nextafter(CRITICAL, 0.0))),
    define("n=1/1.5, sun at the critical cosine", "the refracted beam goes along the surface",
           media=(1.5, 1.0, 1.0), sun="critical", view="critical"),
    define("n=1/1.5, sun above the critical cosine", "one unit in the last place: cosine 2e-8 behind the surface",
           media=(1.5, 1.0, 1.0), sun=math.nextafter(CRITICAL, 1.0)),
    define("n=1/1.5, sun below the critical cosine", "one unit in the last place: all of the beam is reflected",
           media=(1.5, 1.0, 1.0), sun=math.nextafter(CRITICAL, 0.0)),
    define("n=1.5, sun grazing", "it enters at the critical angle", media=GLASS, sun="1e-8", view="1e-8", albedo=0.99),
    define("n=1.5, sun grazing, thin plate", "what enters is 1e-8 of it, and crosses 1e-6",
           media=(1.0, 1.5, 1.0), sun="1e-8", view="1e-8", base="white", albedo=0.99, thickness=1e-6),
    define("n=1.0001, grazing", "a surface that reflects nothing but what is beyond 89 degrees",
           media=(1.0, 1.0001, 1.0001), sun="1e-8", view="critical"),
    define("n=1.0001, conservative, thick", "one panel of nodes is 0.014 wide, thickness 1e6",
           media=(1.0, 1.0001, 1.0001), thickness=1e6),
    define("n=1/1.5, gap of air in glass", "light of the gap is all that gets across", phase="metal-x1",
           media=(1.5, 1.0, 1.5), view="critical"),
    define("n=1/1.5, empty gap of air in glass", "nothing scatters, and most is reflected totally", albedo=0.0,
           thickness=0.0, media=(1.5, 1.0, 1.5), sun="critical", view="critical"),
    define("n=2.7, thickness 0 over a white base", "the surface and the base alone",
           media=(1.0, 2.7, 2.7), thickness=0.0, base="white"),
    define("n=1.5, hundred layers", "99 interfaces that are none, and one", media=(1.0,) + 101 * (1.5,),
           layering="hundred", thickness=1e2, nodes=8),
    define("n=1, over a perfect mirror", "nothing refracts: the mirror alone turns beams", media=(1.0, 1.0, 1.0),
           base="perfect mirror", thickness=1e2),
    define("n=1.33, haze L on few nodes", "82 terms where 16 are carried",
           phase="haze-L", media=(1.0, 1.33, 1.33), nodes=16, albedo=0.9),
)
# fmt: on


@cache
def list_all_cases() -> tuple[Case, ...]:
    """The corners and the covering array, without surfaces and then with them, names unique.

    >>> len(list_all_cases()) >= 450
    True
    """
    return (*CORNERS, *make_covering_cases("plain"), *SURFACE_CORNERS, *make_covering_cases("under surfaces"))


def list_oracle_cases() -> tuple[Case, ...]:
    """The cases of at most 16 nodes, which ball arithmetic can answer.

    >>> max(case.nodes for case in list_oracle_cases())
    16
    """
    return tuple(case for case in list_all_cases() if case.nodes <= ORACLE_NODES and not case.media)


def choose_quick_cases() -> tuple[Case, ...]:
    """Every second corner and some scenes, of at most 16 nodes that carry all terms, without a hundred layers; and two
    under surfaces.

    >>> 40 <= len(choose_quick_cases()) <= 60
    True
    """
    small = [case for case in list_oracle_cases() if case.resolved and case.layering != "hundred"]
    corners = [case for case in small if case.reason]
    surfaces = [case for case in SURFACE_CORNERS if case.name in QUICK_SURFACES]
    scenes = [case for case in small if not case.reason]
    return (*corners[::2], *scenes[:: len(scenes) // QUICK_SCENES][:QUICK_SCENES], *surfaces)


def find_matching_cases(pattern: str, quick: bool = False) -> list[Case]:
    """The cases whose names match a shell's pattern, of all or of the quick selection. Raises SceneError for none.

    >>> [case.name for case in find_matching_cases("thickness 0*lobe")]
    ['thickness 0 over a lobe']
    """
    found = [case for case in (choose_quick_cases() if quick else list_all_cases()) if fnmatchcase(case.name, pattern)]
    if not found:
        raise SceneError(f"--cases {pattern!r} matches no scene{' of the quick selection' if quick else ''}")
    return found
