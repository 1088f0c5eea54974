"""The plan: what it leaves out changes nothing, what it says is what is done; it is kept for a request seen again."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.basics.running import Run, start_run
from vrte.calls.plan import make_request
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines import cpu
from vrte.discrete_ordinates.orders import routes
from vrte.discrete_ordinates.orders.skip_flags import EVERYTHING, SkipFlags
from vrte.discrete_ordinates.planning import kept_plans
from vrte.discrete_ordinates.planning import plan as planning
from vrte.discrete_ordinates.planning.kept_plans import MOST_PLANS, TOLD, name_request
from vrte.discrete_ordinates.planning.plan import Plan, make_plan
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.results.result import Solution

from .samples import spheroids

EXACT = 1e-13
NAMES = [switch.name for switch in fields(SkipFlags)]
LAMBERTIAN = vrte.Lambertian(0.3)
GREY = vrte.PhaseMatrix(a1=vrte.henyey_greenstein(0.6, 24).coefficients[:, 0])


@dataclass(frozen=True)
class Case:
    """Where something is left out: the name of its switch, the call, a word of the reason, and how far the answers may
    differ, relative to the largest at each depth."""

    name: str
    kind: str
    scene: vrte.Scene
    keywords: dict[str, Any]
    word: str
    tolerance: float = EXACT


def layer(phase_matrix: vrte.PhaseMatrix | None = None, albedo: float = 0.9, thickness: float = 1.0) -> vrte.Layer:
    return vrte.Layer(phase_matrix or spheroids(), albedo, thickness)


def table(**keywords: Any) -> dict[str, Any]:
    """A small BRDF."""
    return {"mu_i": [0.3, 0.8], "mu_o": [0.2, 0.55, 1.0], "phi": [0.0, 50.0, 310.0], "nodes": 8} | keywords


def beam(**keywords: Any) -> dict[str, Any]:
    """A small field."""
    return {"mu0": 0.6, "mu": [0.5, 0.1, -0.3], "phi": [0.0, 70.0], "tau": [0.0, 0.7], "nodes": 8} | keywords


TWICE = vrte.Scene([layer(), layer(GREY, 0.5), layer(thickness=0.5)], LAMBERTIAN)
CLEAR = vrte.Scene([layer(), layer(GREY, 0.0, 0.8), layer(vrte.rayleigh(), 1.0)], LAMBERTIAN)
ONE = vrte.Scene([layer()], LAMBERTIAN)
SATIN = vrte.Scene([vrte.Interface(1.0, 1.5, 0.3), layer(vrte.henyey_greenstein(0.2, 24))], LAMBERTIAN)
SEMI_INFINITE = vrte.Scene([layer(thickness=np.inf)])
DARK = vrte.Scene([layer(albedo=0.5, thickness=9.0), layer(thickness=20.0), layer(GREY)], LAMBERTIAN)
DEEP_CLEAR = vrte.Scene([layer(), layer(GREY, 0.0, np.inf)])
THICK = vrte.Scene([layer(albedo=0.8, thickness=1000.0)], LAMBERTIAN)
FAR = [0.0, 400.0, 1000.0]

CASES = [
    Case("stokes", "brdf", vrte.Scene([layer(GREY)]), table(accuracy=1e-15), "scatter I alone"),
    Case("stokes", "brdf", vrte.Scene([layer(vrte.rayleigh())], LAMBERTIAN), table(), "b2 = 0 keeps V apart"),
    Case("stokes", "radiance", ONE, beam(stokes=[1.0, 0.2, -0.1, 0.3]), "order 0 keeps I, Q and U, V apart"),
    Case("columns", "radiance", ONE, beam(algorithm="direct"), "no k = 2 part"),
    Case("columns", "brdf", ONE, table(), "right-hand sides without light"),
    Case("orders", "brdf", ONE, table(nodes=16, accuracy=1e-6), "together they add less", 1e-6),
    Case("orders", "radiance", ONE, beam(nodes=16, accuracy=1e-9), "together they add less", 1e-9),
    Case("orders", "brdf", SATIN, table(nodes=24, accuracy=1e-4), "together they add less", 1e-4),
    Case("single", "brdf", ONE, table(transmission=True), "in closed form"),
    Case("single", "radiance", CLEAR, beam(stokes=[1.0, 0.0, 0.5, -0.5], phi=[0.0, 200.0]), "in closed form"),
    Case("fluxes", "radiance", ONE, beam(mu=[]), "fluxes alone"),
    Case("normal", "brdf", ONE, table(mu_i=[1.0]), "normal incidence"),
    Case("normal", "brdf", ONE, table(mu_o=1.0), "normal exit"),
    Case("normal", "radiance", ONE, beam(mu0=1.0, stokes=[1.0, 0.3, 0.2, 0.1]), "normal incidence"),
    Case("depth", "brdf", vrte.Scene([layer(albedo=0.6, thickness=200.0)]), table(), "optically infinite", 1e-8),
    Case("depth", "radiance", DARK, beam(accuracy=1e-6), "below layer", 1e-6),
    Case("clear", "brdf", CLEAR, table(transmission=True, algorithm="modes"), "layer 2: no scattering"),
    Case("clear", "radiance", CLEAR, beam(tau=[0.0, 1.4, 2.8], algorithm="doubling"), "layer 2: no scattering"),
    Case("clear", "brdf", DEEP_CLEAR, table(algorithm="modes", accuracy=1e-15), "layer 2"),
    Case("repeats", "brdf", TWICE, table(transmission=True, algorithm="modes"), "1 layer like another"),
    Case("repeats", "radiance", TWICE, beam(tau=[0.0, 0.5], algorithm="doubling"), "2 slabs like another"),
    Case("doublings", "radiance", THICK, beam(tau=FAR, algorithm="doubling"), "once a slab passes less"),
    Case("base", "brdf", ONE, table(transmission=True, algorithm="modes"), "beyond order 0"),
    Case("base", "brdf", ONE, table(transmission=True, algorithm="doubling"), "beyond order 0"),
    Case("base", "radiance", vrte.Scene([layer()]), beam(), "black"),
    Case("azimuths", "brdf", ONE, table(phi=[0.0, 30.0, 330.0, 180.0, 390.0]), "2 of 5 azimuths"),
    Case("symmetric", "brdf", vrte.Scene([layer(vrte.rayleigh())]), table(), "general eigensolver", 1e-8),
    Case("symmetric", "radiance", ONE, beam(), "for order 0", 1e-8),
    Case("halves", "brdf", SEMI_INFINITE, table(algorithm="invariance"), "half of each symmetric product"),
    Case("coarse", "brdf", SEMI_INFINITE, table(nodes=16, algorithm="invariance"), "every other node", 1e-8),
]


def plan_of(case: Case, skip_flags: SkipFlags = EVERYTHING, **changes: Any) -> Plan:
    request = make_request(case.kind, case.scene, **case.keywords | changes)
    return make_plan(request, start_run(1), skip_flags)


def solved(case: Case, skip_flags: SkipFlags = EVERYTHING) -> tuple[Plan, Solution]:
    plan = plan_of(case, skip_flags)
    return plan, carry_out([plan], cpu.PROCESSOR, start_run(1))[0]


def all_but(name: str) -> SkipFlags:
    return replace(EVERYTHING, **{name: False})


def test_every_switch_has_a_case() -> None:
    assert {case.name for case in CASES} == set(NAMES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.name}-{case.word.replace(' ', '-')}")
def test_what_is_left_out_changes_nothing(case: Case) -> None:
    plan, found = solved(case)
    fuller, expected = solved(case, all_but(case.name))
    assert case.word in plan.as_dict()["left_out"][case.name]
    assert case.name not in fuller.as_dict()["left_out"]
    assert case.word in " ".join(str(plan).split())
    # where fluxes alone are asked for, the directions are there for form's sake
    for values, exact in [] if plan.request.fluxes_only else zip(found.parts, expected.parts, strict=True):
        assert (difference(values, exact) <= case.tolerance).all()
    values, exact = (np.stack([light.flux_up, light.flux_down]).sum(axis=-1) for light in (found, expected))
    assert (np.abs(values - exact) <= case.tolerance * np.abs(exact).max(axis=(0, 2))[:, None]).all()


def difference(values: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """The largest difference at each depth, relative to the largest Stokes parameter there, (n_level,)."""
    axes = tuple(range(1, exact.ndim))
    return np.abs(values - exact).max(axis=axes) / np.abs(exact).max(axis=axes)


def compare_to_fuller(case: Case) -> tuple[Plan, Solution]:
    """Plan and light at the top, which differ by no more than the tolerance from those with nothing left out."""
    plan, found = solved(case)
    _, expected = solved(case, all_but(case.name))
    assert difference(found.parts[0], expected.parts[0])[0] <= case.tolerance
    return plan, found


def test_light_from_a_bright_layer_below_a_dark_one_counts() -> None:
    """8 thick, the dark layer leaves it 2e-5 of the brightest: more than the accuracy, so no order may end above it."""
    scene = vrte.Scene([layer(vrte.isotropic(), 0.05, 8.0), layer(vrte.isotropic(), 1.0, 20.0)])
    case = Case("depth", "brdf", scene, {"mu_i": 1.0, "mu_o": 1.0, "nodes": 8, "accuracy": 1e-6}, "", 1e-6)
    compare_to_fuller(case)


def test_transmission_that_nobody_asks_for_changes_no_reflection() -> None:
    with_it, without = (vrte.brdf(ONE, **table(transmission=wanted)) for wanted in (True, False))
    assert difference(with_it.mueller[None], without.mueller[None])[0] <= EXACT
    assert "not asked for" in vrte.plan("brdf", ONE, **table()).as_dict()["left_out"]["transmission"]
    assert "transmission" not in vrte.plan("brdf", ONE, **table(transmission=True)).as_dict()["left_out"]


STEEP = {"mu_i": [0.99, 0.999], "mu_o": [0.9, 0.95], "phi": 180.0, "nodes": 24, "accuracy": 1e-6}
EARLY = Case("orders", "brdf", vrte.Scene([layer(thickness=10.0)]), STEEP, "", 1e-6)


def test_fewer_orders_where_order_0_is_bright() -> None:
    plan, found = compare_to_fuller(EARLY)
    assert found.diagnostics["orders"] < plan.orders


@pytest.mark.parametrize("case", [EARLY, CASES[0], CASES[2], CASES[6], CASES[11], CASES[14], CASES[19], CASES[-1]])
def test_the_solver_does_what_the_plan_says(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Block after block, order after order, by the algorithms named; fewer orders only after order 0, as announced."""
    done: list[tuple[Any, ...]] = []
    original = cpu.make_answer

    def watched(piece: Any, *found: Any) -> Any:
        done.append((piece.orders.tolist(), piece.problem, piece.name))
        return original(piece, *found)

    monkeypatch.setattr(cpu, "make_answer", watched)
    plan, found = solved(case)
    facts = plan.as_dict()
    reported = [
        (b["orders"], b["stokes"], b["unknowns"], b["layers"], b["right_hand_sides"], b["algorithm"])
        for b in facts["blocks"]
    ]
    assert len(done) <= len(reported)
    for (orders, of, name), (planned_orders, letters, *planned_numbers) in zip(done, reported, strict=False):
        assert orders == planned_orders[: len(orders)]
        assert " ".join("IQUV"[k] for k in of.stokes) == letters
        assert [of.size, of.albedo.size, of.n_rhs, name] == planned_numbers
    solved_orders = sorted({order for orders, *_ in done for order in orders})
    assert found.diagnostics["orders"] == len(solved_orders)
    if solved_orders != facts["orders"]:
        assert facts["orders_counted_again"]
        assert "counted again" in str(plan)
        assert solved_orders == facts["orders"][: len(solved_orders)]


