"""a_n and b_n of spheres as Bohren and Huffman (1983) write them, in ball arithmetic."""

import itertools

from flint import acb, arb, ctx, fmpq


def make_ball(value: complex) -> acb:
    real, imaginary = (arb(fmpq(*float(part).as_integer_ratio())) for part in (value.real, value.imag))
    return acb(real, imaginary)


def find_waves(n: int, z: acb) -> list[acb]:
    """psi_n, psi_n', chi_n and chi_n': z j_n and -z y_n."""
    root, half = (acb.pi() * z / 2).sqrt(), acb(1) / 2
    found = []
    for kind, sign in (("bessel_j", 1), ("bessel_y", -1)):
        wave, before = (sign * root * getattr(z, kind)(n - step + half) for step in (0, 1))
        found += [wave, before - n * wave / z]
    return found


def solve_literally(n: int, arguments: list[acb]) -> list[acb]:
    """(4.53) of an index and a size, (8.2) of two indices and two sizes."""
    outer = arguments[-1]
    psi, psi_slope, chi, chi_slope = find_waves(n, outer)
    xi, xi_slope = psi - acb(0, 1) * chi, psi_slope - acb(0, 1) * chi_slope
    index = arguments[0] if len(arguments) == 2 else arguments[1]
    inside, inside_slope, other, other_slope = find_waves(n, index * outer)
    fields = [(inside, inside_slope)] * 2
    if len(arguments) == 4:
        core, shell, core_size, _ = arguments
        u, du, _, _ = find_waves(n, core * core_size)
        v, dv, c, dc = find_waves(n, shell * core_size)
        mixed = (
            (shell * v * du - core * dv * u) / (shell * c * du - core * dc * u),
            (shell * u * dv - core * v * du) / (shell * dc * u - core * du * c),
        )
        fields = [(inside - part * other, inside_slope - part * other_slope) for part in mixed]
    (u, du), (v, dv) = fields
    return [
        (index * u * psi_slope - psi * du) / (index * u * xi_slope - xi * du),
        (v * psi_slope - index * psi * dv) / (v * xi_slope - index * xi * dv),
    ]


def solve_exactly(n: int, given: tuple[complex, ...]) -> list[complex]:
    """a_n and b_n of indices and size parameters, from the inside out, with as many bits as it takes."""
    for doublings in itertools.count(1):
        with ctx.workprec(64 << doublings):
            found = solve_literally(n, [make_ball(complex(value)) for value in given])
        if min(one.rel_accuracy_bits() for one in found) > 60:
            return [complex(one) for one in found]
    raise AssertionError
