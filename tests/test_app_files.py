"""Files that somebody puts into the viewer: what is taken, where it lies, what is said of it, and who reads it."""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import vrte
from vrte.app.form.checks import WAITS, adopt_with_notes
from vrte.app.form.content import START, Content
from vrte.app.solving import tab_session, worker
from vrte.app.solving.tab_session import LARGEST_LIST, LARGEST_TABLE, MOST_TABLES, TabSession, TabSessions, Uploads
from vrte.formats.columns import read_coefficients

from .helpers import wait_until

COEFFICIENTS = b"l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,0.3,0,0,0,0,0\n"
WRONG = COEFFICIENTS.replace(b"0.3", b"4")
CSV = (".csv",)
FOG: Content = {
    "nodes": 4,
    "layer": [{"phase": "fog.csv", "albedo": 0.9, "thickness": 1.0}],
    "brdf": {"mu_i": 0.5, "mu_o": [0.3, 0.9]},
}


@pytest.fixture
def uploads() -> Iterator[Uploads]:
    made = Uploads()
    yield made
    made.close()


def find_all(session: TabSession) -> dict[Any, str]:
    """What is wrong with a scene, once everything has been looked at."""
    while True:
        found = session.find_problems()
        if session.looks.task is None:
            return found
        wait_until(lambda: not session.looks.waits)
        assert session.has_looked()


def test_hostile_files_are_refused_in_a_sentence_and_leave_nothing(uploads: Uploads) -> None:
    names = "../../x", "../../x.csv", "..\\x.csv", "/etc/passwd\0.csv", "x.nc", ""
    for name, data, words in (
        *((name, b"1", "is no plain name of a file that ends in .csv") for name in names),
        ("x.csv", b"", '"x.csv" is empty'),
        ("x.csv", bytes(LARGEST_LIST + 1), '"x.csv" has 0.5 MB, and at most 0.5 MB are taken here'),
    ):
        with pytest.raises(vrte.SceneError) as raised:
            uploads.add(name, data, CSV, LARGEST_LIST)
        assert words in str(raised.value)
        assert "\n" not in str(raised.value)
        assert (uploads.names, uploads.own, uploads.folder) == (frozenset(), {}, Path())


def test_names_are_made_plain_and_a_file_never_changes_under_its_name(uploads: Uploads) -> None:
    """Results tell what they are of by the scene, which names it."""
    for given, expected in (
        ("Nebel (dünn).CSV", "Nebel-d-nn"),
        ("-rf.csv", "rf"),
        ("<b>.csv", "b"),
        ("....csv", "table"),
        (f"{'a' * 300}.csv", "a" * 40),
    ):
        assert uploads.add(given, b"1", CSV, 10) == f"{expected}.csv"
    names = [uploads.add("fog.csv", data, CSV, 10) for data in (b"1", b"2", b"1")]
    assert names == ["fog.csv", "fog-2.csv", "fog.csv"]
    assert [(uploads.folder / name).read_bytes() for name in names] == [b"1", b"2", b"1"]
    folder = uploads.folder
    uploads.close()
    assert not folder.exists()