def test_no_work_is_done_for_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    for way in routes.WAYS:
        monkeypatch.setattr(way, "__init__", None)
    for scene in (ONE, TWICE, SEMI_INFINITE):
        assert "Predicted" in str(vrte.plan("brdf", scene, **table()))
        assert "Predicted" in str(vrte.plan("radiance", scene, **beam()))


def test_what_is_printed_and_what_is_for_programs() -> None:
    text = str(vrte.plan("brdf", TWICE, **table(threads=2, nodes=24, verify=True)))
    lines = text.splitlines()
    assert lines[0] == "Plan of brdf: 3 layers, base Lambertian; accuracy 1e-08 of the largest I, 24 nodes, 2 threads"
    assert lines[1] == "2 mu_i, 3 mu_o, 3 phi, no transmission"
    titles = "orders, Stokes, layers, unknowns, right-hand sides, algorithm, operations"
    assert [cell.strip() for cell in lines[3].split("  ") if cell] == titles.split(", ")
    assert lines[4].split()[:6] == ["0", "I", "Q", "3", "48", "4"]
    assert max(map(len, lines)) <= 120
    for word in ("Left out:", "Shared:", "- 1 layer like another", "auto: ", "verify: every block", "MB of memory"):
        assert word in text
    fluxes = str(vrte.plan("radiance", ONE, 0.6, mu=[], tau=[0.0, 1.0], nodes=8))
    assert "fluxes alone, 2 depths" in fluxes
    assert "multiple scattering" not in fluxes
    assert "1 beam, 1 depth, 16 mu, 1 phi" in str(vrte.plan("radiance", ONE, 0.6, nodes=8))
    facts = json.loads(json.dumps(vrte.plan("brdf", TWICE, **table(nodes=16)).as_dict()))
    assert facts["orders"] == list(range(len(facts["orders"])))
    assert facts["operations"] > sum(block["operations"] for block in facts["blocks"]) > 0.0
    assert facts["memory_bytes"] > 8.0 * 2 * 3 * 3 * 16
    assert set(facts["left_out"]) <= {*NAMES, "transmission"}


