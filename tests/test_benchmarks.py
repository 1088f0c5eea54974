"""The benchmarks of docs/reference/benchmarks: computed again, changed digits found, convention card."""

import re
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import vrte
from bench import benchmarks

from . import literal_rough, oracle
from .helpers import assert_close, call_study, close_to
from .literal import D, azimuthal_sum

FOLDER = Path(__file__).parents[1] / "docs" / "reference" / "benchmarks"
PATHS = benchmarks.find_benchmarks(FOLDER)
SMOOTH = [path for path in PATHS if "rough" not in path.stem]


def make_small(folder: Path) -> Path:
    """The smallest benchmark on few nodes, its numbers computed here."""
    benchmark = benchmarks.read_benchmark(FOLDER / "rayleigh_under_a_surface.csv")
    shutil.copy(benchmark.path, folder)
    return rewrite(folder / benchmark.path.name, 12)


def rewrite(path: Path, nodes: int) -> Path:
    """A file's numbers on so many nodes in place of its own."""
    path.write_text(re.sub(r"nodes = \d+", f"nodes = {nodes}", path.read_text()))
    benchmarks.write_benchmark(benchmarks.compare_benchmark(path).made, path.parent)
    return path


def test_a_changed_digit_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (("--folder", FOLDER, "--scene", "nothing"), "--scene must be one of field_in_glass, "),
        (("--folder", tmp_path), "no benchmarks in"),
    ):
        assert call_study("benchmarks", *arguments) == 2
        assert message in capsys.readouterr().err
    path = make_small(tmp_path)
    right = path.read_text()
    assert call_study("benchmarks", "--folder", tmp_path, "-o", tmp_path / "again") == 0
    assert "unchanged" in capsys.readouterr().out
    assert (tmp_path / "again" / path.name).read_text() == right
    last = right.splitlines()[-1]  # the last reflectance
    digit = int(last.rstrip(",")[-1])
    path.write_text(right.replace(last, f"{last.rstrip(',')[:-1]}{(digit + 5) % 10},,,"))
    assert call_study("benchmarks", "--folder", tmp_path, "--scene", "rayleigh_under_a_surface") == 1
    reported = capsys.readouterr()
    assert "2 changed" in reported.out
    assert re.fullmatch(
        r"vrte: error: 2 numbers are not as they were, the first: \w+, modes: reflectance 0.9 I I: .*\n", reported.err
    )
    path.write_text(right.replace(last + "\n", ""))
    assert call_study("benchmarks", "--folder", tmp_path) == 1
    assert "not in the file" in capsys.readouterr().err


def test_the_page_names_all_ten_and_its_card_quotes_the_files() -> None:
    """Each row of the convention card is a number of a file, named by its row and Stokes parameter."""
    page = (FOLDER / "README.md").read_text()
    assert len(PATHS) == 10
    assert all(f"]({path.name})" in page for path in PATHS)
    rows = re.findall(r"^\| \d+ \| `(\w+)` \| `([^`]+)` \| ([IQUV]) \| (\S+) \|", page, re.M)
    assert len(rows) == 10
    for name, key, parameter, number in rows:
        numbers = benchmarks.read_benchmark(FOLDER / f"{name}.csv").numbers
        assert numbers[tuple(key.split(","))][benchmarks.STOKES.index(parameter)] == number


@pytest.mark.slow
def test_all_of_them_are_as_they_were(capsys: pytest.CaptureFixture[str]) -> None:
    assert call_study("benchmarks", "--folder", FOLDER) == 0
    assert capsys.readouterr().out.count("unchanged") == 10


