"""The example scripts run as they stand, and what they write can be read."""

import csv
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.formats.scene_file import read_scene
from vrte.sweep.table import open_table
from vrte.sweep.template import read_sweep

from .helpers import assert_close
from .samples import slow_but

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(path.stem for path in EXAMPLES.glob("*.py"))
SLOW = "gold_table", "rutile_spectrum"


def read_numbers(path: Path, column: int) -> np.ndarray:
    """A column of a CSV file without its header."""
    return np.array([float(row[column]) for row in list(csv.reader(path.read_text().splitlines()))[1:]])


# a column of what a script writes, and between what it lies: contrast, Q of a panel, errors of methods, reflectances
RANGES = {
    "layered_paint": (-1, 0.1, 1.0),
    "painted_panel": (-1, -0.1, 1.0),
    "which_method_when": (-2, 0.0, 20.0),
    "gold_table": (-1, 0.0, 1.0),
    "rutile_spectrum": (-1, 0.85, 1.0),  # 0.87 at 0.43 um alone: k on rutile's edge is 1.3e-4
}


@pytest.mark.parametrize("name", slow_but(SCRIPTS, *sorted({*SCRIPTS} - {*SLOW})))
def test_a_script_runs_and_what_it_writes_is_read(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By public names alone."""
    assert "from vrte" not in (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path / "new")])
    made: dict[str, Any] = runpy.run_path(str(EXAMPLES / f"{name}.py"))
    assert capsys.readouterr().out.strip()
    written = sorted((tmp_path / "new").iterdir())
    assert written
    for path in written:
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG")
        elif path.suffix == ".csv":
            column, low, high = RANGES[name]
            numbers = read_numbers(path, column)
            assert ((numbers > low) & (numbers < high)).all()
            if name == "layered_paint":
                assert (np.diff(numbers) > 0.0).all()  # the more paint, the better it hides
        elif name in SLOW:
            open_table(path).close()
        else:
            found = vrte.load(path)
            same = [one for one in made.values() if type(one) is type(found)]
            light = "mueller" if isinstance(found, vrte.Brdf) else "stokes"
            assert any(np.array_equal(getattr(found, light), getattr(one, light)) for one in same)


def test_the_panel_of_the_file_is_that_of_the_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["painted_panel", str(tmp_path)])
    panel = runpy.run_path(str(EXAMPLES / "painted_panel.py"))["glossy"]
    scene = read_scene(EXAMPLES / "painted_panel.toml").scene
    again = vrte.brdf(scene, panel.mu_i[9], panel.mu_o[5], phi=40.0).mueller[0, 0, 0]
    # other directions may take other nodes: as near as accuracy says
    assert_close(again, panel.mueller[9, 5, 4], rtol=0.0, atol=1e-6 * panel.mueller[9, ..., 0, 0].max())


@pytest.mark.parametrize(("name", "lengths"), [("gold_table", [21, 28]), ("rutile_spectrum", [55])])
def test_the_sweeps_are_read(name: str, lengths: list[int]) -> None:
    sweep = read_sweep(EXAMPLES / f"{name}.toml")
    assert list(sweep.shape) == lengths
    axis = next(axis for axis in sweep.axes if axis.name == "wavelength_um")
    assert (axis.values[0], axis.values[-1]) == (0.43, 0.70)
