# %% [markdown]
# # Snow: what do its grains and its dirt do to its albedo?
#
# Per length of path ice absorbs red light 700 times as strongly as violet light, and
# light of 2 µm ten million times. So snow is white to the eye, and dark not far beyond
# what the eye sees. How much of that is told by the size of the grains, and how much soot
# makes snow grey?

# %%
import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

radii_um = [25.0, 50.0, 100.0]
infrared_um = np.round(
    np.concatenate([np.arange(0.83, 1.5, 0.0667), np.arange(1.5, 2.45, 0.1)]), 3
)
mu0 = 0.5  # the sun at 60 degrees from the zenith


def find_albedo(grains):
    """The share of a beam's flux that semi-infinite snow reflects."""
    field = vrte.radiance(
        vrte.Scene([vrte.Layer.of(grains, thickness=np.inf)]),
        mu0,
        mu=[],
        tau=[0.0],
        nodes=12,
    )
    return field.flux_up[0] / field.direct[0]


ice = {
    radius: [vrte.spheres("ice", radius_um=radius, wavelength_um=w) for w in infrared_um]
    for radius in radii_um
}
albedo = {
    radius: np.array([find_albedo(grains) for grains in ice[radius]])
    for radius in radii_um
}

# %% [markdown]
# ## The size of the grains
#
# Spheres stand for the grains, at the same ratio of volume to surface. The broken lines
# are a closed form for snow that absorbs little (Kokhanovsky and Zege, Applied Optics 43,
# 1589, 2004):
#
# $$ A = \exp\left(-\frac{3}{7} (1 + 2 \mu_0)\, y\right), \qquad
#    y = 4 \sqrt{\frac{1 - \varpi}{3 (1 - \varpi g)}}, $$
#
# with albedo $\varpi$ and mean cosine $g$ of a grain.


# %%
def approximate_albedo(grains):
    w, g = np.array([[kind.albedo, kind.asymmetry] for kind in grains]).T
    return np.exp(
        -3.0 / 7.0 * (1.0 + 2.0 * mu0) * 4.0 * np.sqrt((1.0 - w) / (3.0 * (1.0 - w * g)))
    )


closed = {radius: approximate_albedo(grains) for radius, grains in ice.items()}
figure, axis = plt.subplots(figsize=(8.0, 4.0))
for radius in radii_um:
    (line,) = axis.plot(infrared_um, albedo[radius], "o-", ms=4, label=f"{radius:g} µm")
    axis.plot(infrared_um, closed[radius], "--", lw=1, color=line.get_color())
axis.plot([], [], "--", lw=1, color="0.3", label="closed form")
axis.set(xlabel="wavelength [µm]", ylabel="albedo, sun 60° from the zenith", ylim=(0, 1))
axis.legend(title="radius of the grains")
# %%
off = {
    radius: np.abs(closed[radius] - albedo[radius])[albedo[radius] > 0.5].max()
    for radius in radii_um
}
print(
    "closed form off by",
    ", ".join(f"{value:.3f} ({radius:g} µm)" for radius, value in off.items()),
    "where albedo > 0.5",
)
assert max(off.values()) < 0.03

here = np.argmin(np.abs(infrared_um - 1.03))
loss = np.array([-np.log(albedo[radius][here]) for radius in radii_um])
power = np.polyfit(np.log(radii_um), np.log(loss), 1)[0]
print(
    f"at {infrared_um[here]} µm the albedo is",
    ", ".join(f"{albedo[radius][here]:.2f}" for radius in radii_um),
)
print(f"-ln(albedo) grows with the radius to the power {power:.2f}")
assert abs(power - 0.5) < 0.08

# %% [markdown]
# The logarithm of the albedo falls with the square root of the grain's radius, as the
# closed form says: the absorption of a grain grows with its radius, and the albedo
# depends on the root of it. Turned around, one albedo near 1 µm tells the grain's size;
# that is how satellites see how old snow is.

# %% [markdown]
# ## Soot
#
# Now the visible, with soot between grains of 50 µm: spheres of carbon, 0.1 µm in radius,
# so many parts in a billion by mass (densities 1.8 and 0.917 g/cm³).

# %%
visible_um = np.array([0.40, 0.47, 0.55, 0.62, 0.70, 0.80, 0.90, 1.00])
parts_per_billion = [0, 10, 100, 1000]
clean = [vrte.spheres("ice", radius_um=50.0, wavelength_um=w) for w in visible_um]
soot = [vrte.spheres("carbon", radius_um=0.1, wavelength_um=w) for w in visible_um]


def make_dirty(grains, carbon, parts):
    number = parts * 1e-9 * (0.917 * grains.volume_um3) / (1.8 * carbon.volume_um3)
    return vrte.mixture([(grains, 1.0), (carbon, number)])


sooty = {
    parts: np.array(
        [
            find_albedo(make_dirty(*kinds, parts))
            for kinds in zip(clean, soot, strict=True)
        ]
    )
    for parts in parts_per_billion
}
figure, axis = plt.subplots(figsize=(8.0, 3.8))
for parts, values in sooty.items():
    axis.plot(visible_um, values, "o-", ms=4, label=f"{parts}" if parts else "none")
axis.set(
    xlabel="wavelength [µm]", ylabel="albedo, sun 60° from the zenith", ylim=(None, 1.0)
)
axis.legend(title="soot [parts per billion]")
# %%
green = np.argmin(np.abs(visible_um - 0.55))
fall = {parts: sooty[0][green] - sooty[parts][green] for parts in parts_per_billion[1:]}
for parts, value in fall.items():
    print(
        f"{parts:4} parts per billion: albedo at 0.55 µm lower by "
        f"{value:.3f}, at 1 µm by {sooty[0][-1] - sooty[parts][-1]:.3f}"
    )
assert 2.0 < fall[1000] / fall[100] < np.sqrt(10.0) + 1.0

# %% [markdown]
# A part in ten million takes two hundredths from the albedo in green light, and hardly
# anything at 1 µm, where ice absorbs more than the soot does. Ten times the soot takes
# some four times as much: on the way from the soot itself to its root. Soot and grain
# size change different parts of the spectrum, so that both can be read from it.
