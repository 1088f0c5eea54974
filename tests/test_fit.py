"""Fits: numbers come back from what they made, with honest errors, and what the data cannot tell is said; fits that do
not fit say so: p-values, runs of residuals, guesses at units, and error bars that grow."""

import itertools
import re
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.gloss import find_glosses
from vrte.appearance.panel import make_panel
from vrte.calls import brdfs
from vrte.cli import main
from vrte.fit.model import make_model
from vrte.fit.problem import FitProblem, StaleSlopesError, fit_residuals
from vrte.fit.run import FitStep
from vrte.fit.verdict import UNLIKELY, count_runs, find_p_value

from .helpers import assert_close, close_to

SCENE = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.95, 1.0)], vrte.Lambertian(0.3))
LAYER = {"phase": "rayleigh", "albedo": 0.95, "thickness": 1.0}
FILM = {"layer": [LAYER], "base": {"kind": "lambertian", "albedo": 0.3}}
ANGLES = [-60.0, -30.0, 0.0, 30.0, 60.0]
ROWS = vrte.Measurement("f00", 0.0, theta_i_deg=40.0, theta_o_deg=ANGLES)


def measure(scene: Any = SCENE, noise: float = 0.0) -> Any:
    """What a scene shows, with noise relative to it, or sigmas as if there were some."""
    exact = ROWS.predict(scene, nodes=4)
    drawn = np.random.default_rng(1).standard_normal(exact.size)
    return ROWS.measure(exact * (1.0 + noise * drawn), np.abs(exact) * (noise or 0.01))


def test_numbers_come_back_from_what_they_made() -> None:
    free = {"layer[1].albedo": {"start": 0.8}, "layer[1].thickness": {"start": 0.6, "spacing": "log"}}
    found = vrte.fit(measure(), SCENE, free, nodes=4)
    assert_close(found.values, [0.95, 1.0], rtol=1e-5, atol=0.0)
    assert found.chi2 < 1e-8
    assert (found.degrees_of_freedom, found.interrupted) == (3, False)
    assert found.scene().layers[0].thickness == close_to(1.0, rtol=1e-5, atol=0.0)
    assert "layer[1].albedo" in str(found)
    with pytest.warns(vrte.MisfitWarning, match="all rows are above what the model shows"):
        found = vrte.fit(measure(), SCENE, {"base.albedo": {"start": 0.1, "high": 0.2}}, nodes=4)
    assert any("base.albedo is at its upper bound 0.2" in one for one in found.notes)


def test_one_number_of_several_layers_is_fitted() -> None:
    """The total of a stack whose layers keep their parts, from 1.2 back to what it was."""
    stack = {"layer": [LAYER, LAYER | {"albedo": 0.6, "thickness": 0.5}]}
    found = vrte.fit(measure(stack), stack, {"layer[1:2].thickness": {"start": 1.2}}, nodes=4)
    assert_close(found.values, [1.5], rtol=1e-5, atol=0.0)
    layers = found.content()["layer"]
    assert layers[0]["thickness"] == close_to(2.0 * layers[1]["thickness"], rtol=1e-12, atol=0.0)


def test_bounds_are_a_pair_and_a_number_in_per_cent_is_free() -> None:
    film = {**FILM, "base": {"kind": "lambertian", "albedo": "20 %"}}
    found = vrte.fit(measure(), film, {"base.albedo": [0.1, 0.6]}, nodes=4)
    assert_close(found.values, [0.3], rtol=1e-5, atol=0.0)
    assert found.problem is not None
    (number,) = found.problem.parameters
    assert (number.start, number.low, number.high) == (0.2, 0.1, 0.6)


