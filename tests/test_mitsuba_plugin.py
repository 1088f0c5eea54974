"""The BSDF `vrte` in Mitsuba: its Mueller matrices, its energy, what it samples, its mirrored beam, what it refuses."""

import itertools
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import SceneError
from vrte.basics.arrays import Array
from vrte.basics.llvm import OLDEST, prepare_llvm
from vrte.formats.measured_polarized import directions, make_unit_vectors

from .helpers import assert_close
from .test_mitsuba import in_stokes_basis

WAVELENGTHS = [0.45, 0.65]
SATIN = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.1, "distribution": "ggx"}}
GLASS = {"interface": {"above": 1.0, "below": 1.5}}
RUTILE = {"rutile": {"index": [2.7, 0.0], "size": {"lognormal": {"median_um": 0.11, "sigma": 1.3}}}}
GOLD = {"gold": {"index": "gold", "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}}
SCENES: dict[str, dict[str, Any]] = {
    "gold": {"particles": GOLD, "layer": [{"particles": "gold", "thickness": np.inf}]},
    "satin": {"host_index": 1.5, "particles": RUTILE, "layer": [SATIN, {"particles": "rutile", "thickness": 40.0}]},
    "gloss": {"host_index": 1.5, "particles": RUTILE, "layer": [GLASS, {"particles": "rutile", "thickness": 40.0}]},
}
WHITE = {"layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": np.inf}]}


def set_variant(name: str) -> Any:
    """Mitsuba in one of its variants, with the plugin registered."""
    found = pytest.importorskip("mitsuba")
    if name.startswith("llvm") and not prepare_llvm():
        pytest.skip(f"no LLVM of version {OLDEST} or newer, which Mitsuba's variants llvm_* need")
    import vrte.mitsuba

    assert vrte.mitsuba.mi is found
    found.set_variant(name)
    return found


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A result of each scene, as `vrte export` writes it."""
    folder = tmp_path_factory.mktemp("files")
    return {name: str(folder / f"{name}.nc") for name in SCENES}


def load(files: dict[str, str], mitsuba: Any, name: str) -> Any:
    """The BSDF of a scene, which is solved where nobody did."""
    if not Path(files[name]).exists():
        done = vrte.export(SCENES[name], files[name], WAVELENGTHS, accuracy=1e-4)
        assert done.median < 1e-3
        assert done.energy < 0.01
    return mitsuba.load_dict({"type": "vrte", "filename": files[name]})


def look_from(mitsuba: Any, views: Array) -> Any:
    """Points seen along directions (n, 3) away from them, at the two wavelengths."""
    import drjit

    at = drjit.zeros(mitsuba.SurfaceInteraction3f, len(views))
    at.wi = mitsuba.Vector3f(np.float32(views.T))
    if mitsuba.is_spectral:
        at.wavelengths = mitsuba.UnpolarizedSpectrum(450.0, 450.0, 650.0, 650.0)
    return at


def solve_pairs(name: str) -> tuple[Array, Array, Array, Array]:
    """Directions of light and view (n, 3), and Mueller matrices (wavelength, n, 4, 4) in meridian planes."""
    random = np.random.default_rng(1)
    mu_i, mu_o, phi = random.uniform(0.15, 1.0, 7), random.uniform(0.15, 1.0, 7), random.uniform(0.0, 360.0, 7)
    asked = {"mu_i": mu_i, "mu_o": mu_o, "phi": phi, "accuracy": 1e-4}
    exact = vrte.spectrum({**SCENES[name], "brdf": {"mu_i": 1, "mu_o": 1}}, WAVELENGTHS, **asked)
    i, o, p = np.array(list(np.ndindex(7, 7, 7))).T
    light = make_unit_vectors(mu_i[i], np.full(i.size, 0.4))
    view = make_unit_vectors(mu_o[o], 0.4 + np.pi + np.radians(phi[p]))
    return light, view, exact.mueller[:, i, o, p], i


def turn_to_bases(mitsuba: Any, light: Array, view: Array, matrices: Array) -> Array:
    """Mueller matrices in Mitsuba's Stokes bases, times the cosine of the light."""
    before, after = (np.array([in_stokes_basis(mitsuba, one) for one in some]) for some in (-light, view))
    return np.asarray(light[:, 2, None, None] * (after @ matrices @ np.swapaxes(before, 1, 2)))


