"""Stability cases under surfaces that refract: axes of their own, covered pair by pair, and corners."""

import math
from collections.abc import Iterator

from bench.cases import Slab
from bench.stability.cases import Case, show_albedo
from bench.stability.covering import Row, make_covering_array

COSINES = ("1", "0.5", "critical", "node", "1e-3", "1e-8")
PILES = ("under a surface", "plate", "below the air", "coated")
AXES: dict[str, tuple[float | str, ...]] = {
    "thickness": (1e-6, 1e-2, 1.0, 1e2, 1e4, 1e6, math.inf),
    "albedo": (0.0, 0.5, 1.0 - 1e-6, 1.0 - 1e-12, 1.0),
    "phase": ("isotropic", "rayleigh", "glass-x1", "metal-x1", "spheroids"),
    "sun": COSINES,
    "view": COSINES,
    "base": ("black", "white", "mirror", "perfect mirror", "lobe"),
    "pile": PILES,
    "index": (1.0001, 1.33, 1.5, 2.7, 4.0, 1.0 / 1.5),
    "nodes": (6, 12, 24),
}
SCENES, SEED = 90, 1621
AIR, COAT = Slab("rayleigh", 0.9, 0.2), Slab("isotropic", 0.0, 0.1)


def arrange_pile(slab: Slab, pile: str, index: float) -> tuple[tuple[Slab, ...], int, tuple[float, ...]]:
    """The slabs of one of PILES, which of them is the one given, and the refractive indices above, of each and below.

    A plate without end has a single surface.

    >>> arrange_pile(Slab("rayleigh", 1.0, 1.0), "plate", 1.5)[1:]
    (0, (1.0, 1.5, 1.0))
    """
    if pile == "below the air":
        return (AIR, slab), 1, (1.0, 1.0, index, index)
    if pile == "coated":
        return (COAT, slab), 1, (1.0, math.sqrt(index), index, index)
    last = 1.0 if pile == "plate" and math.isfinite(slab.thickness) else index
    return (slab,), 0, (1.0, index, last)


def make_surface_rows() -> list[Row]:
    """The covering array of AXES, as value numbers."""
    return make_covering_array([len(values) for values in AXES.values()], SCENES, SEED)


def make_surface_cases() -> Iterator[Case]:
    """The covering array's cases; each looks one unit in the last place to both sides of the critical angle, too."""
    for number, row in enumerate(make_surface_rows()):
        values = dict(zip(AXES, (choices[k] for choices, k in zip(AXES.values(), row, strict=True)), strict=True))
        albedo, thickness, index = (float(values[name]) for name in ("albedo", "thickness", "index"))
        slabs, main, media = arrange_pile(Slab(str(values["phase"]), albedo, thickness), str(values["pile"]), index)
        told = " ".join(f"{name}={values[name]}" for name in ("sun", "view"))
        yield Case(
            f"n={index:.5g} {values['pile']}: {values['phase']} w={show_albedo(albedo)} t={thickness:g} "
            f"{values['base']} {told} N={values['nodes']}",
            nodes=int(values["nodes"]),
            slabs=slabs,
            main=main,
            base_kind=str(values["base"]),
            sun=str(values["sun"]),
            view=str(values["view"]),
            orders=(0, 1 + number % 2),
            layering="",
            media=media,
            pile=str(values["pile"]),
        )
