"""Two threads, and two Dask workers, against two independent processes of one thread: 200 scenes of a sweep."""

from docs.scripts.sweep_scaling import WORTH, measure, report, shares


def test_a_sweep_scales_like_independent_processes() -> None:
    taken = measure()
    print(f"\n{report(taken)}")
    found = shares(taken)
    assert found["threads"] >= WORTH
    assert found["dask"] >= WORTH
