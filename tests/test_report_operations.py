"""Operations of the methods: what is counted from shapes is what products and factorisations of a run add up to."""

from typing import Any

import numpy as np
import pytest

import vrte
from bench.methods import operations, reference, scenes
from vrte.methods import successive_orders
from vrte.methods.parts import on_nodes, slab

TALLY = [0.0]
TWO = scenes.Case("two layers", "Henyey-Greenstein over Rayleigh", "over a base", (32, 24))


class Tallied(np.ndarray):  # type: ignore[type-arg]
    """An array whose products and factorisations are added up, real ones 2 a b c."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **keywords: Any) -> Any:
        plain = [np.asarray(item) for item in inputs]
        out = keywords.pop("out", None)
        found = getattr(ufunc, method)(*plain, **keywords)
        if ufunc is np.matmul:
            TALLY[0] += 2.0 * found.size * plain[0].shape[-1]
        if out is not None:
            np.asarray(out[0])[...] = found
            return out[0]
        return found.view(Tallied) if isinstance(found, np.ndarray) else found

    def __array_function__(self, function: Any, types: Any, arguments: Any, keywords: Any) -> Any:
        if function is np.linalg.solve:
            matrix, right = (np.asarray(item) for item in arguments)
            TALLY[0] += matrix[..., 0, 0].size * operations.count_solve(matrix.shape[-1], right.shape[-1])
        if function is np.linalg.inv:
            TALLY[0] += 2.0 * float(arguments[0].shape[-1]) ** 3
        if function is np.einsum:
            TALLY[0] += 2.0 * extents(*arguments)
        found = super().__array_function__(function, types, arguments, keywords)
        return found.view(Tallied) if isinstance(found, np.ndarray) else found


def extents(labels: str, *arrays: Any) -> float:
    """How many products a sum over indices takes; sums over any axes ("...") are of results, and few."""
    if "..." in labels:
        return 0.0
    sizes = {
        letter: size
        for part, array in zip(labels.split("->")[0].split(","), arrays, strict=True)
        for letter, size in zip(part, array.shape, strict=True)
    }
    return float(np.prod(list(sizes.values())))


@pytest.fixture
def tally(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What is added up from now on, of all that comes from what layers scatter, and from weights of steps."""
    scattered, weights = on_nodes.OnNodes.scatter, slab.compute_step_weights

    def watched(self: on_nodes.OnNodes, order: int, layer: int) -> on_nodes.Scattered:
        return on_nodes.Scattered(*(matrix.view(Tallied) for matrix in scattered(self, order, layer)))

    def weighed(*given: Any) -> tuple[Any, Any]:
        ways, fades = weights(*given)
        return ways.view(Tallied), fades

    monkeypatch.setattr(on_nodes.OnNodes, "scatter", watched)
    monkeypatch.setattr(slab, "compute_step_weights", weighed)
    for name in ("weigh_downward", "weigh_upward"):
        plain = getattr(successive_orders, name)
        monkeypatch.setattr(successive_orders, name, lambda *given, plain=plain: plain(*given).view(Tallied))
    TALLY[0] = 0.0
    return TALLY


@pytest.mark.parametrize(
    ("method", "scene"),
    [
        ("adding-doubling", "Rayleigh, small"),
        ("adding-doubling", "without end, small"),
        ("adding-doubling", "two layers"),
        ("invariant-imbedding", "Rayleigh, small"),
        ("invariant-imbedding", "without end, small"),
        ("invariant-imbedding", "two layers"),
        ("successive-orders", "Rayleigh, small"),
        ("successive-orders", "two layers"),
    ],
)
def test_what_is_counted_is_what_is_done(tally: list[float], method: str, scene: str) -> None:
    case = TWO if scene == "two layers" else scenes.find_case(scene)
    field = reference.solve_case(case, method=method, nodes=6, threads=1)
    done = tally[0]
    found = operations.count_operations(case, method, {"nodes": 6}, field)
    # doublings of a layer without end are the most that any order took
    assert 0.98 * done < found < (1.2 if "without end" in scene else 1.02) * done


def test_the_exact_method_has_its_plan_and_closed_forms_nothing() -> None:
    case = scenes.find_case("Rayleigh, small")
    found = operations.count_operations(case, "discrete-ordinates", {"nodes": 6}, reference.solve_case(case, nodes=6))
    arguments = case.scene, case.mu0, case.stokes, case.signed_mu, scenes.PHI, case.tau
    assert found == vrte.plan("radiance", *arguments, nodes=6).as_dict()["operations"] > 0.0
    parts = {"parts": {"unpolarized": {"operations": 1.0}, "polarized": {"operations": 2.0}}}
    assert operations.count_planned_operations(parts) == 3.0
    assert np.isnan(
        operations.count_operations(case, "small-angle", {}, reference.solve_case(case, method="small-angle"))
    )
