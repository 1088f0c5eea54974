"""What scenes with smooth interfaces give in closed form, where nothing scatters but the base."""

import numpy as np
from flint import arb, ctx


def walsh(n: float) -> tuple[float, float]:
    """Share of even, unpolarized light that a surface reflects, from outside and from within an index n > 1.

    Source: Walsh, in the Dictionary of Applied Physics (1926); Duntley, J. Opt. Soc. Am. 32, 61 (1942), (21).
    """
    ctx.prec, before = 256, ctx.prec  # its terms cancel where n is near 1
    m = arb(n)
    found = (
        arb(1) / 2
        + (m - 1) * (3 * m + 1) / (6 * (m + 1) ** 2)
        + m**2 * (m**2 - 1) ** 2 / (m**2 + 1) ** 3 * ((m - 1) / (m + 1)).log()
        - 2 * m**3 * (m**2 + 2 * m - 1) / ((m**2 + 1) * (m**4 - 1))
        + 8 * m**4 * (m**4 + 1) / ((m**2 + 1) * (m**4 - 1) ** 2) * m.log()
    )
    outside, inside = float(found), float(1 - (1 - found) / m**2)
    ctx.prec = before
    return outside, inside


def shares(n: complex, mu: np.ndarray) -> list[np.ndarray]:
    """Power reflected and let through at an index n relative to where mu is: |p|^2, |s|^2, p s*, (3, mu) each."""
    behind = np.sqrt(1.0 - (1.0 - mu**2) / complex(n) ** 2)
    s, p, power = mu + n * behind, n * mu + behind, n * behind.real / mu
    amplitudes = ((n * mu - behind) / p, (mu - n * behind) / s, 1.0), (2.0 * mu / p, 2.0 * mu / s, power)
    return [np.array([p * p.conj(), s * s.conj(), p * s.conj()]) * w for p, s, w in amplitudes]


def mueller_of(fraction: np.ndarray) -> np.ndarray:
    """Of (3, mu) as above: (mu, 4, 4)."""
    along, across, mixed = fraction
    found = np.zeros((len(mixed), 4, 4))
    found[:, 0, 0] = found[:, 1, 1] = (along + across).real / 2
    found[:, 0, 1] = found[:, 1, 0] = (along - across).real / 2
    found[:, 2, 2] = found[:, 3, 3] = mixed.real
    found[:, 2, 3], found[:, 3, 2] = mixed.imag, -mixed.imag
    return found


def bare_base(n: float, albedo: float, mu_i: list[float], mu_o: list[float]) -> np.ndarray:
    """f_00 (in, out) of a Lambertian base under a smooth surface, diffuse."""
    through = [mueller_of(shares(n, np.array(mu))[1])[:, 0, 0] for mu in (mu_i, mu_o)]
    return np.outer(*through) * albedo / (np.pi * n**2 * (1 - albedo * walsh(n)[1]))


def airy_sum(
    mu: list[float], n: float, last: float | complex, thickness: float, is_mirror: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Mueller matrices (mu, 4, 4) of what a plate of index n from air sends back and on, as shares of power: no phases,
    intensities are added. Behind it lies the index ``last``."""
    outside = np.array(mu)
    inside = np.sqrt(1 - (1 - outside**2) / n**2)
    (r1, t1), (r2, t2) = shares(n, outside), shares(last / n, inside)
    fading = np.exp(-thickness / inside)
    bounces = 1 / (1 - r1 * r2 * fading**2)  # r1 from within is the same: no total reflection there
    sent_on = 0 * t2 if is_mirror else t1 * t2 * fading * bounces
    return mueller_of(r1 + t1 * t1 * r2 * fading**2 * bounces), mueller_of(sent_on)
