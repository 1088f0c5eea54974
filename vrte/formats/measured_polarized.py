"""A spectrum as Mitsuba's ``measured_polarized`` BSDF takes it: Mueller matrices over Rusinkiewicz angles, in its file.

The file's half vector has the angle theta_h with the normal, the light's direction i the angle theta_d with the half
vector, and phi_d is the azimuth of i about it, 0 where the half vector leans to. i and the view's direction o both
point away from the surface. Its Stokes axes are perpendicular to the plane of i and o and in it; ours are meridian
planes, so that each matrix is turned by two rotations.

The matrices come from splines through `directions` that were solved for, in meridian planes, over s, theta = 90 degrees
sin(pi s/2), and over the azimuth. They go on beyond the pole, where meridian planes go on into their other half,
f(-theta_i, theta_o, phi) = f(theta_i, theta_o, phi + 180), and beyond the horizon, where f (mu_i + mu_o) is an even
function of 1 - s.

A tensor file is a head that lists arrays, then their bytes, all little-endian. The head: "tensor_file" and a zero byte,
the version as two bytes (1, 0), the number of fields (uint32); then for each field the length of its name (uint16), the
name, its number of dimensions (uint16), its type (uint8), where its bytes begin (uint64) and its shape (uint64 each).
"""

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import SMALLEST_COSINE, Array, check_number, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import (
    MIRROR,
    compute_coefficients,
    extend_azimuths,
    extend_over_horizon,
    extend_over_pole,
    make_cosines,
    make_spline_matrix,
    stretch_cosines,
)
from vrte.formats.atomic import PathName, check_file_name, write_atomically, write_text
from vrte.formats.contents import describe_result
from vrte.results.brdf import Brdf, Spectrum
from vrte.scene.illumination import SAME

