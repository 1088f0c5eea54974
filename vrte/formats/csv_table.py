"""Results as CSV: a header, then one row a direction."""

import os
from collections.abc import Iterator

import numpy as np

from vrte.arrays import Array
from vrte.brdf import Brdf
from vrte.field import Field
from vrte.formats.atomic import atomic_write

ELEMENTS = [f"{row}{column}" for row in range(4) for column in range(4)]


def write_csv(result: Brdf | Field, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to ``path``, all of it or nothing; numbers keep every digit. Raises OSError.

    A BRDF has the columns mu_i, mu_o, phi_deg, f00 .. f33 [sr-1], then t00 .. t33 where transmission was
    computed; a field has tau, mu, phi_deg, I, Q, U, V.

    >>> write_csv(brdf, "result.csv")
    """
    names, columns = _brdf_table(result) if isinstance(result, Brdf) else _field_table(result)
    with atomic_write(path) as part, open(part, "w", encoding="ascii", newline="") as file:
        file.write(",".join(names) + "\n")
        file.writelines(_lines(columns))


def _brdf_table(result: Brdf) -> tuple[list[str], Array]:
    names = ["mu_i", "mu_o", "phi_deg", *(f"f{element}" for element in ELEMENTS)]
    blocks = [_directions(result.mu_i, result.mu_o, result.phi), result.mueller.reshape(-1, 16)]
    if result.transmission is not None:
        names += [f"t{element}" for element in ELEMENTS]
        blocks.append(result.transmission.reshape(-1, 16))
    return names, np.hstack(blocks)


def _field_table(result: Field) -> tuple[list[str], Array]:
    directions = _directions(result.tau, result.mu, result.phi)
    names = ["tau", "mu", "phi_deg", "I", "Q", "U", "V"]
    return names, np.hstack([directions, result.stokes.reshape(-1, 4)])


def _directions(*axes: Array) -> Array:
    """Every combination of the axes, the last one fastest: (rows, axes)."""
    return np.stack([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")], axis=1)


def _lines(rows: Array) -> Iterator[str]:
    for row in rows:
        yield ",".join(map(repr, row.tolist())) + "\n"
