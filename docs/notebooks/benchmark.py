# %% [markdown]
# # Benchmark: are ten digits right, and how would one know?
#
# A number with ten digits is worth no more than the ways in which it was checked. Ten
# scenes with surfaces are printed to as many digits as are sure
# ([benchmarks](../reference/benchmarks/README.md)). This notebook computes one of them
# again, by two algorithms that share no step of the solution, and then asks how many
# nodes ten digits take.

# %%
import sys

import matplotlib.pyplot as plt
import numpy as np

import vrte

sys.path.append("../..")  # the source tree of vrte, of which this uses the folder bench
from bench.benchmarks import (
    compute_numbers,
    find_benchmarks,
    read_benchmark,
)

plt.style.use("petroff10")  # colours that the colour-blind tell apart
plt.rcParams.update(
    {"font.size": 11, "figure.dpi": 110, "figure.constrained_layout.use": True}
)

(path,) = find_benchmarks(scene="rayleigh_under_a_surface")
benchmark = read_benchmark(path)
print(benchmark.header[:1400])

# %% [markdown]
# ## Every digit, by both algorithms
#
# One algorithm takes eigenvectors of the transfer equation; the other doubles thin layers
# and needs no eigenvectors. A number that is rounded to the last place printed is off by
# half a unit of it at most.

# %%
printed, places = {}, {}
for key, texts in benchmark.numbers.items():
    for stokes, text in zip("IQUV", texts, strict=True):
        if text:
            printed[key, stokes] = float(text)
            places[key, stokes] = len(text.partition(".")[2])

found = {
    algorithm: compute_numbers(benchmark, algorithm)
    for algorithm in ("modes", "doubling")
}
units = {
    algorithm: np.array(
        [
            (numbers[key]["IQUV".index(stokes)] - value) * 10.0 ** places[key, stokes]
            for (key, stokes), value in printed.items()
        ]
    )
    for algorithm, numbers in found.items()
}
for algorithm, off in units.items():
    print(
        f"{algorithm}: {off.size} numbers, off by "
        f"{np.abs(off).max():.3f} of the last place at most"
    )
    assert np.abs(off).max() < 0.55
apart = max(
    np.nanmax(np.abs(found["modes"][key] - found["doubling"][key])) for key, _ in printed
)
print(f"the two algorithms differ by {apart:.1e} at most")

# %% [markdown]
# ## A number that needs no solver
#
# What the surface mirrors before any light enters is Fresnel's formula, a line to write
# down here.

# %%
mu, n = 0.4, 1.34
inside = np.sqrt(1.0 - (1.0 - mu**2) / n**2)
across = ((mu - n * inside) / (mu + n * inside)) ** 2
along = ((n * mu - inside) / (n * mu + inside)) ** 2
mirrored = {
    key[-1]: value
    for key, value in benchmark.numbers.items()
    if key[:2] == ("specular", "0.4")
}
print(f"reflectance {(across + along) / 2:.10f}, printed {mirrored['I'][0]}")
print(f"Q of unpolarized light {(along - across) / 2:.10f}, printed {mirrored['I'][1]}")
assert f"{(across + along) / 2:.10f}"[:11] == mirrored["I"][0][:11]

# %% [markdown]
# ## How many nodes do ten digits take?
#
# Nodes are the directions of the discrete problem, in each hemisphere. Both algorithms
# solve the discrete problem to rounding, so that what is left is the number of nodes. The
# file was made with 128; here they are held against 192.

# %%
(file,) = benchmark.make_files()
nodes = np.array([4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128])
exact = vrte.brdf(file.scene, **file.keywords({"nodes": 192})).mueller
largest = np.abs(exact).max()
errors = {}
for algorithm in ("modes", "doubling"):
    solved = [
        vrte.brdf(
            file.scene, **file.keywords({"nodes": int(n), "algorithm": algorithm})
        ).mueller
        for n in nodes
    ]
    errors[algorithm] = np.array(
        [np.abs(mueller - exact).max() / largest for mueller in solved]
    )

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6))
bins = np.linspace(-0.55, 0.55, 23)
other = (
    np.array(list(printed.values())) != 0.0
)  # by symmetry a third are 0, and come out as 0
left.hist(
    [units["modes"][other], units["doubling"][other]],
    bins=bins,
    label=["modes", "doubling"],
)
left.set(
    xlabel="recomputed less printed [units of the last place]",
    ylabel="numbers",
    title=f"{other.sum()} numbers that are not 0",
)
left.legend()
right.loglog(nodes, errors["modes"], "o-", label="modes")
right.loglog(nodes, errors["doubling"], "s--", label="doubling")
right.axhline(0.5e-10, color="0.4", lw=1)
right.annotate(
    "half a unit of ten digits",
    (4, 0.5e-10),
    xytext=(0, 4),
    textcoords="offset points",
    fontsize=10,
)
right.set(
    xlabel="nodes in each hemisphere",
    ylabel="largest error over largest element",
    title="Convergence",
)
right.set_xticks(nodes[::2], nodes[::2])
right.minorticks_off()
right.legend()
# %%
enough = nodes[errors["modes"] < 0.5e-10].min()
for n, error in zip(nodes, errors["modes"], strict=True):
    print(f"{n:3} nodes: {error:.1e}")
print(f"half a unit of ten digits: from {enough} nodes on")
assert enough > 64

# %% [markdown]
# The printed digits are confirmed by both algorithms, the mirrored share by a formula.
# Both curves lie on each other: what remains is the number of nodes alone, and a hundred
# or so are needed for ten digits, where 16 do for five.
