"""How sure a paint's readings are: each part is the change that the same paint shows when it is varied by hand."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.panel import make_panel
from vrte.appearance.spread import Scaled

from .helpers import close_to, run

AT = [0.43, 0.47, 0.51, 0.55, 0.59, 0.63, 0.67]


def make(index: float = 1.65, median: float = 0.15, packing: str = "coherent-potential") -> dict[str, Any]:
    """Soft spheres, which the Percus-Yevick model allows, as a film in a binder."""
    grains = {"latex": {"index": index, "size": {"lognormal": {"median_um": median, "sigma": 1.2}}}}
    filling = {"volume_fractions": {"latex": 0.2}, "packing": packing, "thickness_um": 60.0}
    layers = [{"interface": {"above": 1.0, "below": 1.5}}, {"host_index": 1.5, **filling}]
    return {"particles": grains, "layer": layers}


def read(content: dict[str, Any]) -> np.ndarray:
    """L* over black and the contrast ratio, by `vrte.appearance`."""
    look = vrte.appearance(content, AT, ["45:0"], nodes=8)
    return np.array([look.colour().L, look.hiding().contrast_ratio])


@pytest.fixture(scope="module")
def painted() -> vrte.Paint:
    return vrte.paint(make(), AT, nodes=8, spread=True)


def test_each_part_is_what_varying_it_by_hand_changes(painted: vrte.Paint) -> None:
    spread, here = painted.spread, read(make())
    assert spread is not None
    assert [*spread.parts] == ["crowding", "size", "index", "accuracy"]
    assert spread.quantities[:4] == ("L", "a", "b", "contrast_ratio")
    by_hand = {
        "crowding": [make(packing="percus-yevick"), make(packing="effective-medium")],
        "size": [make(median=0.9 * 0.15), make(median=1.1 * 0.15)],
        "index": [make(index=0.99 * 1.65), make(index=1.01 * 1.65)],
    }
    for source, varied in by_hand.items():
        changes = np.max([np.abs(read(one) - here) for one in varied], axis=0)
        assert spread.parts[source][[0, 3]] == close_to(changes, rtol=2e-2, atol=2e-5), source
        assert (changes > 1e-4).all()
    assert (spread.parts["accuracy"][[0, 3]] < 0.1 * spread.total[[0, 3]]).all()
    squares = sum(values**2 for values in spread.parts.values())
    assert spread.total == close_to(np.sqrt(squares), rtol=1e-12, atol=0.0)


def test_page_and_table_have_every_part(painted: vrte.Paint, tmp_path: Path) -> None:
    assert painted.spread is not None
    assert f"L* over black may be off: {painted.spread.describe('L')}" in str(painted)
    assert "leaves loads, thickness, binder and surface" in "".join(painted.notes)
    for name in ("page.html", "page.csv"):
        painted.save(tmp_path / name)
    assert "may be off" in (tmp_path / "page.html").read_text("utf-8")
    with open(tmp_path / "page.csv", encoding="utf-8", newline="") as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    found = rows["spread of contrast_ratio by size"]
    assert float(found["value"]) == painted.spread.parts["size"][3]
    assert found["definition"] == "either way, by grains 10% smaller and larger"
    assert all(all(row[key] for key in ("geometry", "unit", "definition", "standard")) for row in rows.values())


def test_what_no_other_model_allows_is_told_and_what_is_not_there_is_not_varied() -> None:
    """Rutile is beyond all models but its own; a phase function has no grains; a semi-infinite film hides."""
    white = {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": math.inf}
    found = vrte.paint(**white, wavelengths_um=AT, nodes=4, spread=True)
    assert found.spread is not None
    assert found.spread.quantities[:4] == ("L", "a", "b", "gloss_20")
    assert any("takes the effective medium for crowding" in one for one in found.notes)
    grey = {"layer": [{"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}]}
    plain = vrte.paint(grey, AT, nodes=4, spread=True).spread
    assert plain is not None
    assert [*plain.parts] == ["accuracy"]
    with pytest.raises(vrte.SceneError, match="spread is of a scene file or its content"):
        vrte.paint(make_panel(grey, AT, nodes=4), spread=True)
    wide = Scaled(vrte.Lognormal(0.2, 1.3), 1.1)
    assert wide.quadrature(4)[0] == close_to(1.1 * wide.distribution.quadrature(4)[0], rtol=1e-15, atol=0.0)


@pytest.mark.slow
def test_the_command_prints_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("latex.toml").write_text(
        f"wavelength_um = {AT}\nnodes = 4\n[paint]\npigment = 'rutile'\nvolume_fraction = 0.1\nbinder = 'alkyd'\n"
        "thickness_um = 20.0\n"
    )
    assert run("paint", "latex.toml", "--spread") == 0
    assert "hiding thickness [µm] may be off: ± " in capsys.readouterr().out