MAGIC, VERSION = b"tensor_file\0", (1, 0)
TYPES = ("", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")  # by number, as NumPy spells them
ALIGNMENT = 8  # bytes
MOST_FIELDS, MOST_DIMENSIONS = 1000, 16
LARGEST = 2e9  # bytes of a file
GAP = 5e-4  # of two spheres of radius 1: rays start 1.8e-4 off what they leave; angles change by its square root


def write_tensors(fields: Mapping[str, NDArray[Any]], path: PathName) -> None:
    """Writes arrays by their names to ``path``, all of it or nothing. Raises OSError, SceneError for another type."""
    arrays = {name.encode("utf-8"): np.asarray(values, order="C") for name, values in fields.items()}
    index = len(MAGIC) + 6 + sum(13 + len(name) + 8 * array.ndim for name, array in arrays.items())
    head, starts = [MAGIC, struct.pack("<BBI", *VERSION, len(arrays))], []
    for name, array in arrays.items():
        kind = array.dtype.str[1:]
        if kind not in TYPES:
            raise SceneError(f"{name.decode()} must be real numbers of a plain type, not {array.dtype}")
        index += -index % ALIGNMENT
        about = array.ndim, TYPES.index(kind), index, *array.shape
        head.append(struct.pack("<H", len(name)) + name + struct.pack(f"<HBQ{array.ndim}Q", *about))
        starts.append(index)
        index += array.nbytes
    with write_atomically(path) as part, open(part, "wb") as file:
        file.write(b"".join(head))
        for start, array in zip(starts, arrays.values(), strict=True):
            file.write(b"\0" * (start - file.tell()))
            file.write(array.astype(array.dtype.newbyteorder("<"), copy=False).data)


def read_tensors(path: PathName, most_bytes: float = LARGEST) -> dict[str, NDArray[Any]]:
    """The arrays of a tensor file by their names. Raises SceneError for one damaged or too long, OSError."""
    name = check_file_name(path)
    with open(name, "rb") as file:
        content = file.read(int(most_bytes) + 1)
    try:
        if len(content) > most_bytes:
            raise SceneError(f"the file is longer than the {most_bytes / 1e9:g} GB that are read")
        return _read_fields(content)
    except SceneError as error:
        raise error.behind(name) from error
    except (struct.error, ValueError, OverflowError) as error:  # a shape that no array has, among others
        raise SceneError(f"{name} is no tensor file, or it is damaged") from error


def _read_fields(content: bytes) -> dict[str, NDArray[Any]]:
    if not content.startswith(MAGIC):
        raise SceneError("not a tensor file")
    major, minor, count = struct.unpack_from("<BBI", content, len(MAGIC))
    if (major, minor) != VERSION or count > MOST_FIELDS:
        raise SceneError(f"not a tensor file of version 1.0 with at most {MOST_FIELDS} fields")
    index, found = len(MAGIC) + 6, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", content, index)
        (label,) = struct.unpack_from(f"<{length}s", content, index + 2)
        dimensions, number, start = struct.unpack_from("<HBQ", content, index + 2 + length)
        if dimensions > MOST_DIMENSIONS or not 0 < number < len(TYPES):
            raise SceneError(f"a field has {dimensions} dimensions and is of type {number}, which is no tensor")
        shape = struct.unpack_from(f"<{dimensions}Q", content, index + 13 + length)
        index += 13 + length + 8 * dimensions
        kind, size = np.dtype(f"<{TYPES[number]}"), math.prod(shape)
        if start + size * kind.itemsize > len(content):
            raise SceneError("the file is cut off: it ends before its fields do")
        found[label.decode("utf-8")] = np.frombuffer(content, kind, size, start).reshape(shape)
    return found


def write_nested_scene(path: PathName, table: PathName, index_above: float, index_below: float) -> None:
    """Writes a scene file (XML): a sphere of the table ``table``, which must lie beside ``path``, in one of a smooth
    dielectric. Mitsuba has no sum of BSDFs (blendbsdf mixes up beams and other light), so the surface is a shape of its
    own: Mitsuba follows the light through it, and up and down between the two as often as it goes. Raises OSError."""
    name = f'"{escape(Path(table).name)}"'
    template = Path(__file__).with_name("nested_dielectric.xml").read_text("utf-8")
    text = template.format(above=index_above, below=index_below, table=name, inside=1.0 - GAP)
    write_text(text, path)


AXES = ("phi_d", "theta_d", "theta_h")  # [rad]: from -pi to pi, from 0 to pi/2 twice, all with both ends
Axes = tuple[Array, Array, Array]
WAVELENGTHS = 5  # in Mitsuba's code
COSINES, AZIMUTHS = 48, 73  # to solve for, by default
FEWEST, MOST = 8, 1024
MOST_COSINES, MOST_AZIMUTHS = 128, 361  # where nodes and Fourier orders are many
CHECKED, CHECKED_FROM = 8, 0.1  # cosines and azimuths to check a table with; the smallest of those cosines
NOTE = (
    "M is the BRDF in sr-1 without the cosine, axes (phi_d, theta_d, theta_h, wavelength, out, in); its Stokes axes "
    "are perpendicular to the plane of the light's and the view's directions, not meridian planes; description is UTF-8"
)
STEP = 2.5  # degrees between the file's theta_d and theta_h by default; phi_d has twice that
FINEST, COARSEST = 0.5, 15.0
FLOOR = 0.25  # of the step: smallest cosine in the table, for at the horizon f itself may have no bound
MARGIN = 8  # points beyond each end: the ends' own error, which is small on such fine grids, has faded to 3e-5 there
CHUNK = 1 << 17  # pairs of directions at a time


def directions(cosines: int = COSINES, azimuths: int = AZIMUTHS) -> dict[str, Any]:
    """What a spectrum must be solved for to be written as a table: ``mu_i``, ``mu_o`` and ``phi`` for `vrte.spectrum`.

    ``cosines`` of incidence and of exit each, ``azimuths`` from 0 to 180 degrees, the other half is their mirror image.
    The scene's own features must be resolved by both: twice as many azimuths as its BRDF has Fourier orders, and
    as many cosines as there are nodes, are plenty. Raises SceneError.

    >>> {name: values.size for name, values in directions().items()}
    {'mu_i': 48, 'mu_o': 48, 'phi': 73}
    """
    mu = make_cosines(check_whole("cosines", cosines, FEWEST, MOST))
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 180.0, check_whole("azimuths", azimuths, FEWEST, MOST))}


