"""Files that somebody puts into the viewer: what is taken, where it lies, what is said of it, and who reads it."""

import copy
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.test_app_solving import ENOUGH, ended
from vrte.app.form import layers
from vrte.app.form.content import START, Content, set_base
from vrte.app.form.files import adopt_and_tell
from vrte.app.form.parts import WAITS
from vrte.app.solving import shelf as shelves
from vrte.app.solving.bench import Bench, Benches
from vrte.app.solving.downloads import make_scene_download
from vrte.app.solving.job import Job
from vrte.app.solving.messages import Outcome, Solve
from vrte.app.solving.shelf import LARGEST_LIST, LARGEST_TABLE, MOST_TABLES, Shelf, split_name
from vrte.formats.bases import BASES
from vrte.formats.coefficient_table import read_coefficients
from vrte.formats.scene_file import read_scene

COEFFICIENTS = b"l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,0.3,0,0,0,0,0\n"
CSV = (".csv",)
FOG: Content = {
    "nodes": 4,
    "layer": [{"phase": "fog.csv", "albedo": 0.9, "thickness": 1.0}],
    "brdf": {"mu_i": 0.5, "mu_o": [0.3, 0.9]},
}


@pytest.fixture
def shelf() -> Any:
    made = Shelf()
    yield made
    made.close()


def looked(bench: Bench) -> dict[Any, str]:
    """What is wrong with a scene, once everything has been looked at."""
    while True:
        found = bench.find_problems()
        if bench.looks is None:
            return found
        ended(bench.looks)
        assert bench.has_looked()


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("../../x", b"1", "is no plain name of a file that ends in .csv"),
        ("../../x.csv", b"1", "is no plain name"),
        ("..\\x.csv", b"1", "is no plain name"),
        ("/etc/passwd\0.csv", b"1", "is no plain name"),
        ("x.nc", b"1", "is no plain name"),
        ("", b"1", "is no plain name"),
        ("x.csv", b"", '"x.csv" is empty'),
        ("x.csv", bytes(LARGEST_LIST + 1), '"x.csv" has 0.5 MB, and at most 0.5 MB are taken here'),
    ],
)
def test_hostile_files_are_refused_in_a_sentence_and_leave_nothing(
    shelf: Shelf, name: str, data: bytes, words: str
) -> None:
    with pytest.raises(vrte.SceneError) as told:
        shelf.add(name, data, CSV, LARGEST_LIST)
    assert words in str(told.value)
    assert "\n" not in str(told.value)
    assert (shelf.names, shelf.own, shelf.folder) == (frozenset(), {}, Path())


def test_names_are_made_plain() -> None:
    for given, expected in (
        ("Nebel (dünn).CSV", "Nebel-d-nn"),
        ("-rf.csv", "rf"),
        ("<b>.csv", "b"),
        ("....csv", "table"),
        ("a" * 300 + ".csv", "a" * 40),
    ):
        assert split_name(given, CSV) == (expected, ".csv")


def test_a_file_never_changes_under_its_name(shelf: Shelf) -> None:
    """Results tell what they are of by the scene, which names it."""
    names = [shelf.add("fog.csv", data, CSV, 10) for data in (b"1", b"2", b"1")]
    assert names == ["fog.csv", "fog-2.csv", "fog.csv"]
    assert [(shelf.folder / name).read_bytes() for name in names] == [b"1", b"2", b"1"]
    folder = shelf.folder
    shelf.close()
    assert not folder.exists()


def test_files_that_no_field_names_go_where_there_is_no_room(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(MOST_TABLES):
        shelf.add(f"{k}.csv", bytes([k]), CSV, 10)
    with pytest.raises(vrte.SceneError, match=f"at most {MOST_TABLES} files"):
        shelf.add("more.csv", b"more", CSV, 10, shelf.names)
    shelf.add("more.csv", b"more", CSV, 10, shelf.names - {"3.csv"})
    assert "3.csv" not in shelf.names
    assert not (shelf.folder / "3.csv").exists()
    monkeypatch.setattr(shelves, "LARGEST_SHELF", 50)
    with pytest.raises(vrte.SceneError, match="in all"):
        shelf.add("large.csv", bytes(60), CSV, 100)


def test_tables_that_the_scene_began_with_stay_beside_it(tmp_path: Path) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "old").mkdir()
    for name in ("fog.csv", "scenes/haze.csv", "scenes/ice.csv"):
        (tmp_path / name).write_text(name)
    shelf = Shelf(tmp_path / "scenes", {"../fog.csv", "haze.csv", "old/../ice.csv"})
    try:
        assert shelf.add("haze.csv", b"other", CSV, 10) == "haze-2.csv"
        assert shelf.folder != tmp_path / "scenes"
        expected = {"../fog.csv": "fog.csv", "haze.csv": "scenes/haze.csv", "haze-2.csv": "other"}
        expected["old/../ice.csv"] = "scenes/ice.csv"
        assert {name: (shelf.folder / name).read_text() for name in expected} == expected
        assert shelf.names == expected.keys()
    finally:
        shelf.close()


def test_what_is_made_from_a_file_is_read_in_a_process_and_told(shelf: Shelf) -> None:
    bench = Bench(
        {**FOG, "layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": 1.0}, *copy.deepcopy(FOG["layer"])]}, shelf
    )
    assert "reads no files" in bench.find_problems()["layer", 1, "phase"]
    bench.content["layer"][1]["phase"] = shelf.add("fog.csv", COEFFICIENTS, CSV, 1000)
    assert bench.find_problems() == {("layer", 1, "phase"): f"layer 2: table of coefficients: {WAITS}"}
    assert looked(bench) == {}
    (said,) = bench.said.values()
    assert said.words == read_coefficients(shelf.folder / "fog.csv").in_words
    wrong = COEFFICIENTS.replace(b"0.3", b"4")
    bench.content["layer"][1]["phase"] = shelf.add("fog.csv", wrong, CSV, 1000)
    found = looked(bench)
    assert list(found) == [("layer", 1, "phase")]
    assert found["layer", 1, "phase"].startswith('layer 2: table of coefficients = "fog-2.csv": ')
    bench.content["layer"][1]["tolerance"] = 1.0
    assert looked(bench) != found  # looked at again: it has a say


