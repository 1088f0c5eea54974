"""Result files that somebody else may have made or damaged: refused before they are read, and never a way to others."""

import faulthandler
import os
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import vrte
from tests.helpers import printed_by
from vrte.basics.errors import SceneError
from vrte.cli import main
from vrte.formats import netcdf
from vrte.formats.atomic import LENGTH
from vrte.formats.columns import read_coefficients, read_index, write_coefficients
from vrte.results.quantities import MUELLER
from vrte.sweep.table import open_table

ROOT = Path(__file__).parents[1]
SECRET = b"the owner's own words, 32 bytes!"
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


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The checks are the same in a process of its own, which takes half a second to start."""
    monkeypatch.setattr(netcdf, "read_foreign", netcdf.read_stored)


def external_storage(file: h5py.File, secret: Path) -> None:
    file.create_dataset("mueller", SHAPE, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def virtual_dataset(file: h5py.File, secret: Path) -> None:
    layout = h5py.VirtualLayout(shape=SHAPE, dtype="f8")
    layout[...] = h5py.VirtualSource(str(secret), "mueller", shape=SHAPE)
    file.create_virtual_dataset("mueller", layout)


def external_link(file: h5py.File, secret: Path) -> None:
    file["mueller"] = h5py.ExternalLink(str(secret), "/mueller")


def soft_link(file: h5py.File, secret: Path) -> None:
    file["beside"] = h5py.ExternalLink(str(secret), "/")
    file["mueller"] = h5py.SoftLink("/beside/mueller")


def of_filter(**options: Any) -> Attack:
    return lambda file, _: file.create_dataset("mueller", data=np.zeros(SHAPE), **options)


@pytest.mark.usefixtures("in_this_process", "not_for_ever")
@pytest.mark.parametrize(
    ("attack", "words"),
    [
        (external_storage, r"its mueller lies in another file \(external storage\)"),
        (virtual_dataset, r"its mueller is put together from other files \(a virtual dataset\)"),
        (external_link, "its mueller is a link to elsewhere"),
        (soft_link, "its mueller is a link to elsewhere"),
        (of_filter(compression="lzf"), "its mueller is packed by the filter 'lzf': only shuffle, deflate, fletcher32"),
        (of_filter(scaleoffset=2), "its mueller is packed by the filter 'scaleoffset'"),
        (lambda file, _: file.create_dataset("mueller", (40_000, 4_000, 4), "f8"), "5120000000 bytes.*and holds 0"),
        (
            lambda file, _: file.create_dataset("mueller", (40_000, 4_000, 4), "f8", compression=9),
            "5120000000 bytes.*and holds 0",
        ),
        (lambda file, _: file.create_group("mueller"), "its mueller must be an array"),
        (lambda file, _: file.create_dataset("mueller", data=[b"a", b"b"]), "its mueller must be an array of numbers"),
        (
            lambda file, _: file.create_dataset("mueller", data=np.array([file.ref], h5py.ref_dtype)),
            "its mueller must be an array of numbers",
        ),
        (lambda file, _: file.attrs.create("kind", 3.0), "its attribute kind must be one text"),
        (lambda file, _: file.attrs.create("diagnostics", ["{}"] * 5000), "its attribute diagnostics must be one text"),
        (lambda file, _: file.attrs.create("kind", "\x1b[2Jgone"), "it must say its kind, one of brdf"),
    ],
)
def test_what_leads_elsewhere_is_refused_before_it_is_read(
    attack: Attack, words: str, good: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    os.mkfifo(secret)  # whoever opens it waits for ever
    with h5py.File(good, "r+") as file:
        del file["mueller"]
        attack(file, secret)
    with pytest.raises(SceneError, match=words) as refused:
        vrte.load(good)
    assert str(refused.value).startswith(str(good))
    assert str(refused.value).isprintable()


def test_what_other_programs_make_of_a_result_is_read(good: Path, small_brdf: Any, tmp_path: Path) -> None:
    import xarray

    packed = {"mueller": {"zlib": True, "shuffle": True, "fletcher32": True, "chunksizes": SHAPE}}
    with xarray.open_dataset(good, engine="h5netcdf") as dataset:
        dataset.to_netcdf(tmp_path / "packed.nc", engine="h5netcdf", encoding=packed)
    np.testing.assert_array_equal(vrte.load(tmp_path / "packed.nc").mueller, small_brdf.mueller)
    assert (tmp_path / "packed.nc").stat().st_size < good.stat().st_size
    with h5py.File(good, "r+") as file:
        file.attrs["title"] = "renamed"
    np.testing.assert_array_equal(vrte.load(good).mueller, small_brdf.mueller)


def test_a_result_larger_than_is_read_says_how_it_is(good: Path, tmp_path: Path) -> None:
    vrte.load(good).save(tmp_path / "good.csv")
    for path in (good, tmp_path / "good.csv"):
        with pytest.raises(
            SceneError, match=r"more than the 0\.0001 GB.*if you trust it, vrte\.load\(path, most_bytes="
        ):
            vrte.load(path, most_bytes=1e5)
        assert vrte.load(path, most_bytes=1e6).mueller.shape == SHAPE
    with pytest.raises(SceneError, match="most_bytes must be a number of bytes >= 0, not -1"):
        vrte.load(good, most_bytes=-1)


@pytest.mark.slow
def test_a_large_table_is_refused_in_little_memory(tmp_path: Path) -> None:
    """5 GB declared in a header, and 0.6 GB in one line, with 0.4 GB to take."""
    header = '# vrte result, format 1\n# kind = "brdf"\n# diagnostics = {}\n'
    axes = "".join(
        f"# {name} = {list(range(size))}\n" for name, size in (("mu_i", 100), ("mu_o", 1000), ("phi_deg", 400))
    )
    columns = ",".join(["mu_i", "mu_o", "phi_deg", *MUELLER]) + "\n"
    (tmp_path / "declared.csv").write_text(header + axes + columns)
    with open(tmp_path / "sparse.csv", "wb") as file:
        file.write((header + "# mu_i = [1]\n# mu_o = [1]\n# phi_deg = [0]\n" + columns).encode())
        file.truncate(600_000_000)
        file.seek(0, 2)
        file.write(b"\n")
    said = printed_by(
        "import vrte\n"
        "from vrte.basics.memory import limit_memory\n"
        "limit_memory(4e8)\n"
        "for name, most in (('declared.csv', 2e9), ('declared.csv', 1e12), ('sparse.csv', 1e12)):\n"
        "    try: vrte.load(name, most_bytes=most)\n"
        "    except vrte.SceneError as error: print(error)\n",
        tmp_path,
    )
    assert said == [
        "declared.csv: its values take 5.12 GB, more than the 2 GB that are read: "
        "if you trust it, vrte.load(path, most_bytes=6e9)",
        "declared.csv: there must be 40000000 rows, one a direction, not 0",
        "sparse.csv: line 8: longer than 50000000 bytes",
    ]


def test_every_flipped_bit_is_told(good: Path) -> None:
    whole = good.read_bytes()
    dice = random.Random(1)
    for _ in range(300):
        place = dice.randrange(len(whole) - LENGTH)
        good.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << dice.randrange(8)]) + whole[place + 1 :])
        with pytest.raises(
            SceneError, match=r"good\.nc: it is (damaged: its bytes are not those that|not a NetCDF file)"
        ):
            vrte.load(good)


@pytest.mark.parametrize(("name", "times"), [("flipped.zarr", 300), ("flipped.csv", 150)])
def test_a_flipped_bit_is_told_or_changes_no_number(name: str, times: int, tmp_path: Path) -> None:
    whole = vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), 0.5, [0.4, 1.0], [0, 90], nodes=4)
    whole.save(tmp_path / name)
    files = [file for file in sorted((tmp_path / name).rglob("*")) if file.is_file()] or [tmp_path / name]
    dice, told = random.Random(5), []
    for _ in range(times):
        (file,) = dice.choices(files, [file.stat().st_size for file in files])
        content = file.read_bytes()
        place = dice.randrange(len(content))
        file.write_bytes(content[:place] + bytes([content[place] ^ 1 << dice.randrange(8)]) + content[place + 1 :])
        try:
            found = vrte.load(tmp_path / name)
        except SceneError as error:
            told.append(str(error))
        else:
            for array in ("mu_i", "mu_o", "phi", "mueller", "reflectance", "direct_transmittance"):
                assert getattr(found, array).tobytes() == getattr(whole, array).tobytes(), (file, place)
            assert found.diagnostics == whole.diagnostics
        file.write_bytes(content)
    assert len(told) > 0.4 * times
    assert all(words.startswith(str(tmp_path / name)) and words.isprintable() for words in told)


def save_coefficients(path: Path) -> Any:
    write_coefficients(vrte.henyey_greenstein(0.7), path)
    return lambda: read_coefficients(path).coefficients.tolist()


def save_measurement(path: Path) -> Any:
    vrte.Measurement("total_reflectance", [0.52, 0.48], sigma=0.01, theta_i_deg=[8.0, 45.0]).save(path)
    return lambda: [getattr(vrte.read_measurement(path), name).tolist() for name in ("value", "sigma", "theta_i_deg")]


def save_index(path: Path) -> Any:
    assert main(["material", "rutile", "--range-um", "0.45:0.7:6", "-o", str(path)]) == 0
    return lambda: (tuple(read_index(path).n), tuple(read_index(path).k))


@pytest.mark.parametrize("save", [save_coefficients, save_measurement, save_index])
def test_damage_to_a_table_is_told(save: Callable[[Path], Any], tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    read = save(path)
    whole, content, dice = read(), path.read_bytes(), random.Random(6)
    told = []
    for _ in range(60):
        place = dice.randrange(len(content))
        path.write_bytes(content[:place] + bytes([content[place] ^ 1 << dice.randrange(8)]) + content[place + 1 :])
        try:
            assert read() == whole
        except SceneError as error:
            told.append(str(error))
    assert len(told) >= 20
    assert all(words.isprintable() for words in told)
    path.write_bytes(content[: content.rindex(b"\n", 0, -1) + 1])  # a row less
    with pytest.raises(SceneError, match=r"is damaged: its bytes .*; if they were changed on purpose, take its first"):
        read()
    path.write_bytes(content.replace(b"\n", b"\r\n"))  # as some editors save it
    assert read() == whole


@pytest.mark.usefixtures("not_for_ever")
@pytest.mark.parametrize("name", ["pipe.csv", "pipe.nc", "pipe.zarr"])
def test_a_pipe_is_no_file(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)  # whoever opens it waits for ever
    words = r"pipe\.\w+:? it is no (file|folder), but a"
    with pytest.raises(SceneError, match=words):
        vrte.load(tmp_path / name)
    if not name.endswith(".zarr"):
        with pytest.raises(SceneError, match=words):
            vrte.read_measurement(tmp_path / name)


def test_a_file_that_hdf5_does_not_get_through_is_given_up(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = "import time; time.sleep(60) # {path}"
    monkeypatch.setattr(netcdf, "START", program)
    monkeypatch.setattr(netcdf, "PATIENCE", 0.2)
    whole = good.read_bytes()
    good.write_bytes(whole[:-LENGTH])
    began = time.monotonic()
    with pytest.raises(SceneError, match="is damaged: HDF5 has not read it after 0 s"):
        vrte.load(good)
    assert time.monotonic() - began < 5.0
    monkeypatch.setattr(netcdf, "START", "import os; os.abort() # {path}")
    with pytest.raises(SceneError, match=r"the process that reads it has ended with code -6"):
        vrte.load(good)


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
        assert outcome == str(SHAPE) or outcome.startswith(f"{good}: ")
        assert outcome.isprintable()
        assert time.monotonic() - began < 20.0


def damaged(whole: bytes, start: int, size: int, seed: int) -> bytes:
    """Every fifth is cut, others have bytes changed, most of them in what is not the numbers."""
    dice, found = random.Random(seed), bytearray(whole)
    if seed % 5 == 0:
        return bytes(found[: dice.randrange(len(found))])
    for _ in range(dice.choice([1, 1, 3, 20])):
        low, high = (start + size, len(found)) if dice.random() < 0.3 else (0, start)
        place = dice.randrange(low, high)
        found[place] = dice.choice([0, 255, found[place] ^ (1 << dice.randrange(8)), dice.randrange(256)])
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
    limits = [0, 100, 5_000, 100_000, 150_000]
    (tmp_path / "here").mkdir()
    assert printed_by(FULL_DISK, tmp_path / "here", good, *limits) == ["File too large"] * 3 * len(limits)
    assert list((tmp_path / "here").iterdir()) == []


def test_the_device_that_is_always_full(small_brdf: Any) -> None:
    with netcdf.WrittenFile("/dev/full", "wb+") as file:
        assert file.write(b"1234") == 4
        with pytest.raises(OSError, match="No space left"):
            file.check()


@pytest.mark.usefixtures("not_for_ever")
@pytest.mark.parametrize("attack", [external_storage, virtual_dataset, external_link, soft_link])
def test_a_table_that_leads_elsewhere_is_refused(attack: Attack, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "secret")  # whoever opens it waits for ever
    with netcdf.create_netcdf(tmp_path / "table.nc") as file:
        file.attrs["sweep"] = "{}"
    with h5py.File(tmp_path / "table.nc", "r+") as file:
        attack(file, tmp_path / "secret")
    with pytest.raises(SceneError, match=r"table\.nc is no table of a sweep: its \w+ (is a link|lies in|is put)"):
        open_table(tmp_path / "table.nc")