class Splines:
    """A BRDF at any pair of directions, from one at `directions`."""

    def __init__(self, one: Brdf) -> None:
        s, weighted = stretch_cosines(one.mu_o), one.mueller * (one.mu_i[:, None] + one.mu_o)[:, :, None, None, None]
        for axis in (0, 1):
            polar, weighted = extend_over_pole(s, weighted, np.flip(weighted, 2) * MIRROR, axis, MARGIN)
            polar, weighted = extend_over_horizon(polar, weighted, axis, MARGIN)
        azimuths, weighted = extend_azimuths(one.phi, weighted, 0.0, 180.0, MARGIN)
        self.grids = polar, polar, azimuths
        self.there = weighted.any(axis=(0, 1, 2))  # elements that are not zero throughout
        # one after another: all at once would take five times the memory
        each = (
            compute_coefficients(self.grids, weighted[..., *element]).ravel() for element in np.argwhere(self.there)
        )
        self.coefficients = np.stack(list(each), axis=1)

    def __call__(self, into: Array, out: Array, lowest: float = SMALLEST_COSINE) -> Array:
        """The BRDF (pairs, 4, 4) in meridian planes [sr-1], directions (pairs, 3) away from the surface; cosines
        below ``lowest``, those below the horizon too, are taken for it."""
        mu_i, mu_o = np.clip(into[:, 2], lowest, 1.0), np.clip(out[:, 2], lowest, 1.0)
        # the light travels against ``into``
        turned = np.arctan2(out[:, 1], out[:, 0]) - np.arctan2(into[:, 1], into[:, 0]) - np.pi
        phi = (np.degrees(turned) + 180.0) % 360.0 - 180.0
        matrices = np.zeros((len(into), 4, 4))
        matrices[:, self.there] = (
            make_spline_matrix(self.grids, (stretch_cosines(mu_i), stretch_cosines(mu_o), np.abs(phi)))
            @ self.coefficients
        )
        matrices /= (mu_i + mu_o)[:, None, None]
        matrices[phi < 0.0] *= MIRROR
        return matrices


@dataclass(frozen=True)
class Errors:
    """How far a table is off between its angles, as Mitsuba interpolates: the largest difference of an element over I.

    ``median``: what half of the pairs of directions stay below; ``most``: what 95 of 100 do; ``pairs``: how many.
    """

    median: float
    most: float
    pairs: int

    def __str__(self) -> str:
        return (
            f"off by {self.median:.1e} of I in the median, by less than {self.most:.1e} for 95% of {self.pairs} pairs "
            f"of directions with both cosines above {CHECKED_FROM:g}"
        )


def write_mitsuba(
    spectrum: Spectrum, path: PathName, step_deg: float = STEP, exact: Spectrum | None = None
) -> Errors | None:
    """Writes the BRDFs of five wavelengths to ``path`` for Mitsuba's BSDF ``measured_polarized``, all or nothing.

    ``spectrum`` must hold five wavelengths of whole nanometres, at the `directions` of this module; ``step_deg`` is the
    step of the file's theta_d and theta_h, phi_d has twice that. ``exact``, the same spectrum at any other directions,
    is what the table is compared with; the errors are returned. A field ``description``, which Mitsuba leaves alone,
    says what made the file. Raises SceneError, OSError.
    """
    axes, nanometres = make_axes(step_deg), check_wavelengths(spectrum.wavelength_um)
    check_directions(spectrum)
    table = tabulate_spectrum(spectrum, axes)
    errors = None if exact is None else measure_errors(table, axes, exact)
    described = describe_result(spectrum) | {"note": NOTE}
    if spectrum.specular is not None:
        described["mirrored"] = describe_beam(spectrum)
    if errors is not None:
        described["interpolation"] = str(errors)
    text = "\n".join(f"{name}: {value}" for name, value in described.items())
    fields: dict[str, NDArray[Any]] = {name: axes[k][None].astype(np.float32) for k, name in enumerate(AXES)}
    fields |= {"wvls": nanometres, "M": table, "description": np.frombuffer(text.encode("utf-8"), np.uint8)}
    write_tensors(fields, path)
    return errors


