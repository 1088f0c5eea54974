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
    """The unit of a quantity, as it stands behind a value.

    Parameters
    ----------
    name : str
        One of QUANTITIES or FIELD_QUANTITIES.

    Returns
    -------
    str
        "" where there is none.

    Raises
    ------
    SceneError
        For an unknown name.

    Examples
    --------
    >>> from vrte.results.quantities import unit_of
    >>> unit_of("f00"), unit_of("I"), unit_of("angle of linear polarization"), unit_of("reflectance factor")
    ('sr⁻¹', 'W m⁻² sr⁻¹', '°', '')
    """
    check_name(name, (*QUANTITIES, *FIELD_QUANTITIES))
    if name in MUELLER:
        return "sr⁻¹"
    return "W m⁻² sr⁻¹" if name in STOKES else "°" if name in ANGLES else ""


def of_stokes(stokes: Any, name: str) -> Array:
    """A quantity of Stokes vectors: intensity, degree or angle of polarization.

    Parameters
    ----------
    stokes : array_like (..., 4)
        I, Q, U, V, in any unit of radiance.
    name : str
        One of FIELD_QUANTITIES, or "reflectance factor": pi I, where ``stokes`` is the radiance that an irradiance of 1
        brings.

    Returns
    -------
    ndarray (...)
        Angles in degrees, from 0 to below 180; NaN where there is no light, or no linear polarization for the angle.

    Raises
    ------
    SceneError
        For another name or another shape.

    Examples
    --------
    >>> from vrte.results.quantities import of_stokes
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
    """A quantity of a BRDF under some incident light: a Mueller element, the reflectance factor, polarization.

    Beams that smooth surfaces mirror are in none of them, but in ``brdf.specular``.

    Parameters
    ----------
    brdf : Brdf
        What was solved.
    name : str
        One of QUANTITIES. A Mueller element, "f00" to "f33" [1/sr] (row: out, column: in), does not depend on
        ``stokes``; "reflectance factor" is pi times the radiance over the incident irradiance, 1 for a white Lambertian
        surface.
    stokes : array_like (4,), optional
        Stokes vector of the incident light, I > 0; default: unpolarized.
    transmitted : bool, optional
        Of the BTDF in place of the BRDF.

    Returns
    -------
    ndarray (n_in, n_out, n_phi)
        In the unit that `unit_of` tells.

    Raises
    ------
    SceneError
        For another name, for light without intensity, and where there is no transmission.

    Examples
    --------
    >>> from vrte.results.quantities import of_brdf
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
    """The incident light of irradiance 1 that shows a quantity: for a Mueller element its column.

    Parameters
    ----------
    name : str
        One of QUANTITIES.
    stokes : array_like (4,)
        Stokes vector of the light for all quantities but Mueller elements, I > 0.

    Returns
    -------
    ndarray (4,)
        I, Q, U, V.

    Raises
    ------
    SceneError
        For another name, and for light without intensity.

    Examples
    --------
    >>> from vrte.results.quantities import incident_for
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
    """A quantity of the light that leaves under what `incident_for` says.

    Parameters
    ----------
    light : ndarray (..., 4)
        Stokes vectors of the light that leaves [1/sr].
    name : str
        One of QUANTITIES.

    Returns
    -------
    ndarray (...)
        In the unit that `unit_of` tells.

    Examples
    --------
    >>> import numpy as np
    >>> from vrte.results.quantities import of_light
    >>> round(of_light(np.array([1.0 / np.pi, 0.0, 0.0, 0.0]), "reflectance factor").item(), 12)
    1.0
    """
    return light[..., int(name[1])] if name in MUELLER else of_stokes(light, name)


def check_name(name: Any, allowed: tuple[str, ...]) -> None:
    """Whether a name is one of those allowed.

    Parameters
    ----------
    name : str
        What was asked for.
    allowed : tuple of str
        What there is: QUANTITIES, FIELD_QUANTITIES.

    Raises
    ------
    SceneError
        Where it is none of them.

    Examples
    --------
    >>> from vrte.results.quantities import QUANTITIES
    >>> from vrte.results.quantities import check_name
    >>> check_name("f00", QUANTITIES)
    """
    if not isinstance(name, str) or name not in allowed:
        raise SceneError(f"a quantity must be one of {', '.join(dict.fromkeys(allowed))}, not {show_value(name)}")
