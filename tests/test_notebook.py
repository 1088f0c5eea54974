"""What a notebook shows of results: a picture that decodes, a table, and never an error."""

import base64
import io
import pickle
import re
import sys
import time
from dataclasses import replace
from typing import Any

import matplotlib.image
import numpy as np
import pytest

import vrte
from vrte.pictures.results import sum_operations_by_order
from vrte.results.spectrum import Spectrum

from .helpers import close_to

MU_O, PHI = np.linspace(0.1, 1.0, 10), np.arange(0, 360, 30)
HOSTILE = "<script>alert('x')</script>"


def made() -> dict[str, Any]:
    """One of each, small."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)], vrte.Lambertian(0.2))
    brdf = vrte.brdf(scene, [0.5], MU_O, PHI, nodes=6, threads=1)
    return {
        "field": vrte.radiance(scene, 0.6, phi=[0, 90], tau=[0.0, 1.0], nodes=6, threads=1),
        "brdf": brdf,
        "phase matrix": vrte.rayleigh(),
        "plan": vrte.plan("brdf", scene, mu_i=0.5, mu_o=MU_O, phi=PHI, nodes=6, threads=1),
        "spectrum": Spectrum([0.5, 0.6], [brdf, brdf]),
    }


THINGS = made()


def picture(text: str) -> np.ndarray:
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    pixels: np.ndarray = matplotlib.image.imread(io.BytesIO(base64.b64decode(encoded)), format="png")
    return pixels


def cells(thing: Any) -> str:
    """What a notebook shows of it, without tags."""
    return re.sub("<[^>]+>", "|", thing._repr_html_())


@pytest.mark.parametrize("name", THINGS)
def test_a_picture_and_a_table_soon(name: str) -> None:
    spent = []
    for _ in range(2):  # of two, the machine disturbs one
        begin = time.process_time()
        text = THINGS[name]._repr_html_()
        spent.append(time.process_time() - begin)
    assert min(spent) < 0.5
    pixels = picture(text)
    assert 100 < pixels.shape[0] < 400
    assert np.ptp(pixels[..., :3]) > 0.5  # something is drawn
    assert ("<pre>" if name == "plan" else "<table>") in text
    assert len(text) < 150_000


def test_the_tables_tell_what_is_there() -> None:
    for name, expected in {
        "brdf": (f"|{THINGS['brdf'].reflectance[0]:.6g}|", "|10 from 0.1 to 1|"),
        "field": ("μ0 = 0.6; I, Q, U, V = 1, 0, 0, 0", "|{:.6g}, {:.6g}|".format(*THINGS["field"].flux_up)),
        "phase matrix": ("|0, 0, 1.2247|",),
        "plan": ("right-hand sides",),
        "spectrum": ("|0.5, 0.6|",),
    }.items():
        for text in expected:
            assert text in cells(THINGS[name])


@pytest.mark.parametrize("name", THINGS)
def test_plot_gives_a_figure_that_a_notebook_shows(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)  # loaded by other tests
    figure = THINGS[name].plot()
    assert figure.axes
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize("name", THINGS)
def test_without_matplotlib_the_table_is_there(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    text = THINGS[name]._repr_html_()
    assert "<img" not in text
    assert "</table>" in text or "</pre>" in text
    with pytest.raises(vrte.MissingExtraError, match="extra 'plot'"):
        THINGS[name].plot()


def test_names_are_escaped() -> None:
    brdf, field = THINGS["brdf"], THINGS["field"]
    hostile = {"method": HOSTILE, "notes": [HOSTILE], "base": 10_000 * "&", "algorithm": "two\nlines"}
    for thing in (
        vrte.Brdf(brdf.mueller, brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, hostile),
        replace(field, diagnostics=hostile),
    ):
        text = thing._repr_html_()
        assert "<script" not in text
        assert text.count("&lt;script&gt;") == 2
        assert len(text) < 150_000


class Nasty:
    def __str__(self) -> str:
        raise RuntimeError("no")


def test_it_never_raises() -> None:
    brdf = THINGS["brdf"]
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=1.0)])
    few = vrte.brdf(scene, 0.5, 0.5, nodes=4)  # no picture of one direction
    fluxes = vrte.radiance(scene, 0.5, mu=[], nodes=4)
    nothing = vrte.Brdf(np.full_like(brdf.mueller, np.nan), brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {})
    nasty = vrte.Brdf(brdf.mueller, brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {"method": Nasty()})
    for thing in (few, fluxes, nothing):
        assert "</table>" in thing._repr_html_()
        assert "<img" not in thing._repr_html_()
    assert "<pre>&lt;vrte.results.brdf.Brdf object" in nasty._repr_html_()
    finer = vrte.Brdf(np.ones((1, 500, 721, 4, 4)), [0.5], [0.5], np.linspace(0.01, 1.0, 500), np.arange(721) / 2.0, {})
    many = vrte.henyey_greenstein(0.5, 6000)
    for thing in (finer, many):  # would take too long for a glance
        assert "<img" not in thing._repr_html_()
    assert "|6000, scalar" in cells(many)
    with pytest.raises(vrte.SceneError, match="holds fluxes alone"):
        fluxes.plot()
    with pytest.raises(vrte.SceneError, match="at least 2 different mu_o"):
        few.plot()


def test_a_spectrum_shows_its_reflectance_and_a_cut_a_wavelength() -> None:
    spectrum = THINGS["spectrum"]
    reflectance, cuts = spectrum.plot().axes
    np.testing.assert_array_equal(reflectance.get_lines()[0].get_ydata(), spectrum.reflectance[:, 0])
    assert [line.get_label() for line in cuts.get_lines()] == ["0.5 µm", "0.6 µm"]
    few = Spectrum([0.5], [vrte.brdf(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 1.0)]), 0.5, 0.5, nodes=4)])
    assert len(few.plot().axes) == 1


def parts() -> list[Any]:
    particles = vrte.spheres((0.19, 3.5), radius_um=0.6, wavelength_um=0.64)
    layers = [
        vrte.Layer.of(particles, 3.0),
        vrte.Layer(vrte.isotropic(), 0.5, 1.0),
        vrte.Layer(vrte.rayleigh(), 1.0, 2.0),
    ]
    scenes = [vrte.Scene(layers[:count], vrte.Lambertian(0.2)) for count in (1, 2, 3)]
    return [particles, particles.phase_matrix, *layers, *scenes, vrte.Scene(vrte.Layer(vrte.rayleigh(), 1.0, np.inf))]


def test_what_a_scene_is_made_of_tells_of_itself_in_three_lines() -> None:
    told = [repr(part) for part in parts()]
    assert max(text.count("\n") for text in told) == 2
    particles, matrix, layer, *_, one, two, three, endless = told
    assert particles.startswith(
        "Particles: spheres, Monodisperse(radius_um=0.6), at 0.64 um, index 0.19 + 3.5i (given)\n"
    )
    assert re.search(r"albedo 0\.\d+, g 0\.\d+, \d+ terms, polarizing\n  extinction \d", particles)
    assert re.fullmatch(r"PhaseMatrix\(g 0\.\d+, \d+ terms, polarizing\)", matrix)
    assert layer.startswith("Layer(optical thickness 3, albedo 0.")
    assert one.startswith("Scene: 1 layer, optical thickness 3, base Lambertian(albedo=0.2)\n  optical thickness 3, ")
    assert "\n  top: optical thickness 3, " in two
    assert two.endswith("\n  bottom: optical thickness 1, albedo 0.5, g 0, 1 term, scalar")
    assert three.endswith("\n  bottom: optical thickness 2, albedo 1, g 0, 3 terms, polarizing (1 more above)")
    assert endless.startswith("Scene: 1 layer, optical thickness inf, base black, which no light reaches\n")


def test_what_a_scene_is_made_of_is_a_table_in_a_notebook() -> None:
    particles, _, layer, *_, three, _ = parts()
    assert "|spheres, Monodisperse(radius_um=0.6), at 0.64 um" in cells(particles)
    assert all(picture(part._repr_html_()).size for part in (particles, layer))
    assert "|layer 3||optical thickness 2, albedo 1, g 0, 3 terms, polarizing|" in cells(three)
    assert "|base||Lambertian(albedo=0.2)|" in cells(three)
    hostile = vrte.Particles(vrte.rayleigh(), 1.0, 0.0, 1.0, 1.0, 1.0, description=HOSTILE)
    assert "<script" not in hostile._repr_html_()


def test_the_plan_draws_its_operations() -> None:
    facts = THINGS["plan"].as_dict()
    (panel,) = THINGS["plan"].plot().axes
    outlines = [np.asarray(area.get_xy()) for area in panel.patches]
    drawn = sum(0.5 * abs((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) for x, y in (one.T for one in outlines))  # areas
    assert drawn == close_to(sum(block["operations"] for block in facts["blocks"]), rtol=1e-6, atol=0.0)
    assert set(sum_operations_by_order(facts)) == {block["algorithm"] for block in facts["blocks"]}


def test_a_plan_in_two_parts_has_two_panels() -> None:
    peaked = vrte.henyey_greenstein(0.9, 300)
    scene = vrte.Scene(
        [vrte.Layer(peaked, albedo=0.9, thickness=1.0), vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)]
    )
    plan = vrte.plan("brdf", scene, mu_i=0.5, mu_o=0.5, nodes=8, threads=1)
    assert len(plan.parts) == 2
    titles = [f"Plan of brdf: {light} light" for light in ("unpolarized", "polarized")]
    assert [panel.get_title() for panel in plan.plot().axes] == titles


def test_the_plan_draws_what_is_left_out() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 40), albedo=0.9, thickness=1.0)])
    plan = vrte.plan("radiance", scene, mu0=0.5, mu=[0.5], nodes=20, threads=1)
    (panel,) = plan.plot().axes
    assert plan.orders < 40
    assert panel.get_xlim() == (-0.5, 39.5)
    texts = [text.get_text() for text in panel.get_legend().get_texts()]
    assert f"left out of multiple scattering: {40 - plan.orders} of 40" in texts


def test_a_figure_survives_the_way_to_another_process() -> None:
    figure = pickle.loads(pickle.dumps(THINGS["phase matrix"].plot()))
    assert figure._repr_png_().startswith(b"\x89PNG")
