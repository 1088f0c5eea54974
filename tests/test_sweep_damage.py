"""Tables and half-made tables that a power cut, a disk or somebody has damaged: mended to the same bits, or refused."""

import contextlib
import json
import os
import pickle
import random
import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numcodecs
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.sweep import store
from vrte.sweep.run import SweepWarning
from vrte.sweep.table import open_table

GOLD = {
    "wavelength_um": 0.55,
    "nodes": 2,
    "particles": {"gold": {"index": [0.4, 2.4], "radius_um": 0.02}},
    "layer": [{"particles": "gold", "thickness": 1.0}],
    "brdf": {"mu_i": 0.6, "mu_o": [0.5, 1.0], "phi_deg": [0, 90]},
    "axes": {
        "radius": {"key": "particles.gold.radius_um", "values": [0.02, 0.0, 0.03]},  # radius 0 is no radius
        "layer[1].thickness": [0.1, 2.0],
    },
}


class PowerCutError(Exception):
    """What stops a sweep here."""


def quietly_swept(output: Path, **how: Any) -> Any:
    """The table in memory; the failed scenes are meant."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*scenes failed", SweepWarning)
        with vrte.sweep(GOLD, output, workers=1, chunk=1, **how) as table:
            return table.load()


@pytest.fixture(scope="module")
def expected() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return vrte.sweep(GOLD, workers=1)


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """An empty folder, for a table and nothing else."""
    (tmp_path / "here").mkdir()
    return tmp_path / "here"


@pytest.fixture
def begun(here: Path) -> Path:
    """The folder of a table of which four of six chunks are there."""

    def cut(done: int, total: int) -> None:
        if done == 4:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        vrte.sweep(GOLD, here / "table.zarr", workers=1, chunk=1, progress=cut)
    return here / "table.zarr.partial"


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    if content:
        place = random.randrange(len(content))
        place += place == 4 and "c" in path.parts  # where zstd has a bit for nothing: no damage
        content[min(place, len(content) - 1)] ^= 1 << random.randrange(8)
    path.write_bytes(bytes(content))


def removed(path: Path) -> None:
    path.unlink()


HARMS = (emptied, cut, flipped, flipped, removed)


def each_damage(folder: Path, spare: Path) -> Iterator[tuple[str, str]]:
    """For each file of a folder and each harm its name and the harm's, with such a folder in place."""
    shutil.copytree(folder, spare)
    for path in sorted(spare.rglob("*")):
        for harm in HARMS if path.is_file() else ():
            for there in folder.parent.iterdir():
                store.remove(there)
            shutil.copytree(spare, folder)
            name = path.relative_to(spare)
            harm(folder / name)
            yield str(name), harm.__name__


def check_mended(output: Path, expected: Any, what: object) -> int:
    """The table is the same to the last bit and nothing else is left; in how many lines was it told?"""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with vrte.sweep(GOLD, output, workers=1) as table:
            found = table.load()
    assert found.identical(expected.assign_attrs(found.attrs)), what
    for name in ("mueller", "reflectance", "direct_transmittance"):
        assert found[name].values.tobytes() == expected[name].values.tobytes(), what
    assert os.listdir(output.parent) == [output.name], what
    lines = [str(one.message) for one in told if "was damaged" in str(one.message)]
    assert all("\n" not in line for line in lines)
    return len(lines)


def is_told(name: str, harm: str) -> bool:
    """Whether a damage is one: a lock and a log hold nothing, and what is not there was never begun."""
    if name in ("lock", "log.txt") or name.endswith(".lock"):
        return False
    return harm != "removed" or name.startswith("table/")


@pytest.mark.slow
def test_whatever_is_damaged_of_a_growing_table_is_made_again(begun: Path, expected: Any, tmp_path: Path) -> None:
    assert len(list(begun.glob("done/*"))) >= 4
    names = set()
    for name, harm in each_damage(begun, tmp_path / "spare"):
        names.add(name.split("/")[0])
        assert check_mended(begun.with_name("table.zarr"), expected, (name, harm)) == is_told(name, harm), (name, harm)
    assert names == {"sweep", "table", "done", "optics", "log.txt", "lock"}


@pytest.mark.slow
def test_whatever_is_damaged_of_a_finished_table_is_made_again_or_refused(
    here: Path, expected: Any, tmp_path: Path
) -> None:
    output = here / "table.zarr"
    quietly_swept(output)
    refused = 0
    for name, harm in each_damage(output, tmp_path / "spare"):
        if name != "zarr.json":
            assert check_mended(output, expected, (name, harm)) == 1, (name, harm)
            continue
        try:
            assert check_mended(output, expected, (name, harm)) == 1, (name, harm)
        except SceneError as error:  # what tells whose table it was is lost
            assert "is no table of a sweep, or too damaged to say of which" in str(error)  # noqa: PT017
            assert os.listdir(here) == ["table.zarr"]
            refused += 1
    assert refused >= 3


