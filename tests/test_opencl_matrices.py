"""Products and inverses on a device, in both forms, against NumPy and LAPACK."""

from typing import Any

import numpy as np
import pytest

from vrte.basics.errors import DeviceError
from vrte.cl import matrices
from vrte.cl.matrices import (
    Stack,
    choose_panel_width,
    download_stack,
    invert,
    make_stack,
    multiply_stacks,
    upload_stack,
)
from vrte.cl.session import Session

from .helpers import assert_close

SIZES = (
    (1, 1, 1),
    (3, 5, 2),
    (8, 8, 8),
    (13, 40, 7),
    (65, 17, 66),
    (100, 30, 129),
    (96, 33, 31),
    (120, 7, 80),
)  # rows, inner, columns


@pytest.fixture
def session(either_form: Session) -> Session:
    """Both forms of products and inverses."""
    return either_form


def transposed(stack: np.ndarray) -> np.ndarray:
    """(item, column, row) as (item, row, column)."""
    return stack.transpose(0, 2, 1)


def inverted(session: Session, stored: np.ndarray, items: Any) -> tuple[np.ndarray, np.ndarray]:
    """(item, column, row) after `invert`, and info."""
    count, rows, _ = stored.shape
    stack = upload_stack(session, stored)
    scratch = session.empty((count, 16 * rows)), session.empty((count, rows), np.int32)
    info = session.zeros((count,), np.int32)
    invert(session, session.upload(np.array(items, np.int32)), stack, *scratch, info)
    return download_stack(session, stack), session.download(info)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("by_transpose", [False, True])
def test_products(session: Session, size: tuple[int, int, int], by_transpose: bool) -> None:
    rows, inner, columns = size
    rng = np.random.default_rng(rows)
    a = rng.standard_normal((4, inner, rows))
    b = rng.standard_normal((4, inner, columns) if by_transpose else (4, columns, inner))
    c = rng.standard_normal((4, columns, rows))
    stacks = [upload_stack(session, values) for values in (a, b, c)]
    items = np.array([3, 0, 2], np.int32)
    multiply_stacks(session, session.upload(items), *stacks, alpha=1.5, beta=-0.7, transposed=by_transpose)  # type: ignore[misc]
    expected = c.copy()
    for item in items:
        right = b[item] if by_transpose else b[item].T
        expected[item] = (1.5 * a[item].T @ right - 0.7 * c[item].T).T
    assert_close(download_stack(session, stacks[2]), expected, rtol=0.0, atol=1e-14 * inner)
    room = session.download(stacks[2].data).reshape(4, columns, -1)
    assert not room[:, :, rows:].any()


def test_without_beta_what_was_there_does_not_matter(session: Session) -> None:
    a = np.random.default_rng(1).random((1, 9, 9))
    stack, made = upload_stack(session, a), upload_stack(session, np.full((1, 9, 9), np.nan))
    multiply_stacks(session, session.upload(np.zeros(1, np.int32)), stack, stack, made)
    assert_close(transposed(download_stack(session, made))[0], a[0].T @ a[0].T, rtol=1e-14, atol=0.0)


def test_a_part_leaves_the_others_alone(session: Session) -> None:
    rng = np.random.default_rng(2)
    a, c = rng.random((2, 24, 24)), rng.random((2, 24, 24))
    big, small = upload_stack(session, c), upload_stack(session, a)
    multiply_stacks(
        session, session.upload(np.arange(2, dtype=np.int32)), small.part(8, 0, 8, 24), small, big.part(16, 5, 8, 7)
    )
    expected = c.copy()
    for item in range(2):
        expected[item].T[16:24, 5:12] = a[item].T[8:16] @ a[item].T[:, :7]
    assert_close(download_stack(session, big), expected, rtol=1e-13, atol=0.0)


def test_nothing_to_do(session: Session) -> None:
    none = session.upload(np.zeros(0, np.int32))
    stack = make_stack(session, 2, 5, 5)
    multiply_stacks(session, none, stack, stack, stack)
    invert(session, none, stack, session.empty((2, 80)), session.empty((2, 5), np.int32), session.zeros((2,), np.int32))
    assert not download_stack(session, stack).any()


@pytest.mark.parametrize("rows", [1, 2, 7, 16, 17, 40, 83, 160])
def test_inverses(session: Session, rows: int) -> None:
    rng = np.random.default_rng(rows)
    stored = rng.standard_normal((3, rows, rows)) + 2.0 * np.sqrt(rows) * np.eye(rows)
    found, info = inverted(session, stored, [2, 0])
    assert not info.any()
    np.testing.assert_array_equal(found[1], stored[1])
    for item in (0, 2):
        assert_close(found[item], np.linalg.inv(stored[item]), rtol=0.0, atol=1e-14 * rows)


def test_rows_are_exchanged_where_a_pivot_is_small(session: Session) -> None:
    rng = np.random.default_rng(3)
    stored = rng.standard_normal((2, 50, 50))
    stored[0] = np.roll(np.diag(rng.random(50) + 0.5), 7, axis=0)
    stored[1][np.diag_indices(50)] = 0.0
    found, info = inverted(session, stored, [0, 1])
    assert not info.any()
    for item in range(2):
        condition = np.linalg.cond(stored[item])
        assert_close(found[item] @ stored[item], np.eye(50), rtol=0.0, atol=1e-14 * condition)


def test_a_singular_matrix_is_told(session: Session) -> None:
    stored = np.stack([np.eye(20), np.eye(20), np.zeros((20, 20))])
    stored[1][18, 18] = 0.0
    found, info = inverted(session, stored, [0, 1, 2])
    np.testing.assert_array_equal(info, [0, 1, 1])
    np.testing.assert_array_equal(found[0], np.eye(20))


@pytest.mark.parametrize("width", [1, 3, 5])
def test_little_local_memory(session: Session, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matrices, "choose_panel_width", lambda rows, local_bytes: width)
    stored = np.random.default_rng(4).standard_normal((2, 37, 37)) + 12.0 * np.eye(37)
    found, info = inverted(session, stored, [0, 1])
    assert not info.any()
    assert_close(found, np.linalg.inv(stored), rtol=0.0, atol=1e-14)


def test_no_local_memory_for_one_column() -> None:
    with pytest.raises(DeviceError, match="5000 rows are too large for the local memory"):
        choose_panel_width(5000, 32 << 10)


def test_parts_begin_at_strips() -> None:
    with pytest.raises(AssertionError):
        Stack(None, 20, 20, 24, 480).part(5, 0, 8, 8)
