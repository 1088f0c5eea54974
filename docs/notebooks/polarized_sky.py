# %% [markdown]
# # Polarized sky: where does a clear sky send unpolarized light?
#
# Sky light is polarized across the direction to the sun, most of all at a right angle
# from it. But at a few points it is not polarized at all: Arago saw one in 1809, Babinet
# and Brewster found two more by 1842. Single scattering has them at the sun and opposite
# to it. What moves them away?

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.special import expn

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

air = vrte.rayleigh(depolarization=0.0279)
theta_deg = np.linspace(0.0, 89.5, 180)  # from the zenith
azimuth_deg = np.arange(0.0, 361.0, 3.0)  # from the sun


def solve_sky(sun_deg, thickness, azimuths, angles=theta_deg, ground=0.1):
    """Stokes vectors (angle, azimuth, 4) that fall on the ground."""
    scene = vrte.Scene(
        [vrte.Layer(air, albedo=1.0, thickness=thickness)], base=vrte.Lambertian(ground)
    )
    mu0 = np.cos(np.radians(sun_deg))
    # light from the sun's side travels away from the sun: phi = 0
    field = vrte.radiance(
        scene,
        mu0,
        mu=-np.cos(np.radians(angles)),
        phi=azimuths,
        tau=thickness,
        accuracy=1e-6,
    )
    return field.stokes[0]


sun_deg, thickness = 65.0, 0.24  # of the clear air above sea level at 0.44 µm
sky = solve_sky(sun_deg, thickness, azimuth_deg)
degree = np.hypot(sky[..., 1], sky[..., 2]) / sky[..., 0]
print(f"polarized to {degree.max():.0%} at most")

# %% [markdown]
# ## The dome
#
# As a camera with a fisheye lens sees it, the zenith in the middle, the horizon around
# it, angles from the zenith as distances.


# %%
def find_neutral_points(sun_deg, thickness, ground=0.1):
    """Their angles from the zenith in the sun's plane, above 0 on the sun's side."""
    fine = np.linspace(0.0, 89.8, 450)
    light = solve_sky(sun_deg, thickness, [0.0, 180.0], fine, ground)
    plane = np.concatenate([light[:0:-1, 1], light[:, 0]])
    angle = np.concatenate([-fine[:0:-1], fine])
    ratio = plane[:, 1] / plane[:, 0]  # Q/I: U is 0 in this plane
    turns = np.flatnonzero(np.diff(np.sign(ratio)))
    return angle[turns] - ratio[turns] * np.diff(angle)[turns] / np.diff(ratio)[turns]


points = find_neutral_points(sun_deg, thickness)
figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.6), subplot_kw={"projection": "polar"})
angle = np.degrees(0.5 * np.arctan2(sky[..., 2], sky[..., 1])) % 180.0
pictures = [
    (100.0 * degree, "viridis", "degree of linear polarization [%]"),
    (angle, "twilight", "angle from the meridian [degrees]"),
]
for axis, (values, colours, label) in zip(axes, pictures, strict=True):
    shown = axis.pcolormesh(
        np.radians(azimuth_deg),
        theta_deg,
        values,
        cmap=colours,
        shading="gouraud",
        rasterized=True,
    )
    axis.plot(0.0, sun_deg, "o", ms=10, color="gold", mec="black")
    for point in points:
        axis.plot(
            0.0 if point > 0 else np.pi,
            abs(point),
            "o",
            ms=7,
            mfc="none",
            mec="red",
            mew=2,
        )
    axis.set(theta_zero_location="N", rticks=[30, 60, 90], xticks=[], rlabel_position=150)
    axis.grid(alpha=0.3)
    figure.colorbar(shown, ax=axis, orientation="horizontal", shrink=0.8, label=label)

# %%
babinet, brewster = points
print(
    f"Babinet's point {sun_deg - babinet:.1f} degrees above "
    f"the sun, Brewster's {brewster - sun_deg:.1f} below it"
)
assert babinet < sun_deg < brewster

