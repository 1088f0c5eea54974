"""What tests of several modules use: results compared bit by bit or within tolerances, the command, programs in
processes of their own."""

import csv
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import vrte
from vrte import cli
from vrte.formats.contents import Result

HANGS = 300.0  # seconds after which a process counts as hanging: a busy machine needs a minute to start a viewer


def assert_same(first: Result, second: Result) -> None:
    """Every bit is the same, and nothing can be written into it."""
    assert type(first) is type(second)
    pairs = {name: (value, getattr(second, name)) for name, value in vars(first).items()}
    for name in [name for name, (value, _) in pairs.items() if "jacobian" in name and value]:
        value, other = pairs.pop(name)
        assert [*value] == [*other]
        pairs |= {f"{name} of {key}": (value[key], other[key]) for key in value}
    for name, (value, other) in pairs.items():
        if name == "brdfs":
            for one, another in zip(value, other, strict=True):
                assert_same(one, another)
        elif isinstance(value, np.ndarray):
            assert value.tobytes() == other.tobytes(), name
            assert value.shape == other.shape
            assert not other.flags.writeable
        else:
            assert value == other, name


def assert_close(found: Any, right: Any, *, rtol: float, atol: float, err_msg: str = "") -> None:
    """|found - right| <= atol + rtol |right| everywhere: both are given, since defaults would hide what is allowed."""
    np.testing.assert_allclose(found, right, rtol=rtol, atol=atol, err_msg=err_msg)


def close_to(right: Any, *, rtol: float, atol: float) -> Any:
    """Equal to whatever is within the larger of atol and rtol |right|: for numbers inside other structures, too."""
    return pytest.approx(right, rel=rtol, abs=atol)


def run(*arguments: str | float | Path, main: Callable[[list[str]], int] = cli.main) -> int:
    """The exit code of `vrte`, or of another command line, with these arguments."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as leaving:
        return leaving.code  # type: ignore[return-value]


def call_study(name: str, *arguments: str | Path) -> int:
    """The exit code of `python -m bench.NAME` with these arguments."""
    return run(*arguments, main=importlib.import_module(f"bench.{name}").main)


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file by its header."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def printed_by(program: str, folder: Path, *arguments: object) -> list[str]:
    """The lines that a Python program prints, run by a process of its own in a folder."""
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(vrte.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=HANGS,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def wait_until(
    condition: Callable[[], Any], seconds: float = HANGS, process: "subprocess.Popen[str] | None" = None
) -> None:
    """Waits for a condition, while the process is alive, or fails."""
    end = time.monotonic() + seconds
    while not condition():
        assert process is None or process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


def is_alive(pid: int) -> bool:
    """Whether there is such a process, and no zombie."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
