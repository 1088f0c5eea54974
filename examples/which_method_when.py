"""Which method when: error and time of some, thin and thick. Usage: python which_method_when.py [FOLDER]"""

import sys
import time
from pathlib import Path

import numpy as np

import vrte

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)

haze = vrte.henyey_greenstein(0.7, terms=100)
seen = {"mu0": 0.6, "mu": np.linspace(0.1, 1.0, 10), "phi": [0, 90, 180]}  # from above, in three azimuths
# Approximations know their limits; "discrete-ordinates" is exact, the default; "auto" takes one for the accuracy.
methods = ("single-scattering", "two-stream", "diffusion", "synthetic-iteration", "discrete-ordinates", "auto")

lines = ["thickness, asked for, taken, largest error over the largest I, milliseconds"]
for thickness in (1e-4, 1.0, 50.0):
    scene = vrte.Scene([vrte.Layer(haze, albedo=0.95, thickness=thickness)])
    exact = vrte.radiance(scene, **seen, accuracy=1e-8).stokes[..., 0]
    for method in methods:
        begin = time.perf_counter()
        how = {"accuracy": 1e-2} if method in ("discrete-ordinates", "auto") else {}  # the others have none to keep
        found = vrte.radiance(scene, **seen, method=method, **how)
        spent, error = 1e3 * (time.perf_counter() - begin), np.abs(found.stokes[..., 0] - exact).max() / exact.max()
        lines.append(f"{thickness:g}, {method}, {found.diagnostics['method']}, {error:.1e}, {spent:.1f}")
print("\n".join(lines))  # docs/explanation/methods.md has the whole answer
(folder / "which_method_when.csv").write_text("\n".join(lines) + "\n")
