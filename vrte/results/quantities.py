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
    """The unit as it stands behind a value, "" where there is none. Raises SceneError for an unknown name.

    >>> unit_of("f00"), unit_of("I"), unit_of("angle of linear polarization"), unit_of("reflectance factor")
    ('sr⁻¹', 'W m⁻² sr⁻¹', '°', '')
    """
    check_name(name, (*QUANTITIES, *FIELD_QUANTITIES))
    if name in MUELLER:
        return "sr⁻¹"
    return "W m⁻² sr⁻¹" if name in STOKES else "°" if name in ANGLES else ""


def of_stokes(stokes: Any, name: str) -> Array:
    """A quantity of Stokes vectors (..., 4): (...).

    ``name`` is one of FIELD_QUANTITIES, or "reflectance factor": pi I, where ``stokes`` is the radiance that an
    irradiance of 1 brings. Angles are in degrees, from 0 to below 180; NaN where there is no light, or no linear
    polarization for the angle. Raises SceneError for another name or another shape.

    >>> of_stokes([2.0, 0.0, 1.0, 0.0], "degree of linear polarization").item()
    0.5
    """
    check_name(name, (*FIELD_QUANTITIES, REFLECTANCE_FACTOR))
    values = check_numbers("stokes", stokes)
    if values.shape[-1:] != (4,):
        raise SceneError(f"stokes must be I, Q, U, V along its last axis, not of shape {values.shape}")
    if name == REFLECTANCE_FACTOR:
        return np.pi * values[..., 0]
    return OF_STOKES[name](values) if name in OF_STOKES else values[..., STOKES.index(name)]


def of_brdf(brdf: Brdf, name: str, stokes: Any = (1.0, 0.0, 0.0, 0.0), transmitted: bool = False) -> Array:
    """A quantity of a BRDF, (mu_i, mu_o, phi), under light of the Stokes vector ``stokes`` (4,), I > 0.

    ``name`` is one of QUANTITIES. A Mueller element, "f00" to "f33" [1/sr] (row: out, column: in), does not depend on
    ``stokes``; "reflectance factor" is pi times the radiance over the incident irradiance, 1 for a white Lambertian
    surface. Of diffuse light alone: beams that smooth surfaces mirror are in none of them, but in ``brdf.specular``.
    ``transmitted``: of the BTDF. Raises SceneError for another name, for light without intensity, where there
    is no transmission.

    >>> import vrte
    >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(1.0))
    >>> f = vrte.brdf(white, mu_i=0.5, mu_o=0.5, nodes=4)
    >>> round(of_brdf(f, "reflectance factor").item(), 12)
    1.0
    """
    matrices = brdf.transmission if transmitted else brdf.mueller
    if matrices is None:
        raise SceneError("no transmission here: ask vrte.brdf for it with transmission=True")
    return of_light(matrices @ incident_for(name, stokes), name)


def incident_for(name: str, stokes: Any) -> Array:
    """The incident Stokes vector (4,) of irradiance 1 that shows a quantity: for a Mueller element its column.

    Raises SceneError for another name than those of QUANTITIES, for light without intensity.

    >>> incident_for("f02", (1, 0, 0, 0)).tolist(), incident_for("reflectance factor", (2, 1, 0, 0)).tolist()
    ([0.0, 0.0, 1.0, 0.0], [1.0, 0.5, 0.0, 0.0])
    """
    check_name(name, QUANTITIES)
    given = check_stokes_vector(stokes)
    if not given[0] > 0.0:
        raise SceneError(f"stokes must have an intensity I above 0, not {given[0]:g}")
    unit: Array = np.eye(4)[int(name[2])] if name in MUELLER else given / given[0]
    return unit


def of_light(light: Array, name: str) -> Array:
    """A quantity of the light (..., 4) that leaves under what `incident_for` says: (...)."""
    return light[..., int(name[1])] if name in MUELLER else of_stokes(light, name)


def check_name(name: Any, allowed: tuple[str, ...]) -> None:
    """Raises SceneError unless ``name`` is one of those."""
    if not isinstance(name, str) or name not in allowed:
        raise SceneError(f"a quantity must be one of {', '.join(dict.fromkeys(allowed))}, not {show_value(name)}")
