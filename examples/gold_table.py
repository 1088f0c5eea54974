"""A look-up table of gold powders, radius x wavelength, and the colour of one that is not in it."""

import csv
import sys
from pathlib import Path

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(exist_ok=True)

table = vrte.sweep(Path(__file__).with_suffix(".toml"), folder / "gold_table.zarr").load()

with open(folder / "gold_colours.csv", "w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["radius_um", "wavelength_um", "reflectance"])
    for radius in (0.033, 0.077, 0.15):
        for wavelength in (0.45, 0.55, 0.65):
            found = vrte.interpolate(table, {"radius_um": radius, "wavelength_um": wavelength})
            rows.writerow([radius, wavelength, found.reflectance.sel(mu_i=1.0).item()])

print((folder / "gold_colours.csv").read_text())
