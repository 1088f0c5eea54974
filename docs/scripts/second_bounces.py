"""What light does that meets facets a second time: `python -m docs.scripts.second_bounces` prints the tables of
docs/how_to/rough_surfaces.md.

Photons walk on a surface of random facets as in Heitz, Hanika, d'Eon and Dachsbacher, Multiple-scattering microfacet
BSDFs with the Smith model (2016): heights of facets depend neither on each other nor on slopes, so light on its way
meets the next facet with the chance that Smith's shadowing comes from. Of unpolarized light: a bounce more forgets what
the last one polarized.
"""

import sys

import numpy as np
from scipy.special import erfc, erfcinv

import vrte
from vrte.basics.arrays import Array

MOST_BOUNCES = 60
CONE = 0.08  # radians: half the opening of what looks at a BRDF
MU = 0.5
SEEN = {"mirrored": np.array([np.sqrt(1.0 - MU**2), 0.0, MU]), "normal": np.array([0.0, 0.0, 1.0])}
ROUGHNESSES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
METAL, GLASS = 0.2 + 3.0j, 1.5 + 0.0j


def find_hidden(cosine: Array, alpha: float) -> Array:
    """Smith's Lambda of Gaussian slopes, (n,), of directions that go up; -1 or less of those that go down."""
    slope = cosine / (alpha * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 1e-12)))
    slope = np.where(np.abs(slope) < 1e-9, 1e-9, slope)
    return 0.5 * (np.exp(-(slope**2)) / (slope * np.sqrt(np.pi)) - erfc(slope))


def draw_facets(ways: Array, alpha: float, rng: np.random.Generator) -> Array:
    """Normals (n, 3) of facets that light along ``ways`` (n, 3) meets, each as often as it turns area to the light: the
    slope along the light's azimuth beyond the least one that does, by rejection, and a free one across."""
    across = np.hypot(ways[:, 0], ways[:, 1])
    azimuth = np.arctan2(ways[:, 1], ways[:, 0])
    least = ways[:, 2] / np.maximum(across, 1e-9)
    chance = erfc(least / alpha)
    most = alpha * erfcinv(1e-8 * chance) - least
    along, left = np.zeros(len(ways)), np.arange(len(ways))
    while left.size:
        drawn = alpha * erfcinv(rng.random(left.size) * chance[left])
        kept = rng.random(left.size) * most[left] < drawn - least[left]
        along[left[kept]] = drawn[kept]
        left = left[~kept]
    free = alpha / np.sqrt(2.0) * rng.standard_normal(len(ways))
    slopes = along * np.cos(azimuth) - free * np.sin(azimuth), along * np.sin(azimuth) + free * np.cos(azimuth)
    normals = np.column_stack([-slopes[0], -slopes[1], np.ones(len(ways))])
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def reflect_flat(index: Array, cosine: Array) -> Array:
    """Fresnel's reflectance of unpolarized light, (n,), of relative indices (n,)."""
    inside = np.sqrt(index**2 - 1.0 + cosine**2 + 0j)
    inside = np.where(inside.imag < 0.0, -inside, inside)
    s, p = (cosine - inside) / (cosine + inside), (index**2 * cosine - inside) / (index**2 * cosine + inside)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2)