@pytest.mark.parametrize(("kind", "keywords"), [("brdf", table()), ("radiance", beam())])
def test_plan_takes_and_refuses_what_the_functions_do(kind: str, keywords: dict[str, Any]) -> None:
    """In the same words."""
    for wrong in ({"nodes": 0}, {"accuracy": 2.0}, {"algorithm": "best"}, {"verify": 3}, {"phi": "x"}, {"threads": 0}):
        reported = []
        for call in (partial(vrte.plan, kind), getattr(vrte, kind)):
            with pytest.raises(SceneError) as raised:
                call(ONE, **keywords | wrong)
            reported.append(str(raised.value))
        assert reported[0] == reported[1]
    with pytest.raises(TypeError, match="colour"):
        vrte.plan(kind, ONE, **keywords, colour=1)
    by_position = vrte.plan("brdf", ONE, [0.3, 0.8], [0.2, 0.55, 1.0], [0.0, 50.0, 310.0], nodes=8, threads=1)
    assert str(by_position) == str(vrte.plan("brdf", ONE, **table(threads=1)))
    assert vrte.plan("brdf", ONE, 0.5, 0.5, progress=print).request.mu0.tolist() == [0.5]
    with pytest.raises(TypeError, match="mu_i"):
        vrte.plan("brdf", ONE)
    with pytest.raises(SceneError, match="scene must be"):
        vrte.plan("brdf", None, 0.5, 0.5)
    with pytest.raises(SceneError, match="kind must be 'brdf' or 'radiance'"):
        vrte.plan("field", ONE)  # type: ignore[arg-type]