@pytest.mark.parametrize("harm", [emptied, flipped])
def test_the_commonest_damages(harm: Callable[[Path], None], begun: Path, expected: Any) -> None:
    for name in ("table/mueller/c/0/0/0/0/0/0/0", "done/000000001", "table/mueller/zarr.json"):
        harm(begun / name)
    next(path for path in begun.glob("optics/*") if not path.suffix).write_bytes(b"")
    output = begun.with_name("table.zarr")
    assert check_mended(output, expected, harm) == 1
    harm(output / "reflectance" / "c" / "2" / "0" / "0")
    assert check_mended(output, expected, harm) == 1
    assert check_mended(output, expected, harm) == 0


def test_a_damaged_netcdf_is_refused(here: Path, expected: Any) -> None:
    output = here / "table.nc"
    quietly_swept(output)
    kept = output.read_bytes()
    assert check_mended(output, expected, "whole") == 0
    for harm, words in (
        (emptied, "is no table of a sweep, or cut"),
        (cut, "is no table of a sweep, or cut"),
        (flipped, "is damaged|is no table of a sweep, or cut"),
    ):
        output.write_bytes(kept)
        harm(output)
        with pytest.raises(SceneError, match=words):
            vrte.sweep(GOLD, output)
        assert os.listdir(here) == ["table.nc"]


@pytest.mark.parametrize("renamings", [0, 1])
def test_mending_killed_half_way_goes_on(
    renamings: int, here: Path, expected: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed before the output becomes work again, or before the mended work becomes the output."""
    output = here / "table.zarr"
    quietly_swept(output)
    cut(output / "mueller" / "c" / "0" / "0" / "0" / "0" / "0" / "0" / "0")
    done, rename = [], os.rename

    def killed(*places: Any) -> None:
        if len(done) == renamings:
            raise PowerCutError
        done.append(places)
        rename(*places)

    told: list[int] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with monkeypatch.context() as patch:
            patch.setattr(os, "rename", killed)
            with pytest.raises(PowerCutError):
                vrte.sweep(GOLD, output, workers=1)
        assert output.exists() == (renamings == 0)
        vrte.sweep(GOLD, output, progress=lambda scenes, _: told.append(scenes)).close()
    assert told == ([5, 6] if renamings == 0 else [])
    assert check_mended(output, expected, "mended") == 0


def planted(table: Path, mark: Path) -> None:
    """Makes of a Zarr table one of version 2 that, read, runs code which leaves a mark."""
    for name in ("mueller", "reflectance", "direct_transmittance", "error", "checksum", "mu_i", "mu_o", "phi_deg"):
        said = json.loads((table / name / "zarr.json").read_text())
        store.remove(table / name)
        (table / name).mkdir()
        shape, filters = said["shape"], [{"id": "vlen-utf8"}, {"id": "pickle", "protocol": 5}]
        array = {"zarr_format": 2, "shape": shape, "chunks": shape, "dtype": "|O", "order": "C", "fill_value": ""}
        (table / name / ".zarray").write_text(json.dumps(array | {"compressor": None, "filters": filters}))
        (table / name / ".".join("0" for _ in shape)).write_bytes(pickle.dumps(Mark(mark)))
    attributes = json.loads((table / "zarr.json").read_text())["attributes"]
    (table / "zarr.json").unlink()
    (table / ".zgroup").write_text('{"zarr_format": 2}')
    (table / ".zattrs").write_text(json.dumps(attributes))


class Mark:
    """What makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.path),)


def test_a_table_that_would_run_code_runs_none(
    begun: Path, expected: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import zarr

    # as numcodecs was before it asked
    monkeypatch.setattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)
    output, mark = begun.with_name("table.zarr"), tmp_path / "mark"
    planted(begun / "table", mark)
    trap = zarr.open_group(begun / "table", mode="r")["mueller"]
    with contextlib.suppress(TypeError):  # what it finds is no text
        trap[...]
    mark.rmdir()  # it works
    assert check_mended(output, expected, "planted") == 1
    planted(output, mark)
    with pytest.raises(SceneError, match="is no table of a sweep"):
        vrte.sweep(GOLD, output)
    with pytest.raises(SceneError, match="is no table of a sweep"):
        open_table(output)
    assert not mark.exists()


def test_a_table_packed_in_a_strange_way_is_not_read(here: Path) -> None:
    output = here / "table.zarr"
    quietly_swept(output)
    said = json.loads((output / "zarr.json").read_text())
    said["consolidated_metadata"]["metadata"]["mueller"]["codecs"][-1] = {"name": "gzip", "configuration": {"level": 1}}
    (output / "zarr.json").write_text(json.dumps(said))
    with pytest.raises(SceneError, match="its mueller is packed as gzip"):
        open_table(output)
