"""The light inside a cloud: how it spreads, how polarization fades. Usage: python inside_the_layer.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)

# Small water droplets that absorb nothing, over dark ground.
droplets = vrte.spheres("water", size=vrte.Gamma(r_eff_um=1.0, v_eff=0.1), wavelength_um=0.64)
scene = vrte.Scene([vrte.Layer.of(droplets, thickness=8.0)], base=vrte.Lambertian(0.05))

# Optical depth tau grows downward from the top; mu > 0 is light going up, mu < 0 light going down.
mu = np.concatenate([np.linspace(-1.0, -0.02, 30), np.linspace(0.02, 1.0, 30)])
tau = [0.0, 0.5, 2.0, 8.0]
field = vrte.radiance(scene, mu0=0.6, stokes=(1, 0, 0, 0), mu=mu, phi=[0, 180], tau=tau, accuracy=1e-4)

# What goes down must come up, or be absorbed by the ground.
for depth, up, down, beam in zip(field.tau, field.flux_up, field.flux_down, field.direct, strict=True):
    print(f"tau {depth:3g}: up {up:.4f}, down {down:z.4f}, unscattered {beam:.4f} W/m2")

field.save(folder / "inside_the_layer.nc")
field.plot().savefig(folder / "inside_the_layer.png")  # I and the degree of polarization, a column an azimuth
