"""Whether an OpenCL device computes what the processor does, and how fast: small scenes by every kernel beside the
compiled core, batches, too little memory, Ctrl-C, the paper's gold powder; products in double precision beside BLAS."""

import platform
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

import vrte
from vrte.basics.errors import DeviceError
from vrte.basics.running import Progress, keep_to_one_thread
from vrte.cl import device
from vrte.cl.device import Device
from vrte.cl.matrices import download_stack, invert, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import Session, open_session
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.methods.discrete_ordinates import solve_plans
from vrte.request.request import make_brdf_request

LONGEST = 120.0  # seconds of all checks together
SAME, CLOSE = 1e-11, 1e-10  # of the largest light: by the same steps, and by fixed points that end at some accuracy
OF_FLOATS = 1e-4  # of single precision
LITTLE = 4e6  # bytes of matrices that a device with little memory holds at once
FINE: dict[str, Any] = {"nodes": 8, "accuracy": 1e-11}
BRDF = FINE | {"mu_i": [0.25, 0.9], "mu_o": [0.15, 0.6, 1.0], "phi": [0.0, 35.0, 110.0, 180.0]}
THROUGH = BRDF | {"transmission": True, "algorithm": "doubling"}
INVARIANCE = BRDF | {"algorithm": "invariance"}
DEPTHS = FINE | {"mu0": 0.6, "mu": [0.9, 0.2, -0.2, -0.9], "phi": [0.0, 50.0], "tau": np.linspace(0.0, 3.1, 12)}
FLOATS: dict[str, Any] = {"precision": "single", "accuracy": OF_FLOATS}
REFERENCE = {"backend": "openmp", "precision": None, "accuracy": 1e-11}
ARRAYS = ("mueller", "transmission", "stokes", "flux_up", "flux_down")  # of results, compared


class Check(NamedTuple):
    """Largest difference over the largest light, what is allowed, seconds; ``problem``: the error instead."""

    name: str
    gap: float
    allowed: float
    seconds: float
    problem: str = ""

    @property
    def passed(self) -> bool:
        """Whether the difference is a number within what is allowed."""
        return not self.problem and self.gap <= self.allowed

    @property
    def line(self) -> str:
        """The check as a line of the printed table: name, difference, limit, seconds."""
        difference = "failed" if self.problem else f"{self.gap:.1e}"
        mark = "" if self.passed else "  <- WRONG" + (f": {self.problem}" if self.problem else "")
        return f"  {self.name:52}{difference:>19}{self.allowed:10.0e}{self.seconds:8.2f}{mark}"


class MistakeError(Exception):
    """Something other than a number is wrong."""


def make_scenes() -> dict[str, vrte.Scene]:
    """Scenes by name: semi-infinite, of four layers on a base, under a surface; the gold powder of Table 3."""
    powder = vrte.spheres(1.6 + 0.01j, radius_um=0.15, wavelength_um=0.5)
    pigment = vrte.spheres(2.0 + 0.01j, radius_um=0.1, wavelength_um=0.5, host_index=1.5)
    gold = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4)
    clear, cloud = vrte.Layer(vrte.rayleigh(), 0.0, 0.1), vrte.Layer(vrte.henyey_greenstein(0.5), 0.9, 2.0)
    stack = [vrte.Layer.of(powder, thickness=0.4), vrte.Layer(vrte.rayleigh(), 1.0, 0.7), clear, cloud]
    glass: list[Any] = [vrte.Interface(1.0, 1.5), vrte.Layer.of(pigment, thickness=1.0)]
    return {
        "semi-infinite": vrte.Scene([vrte.Layer.of(powder, thickness=np.inf)]),
        "stack": vrte.Scene(stack, vrte.Lambertian(0.4)),
        "surface": vrte.Scene(glass, vrte.Lambertian(0.3)),
        "gold": vrte.Scene([vrte.Layer.of(gold, thickness=100.0)]),
    }


def make_batch(count: int = 6) -> list[vrte.Scene]:
    """Scenes that are solved in one call: the wavelengths of a spectrum of gold."""
    gold = [vrte.spheres("gold", radius_um=0.05, wavelength_um=each) for each in np.linspace(0.45, 0.65, count)]
    return [vrte.Scene([vrte.Layer.of(each, thickness=np.inf)]) for each in gold]


def measure_gap(found: Any, right: Any) -> float:
    """The largest difference of arrays, or of the arrays of results, over the largest value; NaN where one is NaN."""
    if not isinstance(found, np.ndarray):
        there = [name for name in ARRAYS if getattr(right, name, None) is not None]
        return max(measure_gap(getattr(found, name), getattr(right, name)) for name in there)
    return float(np.abs(found - right).max() / max(float(np.abs(right).max()), 1e-300))


