"""White paint with and without its smooth surface, from all angles. Usage: python painted_panel.py [FOLDER]"""

import sys
import warnings
from pathlib import Path

import numpy as np

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)
warnings.simplefilter("ignore", vrte.IndependentScatteringWarning)  # 15 % is much, and what paints have

rutile = vrte.spheres("rutile", radius_um=0.125, wavelength_um=0.55, host_index=1.5)
paint = vrte.Layer.of(rutile, thickness_um=40.0, volume_fraction=0.15)
angles = np.arange(0.0, 90.0, 5.0)
mu = np.cos(np.radians(angles))  # in air, where a scene has an interface on top; else in the binder
piles = [vrte.Interface(1.0, 1.5), paint], [paint]
glossy, bare = (vrte.brdf(vrte.Scene(pile), mu, mu, phi=np.arange(0, 360, 10)) for pile in piles)

# What is mirrored is a beam, and not in mueller and reflectance. Q/I of diffuse light on the mirror's side:
polarized = [np.diagonal(f.mueller[:, :, 0, 1, 0] / f.mueller[:, :, 0, 0, 0]) for f in (glossy, bare)]
shares = glossy.reflectance, glossy.specular_reflectance, glossy.total_reflectance, bare.reflectance
lines = ["angle [degrees], diffuse, mirrored, together, without surface, Q/I of diffuse light, without surface"]
lines += [", ".join(f"{value:.4g}" for value in row) for row in np.transpose([angles, *shares, *polarized])]
print("\n".join(lines))
(folder / "painted_panel.csv").write_text("\n".join(lines) + "\n")
glossy.save(folder / "painted_panel.nc")
