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


SCENE = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)], vrte.Lambertian(0.2))
DIRECTIONS = {"mu_o": MU_O, "phi": PHI, "nodes": 6, "threads": 1}


THINGS: dict[str, Any] = {
    "field": vrte.radiance(SCENE, 0.6, phi=[0, 90], tau=[0.0, 1.0], nodes=6, threads=1),
    "brdf": vrte.brdf(SCENE, [0.5], **DIRECTIONS),
    "phase matrix": vrte.rayleigh(),
    "plan": vrte.plan("brdf", SCENE, mu_i=0.5, **DIRECTIONS),
}
THINGS["spectrum"] = Spectrum([0.5, 0.6], 2 * [THINGS["brdf"]])


def picture(text: str) -> np.ndarray:
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    pixels: np.ndarray = matplotlib.image.imread(io.BytesIO(base64.b64decode(encoded)), format="png")
    return pixels


def cells(thing: Any) -> str:
    """What a notebook shows of it, without tags."""
    return re.sub("<[^>]+>", "|", thing._repr_html_())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("brdf", (f"|{THINGS['brdf'].reflectance[0]:.6g}|", "|10 from 0.1 to 1|")),
        ("field", ("μ0 = 0.6; I, Q, U, V = 1, 0, 0, 0", "|{:.6g}, {:.6g}|".format(*THINGS["field"].flux_up))),
        ("phase matrix", ("|0, 0, 1.2247|",)),
        ("plan", ("right-hand sides",)),
        ("spectrum", ("|0.5, 0.6|",)),
    ],
)
def test_a_picture_and_a_table_soon(name: str, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    thing = THINGS[name]
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)  # loaded by other tests
    spent = []
    for _ in range(2):  # of two, the machine disturbs one
        begin = time.process_time()
        text = thing._repr_html_()
        spent.append(time.process_time() - begin)
    assert min(spent) < 0.5
    assert np.ptp(picture(text)[..., :3]) > 0.5  # something is drawn
    assert ("<pre>" if name == "plan" else "<table>") in text
    assert len(text) < 150_000
    assert all(one in cells(thing) for one in words)
    figure = pickle.loads(pickle.dumps(thing.plot())) if name == "phase matrix" else thing.plot()
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "matplotlib.pyplot" not in sys.modules
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    text = thing._repr_html_()
    assert ("<img" in text, "</table>" in text or "</pre>" in text) == (False, True)
    with pytest.raises(vrte.MissingExtraError, match="extra 'plot'"):
        thing.plot()


def test_names_are_escaped() -> None:
    hostile = {"method": HOSTILE, "notes": [HOSTILE], "base": 10_000 * "&", "algorithm": "two\nlines"}
    for name in ("brdf", "field"):
        text = replace(THINGS[name], diagnostics=hostile)._repr_html_()
        assert "<script" not in text
        assert text.count("&lt;script&gt;") == 2
        assert len(text) < 150_000
    grains = vrte.Particles(vrte.rayleigh(), 1.0, 0.0, 1.0, 1.0, 1.0, description=HOSTILE)
    assert "<script" not in grains._repr_html_()


def test_it_never_raises() -> None:
    class Nasty:
        def __str__(self) -> str:
            raise RuntimeError("no")

    brdf, scene = THINGS["brdf"], vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=1.0)])
    few = vrte.brdf(scene, 0.5, 0.5, nodes=4)  # no picture of one direction
    fluxes = vrte.radiance(scene, 0.5, mu=[], nodes=4)
    finer = vrte.Brdf(np.ones((1, 500, 721, 4, 4)), [0.5], [0.5], np.linspace(0.01, 1.0, 500), np.arange(721) / 2.0, {})
    many = vrte.henyey_greenstein(0.5, 6000)  # both would take too long for a glance
    for thing in (few, fluxes, replace(brdf, mueller=np.full_like(brdf.mueller, np.nan)), finer, many):
        assert "</table>" in thing._repr_html_()
        assert "<img" not in thing._repr_html_()
    assert "|6000, scalar" in cells(many)
    assert "<pre>&lt;vrte.results.brdf.Brdf object" in replace(brdf, diagnostics={"method": Nasty()})._repr_html_()
    for thing, words in ((fluxes, "holds fluxes alone"), (few, "at least 2 different mu_o")):
        with pytest.raises(vrte.SceneError, match=words):
            thing.plot()


