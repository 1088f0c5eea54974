# %% [markdown]
# # Methods: which one is worth using?
#
# There are ten ways here to solve the same equation: exact ones, and approximations that
# their inventors made because the exact ones took too long. Do they still pay? Every
# method is run on one scene, over its own knob, and what counts is the error that it
# reaches in the time that it takes.

# %%
import time

import matplotlib.pyplot as plt
import numpy as np

import vrte

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

haze = vrte.henyey_greenstein(0.75, terms=80)
scene = vrte.Scene([vrte.Layer(haze, albedo=0.98, thickness=2.0)])
seen = {
    "mu0": 0.6,
    "mu": np.linspace(0.1, 1.0, 10),
    "phi": [0.0, 45.0, 90.0, 135.0, 180.0],
    "threads": 1,
}
exact = vrte.radiance(scene, **seen, nodes=64).stokes[..., 0]
other = vrte.radiance(scene, **seen, nodes=48, algorithm="doubling").stokes[..., 0]
print(f"the reference is known to {np.abs(exact - other).max() / exact.max():.0e}")

# %% [markdown]
# ## Error against time
#
# The error is the largest of the light that leaves the top, in 50 directions, over the
# largest radiance. The time is the least of three calls, on one thread; it is this
# machine's, at the moment at which the page was made.

# %%
knobs = {
    "discrete-ordinates": [{"nodes": nodes} for nodes in (2, 4, 8, 16, 32)],
    "auto": [{"accuracy": accuracy} for accuracy in (1e-2, 1e-4, 1e-6)],
    "adding-doubling": [{"nodes": nodes} for nodes in (4, 8, 16)],
    "matrix-operator": [{"nodes": nodes} for nodes in (4, 8, 16)],
    "successive-orders": [
        {"nodes": 8, "settings": {"orders": orders}} for orders in (2, 5, 12)
    ],
    "synthetic-iteration": [{"settings": {"iterations": 1}}],
    "single-scattering": [{}],
    "two-stream": [{}],
    "diffusion": [{}],
}


def measure(method, how):
    """The least time of three calls [ms], and the error over the largest radiance."""
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        found = vrte.radiance(scene, **seen, method=method, **how).stokes[..., 0]
        spent.append(1e3 * (time.perf_counter() - begin))
    return min(spent), np.abs(found - exact).max() / exact.max()


runs = {
    method: np.array([measure(method, how) for how in settings])
    for method, settings in knobs.items()
}

figure, axis = plt.subplots(figsize=(8.5, 4.6))
for (method, points), marker in zip(runs.items(), "o*s^vDPXd", strict=True):
    axis.loglog(*points.T, marker + "-", ms=12 if method == "auto" else 7, label=method)
axis.set(xlabel="time of one call [ms]", ylabel="largest error over the largest radiance")
axis.grid(alpha=0.4)
axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=10)
# %%
for method, points in runs.items():
    best = points[np.argmin(points[:, 1])]
    print(f"{method:20} error {best[1]:.0e} in {best[0]:5.1f} ms at best")

# %%
exact_error = runs["discrete-ordinates"][:, 1]
for method in ("single-scattering", "two-stream", "diffusion", "synthetic-iteration"):
    assert runs[method][:, 1].min() > exact_error[1], method
for accuracy, error in zip((1e-2, 1e-4, 1e-6), runs["auto"][:, 1], strict=True):
    assert error < accuracy

# %% [markdown]
# Discrete ordinates on four nodes, in the same few milliseconds, are closer than every
# approximation at its best: approximations save no time any more, where the exact
# solution costs little more than calling it. The other exact methods get to the same
# number and take longer. `auto` keeps what it promises;
# [Methods](../explanation/methods.md) has fifteen scenes and the rules that it follows.