@contextmanager
def change(session: Session, **values: Any) -> Iterator[None]:
    """A session with other values of its attributes, as less room for matrices [bytes]."""
    before = {name: getattr(session, name) for name in values}
    vars(session).update(values)
    try:
        yield
    finally:
        vars(session).update(before)


@dataclass(eq=False)
class Verification:
    """The checks of a device, in doubles or, where it has none, in floats."""

    session: Session
    before: list[vrte.Brdf] | None = None  # of the batch

    def list_checks(self) -> dict[str, tuple[float, Callable[[], float]]]:
        """By name, what is allowed and a function that finds the largest difference, the quick ones first."""
        compare, depths = self.compare, DEPTHS | {"algorithm": "doubling"}

        def solve_alone() -> list[vrte.Brdf]:
            return [vrte.brdf(scene, **self.ask(BRDF)) for scene in make_batch()[:2]]

        checks: dict[str, tuple[float, Callable[[], float]]] = {
            "products and inverses": (1e-12, self.check_matrices),
            "invariance, semi-infinite": (CLOSE, partial(compare, "semi-infinite", INVARIANCE)),
            "doubling, semi-infinite": (SAME, partial(compare, "semi-infinite", BRDF | {"algorithm": "doubling"})),
            "doubling, four layers on a base, transmission": (SAME, partial(compare, "stack", THROUGH)),
            "twelve depths": (SAME, partial(compare, "stack", depths)),
            "a batch of scenes": (CLOSE, lambda: self.compare_with_batch(vrte.brdfs(make_batch(), **BRDF))),
            "each as by itself": (0.0, lambda: self.compare_with_batch(solve_alone())),
            "less memory than they need": (0.0, self.compare_little_memory),
            "stopped midway, then solved again": (0.0, self.compare_stopped),
        }
        if self.session.precision == "single":
            return {name: (allowed and OF_FLOATS, call) for name, (allowed, call) in checks.items()}
        modes = DEPTHS | {"algorithm": "modes", "backend": "opencl+lapack"}
        return checks | {
            "a surface": (SAME, partial(compare, "surface", THROUGH)),
            "eigenvectors of the processor, light by the device": (CLOSE, partial(compare, "stack", modes)),
            "in floats, semi-infinite": (OF_FLOATS, partial(compare, "semi-infinite", INVARIANCE | FLOATS)),
            "in floats, four layers on a base": (OF_FLOATS, partial(compare, "stack", THROUGH | FLOATS)),
            "the paper's gold powder, 40 nodes": (CLOSE, partial(compare, "gold", BRDF | {"nodes": 40})),
        }

    def ask(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Keywords of a call on the device: in floats where it has no doubles."""
        return {"backend": "opencl", **asked} | (FLOATS if self.session.precision == "single" else {})

    def compare(self, name: str, asked: Mapping[str, Any]) -> float:
        """One scene on the device beside the compiled core."""
        call: Callable[..., Any] = vrte.brdf if "mu_i" in asked else vrte.radiance
        scene = make_scenes()[name]
        return measure_gap(call(scene, **self.ask(asked)), call(scene, **{**asked, **REFERENCE}))

    def check_matrices(self) -> float:
        """Products and inverses of several sizes beside NumPy's."""
        differences = []
        for rows, inner, columns in ((5, 3, 7), (40, 33, 48), (64, 50, 64), (130, 80, 70)):
            a, b = (np.random.default_rng(rows).random((3, *shape)) for shape in ((inner, rows), (columns, inner)))
            made = make_stack(self.session, 3, rows, columns)
            multiply_stacks(self.session, upload_stack(self.session, a), upload_stack(self.session, b), made)
            differences.append(measure_gap(download_stack(self.session, made), b @ a))
            square = a[:, :, :inner] + inner * np.eye(inner)
            stack = upload_stack(self.session, square)
            invert(self.session, stack)
            differences.append(measure_gap(download_stack(self.session, stack), np.linalg.inv(square)))
        return max(differences)

    def solve_batch(self, progress: Callable[[int, int], None] | None = None) -> list[vrte.Brdf]:
        """The batch on the device."""
        return vrte.brdfs(make_batch(), **self.ask(BRDF), progress=progress)

    def compare_with_batch(self, found: Sequence[vrte.Brdf]) -> float:
        """BRDFs beside those that the batch gave first."""
        self.before = self.before or self.solve_batch()
        return max(measure_gap(*pair) for pair in zip(found, self.before, strict=False))

    def compare_little_memory(self) -> float:
        """The batch on a device that holds a part of it at once."""
        steps: list[list[int]] = [[], []]
        self.solve_batch(lambda done, total: steps[0].append(done))
        with change(self.session, room=LITTLE):
            found = self.solve_batch(lambda done, total: steps[1].append(done))
        if len(steps[1]) <= len(steps[0]):
            raise MistakeError("the batch was not split")
        return self.compare_with_batch(found)

    def compare_stopped(self) -> float:
        """The batch stopped on its way, as Ctrl-C does, and then solved."""
        requests = [choose_method(make_brdf_request(scene, **self.ask(BRDF))) for scene in make_batch()]
        run, reached = make_run(requests[0]), list[float]()
        plans = [plan_request(request, run) for request in requests]

        def stop(done: int, total: int) -> None:
            reached.append(done / total)
            run.stop[0] = 1

        with change(self.session, room=LITTLE), suppress(KeyboardInterrupt):
            solve_plans(plans, run, stop)
            raise MistakeError("the solve did not stop")
        if not reached or reached[-1] >= 1.0:
            raise MistakeError("the solve stopped when all was done")
        return self.compare_with_batch(self.solve_batch())


def verify_device(
    index: int | None = None,
    write_line: Callable[[str], None] = print,
    report: Callable[[str], None] = lambda line: None,
    seconds: float = LONGEST,
    wanted: Sequence[str] = (),
) -> str:
    """Writes a line of each check of a device; one sentence where one did not pass, else "". Raises DeviceError."""
    all_devices = device.devices()
    chosen = all_devices.index(device.find_chosen_device()) if index is None else index
    if not 0 <= chosen < len(all_devices):
        raise DeviceError(f"there is no OpenCL device {index}: {device.list_names(all_devices)}")
    own, begin = all_devices[chosen], time.perf_counter()
    checks, left_out = list[Check](), list[str]()
    report("compiling")
    with device.raise_device_errors():
        opened = open_session(own.handle, precision=own.widest)
    lanes = f"{opened.lanes} work-items share a piece of work"
    write_line(f"{describe_machine(own)}; {lanes}\n\n  {'check':52}{'largest difference':>19}{'allowed':>10}{'s':>8}")
    with device.take_device(chosen, opened):
        for name, (allowed, call) in Verification(opened).list_checks().items():
            longest = max((check.seconds for check in checks), default=0.0)
            if wanted and name not in wanted:
                continue
            if time.perf_counter() - begin + longest > seconds:
                left_out.append(name)
                continue
            report(name)
            checks.append(perform_check(name, allowed, call))
            write_line(checks[-1].line)
    launched = {name for twin in (opened, *opened.beside.values()) for name in twin.kernels}
    kernels, failures = opened.kernels.names, [check for check in checks if not check.passed]
    write_line(f"\n  {len(checks) - len(failures)} of {len(checks)} checks passed")
    write_line(f"  {len(kernels & launched)} of {len(kernels)} kernels were launched")
    write_line("  " + ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in vars(opened.traffic).items()))
    for words, names in (("never launched", sorted(kernels - launched)), ("left out for want of time", left_out)):
        if names:
            write_line(f"  {words}: {'; '.join(names)}")
    return complain_about(own, checks, failures)


