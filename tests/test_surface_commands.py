"""Surfaces on the command line: what is printed and written."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte

from .helpers import run

MU = [0.5, 1.0]
LAYER = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
HEAD = "nodes = 4\nwavelength_um = 0.55\n"
GLASS = "[[layer]]\ninterface = { above = 1.0, below = 1.5 }\n"
RAYLEIGH = '[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n'
BRDF = "[brdf]\nmu_i = [0.5, 1.0]\nmu_o = 0.5\ntransmission = true\n"
FIELD = "[field]\nmu0 = 0.5\nmu = [-0.5, 0.5]\ntau = [0.0, 1.0]\n"


def written(folder: Path, text: str) -> Path:
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def make_pile(index: float = 1.5, roughness: float = 0.0) -> list[Any]:
    """The layer under an interface."""
    return [vrte.Interface(1.0, index, roughness), LAYER]


def test_a_brdf_is_described_with_its_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = written(tmp_path, HEAD + GLASS + RAYLEIGH + BRDF), tmp_path / "a.csv"
    assert run("brdf", scene, "-o", out) == 0
    reported = capsys.readouterr().out
    found: Any = vrte.load(out)
    alone = vrte.brdf(vrte.Scene(make_pile()), MU, 0.5, nodes=4, transmission=True)
    for name in ("mueller", "specular", "specular_transmission", "direct_transmittance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), strict=True)
    for words in (
        ": BRDF of",
        "interface, index 1 above and 1.5 below",
        "layer 1: optical thickness 1, ",
        "terms, in index 1.5",
        f"mirrored as a beam, and not in it: {found.specular[0, 0, 0]:.4f} at mu_i 0.5",
    ):
        assert words in reported


def test_a_field_lies_on_a_side_of_the_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.csv"
    for more, options, indices in (
        ("", ("--side", "above"), [1.0, 1.5]),
        ("", ("--side", "below"), [1.5, 1.5]),
        ('side = "below"\n', (), [1.5, 1.5]),
        ('side = "below"\n', ("--side", "above"), [1.0, 1.5]),
    ):
        assert run("field", written(tmp_path, HEAD + GLASS + RAYLEIGH + FIELD + more), "-o", out, *options) == 0
        assert f"depths in media of index {'1, ' * (indices[0] == 1.0)}1.5" in capsys.readouterr().out
        assert vrte.load(out).index.tolist() == indices  # type: ignore[union-attr]
    assert run("field", written(tmp_path, HEAD + RAYLEIGH + FIELD + 'side = "below"\n'), "-o", out) == 2
    assert "field.side 'below' is for depths tau at an interface" in capsys.readouterr().err
