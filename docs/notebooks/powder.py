# %% [markdown]
# # Powder: what does a heap of spheres remember of one sphere?
#
# One sphere of gold sends light into a pattern of its own. In a powder light meets many
# of them before it leaves. Which traits of the single sphere are still there in the light
# that a thick powder sends back: the lobe, its fine structure, the polarization?

# %%
import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

radii_um = [0.05, 0.15, 0.6]
gold = {
    radius: vrte.spheres("gold", radius_um=radius, wavelength_um=0.64)
    for radius in radii_um
}
for radius, sphere in gold.items():
    print(
        f"radius {radius:4} µm: albedo {sphere.albedo:.3f}, "
        f"mean cosine {sphere.asymmetry:.3f}"
    )

# %% [markdown]
# ## The lobe, and the part of it that was scattered once
#
# Unpolarized light of 640 nm falls in at 53 degrees from the normal. What a layer without
# end scatters exactly once leaves with the BRDF
#
# $$ f_1 = \frac{\varpi\, F_{11}(\Theta)}{4 \pi (\mu_i + \mu_o)}, $$
#
# where $\varpi$ is the albedo of a sphere, $F_{11}$ its phase function and $\Theta$ the
# angle between the two directions. Whatever is more has met at least two spheres.

# %%
mu_i, degrees = 0.6, np.arange(0.0, 86.0, 1.0)
incident_deg = np.degrees(np.arccos(mu_i))


def solve_powder(sphere, thickness=np.inf):
    """Mueller matrices in the plane of incidence, along seen_deg; the reflectance."""
    scene = vrte.Scene([vrte.Layer.of(sphere, thickness=thickness)])
    f = vrte.brdf(
        scene, mu_i, np.cos(np.radians(degrees)), phi=[0.0, 180.0], accuracy=1e-4
    )
    return np.concatenate([f.mueller[0, :0:-1, 1], f.mueller[0, :, 0]]), f.reflectance[0]


seen_deg = np.concatenate([-degrees[:0:-1], degrees])
scattering_deg = 180.0 - np.abs(seen_deg + incident_deg)
slant = mu_i + np.cos(np.radians(seen_deg))

figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.3), subplot_kw={"projection": "polar"})
lobes, reflectances, once = {}, {}, {}
for axis, (radius, sphere) in zip(axes, gold.items(), strict=True):
    lobes[radius], reflectances[radius] = solve_powder(sphere)
    F = sphere.phase_matrix.scattering_matrix(scattering_deg)
    once[radius] = sphere.albedo * F / (4.0 * np.pi * slant[:, None, None])
    every = lobes[radius][:, 0, 0]
    axis.plot(np.radians(seen_deg), every, lw=2, label="all light")
    axis.plot(
        np.radians(seen_deg), once[radius][:, 0, 0], "--", lw=2, label="scattered once"
    )
    axis.annotate(
        "",
        (0, 0),
        (-np.radians(incident_deg), every.max()),
        arrowprops={"arrowstyle": "-|>", "color": "0.4"},
    )
    axis.set(
        theta_zero_location="N",
        theta_direction=-1,
        thetamin=-90,
        thetamax=90,
        title=f"radius {radius} µm",
    )
    axis.set_yticks(np.round([every.max() / 2, every.max()], 2))
    axis.tick_params(labelsize=9)
figure.suptitle("BRDF f00 in the plane of incidence [1/sr]; the arrow is the light")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
# %%
toward_normal = seen_deg.size // 2
share = {
    radius: once[radius][toward_normal, 0, 0] / lobes[radius][toward_normal, 0, 0]
    for radius in radii_um
}
for radius in radii_um:
    print(
        f"radius {radius:4} µm: reflects {reflectances[radius]:.0%}; "
        f"straight up {share[radius]:.0%} was scattered once"
    )
assert share[0.05] > 0.45
assert share[0.6] < share[0.15] < 0.25

# %% [markdown]
# The smallest spheres absorb a quarter of what they meet: half of the light that leaves
# straight up was scattered once, and the lobe is much like theirs. The larger ones absorb
# a twentieth, and send most light on into the powder: five parts in six of what leaves
# straight up have met two of them or more.

