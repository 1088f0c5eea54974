"""The size of rutile that hides best, and how much of it is worth while: hiding power over diameter and loading.

``python -m docs.scripts.pigment_size -o FOLDER`` writes pigment_size.csv and rutile_size_loading.png there.
"""

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bench.study import write_rows
from vrte.basics.arrays import Array
from vrte.optics.crowding import COHERENT_POTENTIAL, INDEPENDENT, PERCUS_YEVICK
from vrte.pictures.figures import require_pictures, save
from vrte.sweep import sweep
from vrte.sweep.run import SweepWarning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIAMETERS_UM = tuple(np.geomspace(0.08, 0.5, 12).round(4).tolist())  # medians by mass
FRACTIONS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3)
PACKINGS = (INDEPENDENT, PERCUS_YEVICK, COHERENT_POTENTIAL)
COLOURS = dict(zip(PACKINGS, ("#8c8c8c", "#1f4e79", "#a02c2c"), strict=True))
SIGMA, NARROW = 1.3, 1.05  # geometric standard deviations
NODES = 16  # contrast ratios to 4e-6 of what accuracy = 1e-4 gives, at a third of the cost
QUANTITIES = ["contrast_ratio", "hiding_thickness_um", "spreading_rate"]
HEADER = ("packing", "sigma", "mass_median_um", "volume_fraction", *QUANTITIES)


class Map(NamedTuple):
    """Sizes (d,), loadings (v,), and by QUANTITIES what each paint does, (d, v)."""

    packing: str
    sigma: float
    diameters_um: Array
    fractions: Array
    found: dict[str, Array]

    @property
    def pigment_rate(self) -> Array:
        """Area that a litre of pigment hides [m2/l], (d, v)."""
        return self.found["spreading_rate"] / self.fractions


class Optimum(NamedTuple):
    """The mass-median diameter [um] at which something is largest, and how large."""

    diameter_um: float
    value: float


def make_paint(packing: str, sigma: float, diameters_um: Sequence[float], fractions: Sequence[float]) -> dict[str, Any]:
    """A sweep file's content: 20 um of rutile in alkyd under air, lognormal spheres.

    The median by mass is that by number times exp(3 ln^2 sigma) (Hatch and Choate).
    """
    by_number = np.asarray(diameters_um) * np.exp(-3.0 * np.log(sigma) ** 2)
    size = {"lognormal": {"median_diameter_um": float(by_number[0]), "sigma": sigma}}
    film = {"volume_fractions": {"rutile": fractions[0]}, "thickness_um": 20.0, "packing": packing}
    key = "particles.rutile.size.lognormal.median_diameter_um"
    return {
        "host_index": "alkyd",
        "nodes": NODES,
        "particles": {"rutile": {"index": "rutile", "size": size}},
        "layer": [{"interface": {"above": 1.0, "below": "alkyd"}}, film],
        "appearance": {"wavelengths_um": {"start": 0.43, "stop": 0.67, "count": 7}, "quantities": QUANTITIES},
        "axes": {
            "diameter": {"key": key, "values": by_number.tolist()},
            "fraction": {"key": "layer[2].volume_fractions.rutile", "values": list(fractions)},
        },
    }