def test_a_plan_in_two_parts() -> None:
    """Scalar peaks among polarizing layers: unpolarized and polarized light take truncations of their own."""
    scene = vrte.Scene([layer(vrte.henyey_greenstein(0.9, terms=100)), layer(vrte.rayleigh())])
    plan = vrte.plan("brdf", scene, **table())
    facts = plan.as_dict()["parts"]
    for kind, part in zip(("unpolarized", "polarized"), plan.parts, strict=True):
        assert f"Light that comes in {kind}, by itself:\n{part}" in str(plan)
        assert facts[kind]["truncation"] == part.truncation.name
    found = vrte.brdf(scene, **table()).diagnostics
    for part, reported in zip(plan.parts, (found, found["polarized_light"]), strict=True):
        assert reported["truncation"] == part.truncation.name
        assert reported["orders"] <= part.orders
        assert reported["algorithm"] == part.diagnostics()["algorithm"]


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


def test_what_is_not_kept() -> None:
    run, scene, many = Run(1), make_scene(), np.linspace(0.1, 1.0, kept_plans.MOST_NUMBERS)
    uneven = vrte.Scene(scene.layers, vrte.MuellerBase(lambda i, o, phi: np.eye(4) / np.pi))
    assert name_request(make_radiance_request(scene, 0.6, mu=[0.5], nodes=4), run) is not None
    for request, why in (
        (make_radiance_request(scene, 0.6, mu=[0.5]), "nodes are to be found"),
        (make_radiance_request(scene, 0.6, nodes=4), "directions are the nodes"),
        (make_brdf_request(scene, [0.5], many, nodes=4), "too many numbers"),
        (make_brdf_request(uneven, [0.5], [0.5], nodes=4), "a function of the user's"),
    ):
        assert name_request(request, run) is None, why


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


@pytest.mark.parametrize("illuminate", ["top", "bottom"])
def test_the_same_request_is_planned_once(planned: list[Request], illuminate: Any) -> None:
    layers = [vrte.Layer(vrte.rayleigh(), albedo, 1.0) for albedo in (0.9, 0.5)]
    scene, other = vrte.Scene(layers), "bottom" if illuminate == "top" else "top"
    asked: dict[str, Any] = {"mu_i": 0.6, "mu_o": 0.5, "nodes": 4}
    first, second = (vrte.brdf(scene, **asked, illuminate=illuminate).mueller for _ in range(2))
    assert len(planned) == 1
    np.testing.assert_array_equal(first, second)
    assert (vrte.brdf(scene, **asked, illuminate=other).mueller != first).any(), "the plan of the other side"
    assert len(planned) == 2
    vrte.brdf(vrte.Scene(layers), **asked, illuminate=illuminate)
    assert len(planned) == 3, "another scene, though with the same numbers"


def test_threads_that_call_at_once_get_their_own_answers(planned: list[Request]) -> None:
    scenes = [make_scene(0.5 + 0.1 * k) for k in range(4)]
    alone = [vrte.radiance(make_scene(0.5 + 0.1 * k), 0.6, mu=[0.5], nodes=2).stokes for k in range(4)]

    def is_right(k: int) -> bool:
        found = vrte.radiance(scenes[k % 4], 0.6, mu=[0.5], nodes=2, threads=1)
        return np.array_equal(found.stokes, alone[k % 4])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(is_right, range(80)))
