"""Reflection and refraction at a smooth interface: Snell's law and Fresnel's amplitudes as Mueller matrices.

``index`` is that of the medium behind over that of the medium that light comes from, real or n + ik, k >= 0
(absorbing); ``mu`` the positive cosine of incidence, in the medium that light comes from. Amplitudes are along
theta-hat (p) and phi-hat (s) of each direction of travel, of the reflected light too, so that no axes turn:
docs/reference/conventions.md.

Source: Born and Wolf, Principles of Optics, section 1.5.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array


def refract_cosine(index: complex | Any, mu: Any) -> NDArray[np.complex128]:
    """The cosine behind, the root with Im n cosine >= 0: imaginary under total reflection."""
    index = np.asarray(index, complex)
    # n^2 - 1 as a product: exact where media are almost alike
    root: NDArray[np.complex128] = np.sqrt(np.asarray(mu) ** 2 + (index - 1.0) * (index + 1.0))
    # it is the wave behind, n times the cosine, that decays: a metal's cosine itself may lie on either side by rounding
    return np.where(root.imag < 0.0, -root, root) / index


def reflect_smooth(index: complex | Any, mu: Any, behind: Any = None) -> Array:
    """Mueller matrices of reflection, (..., 4, 4); ``behind``: the cosine there, where it is known better."""
    return make_mueller(*reflect_amplitudes(index, mu, behind))


def reflect_amplitudes(index: complex | Any, mu: Any, behind: Any = None) -> tuple[Any, Any]:
    """Fresnel's amplitudes r_p and r_s (...); ``behind``: the cosine there, where it is known better."""
    mu, behind = np.asarray(mu, float), refract_cosine(index, mu) if behind is None else behind
    return (index * mu - behind) / (index * mu + behind), (mu - index * behind) / (mu + index * behind)


def transmit_smooth(index: complex | Any, mu: Any, behind: Any = None) -> Array:
    """Mueller matrices of transmitted power, (..., 4, 4), zero under total reflection; radiance: times index^2."""
    mu, behind = np.asarray(mu, float), refract_cosine(index, mu) if behind is None else behind
    s, p = 2.0 * mu / (mu + index * behind), 2.0 * mu / (index * mu + behind)
    share: Array = np.real(index * behind) / mu
    return share[..., None, None] * make_mueller(p, s)


def make_mueller(p: Any, s: Any) -> Array:
    """What amplitudes along p and s do to (I, Q, U, V), (..., 4, 4)."""
    p, s = np.broadcast_arrays(np.asarray(p, complex), np.asarray(s, complex))
    return lay_out_mueller(list_elements(np.abs(p) ** 2, np.abs(s) ** 2, p * s.conj()))


def list_elements(parallel: Any, across: Any, mixed: Any) -> Array:
    """Elements (..., 4) of a Mueller matrix referred to p and s: 11, 12, 33 and 34, from shares of p and of s and from
    the product of their amplitudes, p s*, (...) each."""
    return np.stack([0.5 * (parallel + across), 0.5 * (parallel - across), mixed.real, mixed.imag], axis=-1)


def lay_out_mueller(elements: Array) -> Array:
    """The matrix (..., 4, 4) of these elements (..., 4)."""
    found = np.zeros((*elements.shape, 4))
    found[..., 0, 0] = found[..., 1, 1] = elements[..., 0]
    found[..., 0, 1] = found[..., 1, 0] = elements[..., 1]
    found[..., 2, 2] = found[..., 3, 3] = elements[..., 2]
    found[..., 2, 3], found[..., 3, 2] = elements[..., 3], -elements[..., 3]
    return found
