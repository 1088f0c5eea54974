"""vrte.paint and its page: the numbers are those of their makers, all of them are written, and nothing is fetched."""

import csv
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import vrte
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import find_contrast
from vrte.appearance.paint import GLOSS_ANGLES
from vrte.appearance.panel import make_panel
from vrte.commands import common
from vrte.pictures import appearance as pages

from .helpers import close_to, run

AT = [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70]
SURFACE = {"interface": {"above": 1.0, "below": 1.5}}
FILM = {"phase": {"henyey_greenstein": 0.5}, "albedo": 0.95, "thickness": 4.0}
GREY = {"title": "Grey <i>& more", "approximations": ["One <phase> function."], "layer": [SURFACE, FILM]}
FILE = f"""
title = "Red"
wavelength_um = {AT}
nodes = 4
[paint]
pigment = "hematite"
volume_fraction = 0.02
binder = [1.5, 0.0]
thickness_um = 3.0
"""
TOLD: list[float] = []  # of the progress of grey


@pytest.fixture(scope="module")
def grey() -> vrte.Paint:
    return vrte.paint(GREY, AT, nodes=4, progress=lambda done, total: TOLD.append(done / total))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with red.toml, and wrong.toml that lacks the binder."""
    monkeypatch.chdir(tmp_path)
    for name, text in (("red", FILE), ("wrong", FILE.replace("binder = [1.5, 0.0]\n", ""))):
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


def test_every_number_has_a_unit_a_definition_and_a_standard(grey: vrte.Paint, tmp_path: Path) -> None:
    """And stands in the table to its last digit; numbers are those of their makers."""
    readings = list(grey.list_readings())
    for one in readings:
        assert all((one.quantity, one.geometry, one.unit, one.definition, one.standard)), one
        assert math.isfinite(one.value)
    standards = {one.quantity: one.standard for one in readings}
    assert standards["contrast ratio"] == "ISO 6504-3; ASTM D2805"  # at a thickness
    assert standards["hiding thickness over this film's"] == "ISO 6504-1; ASTM D2805"  # at a ratio
    assert "T 425 (there 15:di, A, 2 degrees)" in standards["paper opacity"]
    assert {"opacity", "gloss", "K", "S", "L over white", "BRDF f00", "X"} <= {*standards}
    assert len({(one.quantity, one.geometry, one.wavelength_um) for one in readings}) == len(readings)
    grey.save(tmp_path / "grey.csv")
    with open(tmp_path / "grey.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["value"]) for row in rows] == [one.value for one in readings]
    at = ["" if one.wavelength_um is None else repr(float(one.wavelength_um)) for one in readings]
    assert [row["wavelength_um"] for row in rows] == at
    panel = make_panel(GREY, AT, nodes=4)
    assert grey.glosses == close_to({angle: find_gloss(panel, angle) for angle in GLOSS_ANGLES}, rtol=1e-9, atol=0.0)
    assert grey.hiding.contrast_ratio == close_to(find_contrast(panel), rtol=1e-6, atol=0.0)
    assert list(grey.colours) == ["over black", "over white", "semi-infinite"]
    luminance = grey.hiding.find_luminance(grey.hiding.reflectance_over_black)
    assert close_to(100.0 * luminance, rtol=1e-6, atol=0.0) == grey.colours["over black"].Y
    assert sorted(TOLD) == TOLD
    assert TOLD[-1] == 1.0


@pytest.mark.slow
def test_keywords_and_a_file_are_the_same_paint_and_the_command_writes_all_three(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And what is warned of stands on the page."""
    found = vrte.paint(folder / "red.toml")
    keys = {"pigment": "hematite", "volume_fraction": 0.02, "binder": (1.5, 0.0), "thickness_um": 3.0}
    other = vrte.paint(**keys, wavelengths_um=AT, nodes=4)
    assert [one.value for one in other.list_readings()] == [one.value for one in found.list_readings()]
    assert (found.title, other.title, found.made_of[0]) == ("Red", "Paint", "surface: smooth")
    assert "thickness 3.0 µm" in found.made_of[1]
    assert found.hiding.hiding_length_um is not None
    assert run("paint", "red.toml", "--png", "red.png", "--csv", "red.csv") == 0
    reported = capsys.readouterr().out
    assert reported.startswith("Red\n  surface: smooth")
    assert f"contrast ratio: {found.hiding.contrast_ratio:.4f}" in reported
    assert re.findall(r"wrote (\S+)", reported) == ["red.html", "red.png", "red.csv"]
    assert (folder / "red.png").read_bytes().startswith(b"\x89PNG")
    dense = {"pigment": {"hematite": "35 %"}, "binder": [1.5, 0.0], "thickness_um": 1.0, "surface": "none"}
    with pytest.warns(vrte.PackingWarning, match=r"0\.35 is above 0\.3"):
        found = vrte.paint(**dense, wavelengths_um=AT, nodes=4)
    assert sum("a volume_fraction of 0.35 is above 0.3" in note for note in found.notes) == 1


