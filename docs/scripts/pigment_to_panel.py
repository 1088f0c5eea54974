"""Tables and a figure of docs/explanation/pigment_to_panel.md: what its white does, and what shape and clusters change.

``python -m docs.scripts.pigment_to_panel -o FOLDER`` prints the tables and writes white_scattering.png there.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import vrte
from vrte.optics.crowding import pack
from vrte.pictures.figures import require_pictures, save

Paint = dict[str, Any]
AT = np.linspace(0.40, 0.70, 11)  # um
WHITE: Paint = {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 40.0}
BLACK: Paint = WHITE | {"pigment": "titanium black", "volume_fraction": 0.10, "thickness_um": float("inf")}
HOST, WAVELENGTH = 1.52, 0.55  # of alkyd; um
# sigma_s (1 - g) of compact clusters of touching rutile spheres in random orientation over that of as many alone, by
# T-matrices (treams 0.4.7, energy kept to 1e-3, of 13 of 0.25 um to 7e-3): diameter [um], number of grains, ratio
CLUSTERS = {
    0.15: ((2, 1.038), (3, 1.057), (4, 1.096), (8, 1.013), (13, 0.949)),
    0.20: ((2, 0.839), (3, 0.750), (4, 0.698), (8, 0.540), (13, 0.440)),
    0.25: ((2, 0.823), (3, 0.726), (4, 0.680), (8, 0.517), (13, 0.441)),
}
PAIR = 0.8  # of the same for a pair of rutile grains: Thiele and French, J. Am. Ceram. Soc. 81, 469 (1998), abstract
COLOURS = "#8c8c8c", "#1f4e79", "#a02c2c"


def grains(**size: Any) -> Paint:
    """The white with grains of another size."""
    return WHITE | {"particles": {"rutile": size}}


def lognormal(median_um: float) -> Paint:
    """The white with grains of another median diameter [um]."""
    return grains(size={"lognormal": {"median_diameter_um": median_um, "sigma": 1.3}})


TABLES: dict[str, dict[str, Paint]] = {
    "one size [um]": {f"{d:g}": grains(diameter_um=d) for d in (0.10, 0.15, 0.20, 0.25, 0.30, 0.40, 0.60)},
    "by volume": {f"{f:g}": WHITE | {"volume_fraction": f} for f in (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)},
    "changed": {
        "nothing": WHITE,
        **{name: WHITE | {"packing": name} for name in ("independent", "effective-medium", "percus-yevick")},
        **{f"binder {n}": WHITE | {"binder": [n, 0.0]} for n in (1.49, 1.55)},
        **{f"grains {d:g}": lognormal(d) for d in (0.18, 0.22)},
        "10 % less": WHITE | {"volume_fraction": 0.135},
        "36 um": WHITE | {"thickness_um": 36.0},
        **{f"clusters of {n}": lognormal(0.20 * n ** (1.0 / 3.0)) for n in (2, 4, 8)},
    },
}
SURFACES: dict[str, Any] = {"none": "none", "smooth": "smooth", "0.1": {"roughness": 0.1}, "0.3": {"roughness": 0.3}}


def print_tables() -> None:
    """Hiding thickness, contrast ratio, L*, a* and b* at 45:0 of each paint; then what surfaces do."""
    for title, paints in TABLES.items():
        print(f"\n{title}: hides at [um], contrast ratio, L* a* b* over black, pigment [cm3/m2]")
        for name, paint in paints.items():
            look = vrte.appearance({"paint": paint}, AT, geometries=["45:0"])
            hiding, colour = look.hiding(), look.colour("45:0")
            colours = f"{colour.L:.2f} {colour.a:.2f} {colour.b:.2f}"
            needed = hiding.hiding_length_um * paint["volume_fraction"]
            print(
                f"{name}: {hiding.hiding_length_um:.1f}, {hiding.contrast_ratio:.4f}, {colours}, {needed:.1f}",
                flush=True,
            )
    names = ["45:0", "8:di", "8:de"]
    for title, paint in (("white", WHITE), ("black", BLACK)):
        for name, surface in SURFACES.items():
            look = vrte.appearance(
                {"paint": paint | {"surface": surface}}, AT, geometries=names[: 3 if name != "none" else 2]
            )
            lightness = [f"{look.colour(one).L:.1f}" for one in look.reflectances]
            print(title, name, lightness, "" if name == "none" else f"{look.gloss(60.0):.1f}", flush=True)


def find_transport(particles: vrte.Particles) -> float:
    """sigma_s (1 - g) per volume [1/um]: 3/4 of it, times the volume fraction, is S of Kubelka and Munk."""
    return particles.scattering_um2 * (1.0 - particles.asymmetry) / particles.volume_um3


def make_ball(diameter_um: float) -> vrte.Particles:
    return vrte.spheres("rutile", radius_um=0.5 * diameter_um, wavelength_um=WAVELENGTH, host_index=HOST)


def draw(path: Path) -> None:
    """Three panels: loading, clusters, shape; each with what is published."""
    require_pictures()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.4), layout="constrained")
    loading, clusters, shapes = figure.subplots(1, 3)
    size = vrte.Lognormal(0.10, 1.3)
    fractions = np.array([0.002, 0.005, 0.01, 0.02, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30])
    alone = vrte.spheres("rutile", size=size, wavelength_um=WAVELENGTH, host_index=HOST)
    for name, colour in zip(("percus-yevick", "effective-medium", "coherent-potential"), COLOURS, strict=True):
        packed = [find_transport(pack(alone, fraction, name)) for fraction in fractions]
        loading.semilogx(100.0 * fractions, np.array(packed) / find_transport(alone), color=colour, label=name)
    loading.axvline(1.0, color="black", ls=":", label="McNeil and French 2000:\ncrowded from here on")
    loading.set(xlabel="rutile [% by volume]", ylabel="S per volume of pigment, alone = 1", ylim=(0.0, 1.1))
    for (diameter, found), colour in zip(CLUSTERS.items(), COLOURS, strict=True):
        numbers = np.geomspace(1.0, 13.0, 40)
        fused = [find_transport(make_ball(diameter * n ** (1.0 / 3.0))) for n in numbers]
        clusters.semilogx(numbers, np.array(fused) / fused[0], color=colour, lw=1.0)
        clusters.plot(*np.array(found).T, "o", color=colour, label=f"grains of {diameter:g} µm")
    clusters.plot([2], [PAIR], "k*", ms=10, label="Thiele, French 1998: a pair")
    clusters.set(xlabel="grains in a cluster; lines: fused", ylabel="S, grains apart = 1", ylim=(0.0, 2.0))
    ratios = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.5, 1.75, 2.0])
    for diameter, colour in zip(CLUSTERS, COLOURS, strict=True):
        how = {"radius_um": 0.5 * diameter, "wavelength_um": WAVELENGTH, "host_index": HOST}
        found = [find_transport(vrte.spheroids("rutile", aspect_ratio=1.0 / ratio, **how)) for ratio in ratios]
        shapes.plot(
            ratios, np.array(found) / find_transport(make_ball(diameter)), color=colour, label=f"{diameter:g} µm"
        )
    shapes.set(xlabel="length over width of spheroids", ylabel="S, spheres = 1", ylim=(0.0, 1.4))
    for axes in (loading, clusters, shapes):
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    save(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--figure-only", action="store_true")
    asked = parser.parse_args()
    draw(asked.output / "white_scattering.png")
    if not asked.figure_only:
        print_tables()


if __name__ == "__main__":
    main()
