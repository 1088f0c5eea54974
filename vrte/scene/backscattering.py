"""Coherent backscattering: a path of light and the same path reversed add up as fields, not as powers, in the one
direction back to the source (docs/explanation/backscattering.md).

Source: Mishchenko, J. Opt. Soc. Am. A 9, 978 (1992); the exchange of amplitudes is derived on that page.
"""

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.basics.errors import SceneError
from vrte.optics.fresnel import transmit_smooth
from vrte.scene.beams import find_cosines
from vrte.scene.scene import Scene

SAME_COSINE, SAME_AZIMUTH = 1e-12, 1e-9  # [1], [degrees]: rounding of a direction that is meant to lead back
# of the diagonals: that of <J J*> becomes that of <J J_reversed*>, J_reversed = P J^T P with P = diag(1, -1)
EXCHANGE = 0.5 * np.array([[1, 1, -1, 1], [1, 1, 1, -1], [-1, 1, 1, 1], [1, -1, 1, 1]])
DOMAIN = "coherent is for particles, over a black or Lambertian base, bare or under one smooth surface on top"


def find_back_directions(mu_i: Array, mu_o: Array, phi_deg: Array) -> tuple[BoolArray, BoolArray]:
    """Which of mu_o lead back along each mu_i, (n_in, n_out), and which azimuths [degrees], (n_phi,)."""
    turned = np.abs(np.remainder(phi_deg, 360.0) - 180.0) <= SAME_AZIMUTH
    return np.abs(mu_o - mu_i[:, None]) <= SAME_COSINE, turned


def check_interference(scene: Scene, mu_i: Array, mu_o: Array, phi_deg: Array) -> None:
    """Whether the interference of a scene is known, and the directions lead back to the source. Raises SceneError."""
    if scene.has_flakes:
        raise SceneError.of("coherent", f"is not known with oriented flakes: {DOMAIN}")
    for place, interface in enumerate(scene.interfaces):
        if interface is not None and (place > 0 or not interface.is_smooth):
            raise SceneError.of("coherent", f"is not known with this {interface.in_words}: {DOMAIN}")
    if scene.below.keeps_beams or scene.below.is_uneven:
        raise SceneError.of("coherent", f"is not known over the base {scene.base_in_words}: {DOMAIN}")
    same, turned = find_back_directions(mu_i, mu_o, phi_deg)
    if not turned.any():
        raise SceneError.of("coherent", "is in the direction back to the source: phi must have 180 degrees")
    if not same.any(axis=1).all():
        missing = float(mu_i[~same.any(axis=1)][0])
        raise SceneError.of("coherent", f"is in the direction back to the source: mu_o must have mu_i = {missing:g}")


def scatter_back_once(scene: Scene, mu: Array) -> Array:
    """Light scattered once, or by a Lambertian base alone, back along cosines mu (n,) outside: f [1/sr] (n, 4, 4)."""
    along = find_cosines(scene.media, scene.index_above, mu)[1]
    inside = np.where(along > 0.0, along, 1.0)[:, None, None]
    above, found = 0.0, np.zeros((mu.size, 4, 4))
    for layer in scene.layers:
        decay = np.exp(-2.0 * above / inside) * -np.expm1(-2.0 * layer.thickness / inside)
        found += layer.albedo / (8.0 * np.pi * inside) * decay * layer.phase_matrix.scattering_matrix(180.0)
        above += layer.thickness
    found[:, :1, :1] += scene.below.even_albedo / np.pi * np.exp(-2.0 * above / inside)
    if scene.interfaces[0] is None:
        return found
    index = scene.indices[0] / scene.index_above
    found *= (along > 0.0)[:, None, None] / index**2
    return transmit_smooth(1.0 / index, inside[:, 0, 0]) @ found @ transmit_smooth(index, mu)


def find_interference(scene: Scene, mu_i: Array, mu_o: Array, phi_deg: Array, mueller: Array) -> Array:
    """What interference adds to f, ``mueller``, [1/sr] back along each mu_i (n_in,), (n_in, 4, 4)."""
    same, turned = find_back_directions(mu_i, mu_o, phi_deg)
    back = mueller[np.arange(mu_i.size), same.argmax(axis=1), turned.argmax()]
    return exchange_amplitudes(back - scatter_back_once(scene, mu_i))


def exchange_amplitudes(multiple: Array) -> Array:
    """<J J_reversed*> of reciprocal paths, whose <J J*> is ``multiple``, both as Mueller matrices (..., 4, 4) in the
    meridian planes. Reciprocity and mirror symmetry make all of them but the diagonal, 12, 21, 34 and 43 vanish."""
    found = multiple.copy()
    diagonal = np.arange(4)
    found[..., diagonal, diagonal] = multiple[..., diagonal, diagonal] @ EXCHANGE
    return found
