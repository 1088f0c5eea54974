"""Stacks of thin films between two media, coherent: amplitudes of what they reflect and let through.

The product of the films' characteristic matrices, from the innermost interface outwards: with r, t of all that lies
further in, b = 2 pi thickness q/wavelength and q = n cos, the root of n^2 - (n_0 sin)^2 with Im q >= 0,

    r' = (r_12 + r e^{2ib})/(1 + r_12 r e^{2ib}),    t' = t_12 t e^{ib}/(1 + r_12 r e^{2ib}),

in which no exponential grows. Amplitudes are along theta-hat (p) and phi-hat (s) as in fresnel.py.

Source: Born and Wolf, Principles of Optics, section 1.6; Yeh, Optical Waves in Layered Media, chapter 5.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.optics.fresnel import list_elements

Complex = NDArray[np.complex128]
Film = tuple[complex, float]  # refractive index n + ik, thickness [um]
GRAZING = 1e-9  # the least cosine of light on a plate


def find_amplitudes(
    outside: float,
    films: Sequence[Film],
    inside: complex | None,
    cosine: Any,
    wavelength_um: float,
    behind: Any = None,
) -> tuple[Complex, Complex, Complex, Complex]:
    """r_p, r_s, t_p, t_s (...) of films from the outside in, on a medium ``inside`` (None: a perfect mirror), for
    cosines of incidence (...) in the medium ``outside``; t of fields, in the medium inside, ``behind``: the cosine
    there, where it is known better."""
    cosine = np.asarray(cosine, float)
    last = 1.0 if inside is None else inside
    indices = [complex(outside), *(index for index, _ in films), complex(last)]
    roots = [outside * cosine + 0j, *(find_root(index, outside, cosine) for index in indices[1:])]
    if behind is not None:
        roots[-1] = last * behind + 0j
    lengths = [0.0, *(thickness for _, thickness in films)]
    found: list[Complex] = []
    for polarization in "ps":
        r = np.full(cosine.shape, 1.0 if polarization == "p" else -1.0, complex)
        t = np.zeros(cosine.shape, complex) if inside is None else np.ones(cosine.shape, complex)
        for k in range(len(lengths) - 1, -1, -1):
            if k + 1 < len(lengths):
                phase = np.exp(2j * math.pi * lengths[k + 1] / wavelength_um * roots[k + 1])
            elif inside is None:
                continue  # what the mirror reflects is known
            else:
                r, phase = np.zeros(cosine.shape, complex), np.ones(cosine.shape, complex)
            r_12, t_12 = cross_interface(polarization, indices[k], indices[k + 1], roots[k], roots[k + 1])
            below = r * phase**2
            r, t = (r_12 + below) / (1.0 + r_12 * below), t_12 * t * phase / (1.0 + r_12 * below)
        found += [r, t]
    return found[0], found[2], found[1], found[3]


def find_plate(
    outside: float, films: Sequence[Film], substrate: float, cosine: Any, wavelength_um: float
) -> tuple[Array, Array]:
    """What a clear plate under the same films on both faces reflects and lets through, elements 11, 12, 33 and 34 of
    Mueller matrices (..., 4). Light that goes to and fro between the faces is added up without phases: plates differ in
    thickness by more than a wavelength."""
    cosine = np.maximum(np.asarray(cosine, float), GRAZING)  # where nothing gets in, it cannot be divided by
    square = 1.0 - (outside / substrate) ** 2 * (1.0 - cosine) * (1.0 + cosine)
    gets_in, inside = square > 0.0, np.sqrt(np.maximum(square, GRAZING**2))
    front = find_amplitudes(outside, films, substrate, cosine, wavelength_um)
    back = find_amplitudes(substrate, films[::-1], outside, inside, wavelength_um, cosine)
    r, own = front[:2], back[:2]
    through = [np.where(gets_in, down * up, 0.0) for down, up in zip(front[2:], back[2:], strict=True)]
    reflected, passed = [], []
    for x, y in ((0, 0), (1, 1), (0, 1)):
        turned = own[x] * own[y].conj()  # at a face, from within
        once = through[x] * through[y].conj() / (1.0 - turned**2)
        passed.append(once)
        reflected.append(r[x] * r[y].conj() + once * turned)
    return tuple(list_elements(each[0].real, each[1].real, each[2]) for each in (reflected, passed))  # type: ignore[return-value]


def find_root(index: complex, outside: float, cosine: Any) -> Complex:
    """n cos in a medium, (...), of light with these cosines (...) outside: the root with Im >= 0, of what decays."""
    # n^2 - n_0^2 as a product: exact where media are almost alike
    root: Complex = np.sqrt((index - outside) * (index + outside) + (outside * np.asarray(cosine)) ** 2 + 0j)
    return np.where(root.imag < 0.0, -root, root)


def cross_interface(
    polarization: str, above: complex, below: complex, root_above: Complex, root_below: Complex
) -> tuple[Complex, Complex]:
    """Fresnel's r and t of fields (...) at an interface of two media of these indices and n cos."""
    a, b = (below * below * root_above, above * above * root_below) if polarization == "p" else (root_above, root_below)
    return (a - b) / (a + b), 2.0 * (above * below * root_above if polarization == "p" else root_above) / (a + b)