def test_what_a_paint_does_not_have_is_told_and_the_rest_is_there(
    grey: vrte.Paint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No surface, no gloss; no end, nothing to hide and no K and S. Files are whole, or as they were."""
    found = vrte.paint({"layer": [FILM | {"thickness": math.inf}]}, AT, nodes=4)
    assert (found.glosses, found.hiding, found.two_fluxes, list(found.colours)) == ({}, None, None, ["as it lies"])
    missing = [note.partition(":")[0] for note in found.notes if note.startswith("There is no")]
    assert missing == [f"There is no {what} here" for what in ("gloss", "hiding power", "K and S")]
    for suffix in (".html", ".png", ".pdf", ".csv"):
        found.save(tmp_path / f"deep{suffix}")
    with pytest.raises(vrte.SceneError, match=r"must end in \.html, \.png, \.pdf or \.csv"):
        found.save(tmp_path / "page.txt")
    assert (tmp_path / "deep.pdf").read_bytes().startswith(b"%PDF")
    before, names = (tmp_path / "deep.html").read_text(encoding="utf-8"), sorted(tmp_path.iterdir())
    monkeypatch.setattr(pages, "make_paint_body", lambda paint: "\ud800")  # which no file can hold
    with pytest.raises(UnicodeEncodeError):
        found.save(tmp_path / "deep.html")
    assert (tmp_path / "deep.html").read_text(encoding="utf-8") == before
    assert sorted(tmp_path.iterdir()) == names
    assert f"thickness for 0.98: {grey.hiding.hiding_times:.4g} times this film" in str(grey)
    black = replace(grey, hiding=replace(grey.hiding, hiding_times=None, reason="it is black"))
    assert "thickness for 0.98: none: it is black" in str(black)
    assert "hiding thickness over this film's" not in {one.quantity for one in black.list_readings()}


def test_the_page_is_whole_and_fetches_nothing(grey: vrte.Paint, tmp_path: Path) -> None:
    grey.save(tmp_path / "grey.html")
    text = (tmp_path / "grey.html").read_text(encoding="utf-8")
    tags, still_open = re.findall(r"<(/?)([a-z]\w*)([^>]*)>", text), []
    for closing, tag, _ in tags:
        if closing:
            assert still_open.pop() == tag
        elif tag not in ("img", "meta"):
            still_open.append(tag)
    assert not still_open
    assert not {tag for _, tag, _ in tags} & {"script", "link", "iframe", "object"}
    assert "Grey &lt;i&gt;&amp; more" in text
    assert "One &lt;phase&gt; function." in text
    images = [attributes for _, tag, attributes in tags if tag == "img"]
    assert len(images) == 8
    assert all(re.search(' src="data:image/svg[+]xml;base64,[^"]+" alt="[^"]+"', one) for one in images)
    named = re.findall(r"\b(?:href|src|srcset)=.(\w+:)", "".join(attributes for *_, attributes in tags))
    assert named == ["data:"] * 8
    assert "url(" not in text
    assert grey.colours["over black"].hex in text
    for one in grey.list_readings():
        if one.quantity in ("opacity", "gloss"):
            assert f"{one.value:.5g}" in text
            assert one.standard in text
    assert grey._repr_html_() in text  # drawn anew, and the same to the last byte


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["wrong.toml"], 2, "wrong.toml: at 0.42 um: paint.binder: is missing"),
        (["red.toml", "-o", "red.pdf"], 2, "the output red.pdf must end in .html"),
        (["red.toml", "--illuminant", "moon"], 2, "illuminant must be"),
        (["red.toml", "--layer", "3"], 2, "red.toml: layer must be"),
        (["red.toml"], 1, "pip install 'vrte[appearance]'"),
    ],
)
def test_a_command_that_cannot_be_done_says_so_in_one_line(
    arguments: Any, code: int, said: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    if code == 1:  # without the extra
        monkeypatch.setattr(common.importlib.util, "find_spec", lambda module: None)
    assert run("paint", *arguments) == code
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert {path.suffix for path in folder.iterdir()} == {".toml"}
