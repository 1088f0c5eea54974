"""Ctrl-C, SIGTERM, and outputs that are closed, in real processes at many moments: one line and the right exit code."""

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from .helpers import HANGS, is_alive, wait_until
from .samples import slow_but

ROOT = Path(__file__).parents[1]
VRTE = [sys.executable, "-m", "vrte.cli"]
SWEEP = """
nodes = 6
[[layer]]
phase = "rayleigh"
albedo = 1
thickness = 1
[brdf]
mu_i = 0.5
mu_o = 0.5
[axes]
"layer[1].albedo" = { start = 0.1, stop = 1, count = 6000 }
"""
SWEEP_BY_DASK = "sweep", "s.toml", "-o", "t.zarr", "--engine", "dask"
VIEW, OF_THE_VIEWER = ("view", "--no-browser", "--port", "0"), ("uvicorn", "starlette", "nicegui")
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts `vrte` with arguments in a group of its own; whatever is left of it goes in the end."""
    started: list[subprocess.Popen[str]] = []
    (tmp_path / "s.toml").write_text(SWEEP)

    def vrte(*arguments: str, first: Path = ROOT) -> "subprocess.Popen[str]":
        environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(first), str(ROOT)))}
        # a background shell hands down an ignored SIGINT
        default = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        started.append(
            subprocess.Popen(
                [*VRTE, *arguments], **pipes, cwd=tmp_path, env=environment, preexec_fn=default, start_new_session=True
            )
        )
        return started[-1]

    yield vrte
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def check_said(process: "subprocess.Popen[str]", number: signal.Signals) -> None:
    """The exit code, and one line on standard error beside the warning of a long run, which a busy machine earns."""
    reported, complaint = process.communicate(timeout=HANGS)
    lines = [line for line in complaint.splitlines() if not line.startswith("vrte: warning: this will take about ")]
    assert (process.returncode, reported, lines) == (128 + number, "", [f"vrte: error: {WORDS[number]}"])


def slow_module(folder: Path, name: str) -> Path:
    """A folder with a module of that name that says when it is loaded, and loads on until the process is stopped."""
    folder.mkdir()
    loads_on = "while True:\n    time.sleep(0.1)\n"
    (folder / f"{name}.py").write_text(f"import time\nopen({str(folder / 'loading')!r}, 'w').close()\n{loads_on}")
    return folder


LOADING = [*itertools.product(("numpy", "scipy", "zarr", "distributed", *OF_THE_VIEWER), WORDS)]


@pytest.mark.parametrize("case", slow_but(LOADING, ("numpy", signal.SIGINT), ("zarr", signal.SIGTERM)))
def test_stopped_while_a_module_loads(case: tuple[str, signal.Signals], start: Any, tmp_path: Path) -> None:
    module, number = case
    slow = slow_module(tmp_path / "slow", module)
    process = start(*(VIEW if module in OF_THE_VIEWER else SWEEP_BY_DASK), first=slow)
    wait_until((slow / "loading").exists, process=process)
    process.send_signal(number)
    check_said(process, number)
    assert {path.name for path in tmp_path.iterdir()} <= {"s.toml", "slow", "t.zarr.partial"}


@pytest.mark.parametrize("number", slow_but(WORDS, signal.SIGTERM))
def test_stopped_while_a_driver_hears_nothing(number: signal.Signals, start: Any, tmp_path: Path) -> None:
    """A compiler of kernels is at work for minutes; here a lock that is never had."""
    deaf = slow_module(tmp_path / "deaf", "pyopencl")
    lock = "import ctypes\nlock = ctypes.create_string_buffer(64)\n"
    lock += 2 * "ctypes.CDLL(None).pthread_mutex_lock(lock)\n"
    (deaf / "pyopencl.py").write_text(f"open({str(deaf / 'loading')!r}, 'w').close()\n{lock}")
    process = start("devices", first=deaf)
    wait_until((deaf / "loading").exists, process=process)
    process.send_signal(number)
    check_said(process, number)


@pytest.mark.parametrize("number", slow_but(WORDS, signal.SIGINT))
@pytest.mark.parametrize("engine", slow_but(["threads", "dask"], "threads"))
def test_a_sweep_stopped_with_its_whole_group(engine: str, number: signal.Signals, start: Any, tmp_path: Path) -> None:
    process = start("sweep", "s.toml", "-o", "t.zarr", "--engine", engine, "--workers", "2", "--chunk", "1")
    if engine == "dask":  # at once: its workers are only being started
        wait_until(lambda: workers(process), process=process)
    else:
        wait_until(lambda: list(tmp_path.glob("*.partial/done/*")), process=process)
    os.killpg(process.pid, number)
    check_said(process, number)
    wait_until(lambda: not alive(process.pid))


def workers(process: "subprocess.Popen[str]") -> list[psutil.Process]:
    """The processes of its cluster."""
    found = []
    for child in psutil.Process(process.pid).children():
        with suppress(psutil.NoSuchProcess):
            if any("spawn_main" in word for word in child.cmdline()):
                found.append(child)
    return found


def alive(group: int) -> list[int]:
    """Who is left of a group of processes."""
    found = []
    for each in psutil.pids():
        with suppress(ProcessLookupError):
            if os.getpgid(each) == group and is_alive(each):
                found.append(each)
    return found


@pytest.mark.slow
def test_a_worker_killed_at_its_start(start: Any, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SWEEP.replace("6000", "40"))
    process = start("sweep", "s.toml", "-o", "t.zarr", "--engine", "dask", "--workers", "1")
    wait_until(lambda: workers(process), process=process)
    workers(process)[0].kill()
    complaint = process.communicate(timeout=HANGS)[1]
    assert (process.returncode, complaint) == (0, "") or (
        process.returncode == 1
        and complaint.startswith("vrte: error: the Dask cluster did not start, or a worker process ended before")
        and complaint.count("\n") == 1
    )


def test_a_stream_that_takes_nothing() -> None:
    for line, code, words in (
        ("material >&-", 1, "standard output is closed"),
        ("material >/dev/full", 1, "No space left on device"),
        ("material no-such-thing 2>&-", 2, ""),
        ("material | true", 0, ""),
    ):
        command = f"{' '.join(VRTE)} {line}"
        found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, cwd=ROOT, timeout=HANGS)
        assert (found.returncode, found.stdout, found.stderr.count("\n")) == (code, "", int(words != "")), line
        assert words in found.stderr
        assert found.stderr.startswith("vrte: error: ") or not words
