"""method="auto": its rules, what they promise, and whether they agree with the report."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench.methods import Row
from bench.methods_page import make_score_rows
from bench.rules import find_disagreements, read_report_rows
from tests.random_scenes import Asked, asked, faint
from vrte.calls.plan import make_request
from vrte.methods.parts.auto import (
    RULES,
    bound_multiple_scattering,
    count_special_wishes,
    find_rule,
)
from vrte.request.how import EXACT

REPORT = Path(__file__).parents[1] / "docs" / "explanation" / "methods" / "methods.csv"
THIN = vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 1e-3)])
MIDDLE = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 30), 0.99, 1.0)])
DEEP = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 100.0)])
KEYS = {"mu0": 0.6, "mu": [0.3, 0.9, -0.3, -0.9], "phi": [0.0, 90.0], "threads": 1}


@pytest.mark.parametrize(
    ("scene", "accuracy", "place", "by_hand"),
    [
        (THIN, 1e-2, 0, {"method": "single-scattering"}),
        (MIDDLE, 1e-2, 1, {"accuracy": 1e-2}),
        (DEEP, 1e-2, 1, {"accuracy": 1e-2}),
        (MIDDLE, 1e-8, 1, {"accuracy": 1e-8}),
    ],
)
def test_it_solves_as_the_method_that_it_took_and_says_so(
    scene: vrte.Scene, accuracy: float, place: int, by_hand: dict[str, object]
) -> None:
    keys, rule = KEYS | {"tau": [0.0, scene.thickness]}, RULES[place]
    reported = f"auto, rule {place + 1} ({rule.name}): {rule.why}"
    found, expected = (
        vrte.radiance(scene, **keys, accuracy=accuracy, method="auto"),
        vrte.radiance(scene, **keys, **by_hand),
    )
    np.testing.assert_array_equal(found.stokes, expected.stokes)
    np.testing.assert_array_equal(found.flux_up, expected.flux_up)
    made = found.diagnostics
    assert (made["method"], made["method_rule"], made["accuracy"]) == (rule.method, reported, accuracy)
    assert (made["promised"], made["notes"], made["nodes"]) == (True, [], expected.diagnostics["nodes"])
    assert "method_rule" not in expected.diagnostics
    plan = vrte.plan("radiance", scene, **keys, accuracy=accuracy, method="auto")
    assert reported in " ".join(str(plan).split())
    assert (plan.as_dict()["method"], plan.as_dict()["method_rule"]) == (rule.method, reported)
    assert bool(plan.blocks) == (rule.method == EXACT)
    assert ("which the solve compares with" in str(plan)) == (place == 1)
    assert max(map(len, str(plan).splitlines())) <= 120
    assert "auto, rule" not in str(vrte.plan("radiance", scene, **keys))


MUELLER = vrte.MuellerBase(lambda i, o, phi: np.zeros((*np.broadcast_shapes(*map(np.shape, (i, o, phi))), 4, 4)))


@pytest.mark.parametrize(
    ("scene", "wish"),
    [
        (THIN, {"mu": None}),
        (THIN, {"algorithm": "doubling"}),
        (THIN, {"truncation": "none"}),
        (THIN, {"verify": True}),
        (THIN, {"backend": "opencl"}),
        (vrte.Scene(THIN.layers, MUELLER), {}),
        (vrte.Scene([vrte.Interface(1.0, 1.5), *THIN.layers]), {}),
        (vrte.Scene(THIN.layers, vrte.Mirror((0.05, 3.0))), {}),
    ],
)
def test_special_wishes_go_to_the_exact_method_by_accuracy(scene: vrte.Scene, wish: dict[str, object]) -> None:
    """However thin the layer: light scattered once is not all that a surface mirrors."""
    assert find_rule(make_request("radiance", THIN, **KEYS, accuracy=1e-2))[0] == 0
    found = make_request("radiance", scene, **KEYS | wish, accuracy=1e-2)
    assert count_special_wishes(found) >= 1.0
    assert find_rule(found)[0] == 1


def test_light_scattered_again_is_less_than_its_bound() -> None:
    """And the bound is not an empty one."""
    close = 0
    for one in (asked(seed, faint) for seed in range(10, 25)):
        wanted = make_request(one.kind, one.scene, **one.keywords | {"accuracy": 1e-15})
        bound = 0.1 * bound_multiple_scattering(replace(wanted, accuracy=0.1))
        if np.isfinite(bound):
            error = one.solved(method="single-scattering").error(one.solved(nodes=32, accuracy=1e-12))
            assert error <= bound
            close += error > 0.2 * bound
    assert close >= 3


def check_promise(one: Asked, accuracies: tuple[float, ...]) -> list[int]:
    """Every answer of auto is as good as asked for; the rules taken, of those that do not look for nodes themselves."""
    scalar = all(layer.phase_matrix.is_scalar for layer in one.scene.layers)
    nodes = (112 if scalar else 64) if one.lowest > 0.05 else (160 if scalar else 104)
    right, indices = None, []
    for accuracy in accuracies:
        wanted = make_request(one.kind, one.scene, **one.keywords | {"accuracy": accuracy})
        index = find_rule(wanted)[0]
        found = one.solved(accuracy=accuracy, method="auto")
        if 1.5 * found.made["nodes"] > nodes:
            continue  # the reference below is hardly better
        right = right or one.solved(nodes=nodes, grading=2, accuracy=1e-13, truncation="none")
        assert found.error(right) <= accuracy, (one, accuracy)
        indices.append(index)
    return indices


@pytest.mark.filterwarnings("ignore::vrte.LongSolveWarning")  # of references on many nodes
@pytest.mark.parametrize(
    ("seeds", "drawn", "accuracies", "rule", "most"),
    [
        (range(9000, 9003), (), (1e-1, 1e-3), 1, 3),
        *(
            pytest.param(range(first, first + 30), (), (1e-1, 1e-2, 1e-3, 1e-4, 1e-6), 1, 60, marks=pytest.mark.slow)
            for first in (0, 30, 60)
        ),
        pytest.param(range(40), (faint,), (1e-1, 1e-2, 1e-3), 0, 20, marks=pytest.mark.slow),
    ],
)
def test_random_scenes_get_the_accuracy_asked_for(
    seeds: range, drawn: tuple[Any, ...], accuracies: tuple[float, ...], rule: int, most: int
) -> None:
    """And some of them by that rule."""
    indices = [index for seed in seeds for index in check_promise(asked(seed, *drawn), accuracies)]
    assert indices.count(rule) > most


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """Of the committed report."""
    return read_report_rows(REPORT)


def test_the_table_agrees_with_the_report(rows: list[Row]) -> None:
    assert len({row.scene for row in rows}) == 15
    assert find_disagreements(rows) == []


def test_disagreements_are_found(rows: list[Row]) -> None:
    run = next(row for row in rows if (row.scene, row.curve, row.setting) == RULES[0].evidence[0][:3])
    worse = [replace(row, i_max=0.5) if row == run else row for row in rows]
    slower = [replace(row, seconds=5.0) if row == run else row for row in rows]
    missing = [row for row in rows if row != run]
    other = [replace(row, seconds=1e-9) if row.method == "matrix-operator" else row for row in rows]
    for changed, words in (
        (worse, "has an error of 5e-01"),
        (slower, "takes no less time"),
        (missing, "is not in the report"),
        (other, "matrix-operator is the quickest"),
    ):
        assert any(words in text for text in find_disagreements(changed)), words


def test_score() -> None:
    """Of auto: how often it is good enough, and how its time stands to that of the quickest method that is."""
    exact = "discrete-ordinates"
    reported = [
        ("a", "auto", exact, "accuracy 1e-3", 2.0, 1e-4),
        ("a", "x", exact, "8 nodes", 1.0, 9e-4),
        ("a", "y", "two-stream", "no knob", 0.5, 9e-2),  # quicker, and not good enough
        ("b", "auto", exact, "accuracy 1e-3", 3.0, 2e-3),
        ("b", "y", "two-stream", "no knob", 1.0, 1e-4),
        ("c", "auto", exact, "accuracy 1e-3", 4.0, 1e-4),
        ("c", "peer", "somebody else's", "8 nodes", 1.0, 1e-4),  # no method of this package
        ("c", "x", exact, "8 nodes", 5.0, 1e-4),
    ]
    nothing = {"q_max": 0.0, "u_max": 0.0, "v_max": 0.0, "reference_within": 1e-9}
    rows = [Row(*names, "measured", seconds, i_max=error, **nothing) for *names, seconds, error in reported]
    assert make_score_rows(rows) == [("1e-3", "3", "2", "2", "2", "3 (b)")]
    assert make_score_rows([each for each in rows if each.curve != "auto"]) == []
