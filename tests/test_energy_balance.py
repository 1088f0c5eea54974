"""What every solve says of its light: what goes out and what is absorbed against what falls in."""

import dataclasses
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.calls import brdfs
from vrte.calls.energy import ENERGY, find_net_fluxes, list_notes
from vrte.methods import choose_method, make_run, solve_request
from vrte.request.request import make_brdf_request, make_radiance_request
from vrte.sweep.run import SweepWarning

from .helpers import assert_close

RAYLEIGH, HAZE = vrte.rayleigh(), vrte.henyey_greenstein(0.5, 16)
WHITE = vrte.Lambertian(1.0)
MU = [0.3, 0.8]


def make_layer(albedo: float = 1.0, thickness: float = 1.0, host_index: float | None = None) -> vrte.Layer:
    return vrte.Layer(RAYLEIGH, albedo, thickness, host_index)


BALANCED = {
    "white base": vrte.Scene([make_layer(), make_layer(0.0, 0.0)], WHITE),
    "black below": vrte.Scene([make_layer(1.0, 1e6)]),
    "no end": vrte.Scene([make_layer(1.0, np.inf)]),
    "plate": vrte.Scene([vrte.Interface(1.0, 1.5), make_layer(), vrte.Interface(1.5, 1.0)]),
    "glass on white": vrte.Scene([vrte.Interface(1.0, 1.5), make_layer()], WHITE),
    "absorbing": vrte.Scene([make_layer(), make_layer(0.3), make_layer()], WHITE),
    "losing facets": vrte.Scene([vrte.Interface(1.0, 1.5, 0.5, conserving=False), make_layer()], WHITE),
    "metal": vrte.Scene([make_layer()], vrte.Facets((0.2, 3.0), 0.3)),
    "haze": vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5), 1.0, 2.0)], WHITE),
}


def notes_of_energy(found: vrte.Brdf | vrte.Field) -> list[str]:
    return [note for note in found.diagnostics["notes"] if note.startswith(ENERGY)]


@pytest.mark.parametrize("name", BALANCED)
def test_light_that_balances_is_promised(name: str) -> None:
    scene = BALANCED[name]
    ends = bool(np.isfinite(scene.thickness))
    depths = [0.0, 0.5, scene.thickness if ends else 3.0]
    field = vrte.radiance(scene, 0.6, [1.0, 0.3, -0.5, 0.4], mu=[], tau=depths, nodes=12)
    brdf = vrte.brdf(scene, MU, 0.5, nodes=12, transmission=ends)
    graded = vrte.brdf(scene, MU, 0.5, nodes=12, grading=2, algorithm="modes")  # nodes that are not Gauss's
    for one in (brdf, graded, field):
        assert notes_of_energy(one) == []


CONTENT: dict[str, Any] = {  # facets of alpha 0.3 on white powder, with 8 nodes, which are too few for them
    "nodes": 8,
    "layer": [
        {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.3}},
        {"phase": "rayleigh", "albedo": 1.0, "thickness": 10.0},
    ],
    "base": {"kind": "lambertian", "albedo": 1.0},
    "brdf": {"mu_i": MU, "mu_o": 0.5},
}
POWDER = vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.3), make_layer(1.0, 10.0)], WHITE)
HOW: dict[str, Any] = {"mu_i": MU, "mu_o": 0.5, "nodes": 6}
WAYS: dict[str, Callable[[], list[Any]]] = {  # to results of the same powder, by 6 nodes
    "brdf": lambda: [vrte.brdf(POWDER, **HOW)],
    "derivatives": lambda: [vrte.brdf(POWDER, **HOW, derivatives=["layer[2].thickness"])],
    "brdfs": lambda: vrte.brdfs([POWDER, POWDER], **HOW),
    "radiance": lambda: [vrte.radiance(POWDER, MU, mu=[], nodes=6)],
    "inside": lambda: [vrte.radiance(POWDER, 0.3, mu=[], tau=[0.0, 4.0], nodes=6)],
    "views": lambda: [vrte.views(POWDER, MU, MU, 0.0, nodes=6).diagnostics["solves"][0]],
    "spectrum": lambda: [*vrte.spectrum(CONTENT, [0.5, 0.6]).brdfs],
}