@pytest.mark.slow
@pytest.mark.parametrize("path", SMOOTH, ids=lambda path: path.stem)
def test_the_oracle_has_the_same_numbers(path: Path, tmp_path: Path) -> None:
    """On as many nodes as carry all terms it has every matrix and every radiance."""
    for table in FOLDER.glob("*.csv"):
        shutil.copy(table, tmp_path)
    (file,) = benchmarks.read_benchmark(path).make_files()
    n_order = max(layer.phase_matrix.terms for layer in file.scene.layers if layer.albedo > 0.0)
    nodes = max(n_order + 1, 8)
    small = benchmarks.read_benchmark(rewrite(tmp_path / path.name, nodes))
    (file,) = small.make_files()
    scene, request = file.scene, file.request
    phi = np.array(request["phi"], float)
    numbers = benchmarks.compute_numbers(small, "doubling")
    if file.kind == "brdf":
        from_below = file.options.get("illuminate") == "bottom"
        turned = scene.turned() if from_below else scene
        right = oracle.brdf(turned, request["mu_i"], request["mu_o"], nodes, range(n_order), least=1e-13)
        flip = D if from_below else np.eye(4)  # a scene upside down is seen in a horizontal mirror
        found = vrte.Brdf(
            flip @ azimuthal_sum(right.reflected, phi) @ flip,
            right.reflectance,
            np.array(request["mu_i"]),
            np.array(request["mu_o"]),
            phi,
            {},
            transmission=flip @ azimuthal_sum(right.transmitted, phi) @ flip,
            specular=flip @ right.specular @ flip,
            specular_transmission=flip @ right.specular_transmission @ flip,
        )
        expected = benchmarks.list_brdf_numbers(found)
    else:
        expected = find_field(file, nodes, n_order)
    compared = [key for key in numbers if key in expected]
    assert len(compared) >= 8
    size = max(np.nanmax(np.abs(values)) for values in expected.values())
    for key in compared:
        assert_close(numbers[key], expected[key], rtol=0.0, atol=1e-11 * size, err_msg=str(key))


@pytest.mark.slow
def test_a_literal_program_has_the_powder_under_a_rough_surface() -> None:
    """Every matrix to half of the last digit and 1e-10, of facets by Jones vectors in space and adding-doubling."""
    benchmark, file = read_rough("powder_under_a_rough_surface")
    (layer,), asked = file.scene.layers, file.request
    (surface, _), albedo = file.scene.interfaces, file.scene.below.even_albedo
    mu_i, mu_o, phi = (np.array(asked[name], float) for name in ("mu_i", "mu_o", "phi"))
    light, outside, _ = literal_rough.find_light(surface.facets, 1.5, None, [layer], albedo, mu_i, mu_o)
    orders = np.array([rising[outside.count : outside.beams] for _, rising, *_ in light]).transpose(0, 3, 1, 2, 4)
    own = literal_rough.facets(
        surface.facets, 1.5 + 0j, -mu_i[:, None, None], mu_o[:, None], np.radians(phi) + 0.0 * mu_o[:, None]
    )
    found = azimuthal_sum(orders / mu_i[:, None, None, None], phi) + own
    for (i, o, p), matrix in zip(np.ndindex(found.shape[:3]), found.reshape(-1, 4, 4), strict=True):
        key = map(benchmarks.show_key, (mu_i[i], mu_o[o], phi[p]))
        cosines = ("mueller", *key, "", "")
        printed = np.array([benchmark.numbers[(*cosines, one)] for one in benchmarks.STOKES], float).T
        assert_close(matrix, printed, rtol=0.0, atol=5.1e-9)


