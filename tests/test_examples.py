"""The example scripts run as they stand, and what they write can be read."""

import csv
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import assert_same
from vrte.formats.scene_file import read_scene
from vrte.sweep.template import read_sweep

from .helpers import assert_close

EXAMPLES = Path(__file__).parents[1] / "examples"
MOST_LINES = {"rough_sea.py": 52}  # 30 elsewhere


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setattr(sys, "argv", [name, str(folder / "new")])
    return runpy.run_path(str(EXAMPLES / name))


def numbers(path: Path, text_columns: int = 0) -> tuple[list[list[str]], np.ndarray]:
    """Text and numbers of a CSV file without its header."""
    rows = list(csv.reader(path.read_text().splitlines()))[1:]
    return [row[:text_columns] for row in rows], np.array([row[text_columns:] for row in rows], dtype=float)


def test_they_are_short_and_all_of_them_are_run_here() -> None:
    scripts = sorted(EXAMPLES.glob("*.py"))
    assert [script.name for script in scripts] == [
        "first_brdf.py",
        "gold_table.py",
        "inside_the_layer.py",
        "layered_paint.py",
        "painted_panel.py",
        "rough_sea.py",
        "rutile_spectrum.py",
        "which_method_when.py",
    ]
    for script in scripts:
        text = script.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= MOST_LINES.get(script.name, 30)
        assert "from vrte" not in text  # public names only
        assert "vrte._" not in text


def test_first_brdf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    made = run("first_brdf.py", tmp_path, monkeypatch)
    np.testing.assert_array_equal(vrte.load(tmp_path / "new" / "first_brdf.nc").mueller, made["f"].mueller)
    assert (tmp_path / "new" / "first_brdf.png").read_bytes().startswith(b"\x89PNG")
    assert f"reflected in all: {made['f'].reflectance[0]:.1%}" in capsys.readouterr().out


def test_layered_paint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("layered_paint.py", tmp_path, monkeypatch)
    _, values = numbers(tmp_path / "new" / "layered_paint.csv")
    thickness, dark, bright, contrast = values.T
    assert (np.diff(thickness) > 0.0).all()
    assert (np.diff(contrast) > 0.0).all()  # the more paint, the better it hides
    assert (dark < bright).all()
    assert contrast[-1] > 0.8


def test_painted_panel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    panel = run("painted_panel.py", tmp_path, monkeypatch)["glossy"]
    assert_same(vrte.load(tmp_path / "new" / "painted_panel.nc"), panel)
    _, values = numbers(tmp_path / "new" / "painted_panel.csv")
    _, diffuse, mirrored, together, bare, *_ = values.T
    assert_close(diffuse + mirrored, together, rtol=0.0, atol=2e-4)  # as they are rounded
    assert (together < bare).all()  # light that the surface keeps inside gets to the black panel
    assert mirrored[0] == 0.04
    in_file = read_scene(EXAMPLES / "painted_panel.toml")  # the same scene
    assert in_file.scene.interfaces == (vrte.Interface(1.0, 1.5), None)
    again = vrte.brdf(in_file.scene, panel.mu_i[[0, 9]], panel.mu_o[5], phi=40.0)
    there = panel.mueller[[0, 9]]
    largest = there[..., 0, 0].max(axis=(1, 2))  # other directions may take other nodes: as near as accuracy says
    difference = np.abs(again.mueller[:, 0, 0] - there[:, 5, 4]).max(axis=(1, 2))
    assert (difference <= 1e-6 * largest).all()


def test_rough_sea(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = run("rough_sea.py", tmp_path, monkeypatch)
    np.testing.assert_array_equal(vrte.load(tmp_path / "new" / "rough_sea.nc").mueller, made["f"].mueller)
    assert 0.8 < made["polarized"][12] < 1.0  # near Brewster's angle, a little less for the air's light


def test_inside_the_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    field = run("inside_the_layer.py", tmp_path, monkeypatch)["field"]
    net = field.flux_down + field.direct - field.flux_up
    assert_close(net, net[0], rtol=1e-3, atol=0.0)  # droplets of water absorb next to nothing
    assert vrte.load(tmp_path / "new" / "inside_the_layer.nc").stokes.shape == field.stokes.shape
    assert (tmp_path / "new" / "inside_the_layer.png").read_bytes().startswith(b"\x89PNG")


def test_which_method_when(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("which_method_when.py", tmp_path, monkeypatch)
    names, values = numbers(tmp_path / "new" / "which_method_when.csv", 3)
    error = {(float(names[0]), names[1].strip()): row[0] for names, row in zip(names, values, strict=True)}
    taken = {(float(thickness), asked.strip()): found.strip() for thickness, asked, found in names}
    thick = (1e-4, 1.0, 50.0)
    assert len(error) == 18
    assert all(error[thickness, method] < 1e-2 for thickness in thick for method in ("discrete-ordinates", "auto"))
    assert error[1e-4, "single-scattering"] < 1e-2 < error[1.0, "single-scattering"] < error[50.0, "single-scattering"]
    assert all(asked in ("auto", found) for (_, asked), found in taken.items())


@pytest.mark.parametrize(("name", "lengths"), [("gold_table", [21, 28]), ("rutile_spectrum", [55])])
def test_the_sweeps_are_read(name: str, lengths: list[int]) -> None:
    sweep = read_sweep(EXAMPLES / f"{name}.toml")
    assert list(sweep.shape) == lengths
    axis = next(axis for axis in sweep.axes if axis.name == "wavelength_um")
    assert (axis.values[0], axis.values[-1]) == (0.43, 0.70)


@pytest.mark.slow
def test_rutile_spectrum(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    run("rutile_spectrum.py", tmp_path, monkeypatch)
    _, values = numbers(tmp_path / "new" / "rutile_spectrum.csv")
    assert values.shape == (55, 3)
    assert_close(np.diff(values[:, 0]), 0.005, rtol=0.0, atol=1e-9)  # steps of 5 nm
    assert ((values[:, 1:] > 0.9) & (values[:, 1:] < 1.0)).all()  # white, thick
    assert "reflected at normal incidence: 9" in capsys.readouterr().out


@pytest.mark.slow
def test_gold_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = run("gold_table.py", tmp_path, monkeypatch)
    _, values = numbers(tmp_path / "new" / "gold_colours.csv")
    assert not (made["table"].error != "").any()
    for radius, wavelength, reflectance in values:
        gold = vrte.spheres("gold", radius_um=radius, wavelength_um=wavelength)
        solved = vrte.brdf(vrte.Scene([vrte.Layer.of(gold, 100.0)]), 1.0, 0.5, nodes=24)
        assert abs(reflectance - solved.reflectance[0]) < 0.01 * solved.reflectance[0]
