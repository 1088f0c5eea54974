"""The first BRDF: a thick powder of gold spheres in red light. Usage: python first_brdf.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)

# What is the powder made of? The index of gold comes from a database; lengths are in micrometres.
gold = vrte.spheres("gold", radius_um=0.3, wavelength_um=0.64)
print(f"one sphere scatters {gold.albedo:.0%} of the light that it takes away, mean cosine {gold.asymmetry:.2f}")

# One layer, so thick that nothing comes back from below.
scene = vrte.Scene([vrte.Layer.of(gold, thickness=float("inf"))])

# From where does light come (cosine from the normal), where to (cosines and azimuths in degrees)?
f = vrte.brdf(scene, mu_i=0.6, mu_o=np.linspace(0.05, 1.0, 20), phi=np.arange(0, 361, 10), nodes=16)

# mueller[mu_i, mu_o, phi] is a 4x4 Mueller matrix in 1/sr: its corner is what unpolarized light makes of itself.
print(f"straight up: {f.mueller[0, -1, 0, 0, 0]:.4f} 1/sr; reflected in all: {f.reflectance[0]:.1%}")

f.save(folder / "first_brdf.nc")  # vrte.load reads it back
f.plot().savefig(folder / "first_brdf.png")  # in a notebook, f alone shows itself
