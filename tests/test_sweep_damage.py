"""Tables and half-made tables that a power cut, a disk or somebody has damaged: mended to the same bits, or refused;
and sweeps killed for real, their process and their Dask workers, at random moments: then the same command again."""

import json
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numcodecs
import psutil
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.sweep import store
from vrte.sweep.run import SweepWarning
from vrte.sweep.table import open_table

from .helpers import HANGS, is_alive, wait_until

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


def sweep_quietly(output: Path | None = None) -> Any:
    """A table; the failed scenes are meant."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*scenes failed", SweepWarning)
        return vrte.sweep(GOLD, output, workers=1)


@pytest.fixture(scope="module")
def expected() -> Any:
    return sweep_quietly()


@pytest.fixture
def begun(tmp_path: Path) -> Path:
    """The folder of a table of which four of six chunks are there, in a folder with nothing else."""

    def cut(done: int, total: int) -> None:
        if done == 4:
            raise PowerCutError

    output = tmp_path / "here" / "table.zarr"
    output.parent.mkdir()
    with pytest.raises(PowerCutError):
        vrte.sweep(GOLD, output, workers=1, chunk=1, progress=cut)
    return output.with_name("table.zarr.partial")


@pytest.fixture
def output(begun: Path) -> Path:
    """A finished table."""
    sweep_quietly(begun.with_name("table.zarr")).close()
    return begun.with_name("table.zarr")


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    if content:
        index = random.randrange(len(content))
        index += index == 4 and "c" in path.parts  # where zstd has a bit for nothing: no damage
        content[min(index, len(content) - 1)] ^= 1 << random.randrange(8)
    path.write_bytes(bytes(content))


HARMS = (emptied, cut, flipped, flipped, Path.unlink)


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


def check_bits(found: Any, expected: Any, what: object) -> None:
    """The same table to the last bit."""
    assert found.identical(expected.assign_attrs(found.attrs)), what
    for name in ("mueller", "reflectance", "direct_transmittance"):
        assert found[name].values.tobytes() == expected[name].values.tobytes(), what


def check_mended(output: Path, expected: Any, what: object) -> int:
    """The table is the same to the last bit and nothing else is left; in how many lines was it told?"""
    with warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("always")
        with vrte.sweep(GOLD, output, workers=1) as table:
            check_bits(table.load(), expected, what)
    assert os.listdir(output.parent) == [output.name], what
    lines = [str(one.message) for one in reported if "was damaged" in str(one.message)]
    assert all("\n" not in line for line in lines)
    return len(lines)


def test_what_is_done_is_not_done_again(begun: Path, expected: Any) -> None:
    """A complete table is only opened."""
    output, reported = begun.with_name("table.zarr"), list[int]()
    assert not output.exists()
    os.link(begun / "log.txt", begun.parents[1] / "log.txt")
    with pytest.warns(SweepWarning, match="scenes failed"):
        vrte.sweep(GOLD, output, workers=1, progress=lambda done, total: reported.append(done)).close()
    assert reported in ([4, 5, 6], [5, 6])  # that which was at work when it was stopped may have been finished
    lines = [line.split()[:2] for line in (begun.parents[1] / "log.txt").read_text().splitlines()]
    assert [lines.count(["begin", chunk]) for chunk in "01235"] == [1] * 5
    assert check_mended(output, expected, "complete") == 0


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["begun", "output"])
def test_whatever_is_damaged_is_made_again_or_refused(
    stage: str, expected: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Of a growing table a lock and a log hold nothing, and what is not there was never begun; of a finished one what
    says whose table it is can be lost."""
    folder, names, refused = request.getfixturevalue(stage), set(), 0
    for name, harm in each_damage(folder, tmp_path / "spare"):
        names.add(name.split("/")[0])
        is_told = not name.endswith(("lock", "log.txt")) and (harm != "unlink" or name.startswith("table/"))
        try:
            reported = check_mended(folder.with_name("table.zarr"), expected, (name, harm))
            assert reported == (is_told or stage == "output"), (name, harm)
        except SceneError as error:
            assert (stage, name) == ("output", "zarr.json")
            assert "is no table of a sweep, or too damaged to say of which" in str(error)  # noqa: PT017
            assert os.listdir(folder.parent) == ["table.zarr"]
            refused += 1
    assert stage == "output" or names == {"sweep", "table", "done", "optics", "log.txt", "lock"}
    assert (refused >= 3) == (stage == "output")


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


def test_a_damaged_netcdf_is_refused(tmp_path: Path, expected: Any) -> None:
    output = tmp_path / "table.nc"
    sweep_quietly(output).close()
    kept = output.read_bytes()
    assert check_mended(output, expected, "whole") == 0
    for harm in (emptied, cut, flipped):
        output.write_bytes(kept)
        harm(output)
        with pytest.raises(SceneError, match="is no table of a sweep, or cut" + "|is damaged" * (harm is flipped)):
            vrte.sweep(GOLD, output)
        assert os.listdir(tmp_path) == ["table.nc"]


