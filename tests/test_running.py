"""Threads of a run share its jobs, as many as the process may use; BLAS has one inside a solve; idle ones sleep."""

import json
import math
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics import memory, running
from vrte.basics.memory import find_available_bytes
from vrte.basics.running import Run, count_usable_cpus, find_blas_libraries, find_setter, keep_to_one_thread, run_jobs
from vrte.basics.starting import POLICY

from .helpers import HANGS, close_to


@contextmanager
def run_of(threads: int) -> Iterator[Run]:
    """A run whose helping threads are gone afterwards."""
    run = Run(threads)
    yield run
    run.release_threads()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("vrte-job")]


def hold(seconds: float, answer: int) -> int:
    time.sleep(seconds)
    return answer


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_job_is_done_once_and_its_answer_is_in_its_place(threads: int) -> None:
    """Up to the first one that fails, whose error is raised: no other job begins then."""
    begun: list[int] = []

    def job(k: int, last: int) -> int:
        begun.append(k)
        if k >= last:
            raise ValueError(f"job {k}")
        return hold(0.002 * (k % 3), k * k)

    with run_of(threads) as run:
        assert run_jobs(run, [lambda own, k=k: job(k, 20) for k in range(20)]) == [k * k for k in range(20)]
        assert sorted(begun) == list(range(20))
        begun.clear()
        with pytest.raises(ValueError, match="job 1"):
            run_jobs(run, [lambda own, k=k: hold(0.05, job(k, 1)) for k in range(20)])
    assert set(begun) <= set(range(1 + threads))


def test_jobs_are_done_side_by_side_each_on_one_thread_and_progress_is_told_by_the_caller() -> None:
    together, reported = threading.Barrier(3, timeout=HANGS), []

    def job(own: Run) -> int:
        together.wait()  # never passed by one thread after another
        return hold(0.0 if threading.current_thread() is threading.main_thread() else 0.1, own.threads)

    def tell(done: int) -> None:
        reported.append((threading.current_thread() is threading.main_thread(), done))

    with run_of(3) as run:
        assert run_jobs(run, [job] * 3, tell) == [1, 1, 1]
        assert reported == [(True, 1), (True, 3)]
    alone = Run(8)
    assert run_jobs(alone, [lambda own: threading.get_ident()]) == [threading.get_ident()]
    assert "helpers" not in vars(alone)  # no thread without a job


def test_seconds_are_recorded_once_for_the_wall_and_all_for_the_threads_and_stops_are_passed_on() -> None:
    def job(own: Run) -> None:
        with own.timed("nap"):
            time.sleep(0.05)

    with run_of(2) as run:
        run_jobs(run, [job] * 4)
        clock = run.stages["nap"]
        assert clock["thread_seconds"] >= 0.2
        assert clock["wall_seconds"] == close_to(clock["thread_seconds"] / 2, rtol=1e-6, atol=0.0)
        run.stop[0] = 1
        with pytest.raises(KeyboardInterrupt):
            run_jobs(run, [job] * 4)


FORKED = """
import multiprocessing, os, threading, warnings
import vrte

scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
warnings.simplefilter("ignore")  # newer Pythons warn of fork with threads: the point here

def solve(progress=None):
    return vrte.brdf(scene, 0.5, 0.5, nodes=12, threads=2, progress=progress).mueller[0, 0, 0, 0, 0]

def ask(_):
    try:
        return solve()
    except RuntimeError as error:
        return str(error)

def fork():
    with multiprocessing.get_context("fork").Pool(2) as pool:
        return {*pool.map(ask, range(2))}

inside, over = threading.Event(), threading.Event()
other = threading.Thread(target=solve, args=[lambda *_: (inside.set(), over.wait())])
expected = solve()
assert fork() == {expected}
other.start()
inside.wait()
print(*fork(), flush=True)
over.set()
other.join()
assert fork() == {expected}
"""


def run_program(program: str, **environment: str) -> str:
    """What a process of its own prints, without a policy for threads but one given here."""
    plain = {name: value for name, value in os.environ.items() if name != POLICY} | environment
    done = subprocess.run([sys.executable, "-c", program], env=plain, capture_output=True, text=True, timeout=HANGS)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="there is no fork here")
def test_a_pool_forked_while_another_thread_solves_says_so() -> None:
    reported = run_program(FORKED)
    assert reported.startswith("this process was forked while another thread of its parent was solving")
    assert "spawn" in reported


