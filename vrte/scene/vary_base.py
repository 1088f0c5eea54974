"""How a base changes with a number: boundaries whose weighted sum is the derivative of what it reflects."""

from collections.abc import Callable

from vrte.basics.errors import SceneError
from vrte.scene.boundary import BLACK, Boundary, Lambertian

CENTRAL = {3: 1.0 / 60.0, 2: -3.0 / 20.0, 1: 3.0 / 4.0, -1: -3.0 / 4.0, -2: 3.0 / 20.0, -3: -1.0 / 60.0}
ONE_SIDED = {0: -49.0 / 20.0, 1: 6.0, 2: -15.0 / 2.0, 3: 20.0 / 3.0, 4: -15.0 / 4.0, 5: 6.0 / 5.0, 6: -1.0 / 6.0}

Weighted = tuple[tuple[float, Boundary], ...]


def vary_base(base_at: Callable[[float], Boundary | None], value: float, step: float) -> Weighted:
    """Weights and boundaries of the derivative of a base over a number, at its ``value``; none where it stays the same.

    Differences of sixth order, central ones, or one-sided where ``base_at`` raises a SceneError on the other side; of a
    Lambertian base, which reflects in proportion to its albedo, the white one alone. Raises that SceneError where
    neither side is allowed.
    """
    for side, stencil in ((1.0, CENTRAL), (1.0, ONE_SIDED), (-1.0, ONE_SIDED)):
        try:
            found = [(side * weight / step, base_at(value + side * n * step)) for n, weight in stencil.items()]
        except SceneError as error:
            refused = error
            continue
        pairs = [(weight, base or BLACK) for weight, base in found]
        if all(base == pairs[0][1] for _, base in pairs):
            return ()
        if all(isinstance(base, Lambertian) for _, base in pairs):
            return ((sum(weight * base.even_albedo for weight, base in pairs), Lambertian(1.0)),)
        return tuple(pairs)
    raise refused