def perform_check(name: str, allowed: float, call: Callable[[], float]) -> Check:
    """A check and its time; an error is one that did not pass."""
    start, difference, problem = time.perf_counter(), np.inf, ""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            difference = call()
        except Exception as error:  # wrong numbers may lead to any
            problem = str(error) or type(error).__name__
    return Check(name, difference, allowed, time.perf_counter() - start, problem)


def describe_machine(own: Device) -> str:
    """Versions of the libraries, and the properties that a device reports."""
    return (
        f"vrte {vrte.__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"pyopencl {version('pyopencl')}, {platform.system()} {platform.machine()}\n"
        f"{own.name} ({own.kind}, {'doubles' if own.double_precision else 'no doubles'}) on {own.platform}, driver "
        f"{own.driver}, {own.handle.version.strip()}\n"
        f"{own.units} compute units, {own.memory / 1e9:.1f} GB, largest array "
        f"{own.largest / 1e9:.1f} GB, local memory {own.handle.local_mem_size} B, work-groups of "
        f"{own.handle.max_work_group_size}"
    )


def complain_about(own: Device, checks: Sequence[Check], failures: Sequence[Check]) -> str:
    """One sentence where a check did not pass or there was no time for any, otherwise empty."""
    if not checks:
        words = "compiling its kernels took all of it, and a second time they are kept; or the machine is busy"
        return f"{own.name} is not verified: there was no time for any check ({words})"
    if not failures:
        return ""
    first, *others = failures
    what = first.problem or f"differs by {first.gap:.1e} of the largest light, allowed are {first.allowed:.0e}"
    more = f", and {len(others)} more checks did not pass" if others else ""
    return f"{own.name} is not to be trusted: {first.name}: {what}{more}"