@pytest.mark.slow
def test_a_literal_program_has_the_rough_sea_under_air() -> None:
    """Every radiance and flux to half of the last digit and what both programs differ by, 1e-10 of fluxes and 6e-10."""
    benchmark, file = read_rough("rough_sea_under_air")
    (air, water), asked, tops = file.scene.layers, file.request, file.scene.layers[0].thickness
    surface, mu0, stokes = file.scene.interfaces[1].facets, asked["mu0"], np.array(asked["stokes"])
    mu, phi, tau = (np.array(asked[name], float) for name in ("mu", "phi", "tau"))
    upper = tau[2] - tops
    parts = [replace(water, thickness=thickness) for thickness in (upper, water.thickness - upper)]
    seen = sorted({*np.abs(mu).tolist()})
    light, *sides = literal_rough.find_light(surface, 1.34, air, parts, 0.0, [mu0], seen)
    places = [(0.0, "above", 0, None), (tops, "above", 1, 2), (tops, "below", 3, 4), (tau[2], "above", 5, 6)]
    for depth, name, *ways in places:
        side = sides[int(ways[0] > 2)]
        for up, way in zip((True, False), ways, strict=True):
            key = (benchmarks.show_key(mu0), "", "", benchmarks.show_key(depth), name, "")
            kind = "flux_up" if up else "flux_down"
            (printed, *_) = benchmark.numbers[(kind, *key)]
            flux = 0.0
            if way is not None:
                flux = 2.0 * np.pi * (side.weight * side.mu)[: side.count] @ light[0][way][: side.count, 0, 0] @ stokes
            assert flux == close_to(float(printed), rtol=0.0, atol=5.2e-9)
            for one in mu[(mu > 0.0) == up]:
                found = np.zeros((phi.size, 4))
                if way is not None:
                    at = side.count + seen.index(abs(one))
                    orders = np.array([parts[way][at] for parts in light]).transpose(0, 2, 1, 3)[:, :, None]
                    found = azimuthal_sum(orders, phi)[0, 0] @ stokes
                if up == (ways[0] < 2):  # of beams that met facets alone
                    facets = literal_rough.facets(
                        surface, 1.34 + 0j, np.full(phi.size, -mu0), np.full(phi.size, one), np.radians(phi)
                    )
                    left = np.exp(-tops / mu0 - abs(depth - tops) / abs(one))
                    found += mu0 * left * facets @ stokes
                for angle, values in zip(phi, found, strict=True):
                    cosines = (key[0], benchmarks.show_key(one), benchmarks.show_key(angle), *key[3:])
                    printed = np.array(benchmark.numbers[("radiance", *cosines)], float)
                    assert_close(values, printed, rtol=0.0, atol=1.1e-9)


def read_rough(name: str) -> tuple[benchmarks.Benchmark, benchmarks.SceneFile]:
    """A benchmark and its scene."""
    (path,) = benchmarks.find_benchmarks(FOLDER, name)
    benchmark = benchmarks.read_benchmark(path)
    (file,) = benchmark.make_files()
    return benchmark, file


def find_field(file: benchmarks.SceneFile, nodes: int, n_order: int) -> dict[benchmarks.Key, np.ndarray]:
    """Radiances at the depths of a file, at interfaces on their lower sides as well."""
    scene, asked = file.scene, file.request
    mu, phi, stokes = np.array(asked["mu"]), np.array(asked["phi"], float), np.array(asked["stokes"])
    tops = np.concatenate([[0.0], np.cumsum([layer.thickness for layer in scene.layers])])
    depths = [(tau, side) for tau in asked["tau"] for side in ("above", "below")]
    levels = []
    for tau, side in depths:
        layer = int(np.searchsorted(tops[1:-1], tau, side="right" if side == "below" else "left"))
        levels.append((-1, 0.0) if tau == 0.0 and side == "above" else (layer, tau - tops[layer]))
    orders = [oracle.solve(scene, [asked["mu0"]], mu, levels, nodes, m) for m in range(n_order)]
    light = azimuthal_sum(np.array([order.radiance[:, 0] for order in orders]), phi) @ stokes  # (level, mu, phi, 4)
    found = {}
    for (t, (tau, side)), (k, one), (p, angle) in product(enumerate(depths), enumerate(mu), enumerate(phi)):
        key = (*map(benchmarks.show_key, (asked["mu0"], one, angle, tau)), side, "")
        found[("radiance", *key)] = light[t, k, p]
    return found
