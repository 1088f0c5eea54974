"""Jobs that threads of a run share: every one done once, in order told, errors and stops passed on."""

import multiprocessing
import subprocess
import sys
import threading
import time

import pytest

from vrte.basics.running import Run, run_jobs

from .helpers import close_to


def hold(seconds: float, answer: int) -> int:
    time.sleep(seconds)
    return answer


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_job_is_done_once_and_its_answer_is_in_its_place(threads: int) -> None:
    run, calls = Run(threads), []

    def job(k: int) -> int:
        calls.append(k)
        return hold(0.002 * (k % 3), k * k)

    assert run_jobs(run, [lambda own, k=k: job(k) for k in range(20)]) == [k * k for k in range(20)]
    assert sorted(calls) == list(range(20))
    run.release_threads()


def test_jobs_are_done_side_by_side_each_on_one_thread() -> None:
    run, together = Run(3), threading.Barrier(3, timeout=10.0)

    def job(own: Run) -> int:
        together.wait()  # never passed by one thread after another
        return own.threads

    assert run_jobs(run, [job] * 3) == [1, 1, 1]
    run.release_threads()


def test_no_thread_without_a_job() -> None:
    run = Run(8)
    assert run_jobs(run, [lambda own: threading.get_ident()]) == [threading.get_ident()]
    assert "helpers" not in vars(run)


def test_told_in_the_thread_that_called_up_to_the_last_job_of_any_thread() -> None:
    run, told, together = Run(2), [], threading.Barrier(2, timeout=10.0)

    def job(own: Run) -> int:
        together.wait()
        return hold(0.0 if threading.current_thread() is threading.main_thread() else 0.1, 0)

    run_jobs(run, [job] * 2, lambda done: told.append((threading.current_thread() is threading.main_thread(), done)))
    assert told == [(True, 1), (True, 2)]
    run.release_threads()


@pytest.mark.parametrize("threads", [1, 2])
def test_the_error_of_the_first_job_that_failed_is_raised_and_no_other_job_begins(threads: int) -> None:
    run, begun = Run(threads), []

    def job(k: int) -> int:
        begun.append(k)
        if k == 1:
            raise ValueError(f"job {k}")
        return hold(0.05, k)

    with pytest.raises(ValueError, match="job 1"):
        run_jobs(run, [lambda own, k=k: job(k) for k in range(10)])
    assert set(begun) <= {0, 1, 2}
    run.release_threads()


def test_seconds_are_booked_once_for_the_wall_and_all_for_the_threads() -> None:
    run = Run(2)

    def job(own: Run) -> None:
        with own.recorded("nap"):
            time.sleep(0.05)

    run_jobs(run, [job] * 4)
    clock = run.stages["nap"]
    assert clock["thread_seconds"] >= 0.2
    assert clock["wall_seconds"] == close_to(clock["thread_seconds"] / 2, rtol=1e-6, atol=0.0)
    run.release_threads()


def test_a_stopped_run_passes_its_interrupt_on() -> None:
    run = Run(2)

    def job(own: Run) -> None:
        with own.recorded("nap"):
            time.sleep(0.01)

    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        run_jobs(run, [job] * 4)
    run.release_threads()


def test_threads_that_were_sent_home_are_gone() -> None:
    run = Run(3)
    run_jobs(run, [lambda own: hold(0.01, 0)] * 6)
    run.release_threads()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("vrte-job")]
    run.release_threads()


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


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="there is no fork here")
def test_a_pool_forked_while_another_thread_solves_says_so() -> None:
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    assert done.stdout.startswith("this process was forked while another thread of its parent was solving")
    assert "spawn" in done.stdout
