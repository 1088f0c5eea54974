"""How much paint hides what is below: white pigment under a thin red coat. Usage: python layered_paint.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)

# Pigments in a clear binder, in green light: host_index is the binder's.
white = vrte.spheres("rutile", size=vrte.Lognormal(median_um=0.12, sigma=1.3), wavelength_um=0.55, host_index=1.5)
red = vrte.spheres("hematite", size=vrte.Lognormal(median_um=0.08, sigma=1.3), wavelength_um=0.55, host_index=1.5)
blend = vrte.mixture([(white, 0.9), (red, 0.1)])  # number fractions

# Layers stand in the order in which light meets them: the coat, then the white paint, then the base.
coat = vrte.Layer.of(blend, thickness_um=2.0, volume_fraction=0.05)
lines = ["white paint [um], reflectance over black, over white, contrast"]
for thickness_um in (2.0, 5.0, 10.0, 20.0, 40.0):
    paint = vrte.Layer.of(white, thickness_um=thickness_um, volume_fraction=0.05)
    over = [vrte.Scene([coat, paint], base=vrte.Lambertian(albedo)) for albedo in (0.0, 0.9)]
    # brdfs solves many scenes in one call; reflectance is the share of unpolarized light that comes back
    dark, bright = (f.reflectance[0] for f in vrte.brdfs(over, mu_i=0.7, mu_o=np.array([0.7]), nodes=8))
    lines.append(f"{thickness_um:g}, {dark:.4f}, {bright:.4f}, {dark / bright:.4f}")

print("\n".join(lines))  # a contrast near 1 hides the base
(folder / "layered_paint.csv").write_text("\n".join(lines) + "\n")