def test_derivatives_are_updated_and_found_anew_where_they_lead_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rosenbrock's valley in the place of a scene: (1, 1), with fewer derivatives than trials."""
    problem = vrte.fit(measure(), SCENE, ["layer[1].thickness", "layer[1].albedo"], nodes=4).problem
    pairs = zip(problem.parameters, (-1.2, 1.0), strict=True)
    free = [replace(one, start=start, low=-2.0, high=2.0) for one, start in pairs]
    asked = {"values": 0, "derivatives": 0}

    def predict(values: Any) -> Any:
        asked["values"] += 1
        return np.array([10.0 * (values[1] - values[0] ** 2), 1.0 - values[0]])

    def linearize(values: Any) -> Any:
        asked["derivatives"] += 1
        asked["values"] -= 1
        return predict(values), np.array([[-20.0 * values[0], 10.0], [-1.0, 0.0]])

    model = SimpleNamespace(predict=predict, linearize=linearize, measurement=SimpleNamespace(value=np.zeros(2)))
    valley = FitProblem(model, free, np.full((2, 2), np.nan), np.ones(2))  # type: ignore[arg-type]
    begin, every, stale = np.array([-1.2, 1.0]), np.ones(2, bool), []
    monkeypatch.setattr(StaleSlopesError, "__init__", lambda self: stale.append(self))
    point, least, converged = fit_residuals(valley, begin, every, 200)
    assert_close(point.values, 1.0, rtol=1e-6, atol=0.0)
    assert converged
    assert least < 1e-12
    assert stale
    assert 2 < asked["derivatives"] < asked["values"] / 2
    assert not fit_residuals(valley, begin, every, 5)[2]


def test_a_prior_counts_like_a_row() -> None:
    """And without sigma errors are those of a sigma that chi2 agrees with."""
    loose = vrte.fit(measure(), SCENE, ["base.albedo"], nodes=4)
    with pytest.warns(vrte.MisfitWarning, match="chi2"):  # data and prior do not go together
        tight = vrte.fit(measure(), SCENE, ["base.albedo"], {"base.albedo": (0.5, loose.errors.item())}, nodes=4)
    assert tight.values.item() == close_to(0.4, rtol=0.0, atol=0.01)  # half way: both know it equally well
    weighed = tight.slopes[:, 0] / tight.sigma
    expected = tight.error_scale * (weighed @ weighed + loose.errors.item() ** -2) ** -0.5
    assert tight.errors.item() == close_to(expected, rtol=1e-6, atol=0.0)
    known = measure(noise=0.01)
    found = vrte.fit(known.measure(known.value, np.nan), SCENE, ["layer[1].thickness"], nodes=4)
    assert (found.residuals**2).sum() / found.degrees_of_freedom == close_to(1.0, rtol=1e-6, atol=0.0)
    weighed = found.slopes / found.sigma[:, None]
    assert_close(found.covariance, np.linalg.inv(weighed.T @ weighed), rtol=1e-9, atol=0.0)
    assert "no sigma" in found.notes[0]


def test_a_bare_base_is_fitted_to_values_below_0() -> None:
    """Without a layer, from a number at 0 that may be negative: bounds are what the base takes."""
    sands = [vrte.Hapke(0.5, linear=linear) for linear in (-0.5, 0.0)]
    content = {"base": {"kind": "hapke", "albedo": 0.5, "linear": 0.0}}
    given, mu_i = measure(vrte.Scene([], sands[0])), np.cos(np.radians(40.0))
    shown = [sands[0].reflect(mu_i, np.cos(np.radians(abs(at))), 180.0 * (at < 0))[0, 0].item() for at in ANGLES]
    assert_close(given.value, shown, rtol=1e-12, atol=0.0)
    for start in (vrte.Scene([], sands[1]), content):
        found = vrte.fit(given, start, ["base.linear"], nodes=4)
        assert found.values.item() == close_to(-0.5, rtol=1e-5, atol=0.0)
        assert [(one.low, one.high) for one in found.find_problem().parameters] == [(-2.0, 2.0)]


def test_colours_of_a_substance_that_is_not_known_everywhere() -> None:
    """The table begins at 0.43 um: colours are worked out from there, as those of `vrte.appearance`."""
    paint = {
        "nodes": 4,
        "particles": {"white": {"index": "main/TiO2/Devore-o", "radius_um": 0.1}},
        "layer": [{"particles": "white", "host_index": 1.5, "thickness": 9.0}],
        "base": {"kind": "lambertian", "albedo": 0.1},
    }
    given = vrte.Measurement(["L", "a", "b"], 50.0, 0.1, geometry="45:0")
    seen = vrte.appearance(paint, geometries=["45:0"]).colour("45:0")
    assert_close(given.predict(paint), [seen.L, seen.a, seen.b], rtol=0.0, atol=2e-3)
    found = vrte.fit(given.measure([seen.L, seen.a, seen.b]), paint, ["layer[1].thickness"], most_steps=1)
    assert "below 0.43 µm, taken as at 0.43" in str(found)


