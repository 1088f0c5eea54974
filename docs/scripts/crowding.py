"""What crowding does, by the packings: a latex's transport length, and what a film of white paint hides.

``python -m docs.scripts.crowding -o FOLDER`` writes crowding.csv and crowding.png there.
"""

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.study import write_rows
from vrte.calls.brdf import brdf
from vrte.optics.crowding import PACKINGS, PackingWarning, compute_structure_factor
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Lognormal
from vrte.optics.spheres import spheres
from vrte.pictures.figures import require_pictures, save
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRACTIONS = (0.01, 0.03, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45)
FILM_UM = 10.0
COLOURS = dict(zip(PACKINGS, ("#8c8c8c", "#1f4e79", "#d98200", "#a02c2c"), strict=True))
HEADER = ("what", "packing", "volume_fraction", "transport_length_um", "reflectance")


class Row(NamedTuple):
    """A transport length l* = thickness over (1 - g) times scattering optical thickness, and what a film reflects."""

    what: str
    packing: str
    volume_fraction: float
    length_um: float
    reflectance: float


def make_kinds() -> dict[str, Particles]:
    """Polystyrene in water, and titania in resin."""
    return {
        "latex of 0.46 um in water, 0.65 um": spheres(1.59, radius_um=0.23, wavelength_um=0.65, host_index=1.33),
        "rutile in resin, 0.55 um": spheres(2.7, size=Lognormal(0.1, 1.2), wavelength_um=0.55, host_index=1.5),
    }


def measure_row(what: str, particles: Particles, packing: str, volume_fraction: float) -> Row:
    """Of a film over black, without a surface, in light along the normal; its domains do not matter here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PackingWarning)
        layer = Layer.of(particles, thickness_um=FILM_UM, volume_fraction=volume_fraction, packing=packing)
    length = FILM_UM / (layer.thickness * layer.albedo * (1.0 - layer.phase_matrix.asymmetry))
    reflected = brdf(Scene([layer]), [1.0], [1.0], nodes=12).reflectance
    return Row(what, packing, volume_fraction, length, float(reflected[0]))


def draw_figure(rows: Sequence[Row]) -> "Figure":
    """S(q) of one size; l* of each kind, times the volume fraction; reflectance of films of the last kind."""
    require_pictures()
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(11.0, 3.6), facecolor="white")
    first, second, third = drawing.subplots(1, 3)
    q = np.linspace(0.0, 20.0, 400)
    for fraction, colour in ((0.1, "#9db8d2"), (0.3, "#4a7fb0"), (0.45, "#1f4e79")):
        first.plot(q, compute_structure_factor(q, 0.5, fraction), color=colour, label=f"{fraction:.0%} by volume")
    first.set(xlabel="q times the diameter", title="S(q) of hard spheres", ylim=(0.0, 2.6))
    kinds = list(dict.fromkeys(row.what for row in rows))
    for kind, panel, title in zip(
        kinds, (second, third), ("latex: l* [um] times fraction", f"rutile, {FILM_UM:g} um: reflectance"), strict=True
    ):
        for packing, colour in COLOURS.items():
            chosen = [row for row in rows if (row.what, row.packing) == (kind, packing)]
            values = [row.length_um * row.volume_fraction if panel is second else row.reflectance for row in chosen]
            panel.plot([row.volume_fraction for row in chosen], values, color=colour, label=packing)
        panel.set(xlabel="volume fraction", title=title)
    for panel in (first, second, third):
        panel.grid(color="#d0d0d0", linewidth=0.5)
        panel.legend(fontsize=8, frameon=False)
    drawing.tight_layout()
    return drawing


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``, and ``--fractions`` for others than FRACTIONS."""
    parser = argparse.ArgumentParser(prog="python -m docs.scripts.crowding", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("crowding"), help="folder to write to")
    parser.add_argument("--fractions", type=float, nargs="+", default=FRACTIONS, help="volume fractions")
    options = parser.parse_args(arguments)
    rows = [
        measure_row(what, particles, packing, fraction)
        for what, particles in make_kinds().items()
        for packing in PACKINGS
        for fraction in options.fractions
    ]
    options.output.mkdir(parents=True, exist_ok=True)
    write_rows(
        options.output / "crowding.csv",
        HEADER,
        ((*row[:3], f"{row.length_um:.5g}", f"{row.reflectance:.5f}") for row in rows),
    )
    save(draw_figure(rows), options.output / "crowding.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