def describe_beam(spectrum: Spectrum) -> str:
    """What of the light no table has, in words: beams reflected by smooth surfaces."""
    shares, steep = spectrum.specular_reflectance, int(np.argmax(spectrum.mu_i))
    assert shares is not None
    low, high = (f"{share:.3g}" for share in (shares[:, steep].min(), shares[:, steep].max()))
    where = f"{low if low == high else f'{low} to {high}'} of the light at mu_i {spectrum.mu_i[steep]:.3g}"
    return f"left out is the mirrored beam, {where}: no table holds what goes into one direction"


def make_axes(step_deg: float) -> Axes:
    """Axes with that step in theta, or the next smaller one that divides 90 degrees."""
    step = check_number("step_deg", step_deg, FINEST, COARSEST, f"between {FINEST:g} and {COARSEST:g} degrees")
    count = math.ceil(90.0 / step - 1e-9)
    theta = np.linspace(0.0, 0.5 * np.pi, count + 1)
    return np.linspace(-np.pi, np.pi, 2 * count + 1), theta, theta


def check_wavelengths(wavelengths_um: Sequence[float] | Array) -> NDArray[np.uint16]:
    """The wavelengths in nanometres, if they are five whole ones. Raises SceneError."""
    if len(wavelengths_um) != WAVELENGTHS:
        words = f"exactly {WAVELENGTHS} wavelengths, not {len(wavelengths_um)}"
        raise SceneError(f"Mitsuba's measured_polarized takes {words}")
    nanometres = 1e3 * np.asarray(wavelengths_um)
    if np.abs(nanometres - nanometres.round()).max() > 1e-6 or nanometres[-1] > np.iinfo(np.uint16).max:
        raise SceneError("Mitsuba's measured_polarized takes wavelengths of whole nanometres, up to 65535")
    return nanometres.round().astype(np.uint16)


def check_directions(spectrum: Spectrum) -> None:
    """Whether the spectrum is for the directions that splines want. Raises SceneError."""
    counts = spectrum.mu_i.size, spectrum.phi.size
    if all(FEWEST <= count <= MOST for count in counts):
        pairs = [(getattr(spectrum, name), wanted) for name, wanted in directions(*counts).items()]
        if all(one.shape == wanted.shape and np.allclose(one, wanted, 0.0, SAME) for one, wanted in pairs):
            return
    raise SceneError(
        "a table for Mitsuba must be solved for its own directions: "
        "vrte.spectrum(..., **vrte.formats.measured_polarized.directions())"
    )


def tabulate_spectrum(spectrum: Spectrum, axes: Axes) -> NDArray[np.float32]:
    """The field M (phi_d, theta_d, theta_h, wavelength, 4, 4) [sr-1]: mirror symmetry gives the half with phi_d < 0."""
    phi_d, theta_d, theta_h = axes
    half = phi_d.size // 2
    into, out, across = make_direction_pairs((phi_d[half:], theta_d, theta_h))
    lowest = FLOOR * math.sin(theta_h[1])
    found = np.empty((phi_d.size, theta_d.size, theta_h.size, len(spectrum), 4, 4), np.float32)
    for index, one in enumerate(spectrum):
        matrices = sample_in_scattering_plane(Splines(one), into, out, across, lowest)
        matrices = matrices.reshape(-1, theta_d.size, theta_h.size, 4, 4)
        found[half:, :, :, index] = matrices
        found[:half, :, :, index] = (matrices * MIRROR)[:0:-1]
    return found


