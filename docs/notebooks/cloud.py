# %% [markdown]
# # Cloud: how large are the droplets?
#
# Seen from above, with the sun behind, a cloud has a white bow and a glory. Where they
# are depends on how large the droplets are, and polarized light shows them best, since it
# was scattered once for the most part. How well can a droplet's size be read off them?

# %%
import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

wavelength_um = 0.865  # where the ground is dark over the sea, and the air thin
radii_um = np.array(
    [4.0, 4.8, 5.8, 7.0, 8.4, 10.0]
)  # effective radii: the mean of r³ over that of r²


def make_droplets(r_eff_um):
    size = vrte.Gamma(r_eff_um=r_eff_um, v_eff=0.02)
    return vrte.spheres("water", size=size, wavelength_um=wavelength_um)


droplets = {radius: make_droplets(radius) for radius in radii_um}

# %% [markdown]
# ## The bow of one droplet, and Airy's
#
# Rays that are reflected once inside a droplet leave at 137 degrees or more: Descartes'
# bow. Airy's theory moves its brightest place further on by
#
# $$ \Delta\Theta = 1.0188 \left(\frac{\Theta''}{2}\right)^{1/3} x^{-2/3}, $$
#
# where $x$ is the droplet's circumference over the wavelength and $\Theta''$ the
# curvature of the angle over the impact parameter.

# %%
angle_deg = np.arange(130.0, 180.01, 0.1)
n = vrte.refractive_index("water", wavelength_um).n
impact = np.linspace(0.6, 0.99, 20001)
deflection = np.pi + 2.0 * np.arcsin(impact) - 4.0 * np.arcsin(impact / n)
least = np.argmin(deflection)
curvature = np.gradient(np.gradient(deflection, impact), impact)[least]
descartes_deg = np.degrees(deflection[least])

figure, axis = plt.subplots(figsize=(8.0, 3.8))
peaks_deg, airy_deg = [], []
for radius, kind in droplets.items():
    polarized = -kind.phase_matrix.scattering_matrix(angle_deg)[:, 0, 1]
    axis.plot(angle_deg, polarized, label=f"{radius:g} µm")
    in_bow = angle_deg < 155.0
    peaks_deg.append(angle_deg[in_bow][np.argmax(polarized[in_bow])])
    x = 2.0 * np.pi * radius / wavelength_um
    airy_deg.append(
        descartes_deg + np.degrees(1.0188 * (curvature / 2.0) ** (1 / 3) * x ** (-2 / 3))
    )
axis.axvline(descartes_deg, color="0.5", lw=1)
axis.annotate(
    "Descartes' bow",
    (descartes_deg, 0.2),
    xytext=(-4, 0),
    textcoords="offset points",
    ha="right",
    fontsize=10,
)
axis.set(
    xlabel="scattering angle [degrees]",
    ylabel="-F12, the polarized part of scattering",
    ylim=(-0.4, None),
)
axis.legend(title="effective radius", fontsize=9, ncols=2)
# %%
peaks_deg, airy_deg = np.array(peaks_deg), np.array(airy_deg)
for radius, peak, airy in zip(radii_um, peaks_deg, airy_deg, strict=True):
    print(f"{radius:4g} µm: brightest at {peak:.1f} degrees, Airy's theory {airy:.1f}")
print(f"Descartes' bow: {descartes_deg:.1f} degrees")
assert np.abs(peaks_deg - airy_deg).max() < 1.0

# %% [markdown]
# Airy's formula and Mie's series agree within a degree, the better the larger the
# droplet: the bow's place is a ruler.

# %% [markdown]
# ## Reading the size off a cloud
#
# A cloud of optical thickness 10 is solved in full, for droplets whose size is on
# nobody's list, 6.3 µm, and noise is added: that is the measurement. The model for it
# knows single scattering alone (Bréon and Goloub, Geophysical Research Letters 25, 1879,
# 1998). Whatever was scattered more often is left to two smooth terms:
#
# $$ -4 (\mu_i + \mu_o)\, Q \approx -A\, F_{12}(\Theta) + B \cos^2\Theta + C. $$

# %%
sun_deg, view_deg = 40.0, np.arange(0.0, 75.1, 0.5)
mu_i, mu_o = np.cos(np.radians(sun_deg)), np.cos(np.radians(view_deg))


def solve_cloud(kind, nodes=40):
    """Reflectance on the sun's side of its plane: f00 to f30 of the matrix."""
    scene = vrte.Scene([vrte.Layer.of(kind, thickness=10.0)], base=vrte.Lambertian(0.05))
    return vrte.brdf(scene, mu_i, mu_o, phi=180.0, nodes=nodes).mueller[0, :, 0, :, 0]