@pytest.mark.parametrize("name", ["gold", "satin", "gloss"])
def test_mueller_matrices_are_ours(name: str, files: dict[str, str]) -> None:
    """Against BRDFs solved at other directions, both ways along the light's path."""
    light, view, matrices, _ = solve_pairs(name)
    scalar = set_variant("scalar_spectral_polarized")
    ours = [turn_to_bases(scalar, light, view, one) for one in matrices]
    mitsuba = set_variant("llvm_ad_spectral_polarized")
    bsdf = load(files, mitsuba, name)
    back = mitsuba.BSDFContext(mitsuba.TransportMode.Importance)
    found = np.array(bsdf.eval(mitsuba.BSDFContext(), look_from(mitsuba, view), mitsuba.Vector3f(np.float32(light.T))))
    other = np.array(bsdf.eval(back, look_from(mitsuba, light), mitsuba.Vector3f(np.float32(view.T))))
    assert_close(other / view[:, 2], found / light[:, 2], rtol=1e-5, atol=1e-6)
    for lane, wanted in ((0, ours[0]), (2, ours[1])):
        off = np.abs(np.moveaxis(found[:, :, lane], -1, 0) - wanted)
        relative = off.max(axis=(1, 2)) / wanted[:, 0, 0]
        assert np.median(relative) < 1e-3
        assert np.quantile(relative, 0.95) < 0.02
        assert ((off**2).mean(axis=0) < 0.02 * (wanted**2).mean(axis=0) + 1e-12).all()


@pytest.mark.parametrize("variant", ["scalar_spectral_polarized", "scalar_spectral"])
def test_scalar_variants_are_those_of_llvm(variant: str, files: dict[str, str]) -> None:
    directions = make_unit_vectors(np.array([0.9, 0.5, 0.2]), np.array([0.3, 2.0, -1.0]))
    vector = set_variant(variant.replace("scalar", "llvm_ad"))
    bsdf = load(files, vector, "gloss")
    light, numbers = (
        vector.Vector3f(np.float32(directions.T)),
        [np.float32([0.9, 0.02, 0.4]), np.float32([0.2, 0.5, 0.7])],
    )
    at = look_from(vector, directions[::-1])
    expected = np.array(bsdf.eval(vector.BSDFContext(), at, light))
    drawn, weight = bsdf.sample(vector.BSDFContext(), at, vector.Float(numbers[0]), vector.Point2f(*numbers))
    found = np.array(drawn.wo).T, np.array(drawn.pdf), np.array(weight)
    scalar = set_variant(variant)
    bsdf = scalar.load_dict({"type": "vrte", "filename": files["gloss"]})
    for n, view in enumerate(directions[::-1]):
        at = scalar.SurfaceInteraction3f()
        at.wi = scalar.Vector3f(*view)
        if scalar.is_spectral:
            at.wavelengths = [450.0, 450.0, 650.0, 650.0]
        value = bsdf.eval(scalar.BSDFContext(), at, scalar.Vector3f(*directions[n]))
        assert_close(np.array(value), expected[..., n], rtol=1e-4, atol=1e-7)
        pair = [float(one[n]) for one in numbers]
        one, weight = bsdf.sample(scalar.BSDFContext(), at, pair[0], scalar.Point2f(*pair))
        assert_close(np.array(one.wo), found[0][n], rtol=0.0, atol=1e-4)
        assert_close(one.pdf, found[1][n], rtol=1e-3, atol=0.0)
        assert_close(np.array(weight), found[2][..., n], rtol=1e-3, atol=1e-6)


def test_an_older_llvm_is_an_error_and_no_end_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    set_variant("llvm_ad_rgb")
    from vrte.mitsuba import bsdf

    monkeypatch.setattr(bsdf, "OLDEST", 99)
    with pytest.raises(ImportError, match=r"has loaded LLVM [\d.]+, .*: import vrte\.mitsuba before mitsuba"):
        bsdf.register()


