"""Sums over Fourier orders and single scattering on a device against those of the compiled core."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl import sums
from vrte.discrete_ordinates.execution.sums import find_column_kinds
from vrte.discrete_ordinates.planning.azimuths import compute_cos_sin, fold_azimuths

from .helpers import assert_close
from .test_sums import FULL_TURN, some_kernels

MANY_AZIMUTHS = np.append(FULL_TURN, np.arange(0.0, 360.0, 7.5))


def a_crew(threads: int) -> ThreadTeam:
    """Who has not worked yet."""
    return ThreadTeam(threads, np.zeros(threads), np.zeros(1, np.int32))


def integers(*lists: Sequence[int]) -> list[np.ndarray]:
    return [np.array(values, np.int32) for values in lists]


SUMMED = ("kernels", "stokes", "kind", "place", "cosine", "sine", "angle", "sign", "levels", "rows", "scale")


def both_sums(either_form: Any, values: tuple[Any, ...], shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """A table of ones, and what the core and the device add to it, in two pieces."""
    tables = np.ones(shape), np.ones(shape)
    arguments = dict(zip(SUMMED, values, strict=True))
    for first, last in ((0, 1), (1, shape[1])):
        _core.azimuthal_sum(a_crew(2), **arguments, first=first, last=last, out=tables[0])
        sums.azimuthal_sum(either_form, a_crew(2), **arguments, first=first, last=last, out=tables[1])
    return tables


@pytest.mark.parametrize("stokes", [(0,), (0, 1), (2, 3), (3,), (0, 1, 2, 3)])
@pytest.mark.parametrize(("kind", "place"), [((0, 0, 1, 1), (3, 0, 2, 1)), ((1,), (0,)), ((0, 1, 0), (1, 1, 0))])
def test_azimuthal_sum(either_form: Any, stokes: Sequence[int], kind: Sequence[int], place: Sequence[int]) -> None:
    orders = np.array([0, 1, 2, 5, 6, 9, 30], np.int32)
    kernels = some_kernels(orders.size, len(kind))[..., list(stokes)]
    azimuths = fold_azimuths(MANY_AZIMUTHS)
    levels, rows = [2, 0], [20, 3, 3, 0, 7, 8, 9, 10, 11, 12, 13]
    arguments = (
        kernels,
        *integers(stokes, kind, place),
        *azimuths.cos_sin(orders),
        azimuths.angle,
        azimuths.sign,
        *integers(levels, rows),
        np.array([1.0, 0.5, 2.0, -3.0]),
    )
    shape = (len(levels), 4, len(rows), MANY_AZIMUTHS.size, 4, max(place) + 1)
    expected, found = both_sums(either_form, arguments, shape)
    assert_close(found, expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())


def test_azimuthal_sum_of_more_orders_than_are_kept_at_hand_and_of_one_azimuth(either_form: Any) -> None:
    for n_order, phi in ((70, np.array([33.0])), (0, FULL_TURN)):
        azimuths = fold_azimuths(phi)
        arguments = (
            some_kernels(n_order, 1),
            *integers(range(4), [0], [0]),
            *azimuths.cos_sin(np.arange(n_order, dtype=np.int32)),
            azimuths.angle,
            azimuths.sign,
            *integers(range(3), range(21)),
            np.ones(4),
        )
        expected, found = both_sums(either_form, arguments, (3, 4, 21, phi.size, 4, 1))
        assert_close(found, expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())


def test_orders_of_many_scenes_are_added_at_once(either_form: Any) -> None:
    """Kernels as stacks of matrices hold them, other numbers of orders, factors of rows and Stokes components, and a
    buffer that more than these tables share."""
    rng = np.random.default_rng(3)
    n_order, azimuths, first, shape = [5, 3], fold_azimuths(FULL_TURN), 12, (1, 2, 3, FULL_TURN.size, 4, 4)
    n_out, columns, size = 5, 2 * 4, int(np.prod(shape))
    stack = rng.standard_normal((sum(n_order), columns, 24))  # rows padded
    cosine, sine = azimuths.cos_sin(np.arange(5, dtype=np.int32))
    stokes, kind, place, rows = integers(range(4), [0, 0, 1, 1], range(4), [4, 0, 2])
    factors = rng.standard_normal((n_out, 4))
    buffer = either_form.upload(np.ones(first + 3 * size))
    sums.add_orders(
        either_form,
        sums.Kernels(either_form.upload(stack), (columns * 24, 0, 4 * 24, 24, 4, 1)),
        either_form.upload(np.array([[0, 0, 5, 0], [1, 5, 3, 0]], np.int32)),
        sums.upload_entries(either_form, stokes, kind, place, 4, cosine, sine),
        sums.upload_azimuths(either_form, azimuths.angle, azimuths.sign, cosine.shape[1]),
        either_form.upload(np.zeros(1, np.int32)),
        either_form.upload(rows),
        either_form.upload(np.array([0.5, 2.0])),
        either_form.upload(factors),
        (0, 2),
        sums.Table(buffer, shape, 2, first, size),
    )
    values = either_form.download(buffer)
    np.testing.assert_array_equal(np.delete(values, np.s_[first : first + 2 * size]), 1.0)
    for scene, count in enumerate(n_order):
        expected = np.ones(shape)
        kernels = stack[5 * scene : 5 * scene + count, :, :20].reshape(count, 1, 2, 4, n_out, 4) * factors
        tables = cosine[:count], sine[:count], azimuths.angle, azimuths.sign, *integers([0]), rows
        given = zip(SUMMED, (kernels, stokes, kind, place, *tables, np.array([0.5, 2.0])), strict=True)
        _core.azimuthal_sum(a_crew(1), **dict(given), first=0, last=2, out=expected)
        found = values[first + scene * size : first + (scene + 1) * size].reshape(shape)
        assert_close(found, expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())


MU0, MU = np.array([0.25, 0.6, 1.0]), np.array([0.25, -0.6, -1.0, 0.6, 1.0, -0.3, 0.05])


def scattering_arguments(coefficients: np.ndarray, columns: np.ndarray, place: Sequence[int]) -> dict[str, Any]:
    """Arguments of `add_single_scattering` but for the piece."""
    azimuths = fold_azimuths(MANY_AZIMUTHS)
    path = np.random.default_rng(2).uniform(0.5, 2.0, (2, MU0.size, MU.size))
    path[1, 2, 4] = path[:, 0, 1] = 0.0
    cosine, sine = compute_cos_sin(azimuths.distinct)
    return {
        "table": _core.series_table(coefficients),
        "path": path,
        "mu0": MU0,
        "mu": MU,
        "cos_phi": cosine,
        "sin_phi": sine,
        "angle": azimuths.angle,
        "sign": azimuths.sign,
        "columns": columns,
        "kind": find_column_kinds(columns),
        "place": np.array(place, np.int32),
    }


SPHERE = vrte.spheres(1.5, radius_um=0.6, wavelength_um=0.5).phase_matrix.coefficients
MIXED = np.array([[1.0, -0.3, 0.0, 0.0], [0.0, 0.0, 0.2, 0.4], [0.0, 1.0, 0.0, 0.0]])


@pytest.mark.parametrize("terms", [1, 2, 3, 27])
@pytest.mark.parametrize(("columns", "place"), [(np.eye(4), (0, 1, 2, 3)), (MIXED, (0, 0, 1)), (MIXED[1:2], (0,))])
def test_single_scattering(either_form: Any, terms: int, columns: np.ndarray, place: Sequence[int]) -> None:
    """Straight on and straight back included, where a plane has to be chosen."""
    arguments = scattering_arguments(SPHERE[:terms], columns, place)
    tables = [np.ones((2, MU0.size, MU.size, MANY_AZIMUTHS.size, 4, max(place) + 1)) for _ in range(2)]
    for first, last in ((0, 1), (1, MU0.size)):
        _core.add_single_scattering(a_crew(2), **arguments, first=first, last=last, out=tables[0])
        sums.add_single_scattering(either_form, a_crew(2), **arguments, first=first, last=last, out=tables[1])
    assert_close(tables[1], tables[0], rtol=0.0, atol=1e-14 * np.abs(SPHERE[:terms]).sum())
    np.testing.assert_array_equal(tables[1][:, 0, 1], 1.0)


def test_scatterers_of_many_scenes_are_added_at_once(either_form: Any) -> None:
    """None, two and one in a scene, with other numbers of terms."""
    rng = np.random.default_rng(4)
    tables = [_core.series_table(SPHERE[:terms]) for terms in (27, 3, 10)]
    paths = [rng.uniform(0.5, 2.0, (2, MU0.size, MU.size)) for _ in tables]
    arguments = scattering_arguments(SPHERE, np.eye(4), range(4))
    names = "cos_phi", "sin_phi", "angle", "sign", "columns", "kind", "place"
    cosine, sine, angle, sign, columns, kind, place = (arguments[name] for name in names)
    shape = (2, MU0.size, MU.size, MANY_AZIMUTHS.size, 4, 4)
    size = int(np.prod(shape))
    result = either_form.zeros((3 * size + 4,))
    pairs = list(zip(tables, paths, strict=True))
    sums.add_scattering(
        either_form,
        sums.upload_scatterers(either_form, [[], pairs[:2], pairs[2:]]),
        sums.upload_directions(either_form, MU0, MU, cosine, sine, columns, kind, place),
        sums.upload_azimuths(either_form, angle, sign, cosine.size),
        (0, MU0.size),
        sums.Table(result, shape, 3, 4, size),
    )
    expected = np.zeros((3, *shape))
    for scene, (table, path) in zip((1, 1, 2), pairs, strict=True):
        given = {**arguments, "table": table, "path": path}
        _core.add_single_scattering(a_crew(1), **given, first=0, last=MU0.size, out=expected[scene])
    found = either_form.download(result)[4:].reshape(3, *shape)
    assert_close(found, expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())


def test_what_cannot_be_scattered_is_refused(either_form: Any) -> None:
    arguments = scattering_arguments(SPHERE, np.tile(np.eye(4), (5, 1)), [0] * 20)
    with pytest.raises(ValueError, match="at most 16 columns"):
        sums.add_single_scattering(
            either_form, a_crew(1), **arguments, first=0, last=1, out=np.zeros((2, 3, 7, 1, 4, 1))
        )
    arguments = scattering_arguments(SPHERE, np.eye(4), range(4))
    arguments["table"] = arguments["table"][:-1]
    with pytest.raises(ValueError, match="series_table"):
        sums.add_single_scattering(either_form, a_crew(1), **arguments, first=0, last=1, out=np.zeros(1))
