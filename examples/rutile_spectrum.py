"""The spectral BRDF of a white powder, rutile spheres of many sizes: half a minute on two cores, once."""

import csv
import sys
from pathlib import Path

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(exist_ok=True)

# called again, it is read and not computed
table = vrte.sweep(Path(__file__).with_suffix(".toml"), folder / "rutile_spectrum.nc")

with open(folder / "rutile_spectrum.csv", "w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["wavelength_um", "reflectance at 60 degrees", "reflectance at normal incidence"])
    for wavelength, reflectance in zip(table.wavelength_um.values, table.reflectance.values, strict=True):
        rows.writerow([f"{wavelength:.3f}", *reflectance])

blue, red = (vrte.interpolate(table, {"wavelength_um": at}).reflectance.values[-1] for at in (0.4525, 0.6525))
print(f"reflected at normal incidence: {blue:.2%} at 452.5 nm, {red:.2%} at 652.5 nm")
table.close()
