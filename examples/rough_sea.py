"""Sunlight on a rough sea under clear air: a base of one's own. Usage: python rough_sea.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np

import vrte

INTO_STOKES = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])  # from E_l E_l*, E_l E_r*, ...


def frame(mu, phi):
    """Direction of travel of signed cosine mu (x ahead, z up), l = theta-hat and r, with r x l along it."""
    sine, cos, sin = np.sqrt(1.0 - mu**2), np.cos(phi), np.sin(phi)
    return np.array([[sine * cos, sine * sin, mu], [mu * cos, mu * sin, -sine], [sin, -cos, 0.0 * phi]])


def rough_sea(mu_i, mu_o, phi_deg, index=1.34, variance=0.003 + 0.00512 * 7.0):
    """Facets of Gaussian slopes (Cox and Munk 1954, wind 7 m/s) that reflect by Fresnel: (..., 4, 4) [1/sr]."""
    mu_i, mu_o, phi = np.broadcast_arrays(mu_i, mu_o, np.radians(phi_deg))
    (k_i, *frame_i), (k_o, *frame_o) = frame(-mu_i, 0.0 * phi), frame(mu_o, phi)
    cosine = np.linalg.norm(k_o - k_i, axis=0) / 2.0  # of incidence on the facet, whose normal is along k_o - k_i
    tilt = (mu_o + mu_i) / (2.0 * cosine)
    density = np.exp((1.0 - tilt**-2) / variance) / (np.pi * variance * tilt**4)
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    r_p = (index * cosine - inside) / (index * cosine + inside)
    r_s = (cosine - index * inside) / (cosine + index * inside)
    s = np.cross(k_i, k_o, axis=0)  # across the plane of incidence; straight back any direction does
    s = np.where(abs(s).max(axis=0) > 1e-9, s, -frame_i[1])
    s = s / np.linalg.norm(s, axis=0)
    p_i, p_o = np.cross(s, k_i, axis=0), np.cross(s, k_o, axis=0)
    p, q = ([[(o * a).sum(0) * (b * i).sum(0) for i in frame_i] for o in frame_o] for a, b in ((p_o, p_i), (s, s)))
    jones = np.moveaxis(r_p * np.array(p) + r_s * np.array(q), (0, 1), (-2, -1))
    pairs = jones[..., :, None, :, None] * jones[..., None, :, None, :].conj()
    mueller = (INTO_STOKES @ pairs.reshape(*phi.shape, 4, 4) @ np.linalg.inv(INTO_STOKES)).real
    return (density / (4.0 * mu_i * mu_o))[..., None, None] * mueller


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(parents=True, exist_ok=True)

# The function is checked as the base is made: shape, symmetry, energy, and whether light can do what it says.
sea = vrte.MuellerBase(rough_sea)
sun, zenith = np.cos(np.radians(60.0)), np.arange(0.0, 90.0, 5.0)
print(f"the sea alone gives back {sea.reflectance([sun])[0]:.1%} of the sunlight")

scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.1)], sea)
f = vrte.brdf(scene, mu_i=sun, mu_o=np.cos(np.radians(zenith)), phi=np.arange(0, 361, 10), nodes=16)
polarized = -f.mueller[0, :, 0, 1, 0] / f.mueller[0, :, 0, 0, 0]
print(f"towards the glint {polarized[12]:.0%} polarized, across the plane of incidence")
f.save(folder / "rough_sea.nc")