def test_a_spectrum_shows_its_reflectance_and_a_cut_a_wavelength() -> None:
    spectrum = THINGS["spectrum"]
    reflectance, cuts = spectrum.plot().axes
    np.testing.assert_array_equal(reflectance.get_lines()[0].get_ydata(), spectrum.reflectance[:, 0])
    assert [line.get_label() for line in cuts.get_lines()] == ["0.5 µm", "0.6 µm"]
    few = Spectrum([0.5], [vrte.brdf(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 1.0)]), 0.5, 0.5, nodes=4)])
    assert len(few.plot().axes) == 1


def test_parts_of_a_scene_describe_themselves_in_three_lines_and_in_a_table() -> None:
    particles = vrte.spheres((0.19, 3.5), radius_um=0.6, wavelength_um=0.64)
    others = [vrte.Layer(vrte.isotropic(), 0.5, 1.0), vrte.Layer(vrte.rayleigh(), 1.0, 2.0)]
    layers = [vrte.Layer.of(particles, 3.0), *others]
    three = vrte.Scene(layers, vrte.Lambertian(0.2))
    semi_infinite = vrte.Scene(vrte.Layer(vrte.rayleigh(), 1.0, np.inf))
    for part, pattern in (
        (particles, r"Particles: spheres, Monodisperse\(radius_um=0.6\), at 0.64 um, index 0.19 \+ 3.5i \(given\)\n"
                    r".*albedo 0\.\d+, g 0\.\d+, \d+ terms, polarizing\n  extinction \d"),
        (particles.phase_matrix, r"PhaseMatrix\(g 0\.\d+, \d+ terms, polarizing\)$"),
        (layers[0], r"Layer\(optical thickness 3, albedo 0\."),
        (three, r"Scene: 3 layers, optical thickness 6, base Lambertian\(albedo=0.2\)\n  top: optical thickness 3, .*\n"
                r"  bottom: optical thickness 2, albedo 1, g 0, 3 terms, polarizing \(1 more above\)$"),
        (semi_infinite, r"Scene: 1 layer, optical thickness inf, base black, which no light reaches\n"),
    ):  # fmt: skip
        assert re.match(pattern, repr(part))
        assert repr(part).count("\n") <= 2
    assert "|spheres, Monodisperse(radius_um=0.6), at 0.64 um" in cells(particles)
    assert all(picture(part._repr_html_()).size for part in (particles, layers[0]))
    assert "|layer 3||optical thickness 2, albedo 1, g 0, 3 terms, polarizing|" in cells(three)
    assert "|base||Lambertian(albedo=0.2)|" in cells(three)
    assert "|and||5 more layers|" in cells(vrte.Scene(25 * [others[0]]))


def test_the_plan_draws_its_operations_and_what_is_left_out() -> None:
    facts = THINGS["plan"].as_dict()
    (panel,) = THINGS["plan"].plot().axes
    outlines = [np.asarray(area.get_xy()) for area in panel.patches]
    drawn = sum(0.5 * abs((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) for x, y in (one.T for one in outlines))  # areas
    assert drawn == close_to(sum(block["operations"] for block in facts["blocks"]), rtol=1e-6, atol=0.0)
    assert set(sum_operations_by_order(facts)) == {block["algorithm"] for block in facts["blocks"]}
    layers = [vrte.Layer(one, 0.9, 1.0) for one in (vrte.henyey_greenstein(0.9, 300), vrte.rayleigh())]
    plan = vrte.plan("brdf", vrte.Scene(layers), mu_i=0.5, mu_o=0.5, nodes=8, threads=1)
    titles = [f"Plan of brdf: {light} light" for light in ("unpolarized", "polarized")]
    assert [panel.get_title() for panel in plan.plot().axes] == titles
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 40), albedo=0.9, thickness=1.0)])
    plan = vrte.plan("radiance", scene, mu0=0.5, mu=[0.5], nodes=20, threads=1)
    (panel,) = plan.plot().axes
    assert plan.orders < 40
    assert panel.get_xlim() == (-0.5, 39.5)
    texts = [text.get_text() for text in panel.get_legend().get_texts()]
    assert f"left out of multiple scattering: {40 - plan.orders} of 40" in texts