def walk(index: complex, alpha: float, photons: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Fractions of light along MU that leave upwards and downwards after 1, 2 ... bounces, (bounce,) each, and mean
    BRDFs of those up in cones around the directions SEEN, (direction, bounce). Below, the surface is upside down."""
    rng = np.random.default_rng(seed)
    is_metal = index.imag > 0.0
    ways = np.tile([np.sqrt(1.0 - MU**2), 0.0, -MU], (photons, 1))
    height = np.full(photons, 1.0 - 1e-15)  # as the fraction of facets that lie lower
    weight, below = np.ones(photons), np.zeros(photons, bool)
    left, seen = np.zeros((2, MOST_BOUNCES)), np.zeros((len(SEEN), MOST_BOUNCES))
    for bounce in range(MOST_BOUNCES + 1):
        hidden, level = find_hidden(ways[:, 2], alpha), rng.random(len(ways))
        leaves = (ways[:, 2] > 0.0) & (level < height ** np.abs(hidden))
        if bounce:
            for side in (0, 1):
                left[side, bounce - 1] = weight[leaves & (below == side)].sum()
            for k, direction in enumerate(SEEN.values()):
                within = leaves & ~below & (ways @ direction > np.cos(CONE))
                seen[k, bounce - 1] = (weight[within] / ways[within, 2]).sum()
        stay = ~leaves
        if bounce == MOST_BOUNCES or not stay.any():
            break
        ways, height, weight, below = ways[stay], height[stay], weight[stay], below[stay]
        height = np.clip(height * level[stay] ** (-1.0 / hidden[stay]), 1e-300, 1.0 - 1e-15)
        facets = draw_facets(ways, alpha, rng)
        cosine = np.minimum(-(ways * facets).sum(axis=1), 1.0)
        ratio = np.where(below, 1.0 / index, index)
        reflected = reflect_flat(ratio, cosine)
        mirrored = ways + 2.0 * cosine[:, None] * facets
        if is_metal:
            weight, ways = weight * reflected, mirrored
        else:
            goes = rng.random(len(ways)) > reflected
            n = ratio.real
            inside = np.sqrt(np.maximum(n**2 - 1.0 + cosine**2, 0.0))
            bent = (ways + (cosine - inside)[:, None] * facets) / n[:, None]
            bent[:, 2] *= -1.0
            ways, height = np.where(goes[:, None], bent, mirrored), np.where(goes, 1.0 - height, height)
            below = below ^ goes
        ways /= np.linalg.norm(ways, axis=1)[:, None]
    return *(left / photons), seen / photons / (2.0 * np.pi * (1.0 - np.cos(CONE)))


def find_mean(surface: vrte.Facets | vrte.Interface, direction: Array) -> float:
    """The BRDF of a surface's facets, on the mean over a cone around a direction."""
    rng = np.random.default_rng(1)
    turn, cosine = 2.0 * np.pi * rng.random(4000), 1.0 - rng.random(4000) * (1.0 - np.cos(CONE))
    sine = np.sqrt(1.0 - cosine**2)
    first = np.array([direction[2], 0.0, -direction[0]])
    ways = cosine[:, None] * direction + (sine * np.cos(turn))[:, None] * first
    ways[:, 1] += sine * np.sin(turn)
    azimuth = np.degrees(np.arctan2(ways[:, 1], ways[:, 0]))
    return float(surface.facets.reflect(MU, ways[:, 2], azimuth)[..., 0, 0].mean())


def main(photons: int) -> None:
    """Both tables."""
    for name, index in (("metal, 0.2 + 3i", METAL), ("glass, 1.5", GLASS)):
        print(f"\n{name}, {photons} photons, mu = {MU:g}, mirrored and seen from the normal\n")
        print("| alpha | once (vrte) | twice | all | conserving | mirrored: once (vrte), all, conserving | normal |")
        print("|---|---|---|---|---|---|---|")
        for alpha in ROUGHNESSES:
            up, _, seen = walk(index, alpha, photons)
            kinds = [
                vrte.Facets(index, alpha, conserving=kept)
                if index.imag
                else vrte.Interface(1.0, index.real, alpha, conserving=kept)
                for kept in (False, True)
            ]
            once, given = (float(each.reflectance([MU])[0] if index.imag else each.share([MU])[0][0]) for each in kinds)
            words = [f"{up[0]:.4f} ({once:.4f})", f"{up[1]:.4f}", f"{up.sum():.4f}", f"{given:.4f}"]
            for k, direction in enumerate(SEEN.values()):
                first, all_ = (find_mean(each, direction) for each in kinds)
                words.append(f"{seen[k, 0]:.4f} ({first:.4f}), {seen[k].sum():.4f}, {all_:.4f}")
            print(f"| {alpha:g} | {' | '.join(words)} |", flush=True)


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 2_000_000)