@pytest.mark.parametrize("name", ["gold", "satin", "gloss"])
@pytest.mark.parametrize("angle", [0.0, 30.0, 75.0])
def test_directions_have_their_density(name: str, angle: float, files: dict[str, str]) -> None:
    """Mitsuba's own chi-square test."""
    mitsuba = set_variant("llvm_ad_spectral")
    from mitsuba import chi2

    bsdf = load(files, mitsuba, name)
    context = mitsuba.BSDFContext()
    context.component = 0
    view = make_unit_vectors(np.cos(np.radians([angle])), np.array([0.7]))

    def sample(numbers: Any) -> Any:
        at = look_from(mitsuba, np.repeat(view, numbers.shape[1], 0))
        drawn, _ = bsdf.sample(context, at, numbers.x, mitsuba.Point2f(numbers.y, numbers.z))
        return drawn.wo, mitsuba.Float(np.float32(np.array(drawn.pdf) > 0.0))

    def find_density(light: Any) -> Any:
        return bsdf.pdf(context, look_from(mitsuba, np.repeat(view, light.shape[1], 0)), light)

    test = chi2.ChiSquareTest(
        chi2.SphericalDomain(), sample, find_density, sample_dim=3, sample_count=200_000, res=51, ires=16, seed=3
    )
    assert test.run(quiet=True)


@pytest.mark.parametrize("name", ["gold", "satin", "gloss"])
def test_sampled_light_is_all_that_comes_back(name: str, files: dict[str, str]) -> None:
    """To 1 %, with weights that hardly differ; the mirrored beam has its own matrix."""
    mitsuba = set_variant("llvm_ad_spectral_polarized")
    bsdf = load(files, mitsuba, name)
    solved = vrte.load(files[name])
    assert isinstance(solved, vrte.Spectrum)
    count = 20_000
    numbers = np.float32(np.random.default_rng(4).random((3, count)))
    for angle in (0.0, 20.0, 45.0, 70.0):
        mu = np.cos(np.radians(angle))
        at = look_from(mitsuba, np.repeat(make_unit_vectors(np.array([mu]), np.array([1.1])), count, 0))
        drawn, weight = bsdf.sample(mitsuba.BSDFContext(), at, mitsuba.Float(numbers[0]), mitsuba.Point2f(*numbers[1:]))
        weights, component = np.array(weight), np.array(drawn.sampled_component)
        for lane, one in ((0, solved[0]), (2, solved[1])):
            reflected = np.interp(-mu, -one.mu_i, one.total_reflectance)
            assert abs(weights[0, 0, lane].mean() / reflected - 1.0) < 0.01
            assert weights[0, 0, lane].std() < (0.4 if name == "gold" else 0.02) * reflected
            if name != "gloss":
                assert not component.any()
                continue
            assert one.specular is not None
            mirrored = np.mean(component == 1) * weights[:, :, lane, component == 1].mean(axis=-1)
            exact = [np.interp(-mu, -one.mu_i, one.specular[:, j, k]) for j, k in np.ndindex(4, 4)]
            view, light = (make_unit_vectors(np.array([mu]), np.array([1.1 + turn])) for turn in (0.0, np.pi))
            scalar = set_variant("scalar_spectral_polarized")
            wanted = turn_to_bases(scalar, light, view, np.reshape(exact, (1, 4, 4)))[0] / mu
            mitsuba = set_variant("llvm_ad_spectral_polarized")
            assert_close(mirrored, wanted, rtol=0.1, atol=1e-3)


def test_a_white_furnace(files: dict[str, str]) -> None:
    """A white sphere under an even sky is as bright as the sky, in a picture by Mitsuba's path tracer."""
    mitsuba = set_variant("llvm_ad_rgb")
    path = files["gold"].replace("gold", "white")
    vrte.export(WHITE, path, np.linspace(0.43, 0.67, 7), accuracy=1e-4)
    view = mitsuba.ScalarTransform4f().look_at(origin=[0, -5, 0], target=[0, 0, 0], up=[0, 0, 1])
    film = {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "perspective", "fov": 20, "to_world": view, "film": film},
        "ball": {"type": "sphere", "bsdf": {"type": "vrte", "filename": path}},
        "sky": {"type": "constant"},
    }
    picture = np.array(mitsuba.render(mitsuba.load_dict(scene), spp=256))
    assert_close(picture.mean(axis=(0, 1)), 1.0, rtol=0.01, atol=0.0)
    radius = np.hypot(*(np.mgrid[:24, :24] - 11.5))
    for low, high in itertools.pairwise((0.0, 6.0, 8.0, 10.0, 11.0, 12.0)):
        ring = picture[(radius >= low) & (radius < high)].mean(axis=-1)
        assert abs(ring.mean() - 1.0) < 0.01