@pytest.mark.parametrize("way", WAYS)
def test_more_light_than_came_is_not_promised(way: str) -> None:
    """The discrete surface keeps energy to 0.3 % on 6 nodes, and says so however it is asked."""
    for one in WAYS[way]():
        reported = one if isinstance(one, dict) else one.diagnostics
        assert reported["promised"] is False
        assert "the nodes are too few to conserve it" in reported["notes"][-1]
    if way == "brdf":
        assert one.reflectance.max() > 1.002
        assert "energy: 0.0024 of the light that falls in along mu = 0.8 is made" in reported["notes"][-1]


def test_more_nodes_for_an_accuracy_are_promised() -> None:
    for nodes, accuracy, promised in ((16, 1e-4, True), (16, 1e-5, False), (14, 1e-3, True), (14, 1e-4, False)):
        found = vrte.brdf(POWDER, MU, 0.5, nodes=nodes, accuracy=accuracy)
        assert (np.abs(found.reflectance - 1.0).max() < accuracy) == promised
        assert (notes_of_energy(found) == []) == promised


def test_scenes_that_are_solved_together_are_looked_at_too(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = [vrte.Scene([make_layer(1.0, thickness)], WHITE) for thickness in (0.5, 1.0)]
    assert [notes_of_energy(one) for one in vrte.brdfs(scenes, MU, 0.5, nodes=4)] == [[], []]
    solve = brdfs.carry_out

    def spoil(*given: Any) -> Any:
        (found,) = solve(*given)
        return [dataclasses.replace(found, flux_up=found.flux_up * np.array([1.0, 1.0 + 1e-6])[:, None, None])]

    monkeypatch.setattr(brdfs, "carry_out", spoil)
    first, second = vrte.brdfs(scenes, MU, 0.5, nodes=4)
    assert "solved_together" in first.diagnostics
    assert "solved_together" not in second.diagnostics  # by itself, as many times as it takes to say what is wrong
    assert_close(second.reflectance, 1.0, rtol=0.0, atol=1e-12)


def test_sweeps_warn_of_it(tmp_path: Path) -> None:
    content = CONTENT | {"axes": {"layer[2].thickness": [2.0, 10.0]}}
    with pytest.warns(SweepWarning, match=r"energy: 0\.0\d+ of the light .*nodes are too few.* \(and 1 more like it"):
        vrte.sweep(content, tmp_path / "table.zarr")


def spoil_solution(scene: vrte.Scene, spoil: Callable[[Any], None], **asked: Any) -> list[str]:
    """What is noted of fluxes that somebody changed."""
    request = choose_method(make_brdf_request(scene, MU, 0.5, nodes=8, **asked))
    solution = solve_request(request, make_run(request))[1]
    assert list_notes(request, find_net_fluxes(request, solution)) == []
    spoil(solution)
    return list_notes(request, find_net_fluxes(request, solution))


@pytest.mark.parametrize("name", ["black below", "plate", "white base"])
def test_each_flux_counts(name: str) -> None:
    """Up at the top, down at the bottom, of I and of Q."""
    for up, level, column in ((True, 0, 0), (True, 0, 1), (False, 1, 0), (False, 1, 1)):
        for sign in (1.0, -1.0):

            def spoil(found: Any, place: Any = (level, 1, column), up: bool = up, sign: float = sign) -> None:
                (found.flux_up if up else found.flux_down)[place] += sign * 1e-6

            (note,) = spoil_solution(BALANCED[name], spoil, transmission=True)
            assert note.startswith("energy: 1.")
            assert "along mu = 0.8" in note


def test_where_something_absorbs_only_too_much_is_wrong() -> None:
    def add(found: Any, more: float) -> None:
        found.flux_up[0, 0, 0] += more * MU[0]

    scene = vrte.Scene([make_layer(0.9)], vrte.Lambertian(0.5))
    back = vrte.brdf(scene, MU, 0.5, nodes=8).reflectance[0]
    assert spoil_solution(scene, lambda found: add(found, 0.98 - back)) == []
    for total, reported in ((0.999, "0.0058"), (1.001, "0.0078")):  # light of Q = -1 returns 0.0068 more
        (note,) = spoil_solution(scene, lambda found, total=total: add(found, total - back))  # type: ignore[misc]
        assert note.startswith(f"energy: {reported} of the light that falls in along mu = 0.3 is made")


def test_levels_inside_tell_what_happens_between() -> None:
    """An absorbing layer between two white ones: only there may the net flux fall."""
    request = choose_method(
        make_radiance_request(BALANCED["absorbing"], 0.6, mu=[], tau=[2.0, 0.0, 0.3, 1.0, 1.4, 3.0], nodes=8)
    )
    solution = solve_request(request, make_run(request))[1]
    net = find_net_fluxes(request, solution)
    assert list_notes(request, net) == []
    for index, change, reported in (
        (4, -1e-3, False),
        (2, 1e-3, True),
        (0, 1e-3, True),
        (5, -1e-3, True),
        (4, 1.0, True),
    ):
        other = net.copy()
        other[index] += change
        assert bool(list_notes(request, other)) == reported


@pytest.mark.parametrize("illuminate", ["top", "bottom"])
def test_facets_that_make_light_are_named(illuminate: str) -> None:
    stack = [vrte.Interface(1.0, 1.34, 0.3, shadowing=False), make_layer(1.0, 0.1, 1.34)]
    if illuminate == "bottom":
        stack = [make_layer(1.0, 0.1, 1.34), vrte.Interface(1.34, 1.0, 0.3, shadowing=False)]
    found = vrte.brdf(vrte.Scene(stack), 0.1, 0.5, nodes=8, illuminate=illuminate, transmission=True).diagnostics
    assert found["promised"] is False
    words = "energy: facets of interface 1 make light without shadowing: along mu = 0.1 they send on"
    assert found["notes"][-2].startswith(words)
    assert found["notes"][-1].endswith(": facets without shadowing make light")


@pytest.mark.parametrize(
    "scene",
    [
        vrte.Scene([vrte.Interface(1.0, 1.34, 0.2, shadowing=False), make_layer(0.5)]),
        vrte.Scene([make_layer(0.5, 1e-9)], vrte.cox_munk(7.0)),
    ],
)
def test_facets_that_make_much_light_are_warned_of(scene: vrte.Scene) -> None:
    with pytest.warns(vrte.AccuracyWarning, match=r"along mu = 1e-06 they send on \d{5}.* give shadowing = True"):
        assert not vrte.brdf(scene, [1e-6, 0.5], 0.5, nodes=8).diagnostics["promised"]
    sea = vrte.Scene([make_layer(0.5)], vrte.cox_munk(7.0))
    assert notes_of_energy(vrte.brdf(sea, 0.9, 0.5, nodes=8)) == []


def test_bases_and_methods_that_make_or_lose_light_are_named() -> None:
    base = vrte.MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([1.0005 / np.pi, 0.0, 0.0, 0.0]))
    found = vrte.brdf(vrte.Scene([make_layer()], base), MU, 0.5, nodes=8).diagnostics
    assert found["notes"][-1].endswith("is made: the base gives back up to 1.0005 of what it gets")
    scene = vrte.Scene([vrte.Layer(HAZE, 1.0, 2.0)], WHITE)
    (note,) = vrte.brdf(scene, MU, 0.5, method="single-scattering").diagnostics["notes"]
    assert note.endswith("is lost where nothing absorbs: method 'single-scattering' does not conserve it")
    assert "notes" not in vrte.brdf(scene, MU, 0.5, method="two-stream").diagnostics


def test_notes_are_made_when_they_are_read() -> None:
    """Of a field and a BRDF; a pickle has them."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.5))
    for found in (vrte.radiance(scene, 0.5, mu=[0.5], nodes=4), vrte.brdf(scene, 0.5, 0.5, nodes=4)):
        assert "diagnostics" not in vars(found)
        again = pickle.loads(pickle.dumps(found))
        assert again.diagnostics == found.diagnostics == vars(found)["diagnostics"]
        with pytest.raises(AttributeError, match="object has no attribute 'diagnosis'"):
            found.diagnosis  # noqa: B018
