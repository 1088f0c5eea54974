# %% [markdown]
# # Sweep: a table of many scenes, and what lies between them
#
# Gold that is ground finely enough is no longer golden: instrument makers know it as gold
# black. From which size on does a powder of gold look like gold? One scene answers for
# one radius and one wavelength; a sweep solves all of them into one labelled table. How
# far can one trust what is interpolated between its scenes?

# %%
import warnings

import matplotlib.pyplot as plt
import numpy as np

import vrte
from vrte.appearance.colours import find_colour
from vrte.sweep.interpolation import held_out

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

powder = {
    "wavelength_um": 0.55,
    "nodes": 10,
    "particles": {"gold": {"index": "gold", "radius_um": 0.1}},
    "layer": [{"particles": "gold", "thickness": 100.0}],
    "brdf": {"angle_i_deg": 45.0, "mu_o": [0.5, 1.0], "phi_deg": [0, 180]},
    "axes": {
        "radius_um": {
            "key": "particles.gold.radius_um",
            "start": 0.015,
            "stop": 0.2,
            "count": 16,
            "spacing": "log",
        },
        "wavelength_um": {"start": 0.42, "stop": 0.70, "count": 15},
    },
}
warnings.simplefilter(
    "ignore", vrte.LongSolveWarning
)  # minutes are predicted, and it takes seconds
table = vrte.sweep(powder)
print(f"{table.reflectance[..., 0].size} scenes:", dict(table.sizes))
assert not table.error.values.any()

# %% [markdown]
# ## The map
#
# The reflectance of thick powders, light at 45 degrees, and beside it the colour of each
# powder as it is seen from above.

# %%
radius, wavelength = table.radius_um.values, table.wavelength_um.values
reflectance = table.reflectance.isel(mu_i=0).values
seen = (
    np.pi
    * table.mueller.isel(mu_i=0, phi_deg=0, stokes_out=0, stokes_in=0)
    .sel(mu_o=1.0)
    .values
)
colours = [find_colour(wavelength, spectrum) for spectrum in seen]

figure, (left, right) = plt.subplots(
    1, 2, figsize=(9.0, 4.2), width_ratios=[4, 1], sharey=True
)
shown = left.pcolormesh(
    wavelength, radius, reflectance, cmap="cividis", vmin=0.0, shading="gouraud"
)
lines = left.contour(
    wavelength,
    radius,
    reflectance,
    levels=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
    colors="white",
    linewidths=0.8,
)
left.clabel(lines, fontsize=9)
left.set(yscale="log", xlabel="wavelength [µm]", ylabel="radius of the spheres [µm]")
left.set_yticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
left.minorticks_off()
figure.colorbar(shown, ax=left, label="reflectance", location="left")
edges = np.sqrt(radius[1:] * radius[:-1])
edges = np.concatenate([[radius[0]], edges, [radius[-1]]])
for low, high, colour in zip(edges[:-1], edges[1:], colours, strict=True):
    right.axhspan(low, high, color=colour.hex)
right.set(xticks=[], title="colour")

# %%
for place in range(0, radius.size, 3):
    colour = colours[place]
    print(
        f"radius {radius[place]:.3f} µm: L* {colour.L:2.0f}, chroma "
        f"{colour.C:2.0f}, hue {colour.h:2.0f} degrees, {colour.hex}"
    )
most = np.argmax([colour.C for colour in colours])
print(f"most colourful at a radius of {radius[most]:.2f} µm")
assert colours[0].L < 15.0
assert 0.1 < radius[most] < 0.15

# %% [markdown]
# Below 20 nm the powder is almost black: such spheres absorb far more than they scatter,
# and hardly any light comes out again. It turns brown, and golden at about 0.1 µm, where
# scattering has taken over in the red but not in the blue.

# %% [markdown]
# ## Between the scenes
#
# `vrte.interpolate` reads a BRDF at any radius and wavelength. `held_out` solves scenes
# at random places between those of the table and says how far the interpolation is off
# there, relative to the largest element of the scene.

# %%
between = vrte.interpolate(table, {"radius_um": 0.0873, "wavelength_um": 0.6134})
print(f"radius 0.0873 µm at 613.4 nm reflects {float(between.reflectance[0]):.4f}")
error = held_out(table, points=15)
print(
    f"off by {error.median:.1e} (median), {error.largest:.1e} "
    f"(largest) at {error.errors.size} places"
)
assert error.median < 5e-3

# %% [markdown]
# Half of the places are good to some parts in a thousand of the largest element, without
# a new solve; the worst is off by a few per cent, where spheres begin to resonate. More
# scenes make it better where the scene is smooth:
# [Sweeps](../how_to/sweeps.md#between-the-scenes) has how fast.