def compute_map(
    packing: str,
    sigma: float = SIGMA,
    diameters_um: Sequence[float] = DIAMETERS_UM,
    fractions: Sequence[float] = FRACTIONS,
) -> Map:
    """One map. Its packing's domain does not matter here: the page says where it ends."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SweepWarning)
        table = sweep(make_paint(packing, sigma, diameters_um, fractions))
    found = {name: table[name].values for name in QUANTITIES}
    return Map(packing, sigma, np.asarray(diameters_um), np.asarray(fractions), found)


def find_optimum(diameters_um: Array, values: Array) -> Optimum:
    """The largest of values (d,) by the parabola through the three highest neighbours, in the logarithm of the size.

    >>> found = find_optimum(np.array([0.1, 0.2, 0.4]), np.array([1.0, 2.0, 1.0]))
    >>> [round(number, 12) for number in found]
    [0.2, 2.0]
    """
    best = int(np.clip(np.argmax(values), 1, len(values) - 2))
    near = slice(best - 1, best + 2)
    middle = np.log(diameters_um[best])
    square, slope, height = np.polyfit(np.log(diameters_um[near]) - middle, values[near], 2)
    off = -slope / (2.0 * square)
    return Optimum(float(np.exp(middle + off)), float(height + 0.5 * slope * off))


def find_optima(found: Map) -> list[Optimum]:
    """The size at which a litre of pigment hides most, at each loading."""
    return [find_optimum(found.diameters_um, rates) for rates in found.pigment_rate.T]


def draw_figure(maps: Sequence[Map]) -> "Figure":
    """Spreading rates over size and loading by each packing, with the best size; below what a litre of pigment hides,
    over the loading, and over the size at two loadings."""
    require_pictures()
    from matplotlib.figure import Figure

    wide = [one for one in maps if one.sigma == SIGMA]
    levels = np.linspace(0.0, 120.0, 13)
    drawing = Figure(figsize=(12.0, 7.0), facecolor="white", layout="constrained")
    panels = drawing.subplots(2, 3)
    for panel, one in zip(panels[0], wide, strict=True):
        given = one.diameters_um, one.fractions, one.found["spreading_rate"].T, levels
        filled = panel.contourf(*given, cmap="YlGnBu", extend="max")
        panel.clabel(panel.contour(*given, colors="#303030", linewidths=0.5), fontsize=7)
        best = [one.diameter_um for one in find_optima(one)]
        panel.plot(best, one.fractions, "o-", color="#d98200", markersize=4, clip_on=False)
        panel.set(title=one.packing, ylabel="volume fraction")
    drawing.colorbar(filled, ax=panels[0], label="m² that a litre of dry film hides")
    over_loading, few, many = panels[1]
    for one in wide:
        colour, usual = COLOURS[one.packing], int(np.argmax(wide[0].pigment_rate[:, 0]))
        over_loading.plot(one.fractions, one.pigment_rate[usual], "o-", color=colour, label=one.packing)
        over_loading.plot(one.fractions, [best.value for best in find_optima(one)], ":", color=colour)
        for panel, fraction in ((few, 0.1), (many, one.fractions[-1])):
            place = int(np.abs(one.fractions - fraction).argmin())
            panel.plot(one.diameters_um, one.pigment_rate[:, place], color=colour, label=one.packing)
            panel.set(title=f"{one.fractions[place]:.0%} by volume")
    for one in maps:
        if one.sigma == NARROW:
            few.plot(one.diameters_um, one.pigment_rate[:, 0], ":", color="black", label=f"independent, σ {NARROW}")
    size = f"{wide[0].diameters_um[usual]:.2f} µm"
    over_loading.set(xlabel="volume fraction", title=f"{size} (dotted: the best size)")
    for panel in (*panels[0], few, many):
        panel.set(xlabel="mass-median diameter [µm]", xscale="log", xlim=wide[0].diameters_um[[0, -1]])
        panel.set_xticks([0.1, 0.2, 0.3, 0.5], ["0.1", "0.2", "0.3", "0.5"])
        panel.set_xticks([], minor=True)
    for panel in panels[1]:
        panel.set(ylim=(0.0, 450.0), ylabel="m² that a litre of rutile hides")
        panel.grid(color="#d0d0d0", linewidth=0.5)
        panel.legend(fontsize=8, frameon=False)
    return drawing


def list_rows(maps: Sequence[Map]) -> list[tuple[str, ...]]:
    """All numbers of the maps, a row a paint."""
    return [
        (
            one.packing,
            *(
                f"{value:.6g}"
                for value in (one.sigma, diameter, fraction, *(found[k, j] for found in one.found.values()))
            ),
        )
        for one in maps
        for k, diameter in enumerate(one.diameters_um)
        for j, fraction in enumerate(one.fractions)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``; ``--diameters-um`` and ``--fractions`` for others than those above."""
    parser = argparse.ArgumentParser(prog="python -m docs.scripts.pigment_size", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("pigment_size"), help="folder to write to")
    parser.add_argument("--diameters-um", type=float, nargs="+", default=DIAMETERS_UM, help="mass-median diameters")
    parser.add_argument("--fractions", type=float, nargs="+", default=FRACTIONS, help="volume fractions")
    options = parser.parse_args(arguments)
    given = options.diameters_um, options.fractions
    maps = [compute_map(packing, SIGMA, *given) for packing in PACKINGS]
    maps += [compute_map(INDEPENDENT, NARROW, options.diameters_um, options.fractions[:1])]  # the same at all
    options.output.mkdir(parents=True, exist_ok=True)
    write_rows(options.output / "pigment_size.csv", HEADER, list_rows(maps))
    save(draw_figure(maps), options.output / "rutile_size_loading.png")
    for one in maps:
        for fraction, best in zip(one.fractions, find_optima(one), strict=True):
            told = (
                f"{one.packing}, sigma {one.sigma:g}, {fraction:.0%}: best {best.diameter_um:.3f} um (median by mass)"
            )
            print(f"{told}, {best.value:.0f} m2 a litre of rutile")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
