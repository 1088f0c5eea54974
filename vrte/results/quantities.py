"""What pictures and tables show of a BRDF or of Stokes vectors, by name."""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_numbers, show_value
from vrte.basics.errors import SceneError
from vrte.basics.polarization import (
    find_angle_of_linear_polarization,
    find_degree_of_circular_polarization,
    find_degree_of_linear_polarization,
    find_degree_of_polarization,
)
from vrte.request.request import check_stokes_vector
from vrte.results.brdf import Brdf

MUELLER = tuple(f"f{row}{column}" for row in range(4) for column in range(4))
STOKES = ("I", "Q", "U", "V")
DEGREE_LINEAR, ANGLE_LINEAR = "degree of linear polarization", "angle of linear polarization"
DEGREE_CIRCULAR, DEGREE = "degree of circular polarization", "degree of polarization"
REFLECTANCE_FACTOR = "reflectance factor"
QUANTITIES = (*MUELLER, DEGREE_LINEAR, ANGLE_LINEAR, DEGREE_CIRCULAR, REFLECTANCE_FACTOR)  # of a BRDF
FIELD_QUANTITIES = (*STOKES, DEGREE, DEGREE_LINEAR, ANGLE_LINEAR, DEGREE_CIRCULAR)  # of a radiance field
ANGLES = frozenset({ANGLE_LINEAR})  # 0 and 180 are the same
SIGNED = frozenset({*MUELLER[1:], *STOKES[1:], DEGREE_CIRCULAR})  # may be negative
SHARES = frozenset({DEGREE, DEGREE_LINEAR, DEGREE_CIRCULAR, REFLECTANCE_FACTOR})  # without a unit
OF_STOKES = {
    DEGREE: find_degree_of_polarization,
    DEGREE_LINEAR: find_degree_of_linear_polarization,
    ANGLE_LINEAR: find_angle_of_linear_polarization,
    DEGREE_CIRCULAR: find_degree_of_circular_polarization,
}


def unit_of(name: str) -> str:
    """The unit of one of QUANTITIES or FIELD_QUANTITIES, as it stands behind a value; "" where there is none."""
    check_name(name, (*QUANTITIES, *FIELD_QUANTITIES))
    if name in MUELLER:
        return "sr⁻¹"
    return "W m⁻² sr⁻¹" if name in STOKES else "°" if name in ANGLES else ""


def of_stokes(stokes: Any, name: str) -> Array:
    """One of FIELD_QUANTITIES, or the reflectance factor pi I at irradiance 1, of Stokes vectors (..., 4): (...),
    angles [degrees] from 0 to below 180; NaN where there is no light, or no linear polarization for the angle."""
    check_name(name, (*FIELD_QUANTITIES, REFLECTANCE_FACTOR))
    values = check_numbers("stokes", stokes)
    if values.shape[-1:] != (4,):
        raise SceneError(f"stokes must be I, Q, U, V along its last axis, not of shape {values.shape}")
    if name == REFLECTANCE_FACTOR:
        return np.pi * values[..., 0]
    return OF_STOKES[name](values) if name in OF_STOKES else values[..., STOKES.index(name)]


def of_brdf(brdf: Brdf, name: str, stokes: Any = (1.0, 0.0, 0.0, 0.0), transmitted: bool = False) -> Array:
    """One of QUANTITIES, (n_in, n_out, n_phi), of a BRDF's or BTDF's diffuse light under light ``stokes`` (4,)."""
    matrices = brdf.transmission if transmitted else brdf.mueller
    if matrices is None:
        raise SceneError("no transmission here: ask vrte.brdf for it with transmission=True")
    return of_light(matrices @ incident_for(name, stokes), name)


def incident_for(name: str, stokes: Any) -> Array:
    """The Stokes vector (4,) of irradiance 1 that shows a quantity: of a Mueller element its column."""
    check_name(name, QUANTITIES)
    given = check_stokes_vector(stokes)
    if not given[0] > 0.0:
        raise SceneError(f"stokes must have an intensity I above 0, not {given[0]:g}")
    return np.eye(4)[int(name[2])] if name in MUELLER else given / given[0]


def of_light(light: Array, name: str) -> Array:
    """One of QUANTITIES, (...), of the light (..., 4) [1/sr] that leaves under what `incident_for` returns."""
    return light[..., int(name[1])] if name in MUELLER else of_stokes(light, name)


def check_name(name: Any, allowed: tuple[str, ...]) -> None:
    """Whether a quantity is one of those allowed. Raises SceneError."""
    if not isinstance(name, str) or name not in allowed:
        raise SceneError(f"a quantity must be one of {', '.join(dict.fromkeys(allowed))}, not {show_value(name)}")
