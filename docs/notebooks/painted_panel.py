# %% [markdown]
# # Painted panel: what does the surface do to the colour?
#
# Pigment in a binder is one thing, the binder's smooth surface to the air another. A red
# iron oxide paint, seen with and without its surface: how much of its colour is the
# pigment's, how much the surface's, how thick must it be to hide what it lies on, and how
# glossy is it?

# %%
import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

wavelengths_um = np.linspace(0.42, 0.70, 8)


def make_panel(surface="smooth", thickness_um=20.0, card=0.0, geometries=("45:0",)):
    """Hematite in acrylic, 4 % by volume, over an even card."""
    paint = {
        "pigment": "hematite",
        "volume_fraction": 0.04,
        "binder": "acrylic",
        "thickness_um": thickness_um,
        "surface": surface,
        "substrate": {"kind": "lambertian", "albedo": card},
    }
    return vrte.appearance({"paint": paint}, wavelengths_um, geometries, nodes=8)


# %% [markdown]
# ## With and without the surface
#
# 45:0 leaves out what the surface mirrors, as an eye does that turns the panel away from
# the window; 8:di collects all light that comes back, the mirrored included.

# %%
bare, smooth = (
    make_panel("none", geometries=["45:0", "8:di"]),
    make_panel("smooth", geometries=["45:0", "8:di"]),
)
seen = {
    "pigment in binder, no surface": (bare, "45:0"),
    "with its surface, 45:0": (smooth, "45:0"),
    "with its surface, 8:di": (smooth, "8:di"),
}
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.5), width_ratios=[3, 2])
for place, (label, (panel, geometry)) in enumerate(seen.items()):
    left.plot(
        wavelengths_um, panel.reflectance(geometry), "os^"[place] + "-", label=label
    )
    colour = panel.colour(geometry)
    right.add_patch(plt.Rectangle((0, 2 - place), 1, 0.95, color=colour.hex))
    words = f"{label}\nL* {colour.L:.0f}  a* {colour.a:.0f}  b* {colour.b:.0f}"
    right.text(0.04, 2.47 - place, words, color="white", va="center", fontsize=10)
left.set(xlabel="wavelength [µm]", ylabel="reflectance factor", ylim=(0, None))
left.legend(fontsize=10)
right.set(xlim=(0, 1), ylim=(0, 3))
right.axis("off")
# %%
inside, outside, all_light = (panel.colour(geometry) for panel, geometry in seen.values())
print(
    f"the surface takes {inside.L - outside.L:.0f} from L*; the "
    f"mirrored light gives {all_light.L - outside.L:.0f} to it"
)
print(
    f"chroma: {inside.C:.0f} without surface, {outside.C:.0f} "
    f"with it, {all_light.C:.0f} with the mirrored light"
)
assert outside.L < inside.L - 8.0
assert all_light.L - outside.L > 8.0
assert all_light.C < outside.C

# %% [markdown]
# The surface keeps half of the light that comes up from the pigment, and every return
# costs the pigment's absorption once more: the same pigment looks darker. Mirrored light
# is white and makes the paint greyer.

# %% [markdown]
# ## Hiding: over black and over white
#
# A drawdown card has a black and a white half. A paint hides where its luminance over
# black is 98 % of that over white.

# %%
thicknesses_um = [1.5, 3.0, 6.0]
cards = {
    albedo: [make_panel(thickness_um=t, card=albedo) for t in thicknesses_um]
    for albedo in (0.0, 0.8)
}
hiding = smooth.hiding()

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.3))
for row, panels in enumerate(cards.values()):
    for column, panel in enumerate(panels):
        left.add_patch(
            plt.Rectangle((column, 1 - row), 1.0, 1.0, color=panel.colour().hex)
        )
left.set(
    xlim=(0, 3),
    ylim=(0, 2),
    xticks=np.arange(3) + 0.5,
    xticklabels=[f"{t:g} µm" for t in thicknesses_um],
)
left.set(
    yticks=[0.5, 1.5],
    yticklabels=["over white", "over black"],
    xlabel="thickness of the dry film",
)
left.tick_params(length=0)
times = np.geomspace(hiding.times[0], hiding.times[-1], 100)
right.semilogx(
    times * hiding.length_um, hiding.interpolate(times)[0], label="hiding curve"
)
ratios = [
    black.colour().Y / white.colour().Y
    for black, white in zip(cards[0.0], cards[0.8], strict=True)
]
right.plot(thicknesses_um, ratios, "o", label="the three films")
right.axhline(0.98, color="0.5", lw=1)
right.set_xticks([2, 5, 10, 20], [2, 5, 10, 20])
right.minorticks_off()
right.set(
    xlabel="thickness of the dry film [µm]", ylabel="contrast ratio", ylim=(0, 1.05)
)
right.legend(fontsize=10)
# %%
print(
    f"hidden from {hiding.hiding_length_um:.1f} µm on: "
    f"{hiding.spreading_rate:.0f} m² of dry film a litre"
)
apart = np.abs(
    hiding.interpolate(np.array(thicknesses_um) / hiding.length_um)[0] - ratios
).max()
print(f"the three films lie within {apart:.4f} of the curve")
assert apart < 3e-3
assert thicknesses_um[-1] < hiding.hiding_length_um < 9.0

# %% [markdown]
# ## Gloss
#
# A glossmeter looks where the surface mirrors, at 20, 60 or 85 degrees; a polished black
# glass of index 1.567 has 100 at each. What Fresnel's formula says of both indices is the
# line; the meter also catches what the pigment sends there.


# %%
def find_mirrored(n, degrees):
    mu = np.cos(np.radians(degrees))
    inside = np.sqrt(1.0 - (1.0 - mu**2) / n**2)
    across, along = (
        (mu - n * inside) / (mu + n * inside),
        (n * mu - inside) / (n * mu + inside),
    )
    return (across**2 + along**2) / 2.0


angles_deg = np.array([20.0, 60.0, 85.0])
glosses = np.array([smooth.gloss(angle) for angle in angles_deg])
index, fine_deg = vrte.refractive_index("acrylic", 0.555).n, np.linspace(0.0, 89.0, 200)
fresnel = 100.0 * find_mirrored(index, angles_deg) / find_mirrored(1.567, angles_deg)

figure, axis = plt.subplots(figsize=(6.5, 3.3))
axis.plot(
    fine_deg,
    100.0 * find_mirrored(index, fine_deg) / find_mirrored(1.567, fine_deg),
    label="Fresnel's formula",
)
axis.plot(angles_deg, glosses, "o", ms=8, label="the panel")
axis.set(xlabel="angle [degrees]", ylabel="gloss [gloss units]")
axis.legend()
# %%
for angle, gloss, mirrored in zip(angles_deg, glosses, fresnel, strict=True):
    print(
        f"{angle:2.0f} degrees: {gloss:.1f} gloss "
        f"units, {mirrored:.1f} by Fresnel's formula"
    )
assert np.abs(glosses - fresnel).max() < 1.0

# %% [markdown]
# The gloss of a smooth paint is its binder's index and nothing else, to half a unit.
# Roughness takes it away: [Seen by instruments](../how_to/appearance.md#gloss) has the
# numbers.
