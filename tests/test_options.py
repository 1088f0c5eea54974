"""One set of options: each is used or refused by name, whatever the method, and told in the same words everywhere."""

import re
from contextlib import suppress
from dataclasses import fields
from functools import cache
from inspect import signature
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import run
from vrte.request.how import AUTO, EXACT, METHOD_NAMES, METHODS, NOT_FOR_ALL, OPTIONS, How

SCENE = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.4, 12), albedo=0.8, thickness=0.2)])
ASKED = {"nodes": 6, "accuracy": 1e-3, "algorithm": "doubling", "verify": True, "truncation": "none"}
ASKED |= {"backend": "sequential", "illuminate": "bottom"}
CALLS = (vrte.brdf, vrte.radiance, vrte.brdfs)


@cache
def answer(method: str, **how: Any) -> str:
    """What a field brings, without the times that it took; along the nodes, where these are chosen."""
    found = vrte.radiance(SCENE, [0.5, 0.9], mu=None if "nodes" in how else [0.4, 1.0, -0.7], method=method, **how)
    left_out = ("stages", "wall_seconds")
    reported = {name: value for name, value in found.diagnostics.items() if name not in left_out}
    return repr((found.stokes.shape, found.stokes.tobytes(), reported))


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_an_option_is_used_or_refused_by_name(method: str) -> None:
    """And all but rounding, and a device: only discrete ordinates have these."""
    for name, value in ASKED.items():
        with suppress(vrte.SceneError):
            if answer(method, **{name: value}) != answer(method):
                continue
        with pytest.raises(vrte.SceneError, match=f"method '{method}' (takes no|separates).*{name}") as refused:
            answer(method, **{name: value})
        assert refused.value.place == ("method",)
        assert name in NOT_FOR_ALL
    for name, value in () if method in (EXACT, AUTO) else (("accuracy", 1e-15), ("backend", "opencl")):
        nodes = {} if method == "monte-carlo" else {"nodes": 4}
        with pytest.raises(vrte.SceneError, match=f"method '{method}' .*{name}"):
            answer(method, **nodes, **{name: value})


@pytest.mark.parametrize("method", [*METHODS, AUTO])
def test_plans_limits_and_settings_go_with_their_method(method: str) -> None:
    if method == EXACT:
        assert vrte.plan("brdf", SCENE, 0.5, 0.5, method=method, nodes=4).orders > 0
    elif method != AUTO:
        nodes = {} if method == "monte-carlo" else {"nodes": 4}
        with pytest.raises(vrte.SceneError, match=f"method '{method}' has no plan"):
            vrte.plan("brdf", SCENE, 0.5, 0.5, method=method, **nodes)
    if method in (EXACT, "adding-doubling", "matrix-operator", "successive-orders"):
        with pytest.raises(vrte.SceneError, match="time_limit_s"):
            answer(method, nodes=4, time_limit_s=1e-12)
    with pytest.raises(vrte.SceneError, match=f"method '{method}' (has no setting|takes no settings)"):
        vrte.brdf(SCENE, 0.5, 0.5, method=method, settings={"depth of nothing": 1})


def test_options_have_one_order_and_one_set_of_names() -> None:
    names = [field.name for field in fields(How) if field.name in OPTIONS]
    for call in CALLS[:2]:
        taken = list(signature(call).parameters)
        own = ["side", "derivatives"] if call is vrte.radiance else ["derivatives", "coherent"]
        options = [name for name in names if name not in ("nodes", "threads")]
        assert taken[taken.index("progress") + 1 :] == options + own
    assert signature(vrte.brdfs).parameters.keys() - {"scenes"} == signature(vrte.brdf).parameters.keys() - {"scene"}


@pytest.mark.parametrize("where", [*CALLS, "brdf", "field"], ids=lambda where: getattr(where, "__name__", where))
def test_help_has_each_option_in_the_same_words(where: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Of calls and of commands."""
    if isinstance(where, str):
        assert run(where, "--help") == 0
        reported, names = capsys.readouterr().out, OPTIONS.keys() - {"settings"}
    else:
        reported, names = where.__doc__, signature(where).parameters.keys() & OPTIONS.keys()
        assert not re.search(r"\{[\w, ]+\}\n", reported)
    for name in names:
        assert (f"--{name.replace('_', '-')}" if isinstance(where, str) else f"\n    {name} : ") in reported
        assert "".join(OPTIONS[name].short[1:].split()) in "".join(reported.split())


def test_options_go_by_place_and_to_batches() -> None:
    positional = vrte.plan("brdf", SCENE, 0.5, 0.5, 0.0, 4, 1, False, None, "doubling").request
    assert (positional.nodes, positional.threads, positional.algorithm) == (4, 1, "doubling")
    how: dict[str, Any] = {"nodes": 4, "method": "successive-orders", "settings": {"orders": 2}}
    (one,), alone = vrte.brdfs([SCENE], 0.5, 0.5, **how), vrte.brdf(SCENE, 0.5, 0.5, **how)
    np.testing.assert_array_equal(one.mueller, alone.mueller)
