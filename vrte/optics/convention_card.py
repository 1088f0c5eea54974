"""By which numbers of one sphere the convention of a code is known."""

from functools import lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.optics.angle_tables import check_angles, check_columns
from vrte.optics.conventions import CONVENTIONS, Convention
from vrte.optics.particles import Particles
from vrte.optics.spheres import spheres

INDEX, RADIUS_UM, WAVELENGTH_UM = 1.5, 0.5, 1.0  # of the sphere, in air: size parameter pi, nothing absorbed
CARD_DEG = (30.0, 60.0, 120.0)
ALIKE = 2e-3  # of F11: four digits are enough, and no two conventions are as near


@lru_cache(maxsize=1)
def make_reference_sphere() -> Particles:
    """The sphere of the card: index 1.5, radius 0.5 um, wavelength 1 um."""
    return spheres(INDEX, radius_um=RADIUS_UM, wavelength_um=WAVELENGTH_UM)


def tabulate_card(convention: Convention, angle_deg: Any = CARD_DEG) -> Array:
    """What a code of this convention gives for the reference sphere: its six columns (6, angles)."""
    sphere = make_reference_sphere()
    ahead, aside = sphere.phase_matrix.to_angles([0.0, 30.0]).F11
    cross_section = sphere.scattering_um2 / (4.0 * np.pi)
    scales = {
        "amplitudes": cross_section * (2.0 * np.pi / WAVELENGTH_UM) ** 2,
        "forward": 1.0 / ahead,
        "30-degrees": 1.0 / aside,
        "cross-section": cross_section,
    }
    scale = convention.mean or scales[convention.scale]
    return convention.write(scale * sphere.phase_matrix.to_angles(angle_deg).elements)


def recognise_convention(
    angle_deg: Any, F11: Any, F12: Any = None, F22: Any = None, F33: Any = None, F34: Any = None, F44: Any = None
) -> tuple[str, ...]:
    """The conventions by which a code writes scattering matrices, known from what it gives for one sphere.

    The sphere has the refractive index 1.5 in air, a radius of 0.5 um at a wavelength of 1 um (size parameter pi), and
    absorbs nothing; docs/how_to/importing.md has the numbers.

    Parameters
    ----------
    angle_deg : array_like (angles,)
        Scattering angles [degrees], ascending; three are enough, neither 0 nor 180 alone.
    F11 : array_like (angles,)
        What the code gives in this place whatever it calls it, four digits of it.
    F12, F22, F33, F34, F44 : array_like (angles,), optional
        The same in the other places; those that it does not give are left out.

    Returns
    -------
    tuple of str
        Names for ``convention=`` of `PhaseMatrix.from_angles`; several where what was given does not tell them apart.

    Raises
    ------
    SceneError
        Where none fits: it names the nearest, how far that is off and where.

    Examples
    --------
    >>> import vrte
    >>> F11, F12, F34 = [4.997, 0.4996, 0.1506], [-0.174, 0.1855, 0.0153], [0.5, 0.199, 0.0606]
    >>> vrte.recognise_convention([30, 60, 120], F11, F12, F34=F34)
    ('vrte',)
    """
    angles = check_angles(angle_deg)
    columns = enumerate(check_columns(angles, (F11, F12, F22, F33, F34, F44)))
    given = {index: column for index, column in columns if column is not None}
    found = {name: _compare(given, tabulate_card(about, angles), about) for name, about in CONVENTIONS.items()}
    fitting = tuple(name for name, (off, _, _) in found.items() if off <= ALIKE)
    if fitting:
        return fitting
    nearest = min(found, key=lambda name: found[name][0])
    off, index, angle = found[nearest]
    scaled = [name for name, about in CONVENTIONS.items() if _is_scaled(given, tabulate_card(about, angles), about)]
    also = f"; up to a constant factor it is {' or '.join(scaled)}, which normalise=True reads" if scaled else ""
    raise SceneError(
        f'no known convention: "{nearest}" is nearest, and its {CONVENTIONS[nearest].columns[index]} is off by '
        f"{off:.2g} of F11 at {angles[angle]:g} degrees{also} (is it the sphere of index 1.5, radius 0.5 um, "
        "wavelength 1 um?)"
    )


def _compare(given: dict[int, Array], card: Array, about: Convention) -> tuple[float, int, int]:
    """The largest difference over F11, of a ratio as it is, and the places of its column and angle."""
    worst = (0.0, 0, 0)
    for index, column in given.items():
        scale = 1.0 if about.columns[index].endswith("/F11") else np.abs(card[0])
        off = np.abs(column - card[index]) / scale
        worst = max(worst, (float(off.max()), index, int(off.argmax())))
    return worst


def _is_scaled(given: dict[int, Array], card: Array, about: Convention) -> bool:
    """Whether all is right but for one factor of what is no ratio."""
    if 0 not in given or not given[0].any():
        return False
    factor = float(np.median(card[0] / np.where(given[0] == 0.0, np.inf, given[0])))
    ratio = [name.endswith("/F11") for name in about.columns]
    scaled = {index: column * (1.0 if ratio[index] else factor) for index, column in given.items()}
    return bool(_compare(scaled, card, about)[0] <= ALIKE)
