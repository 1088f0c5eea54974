"""Plans shared by several OpenCL devices, a thread and an engine a device."""

import itertools
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.basics.running import Progress, Run
from vrte.cl import device
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines.engine import Engine
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.request.backends import Backend
from vrte.results.solution import Solution

_speeds: dict[tuple[str, str], float] = {}  # plans a second that a device, by platform and name, has been seen to make


def carry_out_on_devices(
    plans: Sequence[Plan], engine: Engine, run: Run, progress: Progress | None = None
) -> list[Solution]:
    """The solutions of plans; where several devices are named each takes a share, as large as it is fast.

    Raises what `carry_out` does; of a device among several, the DeviceError says which it was.
    """
    request = plans[0].request
    if len(plans) < 2 or request.backend is not Backend.OPENCL or not engine.takes_many or request.scene.keeps_beams:
        return carry_out(plans, engine, run, progress)
    indices = device.list_sharing_devices()
    if len(indices) < 2:
        return carry_out(plans, engine, run, progress)
    counts = share_out(len(plans), find_speeds([device.devices()[index] for index in indices]))
    shares: list[Sequence[Plan]] = []
    for count in counts:
        first = sum(map(len, shares))
        shares.append(plans[first : first + count])
    reported = add_progress(progress, shares)
    found: dict[int, list[Solution]] = {}
    errors: list[BaseException] = []

    def work(place: int) -> None:
        named = device.devices()[indices[place]]
        own, start = replace(run, stages={k: dict(v) for k, v in run.stages.items()}), time.perf_counter()
        try:
            with device.take_device_here(indices[place]):
                fresh: Any = engine
                found[place] = carry_out(shares[place], replace(fresh), own, reported[place])
        except BaseException as error:
            run.stop[0] = 1
            errors.append(name_device(error, named))
        else:
            speed = counts[place] / (time.perf_counter() - start)
            key = named.platform, named.name
            _speeds[key] = max(speed, _speeds.get(key, 0.0))  # the first time it compiles

    threads = [threading.Thread(target=work, args=(place,)) for place, count in enumerate(counts) if count]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:  # the others were only stopped by it
        raise next((error for error in errors if not isinstance(error, KeyboardInterrupt)), errors[0])
    return [solution for place in sorted(found) for solution in found[place]]


def name_device(error: BaseException, named: device.Device) -> BaseException:
    """The error of one of several devices, which says of which."""
    if not isinstance(error, DeviceError):
        return error
    reported = DeviceError(f"{named.name} ({named.platform}), which shared the work: {error}")
    reported.__cause__ = error.__cause__
    return reported


def find_speeds(found: Sequence[device.Device]) -> list[float]:
    """Of each device, as measured in this process where all were, otherwise by its rate of doubles."""
    seen = [_speeds.get((each.platform, each.name), 0.0) for each in found]
    return seen if all(seen) else [each.rate for each in found]


def share_out(count: int, speeds: Sequence[float]) -> list[int]:
    """How many of so many each gets, by its speed.

    >>> share_out(10, [3.0, 1.0]), share_out(3, [1000.0, 1.0])
    ([8, 2], [3, 0])
    """
    total, reached, ends = sum(speeds), 0.0, [0]
    for speed in speeds:
        reached += speed
        ends.append(int(count * reached / total + 0.5))
    return [end - begin for begin, end in itertools.pairwise(ends)]


def add_progress(progress: Progress | None, shares: Sequence[Sequence[Plan]]) -> list[Progress | None]:
    """What each thread tells of its share, added up."""
    if progress is None:
        return [None] * len(shares)
    lock, done = threading.Lock(), [0.0] * len(shares)
    steps = 100 * sum(map(len, shares))

    def make(index: int) -> Progress:
        def tell(now: int, total: int) -> None:
            with lock:
                done[index] = len(shares[index]) * now / max(total, 1)
                progress(round(100 * sum(done)), steps)

        return tell

    return [make(index) for index in range(len(shares))]
