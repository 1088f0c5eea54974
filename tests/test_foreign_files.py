"""Files that somebody else may have made or damaged: refused before they are read, and never a way to others."""

import faulthandler
import os
import random
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import vrte
from tests.helpers import printed_by, run
from vrte.basics.errors import SceneError
from vrte.formats import netcdf
from vrte.formats.atomic import LENGTH
from vrte.formats.columns import read_coefficients, read_index, write_coefficients
from vrte.results.quantities import MUELLER
from vrte.sweep.table import open_table

SHAPE = (2, 20, 37, 4, 4)
Attack = Callable[[h5py.File, Path], object]


@pytest.fixture
def good(small_brdf: Any, tmp_path: Path) -> Path:
    small_brdf.save(tmp_path / "good.nc")
    return tmp_path / "good.nc"


@pytest.fixture
def not_for_ever() -> Iterator[None]:
    """HDF5 that waits for a pipe is deaf to everything: the tests end then, and say where."""
    faulthandler.dump_traceback_later(60, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def external_storage(file: h5py.File, secret: Path) -> None:
    file.create_dataset("mueller", SHAPE, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def virtual_dataset(file: h5py.File, secret: Path) -> None:
    layout = h5py.VirtualLayout(shape=SHAPE, dtype="f8")
    layout[...] = h5py.VirtualSource(str(secret), "mueller", shape=SHAPE)
    file.create_virtual_dataset("mueller", layout)


def soft_link(file: h5py.File, secret: Path) -> None:
    file["beside"] = h5py.ExternalLink(str(secret), "/")
    file["mueller"] = h5py.SoftLink("/beside/mueller")


def dataset(**options: Any) -> Attack:
    return lambda file, _: file.create_dataset("mueller", **options)


def attribute(name: str, value: Any) -> Attack:
    return lambda file, _: file.attrs.create(name, value)


LARGE = {"shape": (40_000, 4_000, 4), "dtype": "f8"}
ELSEWHERE = [
    (external_storage, r"its mueller lies in another file \(external storage\)"),
    (virtual_dataset, r"its mueller is put together from other files \(a virtual dataset\)"),
    (lambda file, secret: file.update({"mueller": h5py.ExternalLink(str(secret), "/")}), "its mueller is a link to el"),
    (soft_link, "its (mueller|beside) is a link to elsewhere"),
]


@pytest.mark.usefixtures("not_for_ever")
@pytest.mark.parametrize(
    ("attack", "words"),
    [
        *ELSEWHERE,
        (dataset(data=np.zeros(SHAPE), compression="lzf"), "by the filter 'lzf': only shuffle, deflate, fletcher32"),
        (dataset(**LARGE, compression=9), "5120000000 bytes.*and holds 0"),
        (lambda file, _: file.create_group("mueller"), "its mueller must be an array"),
        (dataset(data=[b"a", b"b"]), "its mueller must be an array of numbers"),
        (dataset(data=h5py.Empty("f8")), "its mueller must be an array of numbers"),
        (
            lambda file, _: file.create_dataset("mueller", data=np.array([file.ref], h5py.ref_dtype)),
            "its mueller must be an array of numbers",
        ),
        (attribute("kind", 3.0), "its attribute kind must be one text"),
        (attribute("diagnostics", ["{}"] * 5000), "its attribute diagnostics must be one text"),
        (attribute("kind", "\x1b[2Jgone"), "it must say its kind, one of brdf, field, fields, spectrum"),
        (attribute("diagnostics", "{"), "holds no BRDF, field or spectrum written by vrte: JSONDecodeError"),
    ],
)
def test_what_leads_elsewhere_is_refused_before_it_is_read(
    attack: Attack, words: str, good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a result; what leads elsewhere, of a table of a sweep and of a measurement, too."""
    # the checks are the same in a process of its own, which takes half a second to start
    monkeypatch.setattr(netcdf, "read_foreign", netcdf.read_stored)
    os.mkfifo(tmp_path / "secret")  # whoever opens it waits for ever
    with netcdf.create_netcdf(tmp_path / "table.nc") as file:
        file.attrs["sweep"] = "{}"
    reading: dict[Path, Any] = {good: vrte.load}
    if (attack, words) in ELSEWHERE:
        reading[tmp_path / "table.nc"] = vrte.read_measurement
        reading[tmp_path / "again.nc"] = open_table
        (tmp_path / "again.nc").write_bytes((tmp_path / "table.nc").read_bytes())
    for path, read in reading.items():
        with h5py.File(path, "r+") as changed:
            changed.pop("mueller", None)
            attack(changed, tmp_path / "secret")
        with pytest.raises(SceneError, match=words) as refused:
            read(path)
        assert str(refused.value).startswith(str(path))
        assert str(refused.value).isprintable()


def test_what_other_programs_make_of_a_result_is_read(good: Path, small_brdf: Any, tmp_path: Path) -> None:
    """Read by a process of its own: packed, changed; one that is cut off is refused."""
    import xarray

    packed = {"mueller": {"zlib": True, "shuffle": True, "fletcher32": True, "chunksizes": SHAPE}}
    with xarray.open_dataset(good, engine="h5netcdf") as opened:
        opened.to_netcdf(tmp_path / "packed.nc", engine="h5netcdf", encoding=packed)
    with h5py.File(tmp_path / "packed.nc", "r+") as file:
        file.attrs["title"] = "renamed"
    np.testing.assert_array_equal(vrte.load(tmp_path / "packed.nc").mueller, small_brdf.mueller)
    content = good.read_bytes()
    for fraction in (0.0, 0.99):
        good.write_bytes(content[: int(fraction * len(content))])
        with pytest.raises(SceneError, match=r"good\.nc: it is not a NetCDF file"):
            vrte.load(good)


def test_a_result_larger_than_is_read_says_how_it_is(good: Path, tmp_path: Path) -> None:
    for path in (good, tmp_path / "good.csv", tmp_path / "good.zarr"):
        vrte.load(good).save(path)
        with pytest.raises(SceneError, match=r"more than the 0\.0001 GB.*if you trust it, vrte\.load\(path, most_byt"):
            vrte.load(path, most_bytes=1e5)
        assert vrte.load(path, most_bytes=1e6).mueller.shape == SHAPE
    with pytest.raises(SceneError, match="most_bytes must be a number of bytes >= 0, not -1"):
        vrte.load(good, most_bytes=-1)


@pytest.mark.slow
def test_a_large_table_is_refused_in_little_memory(tmp_path: Path) -> None:
    """5 GB declared in a header, and 0.6 GB in one line, with 0.4 GB to take."""
    header = '# vrte result, format 1\n# kind = "brdf"\n# diagnostics = {}\n'
    sizes = {"mu_i": 100, "mu_o": 1000, "phi_deg": 400}
    axes = "".join(f"# {name} = {list(range(size))}\n" for name, size in sizes.items())
    columns = ",".join([*sizes, *MUELLER]) + "\n"
    (tmp_path / "declared.csv").write_text(header + axes + columns)
    with open(tmp_path / "sparse.csv", "wb") as file:
        file.write((header + "# mu_i = [1]\n# mu_o = [1]\n# phi_deg = [0]\n" + columns).encode())
        file.truncate(600_000_000)
        file.seek(0, 2)
        file.write(b"\n")
    reported = printed_by(
        "import vrte\n"
        "from vrte.basics.memory import limit_memory\n"
        "limit_memory(4e8)\n"
        "for name, most in (('declared.csv', 2e9), ('declared.csv', 1e12), ('sparse.csv', 1e12)):\n"
        "    try: vrte.load(name, most_bytes=most)\n"
        "    except vrte.SceneError as error: print(error)\n",
        tmp_path,
    )
    assert reported == [
        "declared.csv: its values take 5.12 GB, more than the 2 GB that are read: "
        "if you trust it, vrte.load(path, most_bytes=6e9)",
        "declared.csv: there must be 40000000 rows, one a direction, not 0",
        "sparse.csv: line 8: longer than 50000000 bytes",
    ]


def flip(path: Path, whole: bytes, dice: random.Random, most: int) -> None:
    """Writes a file with one bit flipped, one of the first ``most`` bytes."""
    index = dice.randrange(most)
    path.write_bytes(whole[:index] + bytes([whole[index] ^ 1 << dice.randrange(8)]) + whole[index + 1 :])


def test_every_flipped_bit_is_told(good: Path) -> None:
    whole, dice = good.read_bytes(), random.Random(1)
    for _ in range(150):
        flip(good, whole, dice, len(whole) - LENGTH)
        with pytest.raises(SceneError, match=r"good\.nc: it is (damaged: its bytes are not those|not a NetCDF file)"):
            vrte.load(good)


TINY = vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), 0.5, [0.4, 1.0], [0, 90], nodes=4)
MEASURED = vrte.Measurement("total_reflectance", [0.52, 0.48], sigma=0.01, theta_i_deg=[8.0, 45.0])
INDICES = ("material", "rutile", "--range-um", "0.45:0.7:6", "-o")


@pytest.mark.parametrize(
    ("save", "load", "name", "times"),
    [
        (TINY.save, vrte.load, "result.zarr", 60),
        (TINY.save, vrte.load, "result.csv", 100),
        (partial(write_coefficients, vrte.henyey_greenstein(0.7)), read_coefficients, "table.csv", 60),
        (MEASURED.save, vrte.read_measurement, "table.csv", 60),
        (partial(run, *INDICES), read_index, "table.csv", 60),
    ],
)
def test_a_flipped_bit_is_told_or_changes_no_number(
    save: Any, load: Callable[[Path], Any], name: str, times: int, tmp_path: Path
) -> None:
    def read() -> list[str]:
        return [repr(one.tolist() if isinstance(one, np.ndarray) else one) for one in vars(load(path)).values()]

    path = tmp_path / name
    save(path)
    whole, dice = read(), random.Random(6)
    files = [file for file in sorted(path.rglob("*")) if file.is_file()] or [path]
    reported = []
    for _ in range(times):
        (file,) = dice.choices(files, [file.stat().st_size for file in files])
        content = file.read_bytes()
        flip(file, content, dice, len(content))
        try:
            assert read() == whole
        except SceneError as error:
            reported.append(str(error))
        file.write_bytes(content)
    assert len(reported) > 0.3 * times
    assert all(words.isprintable() for words in reported)
    if path.is_file():
        path.write_bytes(content[: content.rindex(b"\n", 0, -1) + 1])  # a row less
        with pytest.raises(SceneError, match=r"is damaged: its bytes .*; if they were changed on purpose, take its fi"):
            read()
        if load is not vrte.load:
            path.write_bytes(content.replace(b"\n", b"\r\n"))  # as some editors save it
            assert read() == whole


@pytest.mark.usefixtures("not_for_ever")
@pytest.mark.parametrize("name", ["pipe.csv", "pipe.nc", "pipe.zarr"])
def test_a_pipe_is_no_file(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)  # whoever opens it waits for ever
    for read in (vrte.load, vrte.read_measurement, vrte.read_base, vrte.read_scattering):
        if not name.endswith(".zarr") or read is vrte.load:
            with pytest.raises(SceneError, match=r"it is no (file|folder), but a"):
                read(tmp_path / name)


def test_a_file_that_hdf5_does_not_get_through_is_given_up(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good.write_bytes(good.read_bytes()[:-LENGTH])
    monkeypatch.setattr(netcdf, "PATIENCE", 0.2)
    began = time.monotonic()
    for program, words in (
        ("import time; time.sleep(60) # {path}", "is damaged: HDF5 has not read it after 0 s"),
        ("import os; os.abort() # {path}", "the process that reads it has ended with code -6"),
    ):
        monkeypatch.setattr(netcdf, "START", program)
        with pytest.raises(SceneError, match=words):
            vrte.load(good)
        monkeypatch.setattr(netcdf, "PATIENCE", 30.0)
    assert time.monotonic() - began < 50.0


@pytest.mark.slow
@pytest.mark.parametrize("first", range(100, 150, 25))
def test_whatever_is_damaged_ends_soon(
    first: int, good: Path, small_brdf: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The checksum is left out: HDF5 sees the damage. Two in a thousand make HDF5 2.0 run for ever."""
    monkeypatch.setattr(netcdf, "PATIENCE", 5.0)
    whole = good.read_bytes()[:-LENGTH]
    with h5py.File(good) as file:
        start = file["mueller"].id.get_offset()
    for seed in range(first, first + 25):  # seeds 111 and 122 make it run for ever
        good.write_bytes(damaged(whole, start, small_brdf.mueller.nbytes, seed))
        began = time.monotonic()
        try:
            outcome = str(vrte.load(good).mueller.shape)
        except SceneError as error:
            outcome = str(error)
        assert outcome == str(SHAPE) or outcome.startswith(str(good))
        assert outcome.isprintable()
        assert time.monotonic() - began < 20.0


def damaged(whole: bytes, start: int, size: int, seed: int) -> bytes:
    """Every fifth is cut, others have bytes changed, most of them in what is not the numbers."""
    dice, found = random.Random(seed), bytearray(whole)
    if seed % 5 == 0:
        return bytes(found[: dice.randrange(len(found))])
    for _ in range(dice.choice([1, 1, 3, 20])):
        low, high = (start + size, len(found)) if dice.random() < 0.3 else (0, start)
        index = dice.randrange(low, high)
        found[index] = dice.choice([0, 255, found[index] ^ (1 << dice.randrange(8)), dice.randrange(256)])
    return bytes(found)


FULL_DISK = """
import resource, signal, sys
import numpy as np
import vrte
from vrte.formats.atomic import write_atomically
from vrte.formats.netcdf import create_netcdf

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as Python has it: an OSError instead
brdf = vrte.load(sys.argv[1])


def table(path):
    with write_atomically(path) as part, create_netcdf(part) as file:
        file.dimensions["x"] = 30_000
        for name in "abcd":
            file.create_variable(name, ("x",), float)[...] = np.arange(30_000.0)


for limit in map(int, sys.argv[2:]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    for write in (lambda: brdf.save("full.nc"), lambda: brdf.save("full.csv"), lambda: table("full.nc")):
        try:
            write()
            print("written")
        except OSError as error:
            print(error.strerror)
"""


def test_a_full_disk_is_an_error_and_no_crash(good: Path, tmp_path: Path) -> None:
    """HDF5 that is told of a full disk ends the process, at the end of it if not at once."""
    limits = [0, 5_000, 150_000]
    (tmp_path / "here").mkdir()
    assert printed_by(FULL_DISK, tmp_path / "here", good, *limits) == ["File too large"] * 3 * len(limits)
    assert list((tmp_path / "here").iterdir()) == []
    with netcdf.WrittenFile("/dev/full", "wb+") as file:
        assert file.write(b"1234") == 4
        assert "No space left" in str(file.error)
