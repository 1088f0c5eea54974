"""A sweep killed for real, its process and its Dask workers, at random moments; then the same command again."""

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

import vrte
from tests.helpers import wait_until
from vrte.sweep.table import open_table

SCENE = """
wavelength_um = 0.5
nodes = 8
[particles.gold]
index = "gold"
radius_um = 0.1
[[layer]]
particles = "gold"
thickness = 1.0
[brdf]
mu_i = [0.4, 1.0]
mu_o = { start = 0.1, stop = 1.0, count = 10 }
phi_deg = { start = 0, stop = 360, count = 37 }
[axes]
"""
ROOT = Path(__file__).parents[1]


@dataclass
class Table:
    """A sweep of ``scenes`` in chunks of two, and what became of it."""

    folder: Path
    scenes: int
    started: "list[subprocess.Popen[str]]" = field(default_factory=list)

    def __post_init__(self) -> None:
        depths = self.scenes // 4
        self.file, self.output = self.folder / "sweep.toml", self.folder / "table.zarr"
        self.partial = self.output.with_name("table.zarr.partial")
        self.kept = self.folder / "kept.log"
        self.file.write_text(
            SCENE + "wavelength_um = [0.45, 0.5, 0.55, 0.6]\n"
            f'"layer[1].thickness" = {{ start = 0.1, stop = 10, count = {depths} }}\n'
        )

    def start(self, *more: str, own_group: bool = False) -> "subprocess.Popen[str]":
        """The command; its log stays when the folder goes."""
        command = [sys.executable, "-m", "vrte.cli", "sweep", str(self.file), "-o", str(self.output), "--chunk", "2"]
        process = subprocess.Popen(
            [*command, *more], stderr=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=own_group
        )
        self.started.append(process)
        if not self.kept.exists():
            wait_until((self.partial / "log.txt").exists, process=process)
            os.link(self.partial / "log.txt", self.kept)
        return process

    def end(self) -> None:
        """Nothing goes on when a test has failed."""
        for process in self.started:
            if process.poll() is None:
                process.kill()
                process.communicate()

    def done(self) -> set[int]:
        """Chunks that nobody may compute again."""
        folder = self.partial / "done"
        return {int(name) for name in os.listdir(folder) if name.isdecimal()} if folder.is_dir() else set()

    def lines(self) -> list[list[str]]:
        return [line.split() for line in self.kept.read_text().splitlines()]

    def begun(self, start: int = 0) -> list[int]:
        """Chunks begun since that line of the log."""
        return [int(chunk) for word, chunk, *_ in self.lines()[start:] if word == "begin"]

    def check_same_as_undisturbed(self) -> None:
        with open_table(self.output) as table:
            expected = vrte.sweep(self.file, workers=1)
            assert not (expected.error != "").any()
            for name in ("mueller", "reflectance", "direct_transmittance", "error"):
                found = table[name].values
                assert found.tobytes() == expected[name].values.tobytes() if name != "error" else (found == "").all()
        assert not self.partial.exists()


def killed_again_and_again(table: Table, kills: int, seed: int, *engine: str) -> None:
    """Kills the whole process ``kills`` times; each time it has at least begun something."""
    chance = random.Random(seed)
    chunks = table.scenes // 2
    seen: list[tuple[set[int], int]] = []
    for kill in range(kills):
        process = table.start(*engine)
        line = len(table.lines()) if seen else 0
        goal = len(table.begun(line)) + chance.randint(
            3, max(3, chunks // (2 * kills))
        )  # on two workers, one has then ended
        wait_until(lambda line=line, goal=goal: len(table.begun(line)) >= goal, process=process)  # type: ignore[misc]
        time.sleep(chance.uniform(0.0, 0.03))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert not table.output.exists(), f"finished before kill {kill + 1}"
        wait_until_quiet(table)
        seen.append((table.done(), len(table.lines())))
    last = table.start(*engine)
    _, complaint = last.communicate(timeout=300)
    assert (last.returncode, complaint) == (0, "")
    for done, line in seen:
        assert not done & set(table.begun(line))
    in_flight = len(table.begun()) - chunks
    assert in_flight <= 2 * kills
    assert seen[-1][0]
    table.check_same_as_undisturbed()


def wait_until_quiet(table: Table) -> None:
    """Workers end with the process that started them, a moment later."""
    while True:
        before = table.kept.stat().st_size, table.done()
        time.sleep(0.3)
        if before == (table.kept.stat().st_size, table.done()):
            return


def worker_killed_again_and_again(table: Table, kills: int, seed: int) -> None:
    """Kills ``kills`` times a Dask worker that is at work; the sweep itself goes on."""
    chance = random.Random(seed)
    process = table.start(*DASK)
    dead: set[int] = set()
    seen: list[tuple[set[int], int]] = []
    for _ in range(kills):
        line = len(table.lines())
        goal = chance.randint(1, table.scenes // (4 * kills))
        wait_until(lambda line=line, goal=goal: len(table.begun(line)) >= goal, process=process)  # type: ignore[misc]
        time.sleep(chance.uniform(0.0, 0.03))
        worker = next(pid for word in reversed(table.lines()) if (pid := int(word[2].rpartition(":")[2])) not in dead)
        done, line = table.done(), len(table.lines())
        os.kill(worker, signal.SIGKILL)
        dead.add(worker)
        seen.append((done, line))
    _, complaint = process.communicate(timeout=300)
    assert (process.returncode, complaint) == (0, "")
    assert len(dead) == kills
    for done, line in seen:
        assert not done & set(table.begun(line))
    often = Counter(table.begun())
    assert set(often) == set(range(table.scenes // 2))
    assert sum(often.values()) - len(often) <= kills
    table.check_same_as_undisturbed()


@pytest.fixture
def table(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Table]:
    """A sweep of as many scenes as the test asks for."""
    found = Table(tmp_path, request.param)
    yield found
    found.end()


SLOW = pytest.mark.slow
DASK = ("--engine", "dask", "--workers", "2")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "kills", "engine"),
    [(64, 1, ()), pytest.param(400, 10, (), marks=SLOW), pytest.param(400, 10, DASK, marks=SLOW)],
    indirect=["table"],
)
def test_process_killed(table: Table, kills: int, engine: tuple[str, ...]) -> None:
    killed_again_and_again(table, kills, random.randrange(10**6), *engine)


@SLOW
@pytest.mark.parametrize(("table", "kills"), [(64, 2), (1200, 10)], indirect=["table"])
def test_dask_worker_killed(table: Table, kills: int) -> None:
    worker_killed_again_and_again(table, kills, random.randrange(10**6))


@pytest.mark.slow
@pytest.mark.parametrize("table", [1200], indirect=True)
def test_interrupted_with_its_dask_workers_it_says_one_line(table: Table) -> None:
    # as a terminal does: the interrupt goes to the whole group of processes
    process = table.start(*DASK, own_group=True)
    wait_until(lambda: len(table.done()) > 2, process=process)
    os.killpg(process.pid, signal.SIGINT)
    _, complaint = process.communicate(timeout=30)
    assert (process.returncode, complaint) == (130, "vrte: error: interrupted\n")
    assert not table.output.exists()
    assert len(table.done()) > 2
