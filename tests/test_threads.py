"""Threads: how many there are by default, and that those without work sleep."""

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from vrte.basics import memory, running
from vrte.basics.memory import find_available_bytes
from vrte.basics.running import count_usable_cpus
from vrte.basics.starting import POLICY

TIMED = """
import json, time, vrte
phase = vrte.mix([(vrte.rayleigh(), 0.5), (vrte.henyey_greenstein(0.7, 40), 0.5)])
scene = vrte.Scene([vrte.Layer(phase, 0.99, 2.0)], vrte.Lambertian(0.3))
spent = {}
for count in (2, 1, 2, 1):
    for turn in range(12):
        begin = time.process_time()
        vrte.brdf(scene, [0.3, 0.8], [0.2, 0.5, 0.9], [0.0, 90.0, 180.0], nodes=32, threads=count)
        if turn:
            spent.setdefault(count, []).append(time.process_time() - begin)
print(json.dumps([sum(spent[2]), sum(spent[1])]))
"""


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A tree of control groups that is this process's own."""
    monkeypatch.setattr(memory, "ROOT", tmp_path)
    monkeypatch.setattr(memory, "OWN", tmp_path / "own")
    memory.find_group_cores.cache_clear()
    yield tmp_path
    memory.find_group_cores.cache_clear()


def write_files(folder: Path, **contents: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        (folder / name.replace("__", ".")).write_text(content)


def test_two_threads_take_no_more_of_a_busy_processor_than_one() -> None:
    """24 times as much where idle threads spin, and the others' work keeps them from what they wait for."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        plain = {name: value for name, value in os.environ.items() if name != POLICY}
        done = subprocess.run([sys.executable, "-c", TIMED], env=plain, capture_output=True, text=True, check=True)
    finally:
        for each in others:
            each.kill()
            each.wait()
    two, one = json.loads(done.stdout)
    assert two < 2.0 * one


@pytest.mark.parametrize("given", [None, "active"])
def test_the_policy_is_for_the_core_alone(given: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name != POLICY}
    environment |= {POLICY: given} if given else {}
    code = f"import os, vrte; print(os.environ.get({POLICY!r}))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(given)


@pytest.mark.parametrize(
    ("tied", "quota", "outer", "expected"),
    [
        (8, "max", "max", 8),
        (8, "150000", "max", 2),
        (8, "max", "400000", 4),
        (2, "400000", "max", 2),
        (8, "1000", "max", 1),
    ],
)
def test_a_quota_counts_as_cores_do(
    groups: Path, monkeypatch: pytest.MonkeyPatch, tied: int, quota: str, outer: str, expected: int
) -> None:
    monkeypatch.setattr(running.os, "sched_getaffinity", lambda process: range(tied), raising=False)
    write_files(groups, own="0::/pod/task\n")
    write_files(groups / "pod", cpu__max=f"{outer} 100000\n")
    write_files(groups / "pod" / "task", cpu__max=f"{quota} 100000\n")
    assert count_usable_cpus() == expected


def test_quotas_of_the_first_version_of_control_groups(groups: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The group's own path is not there in a container that sees its own files as the root."""
    monkeypatch.setattr(running.os, "sched_getaffinity", lambda process: range(8), raising=False)
    write_files(groups, own="4:memory:/docker/1\n2:cpu,cpuacct:/docker/1\n0::/docker/1\n")
    write_files(groups / "cpu", cpu__cfs_quota_us="300000\n", cpu__cfs_period_us="100000\n")
    write_files(groups / "memory", memory__limit_in_bytes="5000000\n", memory__usage_in_bytes="4000000\n")
    assert count_usable_cpus() == 3
    assert find_available_bytes() == 1e6


def test_no_control_groups(groups: Path) -> None:
    assert memory.find_group_cores() == memory.find_group_bytes() == math.inf
