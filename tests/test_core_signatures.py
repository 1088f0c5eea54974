"""The compiled core's declarations: what follows from them is committed, and arguments are checked against them."""

import ast
import inspect
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vrte import _core
from vrte.basics.running import ThreadTeam

ROOT = Path(__file__).parents[1]
SAID = runpy.run_path(str(ROOT / "vrte/core/declare.py"))["Declarations"](ROOT / "vrte/core/stages.toml")
STUB = (ROOT / "vrte/_core.pyi").read_text("utf-8")
DECLARED = {node.name: node.args for node in ast.walk(ast.parse(STUB)) if isinstance(node, ast.FunctionDef)}
MATRIX, CREW = np.diag([3.0, 2.0, 1.0]), ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32))


def test_the_stub_is_what_is_declared() -> None:
    """A build writes it anew where it is not."""
    assert SAID.write_stub() == STUB


def test_what_is_declared_is_what_is_compiled() -> None:
    assert SAID.stages.keys() <= DECLARED.keys()
    for name, args in DECLARED.items():
        compiled = inspect.signature(getattr(_core, name)).parameters.values()
        in_order = [each.name for each in compiled if each.kind is not inspect.Parameter.KEYWORD_ONLY]
        named = {each.name for each in compiled if each.kind is inspect.Parameter.KEYWORD_ONLY}
        more = [args.kwarg.arg] if args.kwarg else []
        assert in_order == [arg.arg for arg in args.args if arg.arg != "self"] + more * (name == "count_scratch"), name
        assert more or named == {arg.arg for arg in args.kwonlyargs}, name


def test_stages_say_what_they_take() -> None:
    words = inspect.getdoc(_core.reflect_semi_infinite) or ""
    assert "up : ndarray (n_order, n_in, n_col, n_out_rows), optional\n    radiance times 2 pi" in words


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: _core.symmetric_eigenproblem(MATRIX[:2].copy()), ValueError, r"shape \(n 2, n 2\), not \(2, 3\)"),
        (lambda: _core.symmetric_eigenproblem(MATRIX[0]), ValueError, r"matrix must have the shape \(n, n\), not \(3,"),
        (lambda: _core.symmetric_eigenproblem(MATRIX.astype(np.float32)), ValueError, "float64, not float32"),
        (lambda: _core.symmetric_eigenproblem(MATRIX[::2, ::2]), ValueError, "matrix must be contiguous"),
        (lambda: _core.symmetric_eigenproblem([[1.0]]), TypeError, "matrix must be an array, not list"),  # type: ignore[arg-type]
        (lambda: _core.symmetric_eigenproblem(MATRIX, values=np.zeros(4)), ValueError, r"values .*\(n 3\), not \(4,"),
        (lambda: _core.symmetric_eigenproblem(MATRIX, None, _read_only()), ValueError, "contiguous and writeable"),  # type: ignore[arg-type]
        (lambda: _core.symmetric_eigenproblem(MATRIX, rows=3), TypeError, "does not take rows"),  # type: ignore[call-arg]
        (lambda: _core.symmetric_eigenproblem(), TypeError, "symmetric_eigenproblem needs matrix"),  # type: ignore[call-arg]
        (lambda: _core.facet_orders(), TypeError, "takes a crew, and its arrays by name"),  # type: ignore[call-arg]
        (lambda: _core.facet_orders(CREW), TypeError, "facet_orders needs n_order"),  # type: ignore[call-arg]
    ],
)
def test_arguments_are_checked(call: Callable[[], Any], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        call()


def _read_only() -> np.ndarray:
    values = np.zeros(3)
    values.setflags(write=False)
    return values


def test_sizes_must_make_each_other() -> None:
    given: dict[str, Any] = {"orders": np.zeros(1, np.int32), "members": np.arange(2, dtype=np.int32), "tolerance": 1.0}
    given |= {"coefficients": np.zeros((1, 3, 6)), "terms": np.ones(1, np.int32), "albedo": np.ones(1)}
    given |= {"halves": True, "coarse": True}
    given |= {"directions": np.ones(3), "weights": np.ones(4), "columns": np.ones((1, 2))}
    given |= {"out_places": np.zeros(1, np.int32), "in_places": np.zeros(1, np.int32)}
    with pytest.raises(ValueError, match=r"n_placed must be n_node \+ n_off = 4 \+ .*, not 3"):
        _core.reflect_semi_infinite(CREW, **given)


def test_what_nobody_gives_is_allocated() -> None:
    found = _core.symmetric_eigenproblem(MATRIX)
    assert sorted(found["values"]) == [1.0, 2.0, 3.0]
    values = np.zeros(3)
    assert _core.symmetric_eigenproblem(MATRIX, values=values).keys() == {"vectors", "info"}
    assert values.tolist() == found["values"].tolist()


def test_calls_share_arrays() -> None:
    """What a call has not comes from those that are shared; its own count, and what it does not take is refused."""
    other = np.diag([5.0, 4.0])
    shared = {"matrix": MATRIX, "nobody": MATRIX}
    found = _core.call_together("symmetric_eigenproblem", CREW, [{}, {"matrix": other}], shared)
    assert [each["values"].tolist() for each in found] == [[3.0, 2.0, 1.0], [5.0, 4.0]]
    with pytest.raises(TypeError, match="does not take nobody"):
        _core.call_together("symmetric_eigenproblem", CREW, [{"nobody": MATRIX}], shared)
    with pytest.raises(TypeError, match="needs matrix"):
        _core.call_together("symmetric_eigenproblem", CREW, [{"matrix": None}], shared)