def test_roughness_is_fitted_to_gloss() -> None:
    """Gloss is that of a panel, its derivatives those of differences, under a rough surface and a smooth one; a film
    without a surface has none."""
    film = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
    surface = {"above": 1.0, "below": 1.5, "roughness": 0.06, "distribution": "ggx"}
    content = {"layer": [{"interface": surface}, film]}
    at = [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70]
    rows = vrte.Measurement(["gloss_20", "gloss_60", "gloss_85"], 10.0, 0.5)
    names = ["layer[1].interface.roughness", "layer[2].albedo", "layer[1].interface.below"]
    for interface, free in ((surface, names), ({"above": 1.0, "below": 1.5}, names[1:])):
        here = {**content, "layer": [{"interface": interface}, film]}
        exact, differences = (
            make_model(rows, here, free, 4, wavelengths_um=at, jacobian=how) for how in ("exact", "differences")
        )
        (value, slopes), (_, expected) = exact.linearize(exact.start), differences.linearize(differences.start)
        assert_close(value, [*find_glosses(make_panel(here, at, nodes=4)).values()], rtol=1e-9, atol=0.0)
        assert_close(slopes, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    guess = {"layer": [{"interface": {**surface, "roughness": 0.1}}, film]}
    measured = rows.measure(rows.predict(content, nodes=4, wavelengths_um=at))
    found = vrte.fit(measured, guess, names[:1], nodes=4, wavelengths_um=at)
    assert_close(found.values, [0.06], rtol=1e-6, atol=0.0)
    with pytest.raises(vrte.SceneError, match="gloss needs a surface"):
        rows.predict({"layer": [film]}, nodes=4, wavelengths_um=at)
    with pytest.raises(vrte.SceneError, match="row 1: wavelength_um must be empty: gloss_60 has none"):
        vrte.Measurement("gloss_60", 50.0, wavelength_um=0.5)


def test_what_cannot_be_told_apart_is_said(tmp_path: Path) -> None:
    """And stands on the page, which fetches nothing."""
    halves = FILM | {"layer": [LAYER | {"thickness": 0.5}] * 2}
    with pytest.warns(vrte.IndistinguishableWarning, match=r"layer\[1\].thickness.*layer\[2\].thickness"):
        found = vrte.fit(measure(), halves, ["layer[1].thickness", "layer[2].thickness"], nodes=4)
    assert found.singular_values[1] < 1e-3 * found.singular_values[0]
    assert re.search(r"layer\[1\].thickness up \d+ % with layer\[2\].thickness down \d+ %", found.blind_spots[0])
    found.page(tmp_path / "fit.html")
    text = (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert "http" not in text.replace("http://www.w3.org", "")
    assert "src=" not in text.replace('src="data:image/svg+xml;base64,', "")
    assert found.blind_spots[0] in text
    assert "<table>" in text


def test_an_outlier_moves_a_robust_fit_less() -> None:
    given = measure()
    spoilt = given.measure(given.value * np.where(np.arange(5) == 2, 1.5, 1.0))
    words = r"row 3 is farthest off, .* sigma: f00 at theta_i_deg 40, theta_o_deg 0"
    with pytest.warns(vrte.MisfitWarning, match=words):
        fits = [vrte.fit(spoilt, SCENE, ["base.albedo"], nodes=4, loss=loss) for loss in ("linear", "soft_l1")]
    far, near = (abs(found.values.item() - 0.3) for found in fits)
    assert near < 0.3 * far


@pytest.mark.slow
def test_a_profile_of_a_linear_problem_is_a_parabola_as_wide_as_the_error() -> None:
    found = vrte.fit(measure(noise=0.001), SCENE, ["layer[1].thickness", "base.albedo"], nodes=4)
    profile, best, error = found.profile("base.albedo", points=5), found.values[1], found.errors[1]
    rise = profile.chi2 - found.chi2
    parabola = ((profile.values - best) / error) ** 2
    assert_close(0.5 * (rise + rise[::-1]), parabola, rtol=0.0, atol=0.02)  # what is skew is of the third order
    assert [profile.low, profile.high] == close_to([best - error, best + error], rtol=0.0, atol=0.03 * error)
    assert profile.others.shape == (5, 1)


def test_stopped_it_goes_on_from_its_file_and_ends_at_the_same(tmp_path: Path) -> None:
    """Stopped, it keeps the best so far; the best of several starts is kept, and all are told."""

    def stop(step: FitStep) -> None:
        if step.step == 2:
            raise KeyboardInterrupt

    free = {"layer[1].thickness": {"start": 4.0, "low": 0.1, "high": 6.0}}
    given, state = measure(), tmp_path / "fit.state"
    how: dict[str, Any] = {"nodes": 4, "starts": 2}
    whole = vrte.fit(given, SCENE, free, **how)
    part = vrte.fit(given, SCENE, free, **how, resume=state, watch=stop)
    with pytest.warns(vrte.MisfitWarning):
        assert part.chi2 < 0.5 * vrte.fit(given, SCENE, free, nodes=4, most_steps=1).chi2
    assert part.interrupted
    assert "interrupted" in part.notes[-1]
    assert not list(tmp_path.glob(".vrte*"))
    again: list[FitStep] = []
    found = vrte.fit(given, SCENE, free, **how, resume=state, watch=again.append)
    assert_close(found.values, whole.values, rtol=1e-6, atol=0.0)
    assert again[0].chi2 == close_to(part.chi2, rtol=1e-6, atol=0.0)  # where it was
    assert len(found.starts) == 2
    assert found.starts[0].chi2 <= found.starts[1].chi2
    assert found.starts[0].found == close_to(found.values, rtol=1e-6, atol=0.0)
    quick: list[FitStep] = []
    same = vrte.fit(given, SCENE, free, **how, resume=state, watch=quick.append)
    assert not quick
    assert_close(same.values, found.values, rtol=1e-7, atol=0.0)
    with pytest.raises(vrte.SceneError, match="is of another fit"):
        vrte.fit(given.measure(given.value * 1.01), SCENE, free, **how, resume=state)
    state.write_bytes(state.read_bytes().replace(b"1", b"2", 1))
    with pytest.raises(vrte.SceneError, match="damaged"):
        vrte.fit(given, SCENE, free, **how, resume=state)


def test_a_fit_that_is_saved_comes_back_and_can_still_be_asked(tmp_path: Path) -> None:
    found = vrte.fit(measure(noise=0.01), FILM, ["base.albedo"], {"base.albedo": (0.3, 0.1)}, nodes=4)
    found.save(tmp_path / "fit.json")
    back = vrte.Fit.load(tmp_path / "fit.json")
    assert str(back) == str(found)
    np.testing.assert_array_equal(back.covariance, found.covariance)
    np.testing.assert_array_equal(back.residuals, found.residuals)
    assert back.starts == found.starts
    assert back.scene().thickness == found.scene().thickness
    one, other = (fit.profile("base.albedo", points=3) for fit in (found, back))
    assert_close(one.chi2, other.chi2, rtol=1e-9, atol=0.0)
    found.write_scene(tmp_path / "fitted.toml")
    assert vrte.SceneFamily(tmp_path / "fitted.toml", ["base.albedo"]).values.tolist() == found.values.tolist()
    of_scene = vrte.fit(measure(), SCENE, ["base.albedo"], nodes=4)
    of_scene.save(tmp_path / "scene.json")
    (tmp_path / "other.json").write_text("{}")
    for wrong, words in (
        (lambda: vrte.Fit.load(tmp_path / "scene.json").scene(), "does not hold its scene"),
        (lambda: found.scene(np.array(0.5)), "wavelength_um must be one of the fit's, only the scene's own, not 0.5"),
        (lambda: of_scene.write_scene(tmp_path / "none.toml"), "no scene file"),
        (lambda: found.write_scene(tmp_path / "none.csv"), "must end in .toml"),
        (lambda: found.save(tmp_path / "none.csv"), "must end in .json"),
        (lambda: vrte.Fit.load(tmp_path / "other.json"), "no file that a fit wrote"),
        (lambda: found.profile("layer[1].albedo"), "name must be one of base.albedo"),
        (lambda: found.profile("base.albedo", [0.5, 1.5]), "within the bounds"),
    ):
        with pytest.raises(vrte.SceneError, match=re.escape(words)):
            wrong()


def write_example(folder: Path, fit: str) -> Path:
    """A file for `vrte fit` beside its measurement."""
    (folder / "rows.csv").write_text("quantity,theta_i_deg,value,sigma\ntotal_reflectance,8,0.5,0.01\n")
    path = folder / "film.toml"
    layer = 'nodes = 4\n[[layer]]\nphase = "rayleigh"\nalbedo = 0.95\nthickness = 1.0\n'
    path.write_text(f'{layer}[base]\nkind = "lambertian"\nalbedo = 0.3\n[fit]\n{fit}')
    return path


ONE = 'measurement = "rows.csv"\nfree = ["base.albedo"]\n'


def test_the_command_prints_numbers_and_writes_what_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_example(tmp_path, f'{ONE}profiles = ["base.albedo"]\n')
    outputs = [tmp_path / name for name in ("fit.json", "fitted.toml")]
    words = ["fit", str(path), *(word for one in outputs for word in ("-o", str(one)))]
    assert main([*words, "--resume", str(tmp_path / "state")]) == 0
    reported = capsys.readouterr().out
    assert ("base.albedo  " in reported, "Profile(base.albedo" in reported) == (True, True)
    assert vrte.Fit.load(outputs[0]).content() == vrte.SceneFamily(outputs[1], []).content_at([])


@pytest.mark.parametrize(
    ("fit", "more", "words"),
    [
        ('free = ["base.albedo"]', [], "fit.measurement: is missing"),
        ('measurement = "rows.csv"', [], "fit.free: is missing"),
        ('measurement = "rows.csv"\nfree = [1]', [], "fit.free = [1]: must be a list of names"),
        ('measurement = "rows.csv"\nfree = ["base.albdo"]', [], "base.albdo"),
        (f"{ONE}start = 3", [], "unknown key; did you mean 'starts'"),
        (f"{ONE}starts = 0", [], "fit.starts must be"),
        (f"{ONE}seed = 0.5", [], "must be a whole number"),
        (f'{ONE}profiles = ["a"]', [], "must be a list of names that are free"),
        ('measurement = "no.csv"\nfree = ["base.albedo"]', [], "no.csv: No such file"),
        (ONE, ["-o", "film.toml"], "is the file that is read"),
        (ONE, ["--resume", "absent/film.state"], "film.state lies in a folder that does not exist"),
    ],
)
def test_what_cannot_be_fitted_is_refused_before_the_work(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch, fit: str, more: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if more:
        monkeypatch.setattr("vrte.commands.fit.fit", None)
    assert main(["fit", str(write_example(tmp_path, fit).relative_to(tmp_path)), *more]) == 2
    reported = capsys.readouterr().err
    assert words in reported
    assert reported.count("\n") == 1


@pytest.mark.parametrize(
    "bottom",
    [
        [],
        [{"interface": {"above": 1.3, "below": 1.1}}],
        [{"interface": {"above": 1.3, "below": 1.1, "roughness": 0.3}}],
    ],
)
def test_light_that_gets_through_has_derivatives(bottom: list[dict[str, Any]]) -> None:
    """What is weighed below the last interface, or below a layer without one, meets the stack from there."""
    film = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.3, "host_index": 1.3}
    content = {"nodes": 8, "layer": [{"interface": {"above": 1.0, "below": 1.3}}, film, *bottom]}
    rows = vrte.Measurement(["diffuse_reflectance", "diffuse_transmittance"], 0.1, 1.0, theta_i_deg=30.0)
    free = ["layer[2].albedo", "layer[2].thickness"]
    (_, slopes), (_, expected) = (
        (model := make_model(rows, content, free, jacobian=how)).linearize(model.start)
        for how in ("exact", "differences")
    )
    assert_close(slopes, expected, rtol=1e-7, atol=0.0)


@pytest.mark.slow
def test_derivatives_of_every_kind_of_quantity_are_those_of_differences() -> None:
    """Beams, ports, ratios and colours among them, through particles, thickness and an interface."""
    film = {"particles": {"dust": 1.0}, "volume_fraction": 0.002, "thickness_um": 30.0}
    above, below = ({"interface": {"above": n, "below": m}} for n, m in ((1.0, 1.3), (1.3, 1.1)))
    content = {"nodes": 8, "wavelength_um": 0.55, "host_index": 1.3, "layer": [above, film, below]}
    content["particles"] = {"dust": {"index": [1.6, 0.01], "radius_um": 0.08}}
    free = ["particles.dust.radius_um", "particles.dust.index[2]", "layer[2].thickness_um", "layer[3].interface.below"]
    beams = [f"{kind}_{what}" for kind in ("total", "diffuse") for what in ("reflectance", "transmittance")]
    seen = ["f00", "t10", "normalized_f11", "degree_of_linear_polarization", "transmitted_minus_q_over_i"]
    names = [*beams, "specular_reflectance", "direct_transmittance", *seen, *["reflectance"] * 4, "X", "L", "a", "b"]
    n, m, nan = len(beams) + 2, len(seen), float("nan")
    at: dict[str, Any] = {"theta_i_deg": [30.0] * (n + m) + [nan] * 8}
    at |= {"theta_o_deg": [nan] * n + [40.0] * m + [nan] * 8, "phi_deg": [nan] * n + [60.0] * m + [nan] * 8}
    at |= {"geometry": [""] * (n + m) + ["8:di", "8:de", "45:0", "di:di"] + ["8:di"] * 4}
    rows = vrte.Measurement(names, 0.1, 1.0, **at, wavelength_um=[nan] * (n + m) + [0.5] * 4 + [nan] * 4)
    options = {"wavelengths_um": np.linspace(0.4, 0.7, 9)}
    one, other = (make_model(rows, content, free, jacobian=how, **options) for how in ("exact", "differences"))
    value, slopes = one.linearize(one.start)
    same, expected = other.linearize(other.start)
    assert_close(value, same, rtol=1e-12, atol=0.0)
    assert_close(slopes, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected).max(axis=1).min() > 0.0


DEGREES = np.linspace(-60.0, 60.0, 13)
MANY_ROWS = vrte.Measurement("reflectance_factor", 0.0, 0.002, theta_i_deg=35.0, theta_o_deg=DEGREES)
EXACT = MANY_ROWS.predict(SCENE, nodes=4)
MEASURED = MANY_ROWS.measure(EXACT + 0.002 * np.random.default_rng(5).standard_normal(13))


def fit_thickness(measured: vrte.Measurement) -> vrte.Fit:
    free = {"layer[1].thickness": {"start": 0.8, "low": 0.1, "high": 10.0}}
    return vrte.fit(measured, SCENE, free, nodes=4)


def test_the_chance_of_runs_is_that_of_all_orders() -> None:
    """Also of a million rows; and p-values of chi-square at 5 and 1 per cent are as tables print them."""
    for up, down in ((3, 4), (5, 2), (1, 6)):
        orders = sorted({*itertools.permutations([1] * up + [-1] * down)})
        runs = np.array([1 + np.count_nonzero(np.diff(order)) for order in orders])
        for order, count in zip(orders, runs, strict=True):
            assert count_runs(np.array(order)) == (count, close_to(np.mean(runs <= count), rtol=1e-12, atol=0.0))
    assert count_runs(np.repeat([1, -1], 500_000)) == (2, close_to(0.0, rtol=0.0, atol=1e-300))
    assert count_runs(np.tile([1, -1], 500_000)) == (1_000_000, close_to(1.0, rtol=0.0, atol=1e-6))
    for freedom, five, one in ((1, 3.841, 6.635), (6, 12.592, 16.812), (30, 43.773, 50.892)):
        assert_close([find_p_value(five, freedom), find_p_value(one, freedom)], [0.05, 0.01], rtol=2e-3, atol=0.0)
    assert np.isnan(find_p_value(1.0, 0))


@pytest.mark.parametrize("has_sigma", [True, False])
def test_other_units_are_guessed(has_sigma: bool) -> None:
    cosines = {"theta_i_deg": np.cos(0.6), "theta_o_deg": np.cos(np.radians(DEGREES))}
    radians = {"theta_i_deg": 0.6, "theta_o_deg": np.radians(DEGREES)}
    for wrong, words in (
        (cosines, "are 0.5 to 1: these look like cos"),
        (radians, "are 0 to 1.0472: these look like radians, and deg"),
        ({"value": 100.0 * MEASURED.value, "sigma": 0.2}, "this looks like per cent"),
    ):
        given = replace(MEASURED, **(wrong if has_sigma else wrong | {"sigma": None}))
        with warnings.catch_warnings(record=True) as reported:
            warnings.simplefilter("always")
            found = fit_thickness(given)
        assert any(words in note for note in found.notes)
        assert any(one.category is vrte.UnitsWarning and words in str(one.message) for one in reported)
        assert any(one.category is vrte.MisfitWarning for one in reported) or not has_sigma


def test_errors_grow_by_what_sigma_is_too_small(tmp_path: Path) -> None:
    """Errors, and the profile with them, are those of a sigma that chi2 agrees with; the best stays where it is. A fit
    that fits has no notes."""
    honest = fit_thickness(MEASURED)
    assert honest.p_value == close_to(find_p_value(honest.chi2, 12), rtol=1e-12, atol=0.0)
    assert honest.p_value > UNLIKELY
    assert (honest.error_scale, honest.notes) == (1.0, ())
    with pytest.warns(vrte.MisfitWarning, match=r"by chance in .* of fits; errors are \S+ times larger for it"):
        found = fit_thickness(MEASURED.measure(MEASURED.value, 0.0002))
    assert found.error_scale == close_to(np.sqrt(found.reduced_chi2), rtol=1e-12, atol=0.0)
    assert found.error_scale == close_to(10.0 * np.sqrt(honest.reduced_chi2), rtol=1e-6, atol=0.0)
    assert_close(found.errors, honest.errors * np.sqrt(honest.reduced_chi2), rtol=1e-5, atol=0.0)
    assert_close(found.values, honest.values, rtol=1e-6, atol=0.0)
    profile = found.profile("layer[1].thickness", points=5)
    assert 0.5 * (profile.high - profile.low) == close_to(found.errors.item(), rtol=0.02, atol=0.0)
    found.save(tmp_path / "fit.json")
    assert str(vrte.Fit.load(tmp_path / "fit.json")) == str(found)


def test_a_wrong_model_is_known_by_its_runs_where_chi2_is_not() -> None:
    """An error of sigmas that bends over all angles, with sigma twice too large: chi2 passes, the order does not."""
    bent = EXACT * (1.0 + 0.02 * np.sin(np.radians(2.0 * DEGREES)))
    sigma = 1.2 * np.std(bent - EXACT)
    with pytest.warns(vrte.MisfitWarning, match=r"may not fit: residuals change sign rarely .* \(\d runs of one sign"):
        found = fit_thickness(MANY_ROWS.measure(bent, sigma))
    assert found.p_value > UNLIKELY
    assert found.error_scale == 1.0
    shuffled = np.random.default_rng(2).permutation(13)
    with pytest.warns(vrte.MisfitWarning, match="may not fit"):  # rows in any order
        fit_thickness(MANY_ROWS.measure(bent, sigma).pick(shuffled))


SPECTRAL = {"layer": [LAYER | {"thickness": 0.4}, LAYER | {"albedo": 0.8}]}
NAMES = ["layer[1].thickness", "layer[2].albedo"]


@pytest.mark.parametrize(
    ("quantity", "where"),
    [
        ("f00", {"theta_i_deg": 40.0, "theta_o_deg": 20.0}),
        ("total_transmittance", {"theta_i_deg": 40.0}),
        ("reflectance", {"geometry": "8:di"}),
    ],
)
def test_scenes_of_a_fit_are_solved_together_as_they_are_alone(
    quantity: str, where: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two bases and wavelengths, one call of four scenes where they take one, to the same bits; how the layers change
    is found once a wavelength, and is the same over either base."""
    at = np.array([0.5, 0.6, 0.5, 0.6])
    rows = vrte.Measurement(quantity, 0.1, wavelength_um=at, base=[0.2, 0.2, 0.7, 0.7], **where)
    model = make_model(rows, SPECTRAL, NAMES, nodes=4)
    together: list[int] = []
    solve = brdfs.solve_batch

    def note(requests: Any, indices: list[int], *more: Any) -> Any:
        together.append(len(indices))
        return solve(requests, indices, *more)

    monkeypatch.setattr(brdfs, "solve_batch", note)
    values, slopes = model.linearize(model.start)
    found = model.predict(model.start)
    assert sum(together) == (0 if quantity == "total_transmittance" else 4)
    assert found.tolist() == values.tolist()
    monkeypatch.setattr(brdfs, "sort_into_batches", lambda requests: [])
    assert model.predict(model.start).tolist() == found.tolist()
    for row, base in enumerate((0.2, 0.7)):
        content = SPECTRAL | {"base": {"kind": "lambertian", "albedo": base}}
        alone = make_model(vrte.Measurement(quantity, 0.1, **where), content, NAMES, nodes=4)
        value, slope = alone.linearize(alone.start)
        assert (value[0], *slope[0]) == (found[2 * row], *slopes[2 * row])
