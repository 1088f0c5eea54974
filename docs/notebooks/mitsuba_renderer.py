# %% [markdown]
# # Mitsuba: does a renderer see what was solved?
#
# Mitsuba 3 is a renderer that carries Stokes vectors along its rays. `vrte.mitsuba` gives
# it the material `vrte`, which reads results of `vrte export`: a table over angles, in
# other axes, with another azimuth, and interpolated linearly. Much can go wrong on the
# way. Here a sphere is rendered by Mitsuba from such a file, and each pixel is held
# against the light that is solved for its own directions, without any table.

# %%
import tempfile
from pathlib import Path

import vrte.mitsuba  # first of all: it names the LLVM that Mitsuba compiles with

# isort: split
import matplotlib.pyplot as plt
import mitsuba as mi
import numpy as np

import vrte

mi.set_variant("llvm_ad_spectral_polarized")
plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

# the same at all wavelengths, so that Mitsuba's three colours are one
haze = {
    "layer": [{"phase": "rayleigh", "albedo": 0.95, "thickness": 1.0}],
    "base": {"kind": "lambertian", "albedo": 0.1},
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},  # a scene file has some; the table has its own
}
folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "haze.nc"
for name, wavelengths in (
    ("haze.nc", [0.55]),
    ("haze.pbsdf", [0.45, 0.5, 0.55, 0.6, 0.65]),
):
    errors = vrte.export(haze, file.with_name(name), wavelengths, nodes=6)
    print(
        f"{name}, {len(wavelengths)} wavelengths: "
        f"{file.with_name(name).stat().st_size / 1e6:.0f} MB, off by "
        f"{errors.median:.1e} (median), {errors.most:.1e} (95 % of the directions)"
    )

# %% [markdown]
# The second file is for Mitsuba's own material `measured_polarized`. Close to the horizon
# it is less exact. It takes five wavelengths, holds no mirrored beam, and its rays are
# sent by the cosine alone. On a ball of satin paint under an even sky its variance times
# processor time is 17 times that of `vrte`, which sends rays where the light goes
# ([Results as files](../how_to/exports.md#everything-for-mitsuba-nc-and-vrtemitsuba)).

# %% [markdown]
# ## The sphere, by Mitsuba
#
# The sun stands at the upper left, behind the camera. A white Lambertian sphere in the
# same light, for which nothing is taken from a table, is the measure: the ratio of both
# pictures times $1/\pi$ is the BRDF.

# %%
size, to_sun = 96, np.array([-1.0, -1.2, 1.0]) / np.linalg.norm([-1.0, -1.2, 1.0])


def render(material):
    """A sphere seen along +y by a camera far away: Stokes vectors (size, size, 4)."""
    view = mi.ScalarTransform4f().look_at(
        origin=[0, -5, 0], target=[0, 0, 0], up=[0, 0, 1]
    )
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "stokes", "nested": {"type": "direct"}},
            "sensor": {
                "type": "orthographic",
                "to_world": view,
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "stratified", "sample_count": 16, "seed": 1},
            },
            "sphere": {"type": "sphere", "bsdf": material},
            "sun": {
                "type": "directional",
                "direction": (-to_sun).tolist(),
                "irradiance": {"type": "d65"},
            },
        }
    )
    return np.array(mi.render(scene))[:, :, 4::3]


white = render({"type": "diffuse", "reflectance": {"type": "spectrum", "value": 1.0}})
seen = render({"type": "vrte", "filename": str(file)})

# %% [markdown]
# ## The same light, pixel by pixel
#
# For each pixel the normal is known, and with it the three angles; `vrte.views` solves
# them all. What does not depend on the axes of a Stokes vector is compared: the radiance
# and the degree of linear polarization.

# %%
across, up = np.meshgrid(
    (np.arange(size) + 0.5) * 2.0 / size - 1.0, 1.0 - (np.arange(size) + 0.5) * 2.0 / size
)
normal = np.stack(
    [across, -np.sqrt(np.clip(1.0 - across**2 - up**2, 0.0, 1.0)), up], axis=-1
)
to_eye = np.array([0.0, -1.0, 0.0])
mu_i, mu_o = normal @ to_sun, normal @ to_eye
compared = (mu_i > 0.15) & (mu_o > 0.3)  # nearer to the horizon a pixel is wide in angle
n = normal[compared]
travels_in, travels_out = ((way - (n @ way)[:, None] * n) for way in (-to_sun, to_eye))
turn = np.einsum("pi,pi->p", n, np.cross(travels_in, travels_out))
phi_deg = np.degrees(np.arctan2(turn, np.einsum("pi,pi->p", travels_in, travels_out)))

layer = vrte.Layer(vrte.rayleigh(), albedo=0.95, thickness=1.0)
scene = vrte.Scene([layer], base=vrte.Lambertian(0.1))
solved = vrte.views(scene, mu_i[compared], mu_o[compared], phi_deg, nodes=8).stokes
print(f"{compared.sum()} pixels")


def put_in_picture(values):
    picture = np.full((size, size), np.nan)
    picture[compared] = values
    return picture


def find_degree(stokes):
    return np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0]


pixels = seen[compared]
ours = (
    np.pi * solved[:, 0] / mu_i[compared]
)  # the reflectance factor: 1 for a white sphere
theirs = pixels[:, 0] / white[compared][:, 0]
rows = {
    "reflectance factor": (theirs, ours, "cividis"),
    "degree of linear\npolarization [%]": (
        100.0 * find_degree(pixels),
        100.0 * find_degree(solved),
        "viridis",
    ),
}
figure, axes = plt.subplots(2, 3, figsize=(9.0, 5.6))
for line, (label, (first, second, colours)) in zip(axes, rows.items(), strict=True):
    largest = second.max()
    for axis, values in zip(line, (first, second), strict=False):
        shown = axis.imshow(put_in_picture(values), cmap=colours, vmin=0.0, vmax=largest)
    figure.colorbar(shown, ax=line[:2], label=label, shrink=0.9)
    off = np.abs(first - second).max()
    shown = line[2].imshow(
        put_in_picture(first - second), cmap="RdBu_r", vmin=-off, vmax=off
    )
    figure.colorbar(shown, ax=line[2], shrink=0.9)
for axis, title in zip(
    axes[0],
    ("Mitsuba, from the file", "solved for each pixel", "difference"),
    strict=True,
):
    axis.set_title(title, fontsize=11)
for axis in axes.flat:
    axis.axis("off")

# %%
off = np.abs(theirs / ours - 1.0)
apart = np.abs(find_degree(pixels) - find_degree(solved))
print(
    f"radiance off by {np.median(off):.1e} (median), "
    f"{np.quantile(off, 0.95):.1e} (95 % of the pixels)"
)
print(
    f"degree of polarization, up to {find_degree(solved).max():.0%}, "
    f"off by {np.median(apart):.1e} and {np.quantile(apart, 0.95):.1e}"
)
assert np.quantile(off, 0.95) < 5e-3
assert np.quantile(apart, 0.95) < 2e-3
folder.cleanup()

# %% [markdown]
# Mitsuba's picture is ours to a part in a thousand, its polarization to a few parts in
# ten thousand. The rings and rays in the differences are the steps of the table: 5
# degrees here, and the error falls with the square of the step ([Results as
# files](../how_to/exports.md#mueller-matrices-for-mitsuba-pbsdf)).