@pytest.mark.slow
def test_noise_for_the_time_beside_the_table_of_mitsuba(files: dict[str, str]) -> None:
    """Variance times processor time of a ball under an even sky, a fifth of that of measured_polarized at most."""
    mitsuba = set_variant("llvm_ad_spectral_polarized")
    path = files["gold"].replace("gold", "five")
    for suffix in (".nc", ".pbsdf"):
        vrte.export(SCENES["satin"], path.replace(".nc", suffix), np.linspace(0.45, 0.65, 5), accuracy=1e-4)
    view = mitsuba.ScalarTransform4f().look_at(origin=[0, -5, 0], target=[0, 0, 0], up=[0, 0, 1])
    film = {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}}
    costs = []
    for bsdf in (
        {"type": "vrte", "filename": path},
        {"type": "measured_polarized", "filename": path.replace(".nc", ".pbsdf"), "alpha_sample": 1.0},
    ):
        scene = {
            "type": "scene",
            "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": 3}},
            "sensor": {"type": "perspective", "fov": 20, "to_world": view, "film": film},
            "ball": {"type": "sphere", "bsdf": bsdf},
            "sky": {"type": "constant"},
        }
        made, pictures, seconds = mitsuba.load_dict(scene), [], []
        for seed in range(5):  # the first compiles
            start = time.process_time()
            pictures.append(np.array(mitsuba.render(made, seed=seed, spp=64))[..., :3])
            seconds.append(time.process_time() - start)
        costs.append(np.var(pictures, axis=0, ddof=1).mean() * min(seconds))
    assert costs[0] < 0.2 * costs[1]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"mu_i": [0.9, 0.5], "mu_o": [0.9, 0.5]}, "mu_i must be 8 or more, from above 0.99 to below 0.05"),
        ({"mu_i": [0.5, 0.9], "mu_o": [0.5, 0.9]}, "mu_i and mu_o must be the same descending cosines"),
        (directions(16, 9) | {"phi": np.arange(0.0, 360.0, 30.0)}, "phi must be 8 or more azimuths, ascending from 0"),
        (directions(16, 9), "what a rough surface reflects is in the result on its grid alone"),
    ],
)
def test_what_is_no_table_is_refused(asked: dict[str, Any], words: str, tmp_path: Path) -> None:
    set_variant("scalar_rgb")
    from vrte.mitsuba.bsdf import read_table

    path = str(tmp_path / "a.nc")
    content = {"layer": [SATIN, {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}], "nodes": 4}
    vrte.spectrum({**content, "brdf": {"mu_i": 1, "mu_o": 1}}, [0.5], **asked).save(path)
    with pytest.raises(SceneError, match=f"^{re.escape(path)}: {words}"):
        read_table(path, polarized=True)


def test_a_field_and_a_lower_side_are_refused(tmp_path: Path) -> None:
    set_variant("scalar_rgb")
    from vrte.mitsuba.bsdf import read_table

    path = str(tmp_path / "a.nc")
    layer = vrte.Layer(vrte.isotropic(), 0.5, 1.0)
    vrte.radiance(vrte.Scene([layer]), mu0=0.5, mu=[0.5], phi=[0.0], tau=[0.0], nodes=4).save(path)
    with pytest.raises(SceneError, match="must hold a BRDF, not a Field"):
        read_table(path, polarized=False)
    vrte.brdf(vrte.Scene([layer]), **directions(16, 9), illuminate="bottom", nodes=4).save(path)
    with pytest.raises(SceneError, match="illuminate must be 'top'"):
        read_table(path, polarized=False)
    with pytest.raises(SceneError, match=r"diffuse leaves out a beam that a \.nc holds"):
        vrte.export(SCENES["gloss"], tmp_path / "b.nc", WAVELENGTHS, diffuse=True)
