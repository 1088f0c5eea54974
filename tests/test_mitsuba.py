"""The table for Mitsuba 3: the splines it is made with, its container, and what Mitsuba itself reads from it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import run
from vrte import SceneError, Spectrum
from vrte.basics.arrays import Array
from vrte.calls import mitsuba as mitsuba_call
from vrte.formats import between_directions, measured_polarized
from vrte.formats.mitsuba_tensor import read_tensors, write_tensors
from vrte.optics.spheres import spheres

from .helpers import assert_close, close_to

WAVELENGTHS = [0.45, 0.5, 0.55, 0.6, 0.65]
GOLD: dict[str, Any] = {
    "nodes": 16,
    "particles": {"gold": {"index": "gold", "radius_um": 0.2}},
    "layer": [{"particles": "gold", "thickness": 5.0}],
    "base": {"kind": "lambertian", "albedo": 0.5},
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}
WHITE: dict[str, Any] = {
    "nodes": 4,
    "layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": 0.0}],
    "base": {"kind": "lambertian", "albedo": 1.0},
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}


@pytest.fixture(scope="module")
def gold() -> Spectrum:
    """Five wavelengths, the first and the last of them solved, at the directions of a table."""
    first, last = vrte.spectrum(GOLD, [0.45, 0.65], **between_directions.directions(32, 37))
    return Spectrum(WAVELENGTHS, (first, first, first, last, last))


@pytest.fixture(scope="module")
def mitsuba() -> Any:
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_spectral_polarized")
    return found


def random_directions(count: int, seed: int, lowest: float = 0.0) -> Array:
    """Unit vectors (count, 3) of the upper hemisphere, evenly spread over it."""
    random = np.random.default_rng(seed)
    return measured_polarized.make_unit_vectors(
        random.uniform(lowest, 1.0, count), random.uniform(-np.pi, np.pi, count)
    )


class TestTable:
    def test_a_convergent_table(self, gold: Spectrum) -> None:
        """The error of linear interpolation falls with the square of the step."""
        pairs = np.linspace(0.15, 0.95, 6)
        exact = vrte.spectrum(GOLD, [0.65], mu_i=pairs, mu_o=pairs[:5], phi=np.arange(7.0, 360.0, 50.0))
        last = Spectrum([0.65], (gold[4],))
        found = []
        for step in (10.0, 5.0, 2.5):
            angles = measured_polarized.make_angles(step)
            table = measured_polarized.tabulate_spectrum(last, angles)
            found.append(measured_polarized.measure_errors(table, angles, exact).median)
        assert_close(np.log2(np.divide(found[:-1], found[1:])), 2.0, rtol=0.0, atol=0.4)
        assert found[-1] < 3e-3

    def test_directions_must_be_those_of_a_table(self, gold: Spectrum, tmp_path: Path) -> None:
        other = vrte.spectrum(WHITE, WAVELENGTHS)
        with pytest.raises(SceneError, match="its own directions"):
            measured_polarized.write_mitsuba(other, tmp_path / "a.bsdf")
        with pytest.raises(SceneError, match="exactly 5 wavelengths, not 2"):
            measured_polarized.write_mitsuba(gold.at([0.45, 0.5]), tmp_path / "a.bsdf")
        odd = Spectrum(np.add(WAVELENGTHS, 0.0005), gold.brdfs)
        with pytest.raises(SceneError, match="whole nanometres"):
            measured_polarized.write_mitsuba(odd, tmp_path / "a.bsdf")
        with pytest.raises(SceneError, match=r"step_deg must be between 0\.5 and 15 degrees, not 0"):
            measured_polarized.write_mitsuba(gold, tmp_path / "a.bsdf", 0)
        assert not list(tmp_path.iterdir())


class TestTensorFile:
    FIELDS = {  # noqa: RUF012
        "a": np.arange(6, dtype=np.float32).reshape(1, 2, 3),
        "wvls": np.array([450, 650], np.uint16),
        "none": np.zeros((0, 3)),
        "ü": np.array(7, np.int64),
    }

    def test_everything_comes_back(self, tmp_path: Path) -> None:
        write_tensors(self.FIELDS, tmp_path / "a.bsdf")
        found = read_tensors(tmp_path / "a.bsdf")
        assert list(found) == list(self.FIELDS)
        for name, array in self.FIELDS.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array, strict=True)

    def test_mitsuba_reads_it(self, mitsuba: Any, tmp_path: Path) -> None:
        fields = {name: array for name, array in self.FIELDS.items() if array.ndim}  # its reader knows no single number
        write_tensors(fields, tmp_path / "a.bsdf")
        found = mitsuba.tensor_io.read(str(tmp_path / "a.bsdf"))
        for name, array in fields.items():
            np.testing.assert_array_equal(found[name], array, strict=True)

    def test_any_cut_is_noticed(self, tmp_path: Path) -> None:
        write_tensors(self.FIELDS, tmp_path / "a.bsdf")
        content = (tmp_path / "a.bsdf").read_bytes()
        for end in range(len(content)):
            (tmp_path / "cut.bsdf").write_bytes(content[:end])
            with pytest.raises(SceneError):
                read_tensors(tmp_path / "cut.bsdf")

    def test_hostile_heads(self, tmp_path: Path) -> None:
        write_tensors(self.FIELDS, tmp_path / "a.bsdf")
        content = bytearray((tmp_path / "a.bsdf").read_bytes())
        for place in range(12, 60):
            damaged = content.copy()
            damaged[place] = 255
            (tmp_path / "bad.bsdf").write_bytes(damaged)
            try:
                read_tensors(tmp_path / "bad.bsdf")
            except SceneError as error:
                assert "\n" not in str(error)  # noqa: PT017

    def test_numbers_of_another_kind(self, tmp_path: Path) -> None:
        with pytest.raises(SceneError, match="a must be real numbers of a plain type, not complex128"):
            write_tensors({"a": np.zeros(2, complex)}, tmp_path / "a.bsdf")


def in_stokes_basis(mitsuba: Any, travel: Array) -> Array:
    """The rotation (4, 4) from our meridian plane of a direction of travel to Mitsuba's basis of it. Mitsuba's x axis
    is `stokes_basis`, its y axis k x x, S1 = |Ex|^2 - |Ey|^2, S2 = 2 Re(Ex Ey*); in ours r x l = k: U changes sign."""
    x_axis = np.array(mitsuba.mueller.stokes_basis(mitsuba.Vector3f(*travel)))
    azimuth = np.arctan2(travel[1], travel[0])
    meridian = np.array([travel[2] * np.cos(azimuth), travel[2] * np.sin(azimuth), -np.hypot(travel[0], travel[1])])
    # the angle from l to the x axis, growing from l to r
    double = 2.0 * np.arctan2(x_axis @ np.cross(meridian, travel), x_axis @ meridian)
    turned = np.eye(4)
    turned[1:3, 1:3] = [[np.cos(double), np.sin(double)], [-np.sin(double), np.cos(double)]]
    return np.diag([1.0, 1.0, -1.0, 1.0]) @ turned


def evaluated(mitsuba: Any, bsdf: Any, light: Array, view: Array, nanometres: float) -> Array:
    """Mitsuba's BSDF (4, 4) times the cosine of the light's direction."""
    interaction = mitsuba.SurfaceInteraction3f()
    interaction.wi = mitsuba.Vector3f(*view)
    interaction.wavelengths = 4 * [nanometres]
    return np.array(bsdf.eval(mitsuba.BSDFContext(), interaction, mitsuba.Vector3f(*light)))[..., 0]


class TestInMitsuba:
    @pytest.mark.parametrize(
        ("place", "nanometres", "step", "median", "most"),
        [
            (0, 450.0, 5.0, 0.013, 0.06),
            pytest.param(4, 650.0, 5.0, 0.006, 0.03, marks=pytest.mark.slow),
            pytest.param(4, 650.0, 2.5, 0.0015, 0.01, marks=pytest.mark.slow),
        ],
    )
    def test_evaluations_are_ours(
        self, place: int, nanometres: float, step: float, median: float, most: float, mitsuba: Any, gold: Spectrum,
        tmp_path: Path,
    ) -> None:  # fmt: skip
        """The bounds are those of linear interpolation: a quarter at half the step. Each element by itself, too, so
        that no small one can have the wrong sign."""
        measured_polarized.write_mitsuba(gold, tmp_path / "gold.bsdf", step)
        bsdf = mitsuba.load_dict({"type": "measured_polarized", "filename": str(tmp_path / "gold.bsdf")})
        light, view = random_directions(500, 1, 0.15), random_directions(500, 2, 0.15)
        matrices = between_directions.Splines(gold[place])(light, view)
        ours = np.array(
            [
                into[2] * in_stokes_basis(mitsuba, out) @ matrix @ in_stokes_basis(mitsuba, -into).T
                for into, out, matrix in zip(light, view, matrices, strict=True)
            ]
        )
        theirs = [evaluated(mitsuba, bsdf, *pair, nanometres) for pair in zip(light, view, strict=True)]
        off = np.abs(theirs - ours)
        relative = off.max(axis=(1, 2)) / ours[:, 0, 0]
        assert np.median(relative) < median
        assert np.quantile(relative, 0.95) < most
        assert ((off**2).mean(axis=0) < 0.1 * (ours**2).mean(axis=0)).all()

    def test_the_sign_of_v(self, mitsuba: Any) -> None:
        """A sphere that is large and opaque reflects as its surface does, a mirror at half the supplement of the
        scattering angle: our scattering matrix against Mitsuba's of a conductor, in axes perpendicular to the plane."""
        index = 1.5 + 1.0j
        ball = spheres((index.real, index.imag), radius_um=160.0, wavelength_um=0.5)
        axes = np.outer(measured_polarized.AXES, measured_polarized.AXES)
        for angle in (60.0, 90.0, 120.0):
            ours = ball.phase_matrix.scattering_matrix(angle)
            cosine = float(np.cos(np.radians(0.5 * (180.0 - angle))))
            mirror = np.array(mitsuba.mueller.specular_reflection(cosine, mitsuba.Complex2f(index)))
            assert_close(axes * ours / ours[0, 0], mirror / mirror[0, 0], rtol=0.0, atol=2e-3)
            assert abs(mirror[3, 2] / mirror[0, 0]) > 0.1

    def test_a_white_furnace_closes(self, mitsuba: Any, tmp_path: Path) -> None:
        white = vrte.spectrum(WHITE, WAVELENGTHS, **between_directions.directions(24, 9))
        measured_polarized.write_mitsuba(white, tmp_path / "white.bsdf", 15.0)
        material = {"type": "measured_polarized", "filename": str(tmp_path / "white.bsdf"), "alpha_sample": 1.0}
        bsdf = mitsuba.load_dict(material)
        points, weights = vrte.hemisphere(4)
        view = np.array([0.6, 0.0, 0.8])
        flux = sum(
            2.0 * np.pi * weight * evaluated(mitsuba, bsdf, into, view, 523.0)
            for into, weight in zip(measured_polarized.make_unit_vectors(points, np.ones(4)), weights, strict=True)
        )
        assert_close(flux, np.diag([1.0, 0.0, 0.0, 0.0]), rtol=0.0, atol=1e-6)
        mean = mitsuba.render(ball_under(mitsuba, material, 16)).array
        assert np.mean(mean) == close_to(1.0, rtol=0.0, atol=0.01)