TIMED = """
import json, time, vrte
phase = vrte.mix([(vrte.rayleigh(), 0.5), (vrte.henyey_greenstein(0.7, 40), 0.5)])
scene = vrte.Scene([vrte.Layer(phase, 0.99, 2.0)], vrte.Lambertian(0.3))
spent = {}
for count in (2, 1, 2, 1):
    for turn in range(4):
        begin = time.process_time()
        vrte.brdf(scene, [0.3, 0.8], [0.2, 0.5, 0.9], [0.0, 90.0, 180.0], nodes=32, threads=count)
        if turn:
            spent.setdefault(count, []).append(time.process_time() - begin)
print(json.dumps([sum(spent[2]), sum(spent[1])]))
"""


def test_two_threads_take_no_more_of_a_busy_processor_than_one() -> None:
    """24 times as much where idle threads spin, and the others' work keeps them from what they wait for."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        two, one = json.loads(run_program(TIMED))
    finally:
        for each in others:
            each.kill()
            each.wait()
    assert two < 2.0 * one


@pytest.mark.parametrize("given", [{}, {POLICY: "active"}])
def test_the_policy_is_for_the_core_alone(given: dict[str, str]) -> None:
    reported = run_program(f"import os, vrte; print(os.environ.get({POLICY!r}))", **given)
    assert reported.strip() == str(given.get(POLICY))


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Writes files of a tree of control groups that is this process's own, which is tied to eight cores."""
    monkeypatch.setattr(memory, "ROOT", tmp_path)
    monkeypatch.setattr(memory, "OWN", tmp_path / "own")
    monkeypatch.setattr(running.os, "sched_getaffinity", lambda process: range(8), raising=False)
    memory.find_group_cores.cache_clear()

    def write(folder: str, **contents: str) -> None:
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            (tmp_path / folder / name.replace("__", ".")).write_text(f"{content}\n")

    yield write
    memory.find_group_cores.cache_clear()


def test_a_quota_counts_as_cores_do(groups: Callable[..., None]) -> None:
    """Of both versions of control groups; the group's own path is not there in a container that sees its own files as
    the root."""
    assert memory.find_group_cores() == memory.find_group_bytes() == math.inf
    groups("", own="0::/pod/task")
    for quota, outer, cores in (("max", "max", 8), ("150000", "max", 2), ("max", "400000", 4), ("1000", "max", 1)):
        groups("pod", cpu__max=f"{outer} 100000")
        groups("pod/task", cpu__max=f"{quota} 100000")
        memory.find_group_cores.cache_clear()
        assert count_usable_cpus() == cores
    memory.find_group_cores.cache_clear()
    groups("", own="4:memory:/docker/1\n2:cpu,cpuacct:/docker/1\n0::/docker/1")
    groups("cpu", cpu__cfs_quota_us="300000", cpu__cfs_period_us="100000")
    groups("memory", memory__limit_in_bytes="5000000", memory__usage_in_bytes="4000000")
    assert (count_usable_cpus(), find_available_bytes()) == (3, 1e6)


@pytest.fixture
def two_threads() -> Iterator[None]:
    """Of every BLAS, set by the main thread, which then controls them as threadpoolctl sees it."""
    before = [(library, library.get_num_threads()) for library in find_blas_libraries()]
    for library, _ in before:
        library.set_num_threads(2)
        find_setter(library)(2)
    yield
    for library, threads in before:
        find_setter(library)(threads)


def threads_of_blas() -> set[int]:
    return {library.get_num_threads() for library in find_blas_libraries()}


@pytest.mark.usefixtures("two_threads")
def test_blas_has_one_thread_inside_a_solve_whichever_thread_calls() -> None:
    seen: list[Any] = []

    def work() -> None:
        with keep_to_one_thread(), keep_to_one_thread():
            seen.append(threads_of_blas())
        seen.append(threads_of_blas())

    work()
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [{1}, {2}] * 2
    inside: list[Any] = []
    scene, mu = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), np.linspace(0.1, 1.0, 60)
    vrte.brdf(scene, mu, mu, np.arange(181), nodes=20, threads=2, progress=lambda *_: inside.append(threads_of_blas()))
    assert inside
    assert all(found == {1} for found in inside)
    assert threads_of_blas() == {2}