# %% [markdown]
# ## Depth: how many spheres does it take?
#
# The same lobe for more and more of the coarse powder, at equal optical thickness from
# thin to thick. In the limit of a thin layer it is single scattering, in closed form.

# %%
coarse = gold[0.6]
thicknesses = [1e-3, 0.1, 0.5, 2.0, 8.0, np.inf]
figure, axis = plt.subplots(figsize=(7.5, 3.8))
lobes_by_thickness = []
colours = plt.colormaps["viridis"](np.linspace(0.0, 0.9, len(thicknesses)))
for colour, thickness in zip(colours, thicknesses, strict=True):
    lobe = solve_powder(coarse, thickness)[0][:, 0, 0]
    lobes_by_thickness.append(lobe)
    axis.semilogy(
        seen_deg,
        lobe,
        color=colour,
        label="semi-infinite" if np.isinf(thickness) else f"{thickness:g}",
    )
    if thickness == thicknesses[0]:
        path = (
            thickness * slant / (mu_i * (slant - mu_i))
        )  # along the way in and out, in mean free paths
        closed = once[0.6][:, 0, 0] * -np.expm1(-path)
        excess = np.abs(lobe / closed - 1.0)[np.abs(seen_deg) < 75.0].max()
axis.set(
    xlabel="angle from the normal, towards the light below 0 [degrees]",
    ylabel="BRDF f00 [1/sr]",
)
axis.legend(title="optical thickness", loc="center left", bbox_to_anchor=(1.0, 0.5))
# %%
print(f"at thickness 0.001 the lobe is single scattering's to {excess:.1%}")
ripples = [np.ptp(np.log(lobe[np.abs(seen_deg) < 50.0])) for lobe in lobes_by_thickness]
for thickness, ripple in zip(thicknesses, ripples, strict=True):
    print(f"thickness {thickness:g}: brightest over darkest {np.exp(ripple):.1f}")
change = np.abs(lobes_by_thickness[-2] / lobes_by_thickness[-1] - 1.0).max()
print(f"at thickness 8 it is the thickest layer's to {change:.1%}")
assert excess < 0.01
assert ripples[0] > 2.0 * ripples[3] > 2.0 * ripples[5]
assert change < 0.05

# %% [markdown]
# The ripples of a sphere's own pattern are all there in the thin layer; a layer of
# thickness 2 has already filled most of them in, and beyond 8 little changes.

# %% [markdown]
# ## Polarization: the darker, the more
#
# Light that was scattered once is polarized as its sphere does it; light that was
# scattered often hardly is. Absorption takes away the second kind first. Umov saw in 1905
# that dark powders polarize more. Here are spheres of the same sizes and one real index,
# 1.6, whose absorption grows from none.

# %%
k = np.array([0.0, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.2])
size = vrte.Lognormal(median_um=0.15, sigma=1.3)
bright, polarized = [], []
for absorption in k:
    sphere = vrte.spheres(complex(1.6, absorption), size=size, wavelength_um=0.64)
    lobe, reflected = solve_powder(sphere)
    bright.append(reflected)
    polarized.append(np.abs(lobe[:, 1, 0] / lobe[:, 0, 0]).max())
bright, polarized = np.array(bright), np.array(polarized)

figure, axis = plt.subplots(figsize=(6.5, 3.8))
axis.loglog(bright, polarized, "o-")
for x, y, absorption in zip(bright, polarized, k, strict=True):
    axis.annotate(
        f"k = {absorption:g}",
        (x, y),
        xytext=(7, 3),
        textcoords="offset points",
        fontsize=9,
    )
axis.set(
    xlabel="reflectance", ylabel="largest degree of linear polarization", xlim=(None, 2.0)
)
# %%
slope = np.polyfit(np.log(bright), np.log(polarized), 1)[0]
print(
    f"polarization {polarized[0]:.1%} of the white powder, "
    f"{polarized[-1]:.0%} of the darkest; slope {slope:.2f}"
)
assert np.all(np.diff(polarized) > 0)

# %% [markdown]
# The law that is named after Umov says that the product of both is the same for all, a
# slope of -1. It holds as a tendency: polarization rises at every step, more slowly than
# the reflectance falls.
