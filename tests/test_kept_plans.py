"""Plans that are kept for a scene seen again: taken only where the whole request is the same."""

import threading
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.running import Run
from vrte.discrete_ordinates.planning import kept_plans
from vrte.discrete_ordinates.planning import plan as planning
from vrte.discrete_ordinates.planning.kept_plans import MOST_PLANS, TOLD, name_request
from vrte.request.request import Request, make_brdf_request, make_radiance_request

BY_NUMBERS = {"scene", "mu0", "columns", "mu", "phi", "tau", "wanted", "under"}
OF_THE_ANSWER = {"asked_tau", "incident"}  # what the result repeats, from the request itself
OF_THE_RUN = {"threads"}
NO_PLAN = {"settings"}  # a request with settings is planned anew


def make_scene(thickness: float = 1.0) -> vrte.Scene:
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, thickness)])


@pytest.fixture
def planned(monkeypatch: pytest.MonkeyPatch) -> list[Request]:
    """The requests that were planned, and none kept at the beginning."""
    seen: list[Request] = []
    whole = planning.make_plan

    def make_plan(request: Request, *more: Any, **told: Any) -> planning.Plan:
        seen.append(request)
        return whole(request, *more, **told)

    monkeypatch.setattr(planning, "make_plan", make_plan)
    monkeypatch.setattr(kept_plans, "_plans", type(kept_plans._plans)())
    return seen


def test_every_field_of_a_request_is_told_or_known_not_to_matter() -> None:
    assert {each.name for each in fields(Request)} == {*TOLD, *BY_NUMBERS, *OF_THE_ANSWER, *OF_THE_RUN, *NO_PLAN}


def test_the_same_request_is_planned_once(planned: list[Request]) -> None:
    scene = make_scene()
    first, second = (vrte.radiance(scene, 0.6, mu=[0.5], nodes=4) for _ in range(2))
    assert len(planned) == 1
    np.testing.assert_array_equal(first.stokes, second.stokes)
    vrte.radiance(make_scene(), 0.6, mu=[0.5], nodes=4)
    assert len(planned) == 2, "another scene, though with the same numbers"


@pytest.mark.parametrize(
    "other",
    [
        {"mu0": 0.7},
        {"stokes": (1.0, 0.1, 0.0, 0.0)},
        {"stokes": (1.0, 0.0, 0.1, 0.0)},
        {"mu": [0.25]},
        {"mu": [-0.5]},
        {"mu": []},
        {"phi": 30.0},
        {"tau": 0.5},
        {"nodes": 6},
        {"accuracy": 1e-5},
        {"algorithm": "doubling"},
        {"verify": True},
        {"truncation": "none"},
        {"illuminate": "bottom"},
        {"time_limit_s": 1e6},
    ],
    ids=str,
)
def test_what_differs_is_planned_anew(planned: list[Request], other: dict[str, Any]) -> None:
    scene, asked = make_scene(), {"mu0": 0.6, "mu": [0.5], "nodes": 4}
    vrte.radiance(scene, **asked)
    before = len(planned)
    found = vrte.radiance(scene, **(asked | other))
    assert len(planned) > before
    alone = vrte.radiance(make_scene(), **(asked | other))
    np.testing.assert_array_equal(found.stokes, alone.stokes)
    np.testing.assert_array_equal(found.flux_up, alone.flux_up)


def test_what_is_not_kept(planned: list[Request]) -> None:
    run, scene = Run(1), make_scene()
    assert name_request(make_radiance_request(scene, 0.6, mu=[0.5], nodes=4), run) is not None
    assert name_request(make_radiance_request(scene, 0.6, mu=[0.5]), run) is None, "nodes are to be found"
    assert name_request(make_radiance_request(scene, 0.6, nodes=4), run) is None, "directions are the nodes"
    many = np.linspace(0.1, 1.0, kept_plans.MOST_NUMBERS)
    assert name_request(make_brdf_request(scene, [0.5], many, nodes=4), run) is None, "too many numbers"
    uneven = vrte.Scene(scene.layers, vrte.MuellerBase(lambda i, o, phi: np.eye(4) / np.pi))
    assert name_request(make_brdf_request(uneven, [0.5], [0.5], nodes=4), run) is None, "a function of the user's"


def test_the_plan_not_asked_for_the_longest_goes(planned: list[Request]) -> None:
    scenes = [make_scene(1.0 + 0.1 * k) for k in range(MOST_PLANS + 1)]
    for scene in scenes[:-1]:
        vrte.radiance(scene, 0.6, mu=[0.5], nodes=2)
    vrte.radiance(scenes[0], 0.6, mu=[0.5], nodes=2)
    vrte.radiance(scenes[-1], 0.6, mu=[0.5], nodes=2)
    assert (len(planned), len(kept_plans._plans)) == (MOST_PLANS + 1, MOST_PLANS)
    vrte.radiance(scenes[0], 0.6, mu=[0.5], nodes=2)
    assert len(planned) == MOST_PLANS + 1, "asked for again, it stayed"
    vrte.radiance(scenes[1], 0.6, mu=[0.5], nodes=2)
    assert len(planned) == MOST_PLANS + 2


def test_a_scene_lit_from_below_is_planned_once(planned: list[Request]) -> None:
    layers = [vrte.Layer(vrte.rayleigh(), albedo, 1.0) for albedo in (0.9, 0.5)]
    scene = vrte.Scene(layers)
    asked: dict[str, Any] = {"mu_i": 0.6, "mu_o": 0.5, "nodes": 4}
    first, second = (vrte.brdf(scene, **asked, illuminate="bottom").mueller for _ in range(2))
    assert len(planned) == 1
    np.testing.assert_array_equal(first, second)
    assert (vrte.brdf(scene, **asked).mueller != first).any(), "the plan of the other side is not taken"
    assert len(planned) == 2


def test_threads_that_call_at_once_get_their_own_answers(planned: list[Request]) -> None:
    scenes = [make_scene(0.5 + 0.1 * k) for k in range(4)]
    alone = [vrte.radiance(make_scene(0.5 + 0.1 * k), 0.6, mu=[0.5], nodes=4).stokes for k in range(4)]
    wrong: list[int] = []

    def call(start: int) -> None:
        for k in range(start, start + 40):
            found = vrte.radiance(scenes[k % 4], 0.6, mu=[0.5], nodes=4, threads=1)
            if not np.array_equal(found.stokes, alone[k % 4]):
                wrong.append(k)

    threads = [threading.Thread(target=call, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