def ball_under(mitsuba: Any, material: dict[str, Any], samples: int) -> Any:
    """A ball that fills the picture under an even sky of radiance 1."""
    at = mitsuba.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}, "pixel_format": "luminance"}
    sampler = {"type": "independent", "sample_count": samples}
    return mitsuba.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sensor": {"type": "perspective", "fov": 12, "to_world": at, "film": film, "sampler": sampler},
            "ball": {"type": "sphere", "bsdf": material},
            "sky": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
        }
    )


class TestFromAScene:
    def test_the_command_line_and_the_call_write_the_same(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(mitsuba_call, "COSINES", 16)  # fewer than anybody would ask for
        monkeypatch.setattr(mitsuba_call, "AZIMUTHS", 19)

        (tmp_path / "haze.toml").write_text(
            'nodes = 4\n[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n[brdf]\nmu_i = 0.5\nmu_o = 0.5\n'
        )
        told: list[tuple[int, int]] = []
        errors = vrte.to_mitsuba(
            tmp_path / "haze.toml",
            WAVELENGTHS,
            tmp_path / "call.bsdf",
            step_deg=15,
            progress=lambda done, total: told.append((done, total)),
        )
        assert told[-1] == (1000, 1000)
        command = ["--wavelengths-um", "0.45,0.5,0.55,0.6,0.65", "--mitsuba", tmp_path / "line.bsdf"]
        out = tmp_path / "haze.nc"
        assert run("brdf", tmp_path / "haze.toml", "-o", out, *command, "--mitsuba-step-deg", 15) == 0
        assert f"Mitsuba's table: {errors}" in capsys.readouterr().out
        call, line = read_tensors(tmp_path / "call.bsdf"), read_tensors(tmp_path / "line.bsdf")
        # to rounding: the spectra are the same bits, SciPy 1.14's matrices of splines are not always
        assert_close(call["M"], line["M"], rtol=0.0, atol=1e-15)
        assert call["M"].shape == (13, 7, 7, 5, 4, 4)
        assert call["wvls"].tolist() == [450, 500, 550, 600, 650]
        text = call["description"].tobytes().decode("utf-8")
        assert f"interpolation: {errors}" in text
        assert 'phase = "rayleigh"' in text