@pytest.mark.slow
def test_it_is_solved_as_from_a_scene_file(shelf: Shelf, tmp_path: Path) -> None:
    shelf.add("fog.csv", COEFFICIENTS, CSV, 1000)
    job = ended(Job(Solve(FOG, shelf.folder, ENOUGH)))
    assert isinstance(job.outcome, Outcome), job.message
    name, data = make_scene_download(FOG, shelf)
    assert name == "scene.zip"
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.namelist() == ["scene.toml", "fog.csv"]
        archive.extractall(tmp_path)
    file = read_scene(tmp_path / "scene.toml")
    expected = vrte.brdf(file.scene, **file.keywords({}))
    np.testing.assert_array_equal(job.outcome.brdfs[0].mueller, expected.mueller)
    assert make_scene_download(START, shelf)[0] == "scene.toml"


def test_a_process_that_dies_of_a_file_is_a_sentence(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf.add("fog.csv", COEFFICIENTS, CSV, 1000)
    bench = Bench(copy.deepcopy(FOG), shelf)
    monkeypatch.setattr("vrte.app.solving.job.START", "import os; os._exit(3)")
    found = looked(bench)
    assert found == {("layer", 0, "phase"): "the process of this task has ended with code 3"}


def test_a_scene_that_names_files_is_taken_and_asks_for_them() -> None:
    given = {**START, "layer": [{"phase": "../fog.csv", "albedo": 1, "thickness": 1, "tolerance": 0.1}]}
    content, told = adopt_and_tell(given)
    assert content["layer"] == given["layer"]
    assert told == ('"../fog.csv" is not here: put it in where the form asks for it',)
    assert list(Bench(content).find_problems()) == [("layer", 0, "phase")]
    with pytest.raises(vrte.SceneError, match="nodes"):
        adopt_and_tell({**given, "nodes": 0})


@pytest.mark.slow
def test_an_opened_scene_has_what_it_names_looked_at_aside(shelf: Shelf) -> None:
    """What a page brings is read by the server's process nowhere, if it is more than lines of text."""
    shelf.add("fog.csv", COEFFICIENTS.replace(b"0.3", b"4"), CSV, 1000)
    content, told = adopt_and_tell(FOG, shelf.folder, shelf.names, True)
    assert (content["layer"], told) == (FOG["layer"], ())
    assert "phase" in str(looked(Bench(content, shelf)))
    with pytest.raises(vrte.SceneError, match=r"fog\.csv"):
        adopt_and_tell(FOG, shelf.folder, shelf.names)  # as `vrte view` begins


def test_indices_and_sizes_are_read_where_they_are_named(shelf: Shelf) -> None:
    bench = Bench({**START, "particles": {"gold": {"index": "clay.csv", "size": {"table": "sizes.csv"}}}}, shelf)
    shelf.add("clay.csv", b"wavelength_um,n,k\n0.5,1.5,0\n0.7,1.4,0\n", CSV, LARGEST_LIST)
    shelf.add("sizes.csv", b"radius_um,density\n0.1,0\n0.2,1\n0.4,0\n", CSV, LARGEST_LIST)
    assert bench.find_problems() == {}
    bench.content["wavelength_um"] = [0.6, 0.8]
    assert "0.7" in bench.find_problems()["particles", "gold", "index"]


def test_files_go_with_their_tab() -> None:
    benches = Benches()
    bench = benches.of("tab")
    bench.shelf.add("fog.csv", COEFFICIENTS, CSV, 1000)
    folder = bench.shelf.folder
    bench.content = copy.deepcopy(FOG)
    bench.find_problems()
    assert bench.looks is not None
    benches.close()
    assert not folder.exists()
    ended(bench.looks)
    assert benches.of("other").shelf.names == frozenset()  # another's tab names none of them


def test_a_file_to_be_chosen_is_asked_for_at_its_field() -> None:
    content: Content = {**START, "layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": 1.0}]}
    layers.set_medium(content, 0, "coefficients")
    assert Bench(content).find_problems() == {
        ("layer", 0, "phase"): "layer 1: table of coefficients needs a file (.csv)"
    }


@pytest.mark.slow
def test_a_base_is_taken_from_a_result_and_what_is_none_is_told_without_its_path(shelf: Shelf, tmp_path: Path) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    mu = np.linspace(0.02, 1.0, 12)
    vrte.brdf(scene, mu, mu, [0, 45, 90, 135, 180], nodes=4).save(tmp_path / "haze.nc")
    bench = Bench(copy.deepcopy(START), shelf)
    set_base(bench.content, "table")
    suffixes = BASES["table"].keys["file"].suffixes
    good, bad = (tmp_path / "haze.nc").read_bytes(), b"\x89HDF\r\n\x1a\n" + bytes(1000)
    for data, words in ((bad, "bad.nc is not a NetCDF file"), (good, "")):
        name = "good.nc" if data is good else "bad.nc"
        bench.content["base"]["file"] = shelf.add(name, data, suffixes, LARGEST_TABLE)
        found = "; ".join(looked(bench).values())
        assert (words in found, str(shelf.folder) in found) == (True, False)
    assert found == ""