SIZES = ((40, 512), (80, 256), (160, 64), (240, 32))  # rows and columns, matrices in one call
ROUNDS = 7  # of all calls in turn; the fastest of each counts
SECONDS = 0.03  # of one round, about


@dataclass(frozen=True)
class Rate:
    """Products of ``count`` matrices of ``rows`` rows: 1e9 operations a second on the device and by BLAS."""

    rows: int
    count: int
    device: float
    blas: float


def measure_rates(session: Session, threads: int, progress: Progress = lambda done, total: None) -> list[Rate]:
    """Rates of products in double precision, the device and BLAS in turn. Raises DeviceError."""
    rates = []
    with ThreadPoolExecutor(threads) as pool, keep_to_one_thread(), session.lock:
        for done, (rows, count) in enumerate(SIZES):
            progress(done, len(SIZES))
            seconds = time_calls(make_products(session, pool, threads, rows, count))
            rates.append(Rate(rows, count, *(2e-9 * rows**3 * count / each for each in seconds)))
    return rates


def make_products(
    session: Session, pool: ThreadPoolExecutor, threads: int, rows: int, count: int
) -> tuple[Callable[[], object], Callable[[], object]]:
    """Calls that multiply matrices of one size on the device, and by BLAS on threads."""
    a, b = np.random.default_rng(0).random((2, count, rows, rows))
    c = np.empty_like(a)
    stacks = upload_stack(session, a), upload_stack(session, b), make_stack(session, count, rows, rows)
    ends = np.linspace(0, count, threads + 1).astype(int)
    parts = list(map(slice, ends[:-1], ends[1:]))

    def on_device() -> None:
        multiply_stacks(session, *stacks)
        session.finish()

    return on_device, lambda: list(pool.map(lambda part: np.matmul(a[part], b[part], out=c[part]), parts))


def time_calls(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Seconds of each call, the fastest of some rounds, all of them in turn; the first round warms up."""
    times: list[list[float]] = [[] for _ in calls]
    for round_ in range(ROUNDS):
        for call, seconds in zip(calls, times, strict=True):
            repeats = max(1, int(SECONDS / seconds[0])) if round_ else 1
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            seconds.append((time.perf_counter() - start) / repeats)
    return [min(seconds[1:]) for seconds in times]


def describe_rates(rates: Sequence[Rate], threads: int) -> str:
    """A line a size: products of matrices a second on the device and by BLAS."""
    title = f"BLAS, {threads} thread{'s' if threads > 1 else ''}"
    lines = ["  products in double precision, 1e9 operations a second"]
    lines.append(f"  size        matrices    device{title:>18}   ratio")
    for rate in rates:
        size = f"{rate.rows} x {rate.rows}"
        lines.append(f"  {size:12}{rate.count:8}{rate.device:10.1f}{rate.blas:18.1f}{rate.device / rate.blas:8.2f}")
    return "\n".join(lines)


def measure_costs(session: Session, megabytes: float = 16.0) -> str:
    """Launches, reads and copies of a device, in words. Raises DeviceError."""
    import pyopencl

    values = np.zeros(int(megabytes * 1e6 / 8.0))
    first, second, small = session.empty(values.shape), session.empty(values.shape), session.zeros((1,))
    stack = make_stack(session, 1, 8, 8)

    def launch() -> None:
        for _ in range(100):
            session.launch("add_rates", (1,), stokes=8, directions=small, E=stack, F=stack)
        session.finish()

    def copy() -> None:
        pyopencl.enqueue_copy(session.queue, second.data, first.data, byte_count=values.nbytes)
        session.finish()

    def put() -> None:
        session.put(values, first)
        session.finish()

    with session.lock:
        launched, was_read, copied, sent = time_calls((launch, lambda: session.download(small), copy, put))
    return (
        f"  a launch {1e4 * launched:.1f} us, a blocking read {1e6 * was_read:.1f} us, memory "
        f"{2e-9 * values.nbytes / copied:.0f} GB/s, to the device {1e-9 * values.nbytes / sent:.1f} GB/s"
    )