def make_direction_pairs(axes: Axes) -> tuple[Array, Array, Array]:
    """Directions of light and view away from the surface, and the normal of their plane, each (pairs, 3), z upward: the
    half vector lies in y = 0; across is half vector x difference vector."""
    phi, spread, half = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    middle = np.stack([np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    tangent = np.stack([np.cos(half), 0.0 * half, -np.sin(half)], axis=1)
    aside = np.cos(phi)[:, None] * tangent + np.sin(phi)[:, None] * np.array([0.0, 1.0, 0.0])
    along, sideways = np.cos(spread)[:, None] * middle, np.sin(spread)[:, None] * aside
    return along + sideways, along - sideways, np.cross(middle, aside)


def measure_errors(table: NDArray[np.float32], axes: Axes, exact: Spectrum) -> Errors:
    """How far the table is off at the directions of another spectrum."""
    found = evaluate_table(table, axes, exact.mu_i, exact.mu_o, exact.phi)
    wanted = exact.mueller.reshape(len(exact), -1, 4, 4).swapaxes(0, 1)
    off = np.abs(found - wanted).max(axis=(2, 3)) / wanted[:, :, 0, 0]
    return Errors(float(np.median(off)), float(np.quantile(off, 0.95)), len(off))


def make_unit_vectors(mu: Array, azimuth: Array) -> Array:
    """Unit vectors (n, 3)."""
    across = np.sqrt(1.0 - mu**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), mu], axis=1)


def evaluate_table(table: NDArray[np.floating], axes: Axes, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
    """What Mitsuba makes of the table M at all pairs of these directions, in meridian planes: (n, wavelength, 4, 4)."""
    from scipy.interpolate import RegularGridInterpolator

    cosine, seen, azimuth = (axis.ravel() for axis in np.meshgrid(mu_i, mu_o, phi_deg, indexing="ij"))
    into = make_unit_vectors(cosine, np.full_like(cosine, np.pi))  # light that travels along the azimuth 0
    out = make_unit_vectors(seen, np.radians(azimuth))
    middle = normalise(into + out)
    sideways = normalise(np.cross([0.0, 0.0, 1.0], middle))
    phi = np.arctan2((sideways * into).sum(axis=1), (np.cross(sideways, middle) * into).sum(axis=1))
    spread = np.arccos(np.clip((middle * into).sum(axis=1), -1.0, 1.0))
    indices = np.stack([phi, spread, np.arccos(np.clip(middle[:, 2], -1.0, 1.0))], axis=1)
    across = normalise(np.cross(into, out))
    from_light, to_view = turn(-into, across)[:, None], turn(out, across)[:, None]
    return np.asarray(to_view.swapaxes(2, 3) @ RegularGridInterpolator(axes, table)(indices) @ from_light)


def normalise(vectors: Array) -> Array:
    """Vectors (n, 3) of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def sample_in_scattering_plane(splines: Splines, into: Array, out: Array, across: Array, lowest: float) -> Array:
    """The BRDF (pairs, 4, 4) in Mitsuba's axes: one is ``across``, perpendicular to the plane of both directions."""
    found = np.empty((len(into), 4, 4))
    for start in range(0, len(into), CHUNK):
        part = slice(start, start + CHUNK)
        from_light, to_view = turn(-into[part], across[part]), turn(out[part], across[part])
        found[part] = to_view @ splines(into[part], out[part], lowest) @ from_light.swapaxes(1, 2)
    return found


def turn(travel: Array, across: Array) -> Array:
    """Matrices (pairs, 4, 4) that take Stokes vectors from the meridian plane of a direction of travel to the plane
    perpendicular to ``across``, with Q as perpendicular minus parallel."""
    azimuth = np.arctan2(travel[:, 1], travel[:, 0])
    horizontal = np.hypot(travel[:, 0], travel[:, 1])
    # theta-hat, along which l lies, and r with r x l along the direction of travel: minus phi-hat
    meridian = np.stack([travel[:, 2] * np.cos(azimuth), travel[:, 2] * np.sin(azimuth), -horizontal], axis=1)
    beside = np.stack([np.sin(azimuth), -np.cos(azimuth), 0.0 * azimuth], axis=1)
    inside = np.cross(travel, across)  # l of the other plane, or its opposite, which is the same axis
    cosine, sine = (meridian * inside).sum(axis=1), (beside * inside).sum(axis=1)
    found = np.zeros((len(travel), 4, 4))
    found[:, 0, 0] = found[:, 3, 3] = 1.0
    found[:, 2, 2] = cosine**2 - sine**2
    found[:, 1, 1] = -found[:, 2, 2]
    found[:, 1, 2] = found[:, 2, 1] = -2.0 * sine * cosine
    return found