def test_files_that_no_field_names_go_where_there_is_no_room(uploads: Uploads, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(MOST_TABLES):
        uploads.add(f"{k}.csv", bytes([k]), CSV, 10)
    with pytest.raises(vrte.SceneError, match=f"at most {MOST_TABLES} files"):
        uploads.add("more.csv", b"more", CSV, 10, uploads.names)
    uploads.add("more.csv", b"more", CSV, 10, uploads.names - {"3.csv"})
    assert "3.csv" not in uploads.names
    assert not (uploads.folder / "3.csv").exists()
    monkeypatch.setattr(tab_session, "LARGEST_UPLOADS", 50)
    with pytest.raises(vrte.SceneError, match="in all"):
        uploads.add("large.csv", bytes(60), CSV, 100)


def test_tables_that_the_scene_began_with_stay_beside_it(tmp_path: Path) -> None:
    (tmp_path / "scenes" / "old").mkdir(parents=True)
    for name in ("fog.csv", "scenes/haze.csv", "scenes/ice.csv"):
        (tmp_path / name).write_text(name)
    uploads = Uploads(tmp_path / "scenes", {"../fog.csv", "haze.csv", "old/../ice.csv"})
    assert uploads.add("haze.csv", b"other", CSV, 10) == "haze-2.csv"
    assert uploads.folder != tmp_path / "scenes"
    expected = {"../fog.csv": "fog.csv", "haze.csv": "scenes/haze.csv", "haze-2.csv": "other"}
    expected["old/../ice.csv"] = "scenes/ice.csv"
    assert {name: (uploads.folder / name).read_text() for name in expected} == expected
    assert uploads.names == expected.keys()
    uploads.close()


def test_what_is_made_from_a_file_is_read_in_a_process_and_described(
    uploads: Uploads, monkeypatch: pytest.MonkeyPatch
) -> None:
    isotropic = {"phase": "isotropic", "albedo": 1.0, "thickness": 1.0}
    session = TabSession({**FOG, "layer": [isotropic, dict(FOG["layer"][0])]}, uploads)
    named = session.content["layer"][1]
    assert "reads no files" in session.find_problems()["layer", 1, "phase"]
    named["phase"] = ""
    assert session.find_problems() == {("layer", 1, "phase"): "layer 2: table of coefficients needs a file (.csv)"}
    named["phase"] = uploads.add("fog.csv", COEFFICIENTS, CSV, 1000)
    assert session.find_problems() == {("layer", 1, "phase"): f"layer 2: table of coefficients: {WAITS}"}
    assert find_all(session) == {}
    (read,) = session.parts_read.values()
    assert read.words == read_coefficients(uploads.folder / "fog.csv").in_words
    named["phase"] = uploads.add("fog.csv", WRONG, CSV, 1000)
    found = find_all(session)
    assert list(found) == [("layer", 1, "phase")]
    assert found["layer", 1, "phase"].startswith('layer 2: table of coefficients = "fog-2.csv": ')
    monkeypatch.setattr(worker, "START", "import os; os._exit(3)")
    named["tolerance"] = 1.0  # looked at again: it has a say
    assert find_all(session) == {("layer", 1, "phase"): "the process of this task has ended with code 3"}


def test_a_scene_that_names_files_is_taken_and_asks_for_them() -> None:
    given = {**START, "layer": [{"phase": "../fog.csv", "albedo": 1, "thickness": 1, "tolerance": 0.1}]}
    content, notes = adopt_with_notes(given)
    assert content["layer"] == given["layer"]
    assert notes == ('"../fog.csv" is not here: put it in where the form asks for it',)
    assert list(TabSession(content).find_problems()) == [("layer", 0, "phase")]
    with pytest.raises(vrte.SceneError, match="nodes"):
        adopt_with_notes({**given, "nodes": 0})


@pytest.mark.slow
def test_an_opened_scene_has_what_it_names_looked_at_aside(uploads: Uploads) -> None:
    """What a page brings is read by the server's process nowhere, if it is more than lines of text."""
    uploads.add("fog.csv", WRONG, CSV, 1000)
    content, notes = adopt_with_notes(FOG, uploads.folder, uploads.names, True)
    assert (content["layer"], notes) == (FOG["layer"], ())
    assert "phase" in str(find_all(TabSession(content, uploads)))
    with pytest.raises(vrte.SceneError, match=r"fog\.csv"):
        adopt_with_notes(FOG, uploads.folder, uploads.names)  # as `vrte view` begins


def test_indices_and_sizes_are_read_where_they_are_named(uploads: Uploads) -> None:
    gold = {"index": "clay.csv", "size": {"table": "sizes.csv"}}
    session = TabSession({**START, "particles": {"gold": gold}}, uploads)
    uploads.add("clay.csv", b"wavelength_um,n,k\n0.5,1.5,0\n0.7,1.4,0\n", CSV, LARGEST_LIST)
    uploads.add("sizes.csv", b"radius_um,density\n0.1,0\n0.2,1\n0.4,0\n", CSV, LARGEST_LIST)
    assert session.find_problems() == {}
    session.content["wavelength_um"] = [0.6, 0.8]
    assert "0.7" in session.find_problems()["particles", "gold", "index"]


def test_files_go_with_their_tab() -> None:
    sessions = TabSessions()
    session = sessions.of("tab")
    session.uploads.add("fog.csv", COEFFICIENTS, CSV, 1000)
    folder = session.uploads.folder
    session.content = copy.deepcopy(FOG)
    session.find_problems()
    assert session.looks.waits
    sessions.close()
    assert (folder.exists(), session.looks.waits) == (False, False)
    assert sessions.of("other").uploads.names == frozenset()  # another's tab names none of them


@pytest.mark.slow
def test_a_file_that_is_no_base_is_refused_without_its_path(uploads: Uploads) -> None:
    content = {**START, "base": {"kind": "table", "file": "bad.nc"}}
    uploads.add("bad.nc", b"\x89HDF\r\n\x1a\n" + bytes(1000), (".nc",), LARGEST_TABLE)
    (found,) = find_all(TabSession(content, uploads)).values()
    assert "bad.nc: it is not a NetCDF file" in found
    assert str(uploads.folder) not in found
