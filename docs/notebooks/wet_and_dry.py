# %% [markdown]
# # Wet and dry: why is wet sand darker?
#
# Water absorbs next to nothing of visible light, and yet a wet beach is about half as
# bright as a dry one. Two reasons are on offer. Light that comes back up is reflected
# inside the water's surface and has to try again (Ångström, 1925). And grains in water
# differ less from what surrounds them, so that they scatter more forward, and light gets
# deeper before it turns (Twomey, Bohren and Mergenthaler, 1986). Which one is it?

# %%
import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

wavelength_um, quartz, water = 0.55, 1.55, 1.333
absorption = np.array(
    [1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2]
)  # k of the grains, from clean to dark
sizes = vrte.Lognormal(
    median_um=0.8, sigma=1.3
)  # of clay; sand's are larger, and need smaller k for the same
mu, weights = vrte.hemisphere(10)


def make_grains(k, host):
    return vrte.Layer.of(
        vrte.spheres(
            complex(quartz, k), size=sizes, wavelength_um=wavelength_um, host_index=host
        ),
        thickness=np.inf,
    )


dry = [make_grains(k, 1.0) for k in absorption]
wet = [make_grains(k, water) for k in absorption]
for name, layer in (("in air", dry[2]), ("in water", wet[2])):
    print(
        f"{name}: mean cosine {layer.phase_matrix.asymmetry:.3f}, "
        f"albedo of a grain {layer.albedo:.5f}"
    )

# %% [markdown]
# ## Three beds of the same grains
#
# In air; in water, as seen from inside the water; and in water under its surface, seen
# from the air. Each is lit evenly from all sides, and the fraction of light reflected is
# the bed's reflectance.


# %%
def find_reflectance(*stack):
    return vrte.brdf(
        vrte.Scene(stack), mu, mu_o=1.0, nodes=16
    ).bihemispherical_reflectance(weights)


in_air = np.array([find_reflectance(layer) for layer in dry])
in_water = np.array([find_reflectance(layer) for layer in wet])
under_surface = np.array(
    [find_reflectance(vrte.Interface(1.0, water), layer) for layer in wet]
)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8))
for values, style, label in (
    (in_air, "o-", "dry"),
    (in_water, "s--", "in water, no surface"),
    (under_surface, "D-", "wet: in water, with its surface"),
):
    left.semilogx(absorption, values, style, ms=5, label=label)
left.set(xlabel="k of the grains", ylabel="reflectance, even light", ylim=(0, 1))
left.legend(fontsize=10, loc="lower left")
right.plot(in_air, in_water, "s--", ms=5, color="C1")
right.plot(in_air, under_surface, "D-", ms=5, color="C2")
right.plot([0, 1], [0, 1], color="0.5", lw=1)
right.annotate("as bright as dry", (0.55, 0.58), rotation=38, color="0.35", fontsize=10)
right.set(xlabel="reflectance dry", ylabel="reflectance wet", xlim=(0, 1), ylim=(0, 1))
# %%
at = 0.4  # sand
alone, both = (
    np.interp(at, in_air[::-1], values[::-1]) for values in (in_water, under_surface)
)
print(
    f"of the loss {(at - alone) / (at - both):.0%} is the grains' "
    f"in water, {(alone - both) / (at - both):.0%} the surface's"
)
print(
    f"a bed that reflects {at:.0%} dry reflects {alone:.0%} "
    f"in water and {both:.0%} under the water's surface"
)
assert 0.4 < both / at < 0.55
assert alone - both > 0.25 * (at - both)
assert at - alone > 0.25 * (at - both)
assert in_air[0] - under_surface[0] < 0.04

# %% [markdown]
# Both, and neither alone: more than half of the loss is the grains', which scatter
# forward in water (their mean cosine goes from 0.693 to 0.935), the rest the surface's.
# Together they make sand that reflects 40 % reflect less than half of that. Clean grains
# hardly darken: light that goes a longer way without being absorbed comes back all the
# same.

# %% [markdown]
# ## The surface's share in closed form
#
# Of even light from outside a surface of index $n$ mirrors $k_1$, of even light from
# inside $k_2 = 1 - (1 - k_1)/n^2$. If the light from the bed is even, what comes out in
# the end is a geometric series (Saunderson, 1942):
#
# $$ R_\mathrm{wet} = k_1 + \frac{(1 - k_1)(1 - k_2) R}{1 - k_2 R}. $$

# %%
cosine = (np.arange(2000) + 0.5) / 2000
inside = np.sqrt(1.0 - (1.0 - cosine**2) / water**2)
fresnel = [
    ((cosine - water * inside) / (cosine + water * inside)) ** 2,
    ((water * cosine - inside) / (water * cosine + inside)) ** 2,
]
k1 = (2.0 * cosine * np.mean(fresnel, axis=0)).mean()
k2 = 1.0 - (1.0 - k1) / water**2
series = k1 + (1.0 - k1) * (1.0 - k2) * in_water / (1.0 - k2 * in_water)
print(f"k1 = {k1:.4f}, k2 = {k2:.4f}")
print("exact  ", under_surface.round(3))
print("series ", series.round(3))

away = np.abs(series - under_surface)
assert away[in_water > 0.9].max() < 0.01
assert away.max() < 0.06

# %% [markdown]
# Where the bed is bright the series is right to a few thousandths. Where it is dark it
# makes the wet bed too bright, by 0.02 to 0.04: refracted light goes down within 49
# degrees of the normal, gets deeper than even light does, and is absorbed there.