# %% [markdown]
# ## It is light scattered twice
#
# Near the sun light that was scattered once is polarized as the square of the distance
# $\delta$ from it. Light that was scattered again comes from all around, most of it from
# the bright horizon, and is polarized upright. Both cancel where $\delta^2$ is
# proportional to how bright the sky itself is as a lamp. In a layer of thickness $\tau$
# that is, on the mean over the depth,
#
# $$ s(\tau) = 2 - \frac{1 - 2 E_3(\tau)}{\tau}
#    \approx \tau \left(0.92 + \ln \frac{1}{\tau}\right), $$
#
# with the exponential integral $E_3$; the logarithm is the horizon's. So $\delta \propto
# \sqrt{s}$.

# %%
thicknesses = np.array([0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4])
high_deg = 45.0  # so high that Brewster's point is above the horizon for all of them
found = np.array(
    [
        find_neutral_points(high_deg, thickness, ground=0.0)[-2:]
        for thickness in thicknesses
    ]
)
distance = np.abs(found - high_deg)
sky_light = 2.0 - (1.0 - 2.0 * expn(3, thicknesses)) / thicknesses
thin = thicknesses < 0.03
powers = np.polyfit(np.log(sky_light[thin]), np.log(distance[thin]), 1)[0]

figure, axis = plt.subplots(figsize=(6.5, 3.6))
for values, name, marker in zip(
    distance.T, ("Babinet, above the sun", "Brewster, below"), "os", strict=True
):
    axis.loglog(thicknesses, values, marker, label=name)
axis.loglog(
    thicknesses,
    distance[0].mean() * np.sqrt(sky_light / sky_light[0]),
    "--",
    color="0.4",
    lw=1,
    label="root of s",
)
axis.set_yticks([3, 5, 10, 20], ["3", "5", "10", "20"])
axis.minorticks_off()
axis.set(xlabel="optical thickness of the air", ylabel="distance from the sun [degrees]")
axis.legend()
# %%
print("powers of s up to a thickness of 0.02:", powers.round(3))
assert np.abs(powers - 0.5).max() < 0.05

# %% [markdown]
# ## Four points and nothing else
#
# Berry, Dennis and Lee (New Journal of Physics 6, 162, 2004) guessed that the angles of
# the whole sky follow from four points without polarization: in the stereographic plane,
# $\zeta = \tan(\theta/2)\, e^{i\varphi}$,
#
# $$ Q + iU \propto -\left(\zeta - \zeta_1\right) \left(\zeta - \zeta_2\right)
#    \left(\zeta + 1/\zeta_1^*\right) \left(\zeta + 1/\zeta_2^*\right). $$
#
# Two are Babinet's and Brewster's point, the others lie opposite to them: Arago's is one.
# With the places that were found above nothing is left to fit.

# %%
zeta = np.tan(np.radians(theta_deg) / 2.0)[:, None] * np.exp(1j * np.radians(azimuth_deg))
one, two = np.tan(np.radians(points) / 2.0)
guess = -(zeta - one) * (zeta - two) * (zeta + 1.0 / one) * (zeta + 1.0 / two)
turned = (sky[..., 1] + 1j * sky[..., 2]) * np.exp(
    2j * np.radians(azimuth_deg)
)  # axes that do not turn with azimuth
apart_deg = 0.5 * np.degrees(np.angle(turned * np.conj(guess)))
solid = np.sin(np.radians(theta_deg))[:, None] * np.ones(azimuth_deg.size)
off_deg = np.sqrt(np.average(apart_deg**2, weights=solid))
print(
    f"angles of polarization: {off_deg:.2f} degrees apart on the "
    f"mean over the dome, {np.abs(apart_deg).max():.0f} at most"
)
assert off_deg < 0.4

low_deg = 85.0
arago, low_babinet = find_neutral_points(low_deg, thickness)
above = 180.0 - low_deg + arago
print(
    f"sun 5 degrees high: Arago's point {above:.1f} degrees above "
    f"the point opposite, Babinet's {low_deg - low_babinet:.1f}"
)
assert 15.0 < above < 28.0

# %% [markdown]
# Four points tell all angles of the sky to a fifth of a degree on the mean; only right
# beside the points, where there is nothing to be seen, are they further off. With a low
# sun Arago's point comes up where observers have it, some 20 degrees above the point
# opposite the sun.