true_um = 6.3
seen = {
    radius: solve_cloud(kind)
    for radius, kind in [(4.0, droplets[4.0]), (true_um, make_droplets(true_um))]
}
scattering_deg = 180.0 - np.abs(sun_deg - view_deg)
bow = (scattering_deg > 140.0) & (scattering_deg < 168.0)
clean = -4.0 * (mu_i + mu_o) * seen[true_um][:, 1]
noise = np.random.default_rng(1).normal(
    scale=0.03 * np.abs(clean[bow]).max(), size=clean.size
)
measured = (clean + noise)[bow]

misfits, fits = [], []
for kind in droplets.values():
    F12 = kind.phase_matrix.scattering_matrix(scattering_deg[bow])[:, 0, 1]
    terms = np.stack(
        [-F12, np.cos(np.radians(scattering_deg[bow])) ** 2, np.ones(bow.sum())], axis=1
    )
    fits.append(terms @ np.linalg.lstsq(terms, measured)[0])
    misfits.append(np.sqrt(np.mean((fits[-1] - measured) ** 2)))
best = np.argmin(misfits)
around = slice(best - 1, best + 2)
parabola = np.polyfit(np.log(radii_um[around]), np.square(misfits)[around], 2)
found_um = np.exp(-parabola[1] / (2.0 * parabola[0]))

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), width_ratios=[3, 2])
order = np.argsort(view_deg[bow])
left.plot(view_deg[bow], measured, ".", color="0.45", label="measured")
for place, style in ((best, "-"), (0, "--")):
    gaps = np.where(np.diff(view_deg[bow], append=0.0) > 1.0, np.nan, fits[place])
    left.plot(view_deg[bow], gaps, style, label=f"{radii_um[place]:g} µm")
left.set(xlabel="angle of view, towards the sun [degrees]", ylabel="-4 (µi + µo) Q")
left.legend(fontsize=10)
right.plot(radii_um, misfits, "o-")
right.axvline(true_um, color="0.5", lw=1)
right.set(
    xlabel="effective radius of the model [µm]",
    ylabel="root mean square misfit",
    ylim=(0, None),
)
# %%
print(f"found {found_um:.2f} µm, true {true_um} µm")
assert abs(found_um / true_um - 1.0) < 0.05

# %% [markdown]
# Within a few per cent, by a model that knows single scattering alone, of a cloud in
# which most light was scattered many times: polarization picks the single scattering out.

# %% [markdown]
# ## The glory
#
# Around the point opposite the sun are rings, in intensity too. Their radius goes with
# the inverse of the droplet's size.

# %%
fine_deg = np.arange(170.0, 180.001, 0.02)
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4))
for radius, light in seen.items():
    left.plot(view_deg, light[:, 0], label=f"{radius:g} µm")
left.axvline(sun_deg, color="0.5", lw=1)
left.annotate(
    "opposite the sun",
    (sun_deg, left.get_ylim()[1]),
    xytext=(4, -12),
    textcoords="offset points",
    fontsize=10,
)
left.set(
    xlabel="angle of view, towards the sun [degrees]",
    ylabel="BRDF f00 of the cloud [1/sr]",
)
left.legend(loc="upper left", fontsize=10)
rings_deg = []
for kind in droplets.values():
    F11 = kind.phase_matrix.scattering_matrix(fine_deg)[:, 0, 0]
    rising = np.diff(F11)
    tops = np.flatnonzero((rising[:-1] > 0) & (rising[1:] <= 0)) + 1
    rings_deg.append(180.0 - fine_deg[tops[fine_deg[tops] < 179.0]].max())
rings_deg = np.array(rings_deg)
x = 2.0 * np.pi * radii_um / wavelength_um
right.plot(1.0 / x, rings_deg, "o")
scale = (rings_deg * x).mean()
right.plot([0, 1.0 / x[0]], [0, scale / x[0]], "--", lw=1, color="0.4")
right.set(
    xlabel="wavelength over circumference",
    ylabel="radius of the first ring [degrees]",
    xlim=(0, None),
    ylim=(0, None),
)
# %%
print("radius of the ring times x [degrees]:", (rings_deg * x).round(0))
assert np.ptp(rings_deg * x) < 0.1 * scale

# %% [markdown]
# The radius of the first ring times $x$ stays at 164 to 173 degrees while the droplets
# grow from 4 to 10 µm: twice as large a droplet, half as wide a ring. Of the bow, which
# follows the power -2/3, it is the finer ruler, but its contrast is a tenth of all light.