@pytest.mark.parametrize("renamings", [0, 1])
def test_mending_killed_half_way_goes_on(
    renamings: int, output: Path, expected: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed before the output becomes work again, or before the mended work becomes the output."""
    cut(output / "mueller" / "c" / "0" / "0" / "0" / "0" / "0" / "0" / "0")
    done, rename = [], os.rename

    def killed(*places: Any) -> None:
        if len(done) == renamings:
            raise PowerCutError
        done.append(places)
        rename(*places)

    reported: list[int] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        monkeypatch.setattr(os, "rename", killed)
        with pytest.raises(PowerCutError):
            vrte.sweep(GOLD, output, workers=1)
        monkeypatch.setattr(os, "rename", rename)
        assert output.exists() == (renamings == 0)
        vrte.sweep(GOLD, output, progress=lambda scenes, _: reported.append(scenes)).close()
    assert reported == ([5, 6] if renamings == 0 else [])
    assert check_mended(output, expected, "mended") == 0


def planted(table: Path, mark: Path) -> None:
    """Makes of a Zarr table one of version 2 that, read, runs code which leaves a mark."""
    for name in ("mueller", "reflectance", "direct_transmittance", "error", "checksum", "mu_i", "mu_o", "phi_deg"):
        reported = json.loads((table / name / "zarr.json").read_text())
        store.remove(table / name)
        (table / name).mkdir()
        shape, filters = reported["shape"], [{"id": "vlen-utf8"}, {"id": "pickle", "protocol": 5}]
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
    """Nor is a table read that is packed in another way than a sweep's."""
    import zarr

    # as numcodecs was before it asked
    monkeypatch.setattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)
    output, mark = begun.with_name("table.zarr"), tmp_path / "mark"
    planted(begun / "table", mark)
    trap = zarr.open_group(begun / "table", mode="r")["mueller"]
    with suppress(TypeError):  # what it finds is no text
        trap[...]
    mark.rmdir()  # it works
    assert check_mended(output, expected, "planted") == 1
    reported = json.loads((output / "zarr.json").read_text())
    gzip = {"name": "gzip", "configuration": {"level": 1}}
    reported["consolidated_metadata"]["metadata"]["mueller"]["codecs"][-1] = gzip
    (output / "zarr.json").write_text(json.dumps(reported))
    with pytest.raises(SceneError, match="its mueller is packed as gzip"):
        open_table(output)
    planted(output, mark)
    for read in (lambda: vrte.sweep(GOLD, output), lambda: open_table(output)):
        with pytest.raises(SceneError, match="is no table of a sweep"):
            read()
    assert not mark.exists()


SCENE = """
wavelength_um = 0.5
nodes = 8
particles.gold = { index = "gold", radius_um = 0.1 }
layer = [{ particles = "gold", thickness = 1.0 }]
brdf.mu_i = [0.4, 1.0]
brdf.mu_o = { start = 0.1, stop = 1.0, count = 10 }
brdf.phi_deg = { start = 0, stop = 360, count = 37 }
axes.wavelength_um = [0.45, 0.5, 0.55, 0.6]
"""
DASK = ("--engine", "dask", "--workers", "2")
KILLS = 10


@pytest.mark.slow
@pytest.mark.parametrize(("scenes", "engine", "worker"), [(400, (), False), (400, DASK, False), (1200, DASK, True)])
def test_killed_again_and_again(scenes: int, engine: Any, worker: bool, tmp_path: Path, request: Any) -> None:
    """The whole process each time, or a Dask ``worker`` that is at work, while the sweep itself goes on; each time
    something has at least begun, and chunks that are done are not computed again."""
    file, output, log = tmp_path / "table.toml", tmp_path / "table.zarr", tmp_path / "kept.log"
    depths = f"{{ start = 0.1, stop = 10, count = {scenes // 4} }}"
    file.write_text(f'{SCENE}axes."layer[1].thickness" = {depths}\n')
    command = [sys.executable, "-m", "vrte.cli", "sweep", str(file), "-o", str(output), "--chunk", "2", *engine]

    def start() -> "subprocess.Popen[str]":
        found = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
        request.addfinalizer(found.kill)
        return found

    def list_begun() -> list[tuple[int, int]]:
        """Chunks and the processes that began them."""
        lines = [line.split() for line in log.read_text().splitlines()]
        return [(int(chunk), int(who.rpartition(":")[2])) for word, chunk, who, _ in lines if word == "begin"]

    process, dead = start(), set[int]()
    growing = output.with_name("table.zarr.partial") / "log.txt"
    wait_until(growing.exists, process=process)
    os.link(growing, log)  # it stays when the folder goes
    for kill in range(KILLS):
        least, most = (1, scenes // (4 * KILLS)) if worker else (3, max(3, scenes // (4 * KILLS)))  # on two workers
        goal = len(list_begun()) + random.randint(least, most)
        wait_until(lambda goal=goal: len(list_begun()) >= goal, process=process)  # type: ignore[misc]
        time.sleep(random.uniform(0.0, 0.03))
        if worker:
            dead.add(chosen := next(one for _, one in reversed(list_begun()) if one not in dead))
            os.kill(chosen, signal.SIGKILL)
            continue
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.communicate()
        assert not output.exists(), f"finished before kill {kill + 1}"
        wait_until(lambda workers=workers: not any(is_alive(one.pid) for one in workers))  # type: ignore[misc]
        process = start()
    _, complaint = process.communicate(timeout=HANGS)
    assert (process.returncode, complaint) == (0, "")
    chunks = [chunk for chunk, _ in list_begun()]
    assert {*chunks} == {*range(scenes // 2)}
    assert len(chunks) - scenes // 2 <= (1 if worker else 2) * KILLS
    assert not growing.parent.exists()
    with open_table(output) as found:
        check_bits(found, vrte.sweep(file, workers=1), "killed")
        assert (found.error.values == "").all()
