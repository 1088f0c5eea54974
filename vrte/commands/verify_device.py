"""OpenCL devices: a table of them, the products that one computes in a second, and whether it is right.

`vrte devices --verify` is the first thing to run on a new device: small scenes by every kernel, in each form of kernels
that the device can run, beside the compiled core; then what goes on around them: batches, too little memory, Ctrl-C. At
the end the paper's gold powder, timed, where there is time.
"""

import platform
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from types import MappingProxyType
from typing import Any

import numpy as np

import vrte
from vrte.basics.arrays import Array
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import DeviceError
from vrte.basics.running import Progress
from vrte.calls.brdf import brdf
from vrte.calls.brdfs import brdfs
from vrte.calls.radiance import radiance
from vrte.cl import device
from vrte.cl.device import Device
from vrte.cl.extended import Algebra, Sizes
from vrte.cl.matrices import download_stack, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import FORMS, WORK_GROUP, Session, Traffic, open_session
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.methods.discrete_ordinates import solve_plans
from vrte.optics.phase_matrix import henyey_greenstein, rayleigh
from vrte.optics.spheres import spheres
from vrte.request.request import make_brdf_request
from vrte.scene.boundary import Lambertian
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

NOTHING: Mapping[Any, Any] = MappingProxyType({})
SIZES = ((40, 512), (80, 256), (160, 64), (240, 32))  # rows and columns, matrices in one call
ROUNDS = 7  # of both in turn; the fastest of each counts
SECONDS = 0.03  # of one round, about


@dataclass(frozen=True)
class Rate:
    """Products of ``count`` matrices of ``rows`` rows and columns: 1e9 operations a second, on the device and by BLAS
    on as many threads as were asked for."""

    rows: int
    count: int
    device: float
    blas: float


def describe_devices(
    found: Sequence[Device], taken: int | None, reason: str, complaints: Mapping[int, str] = NOTHING
) -> str:
    """A line a device, and which one is taken and why; complaints: of those that do not compute, by index.

    >>> cpu = Device("PoCL", "a processor", "cpu", True, 16 << 30, 4 << 30, 8, "3.0")
    >>> print(describe_devices([cpu], 0, "the only device"))
         device                                      kind         fp64    memory   largest  units  driver
     * 0 a processor                                 cpu          yes    17.2 GB    4.3 GB      8  3.0
         on PoCL
    <BLANKLINE>
      taken: 0, the only device
    """
    columns = f"{'memory':>10}{'largest':>10}{'units':>7}  driver"
    lines = [f"     {'device':44}{'kind':13}{'fp64':4}{columns}"]
    for index, each in enumerate(found):
        precision = "yes" if each.double_precision else "no"
        sizes = "".join(f"{size / 1e9:7.1f} GB" for size in (each.memory, each.largest))
        mark = "*" if index == taken else " "
        text = f"{each.name[:43]:44}{each.kind:13}{precision:4}{sizes}{each.units:7}  {each.driver}"
        lines.append(f" {mark}{index:2} {text}")
        power = f", about {each.rate / 1e9:.3g}e9 operations a second in doubles" if each.double_precision else ""
        memory = "the processor's memory" if each.shared else "memory of its own"
        lines.append(f"     on {each.platform}" + (f"; {memory}{power}" if each.kind == "gpu" else ""))
        if complaints.get(index):
            lines.append(f"     never taken: {complaints[index]}")
    return "\n".join([*lines, "", f"  taken: {'none' if taken is None else taken}, {reason}"])


def measure_rates(session: Session, threads: int, told: Progress = lambda done, total: None) -> list[Rate]:
    """Rates of products in double precision, the device and BLAS in turn. Raises DeviceError."""
    rates = []
    with ThreadPoolExecutor(threads) as pool, keep_to_one_thread(), session.lock:
        for done, (rows, count) in enumerate(SIZES):
            told(done, len(SIZES))
            rates.append(measure_rate(session, pool, threads, rows, count))
    return rates


def measure_rate(session: Session, pool: ThreadPoolExecutor, threads: int, rows: int, count: int) -> Rate:
    """Of one size."""
    a, b = np.random.default_rng(0).random((2, count, rows, rows))
    c = np.empty_like(a)
    first, second, made = upload_stack(session, a), upload_stack(session, b), make_stack(session, count, rows, rows)
    items = session.upload(np.arange(count, dtype=np.int32))
    shares = [part for part in np.array_split(np.arange(count), threads) if part.size]

    def on_device() -> None:
        multiply_stacks(session, items, first, second, made)
        session.finish()

    def multiply_share(share: Array) -> None:
        for item in share:
            np.matmul(a[item], b[item], out=c[item])

    def by_blas() -> None:
        list(pool.map(multiply_share, shares))

    operations = 2.0 * rows**3 * count
    best = time_calls((on_device, by_blas))
    return Rate(rows, count, *(operations / 1e9 / seconds for seconds in best))


def time_calls(calls: Sequence[Callable[[], None]]) -> list[float]:
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
    """A line a size.

    >>> print(describe_rates([Rate(160, 64, 90.0, 100.0)], 2))
      products in double precision, 1e9 operations a second
      size        matrices    device   BLAS, 2 threads   ratio
      160 x 160         64      90.0             100.0    0.90
    """
    title = f"BLAS, {threads} thread{'s' if threads > 1 else ''}"
    lines = [
        "  products in double precision, 1e9 operations a second",
        f"  size        matrices    device{title:>18}   ratio",
    ]
    for rate in rates:
        size = f"{rate.rows} x {rate.rows}"
        lines.append(f"  {size:12}{rate.count:8}{rate.device:10.1f}{rate.blas:18.1f}{rate.device / rate.blas:8.2f}")
    return "\n".join(lines)


def measure_costs(session: Session, megabytes: float = 16.0) -> str:
    """What a device takes beside its work, in words. Raises DeviceError."""
    import pyopencl

    values = np.zeros(int(megabytes * 1e6 / 8.0))
    first, second, small = session.empty(values.shape), session.empty(values.shape), session.zeros((1,))
    stack, items = make_stack(session, 1, 8, 8), session.upload(np.zeros(1, np.int32))

    def launch() -> None:
        for _ in range(100):
            session.launch("add_rates", (1,), 0, 1, small, stack, stack, items)
        session.finish()

    def read() -> None:
        for _ in range(20):
            session.download(small)

    def copy() -> None:
        pyopencl.enqueue_copy(session.queue, second.data, first.data, byte_count=values.nbytes)
        session.finish()

    def put() -> None:
        session.put(values, first)
        session.finish()

    with session.lock:
        launched, was_read, copied, sent = time_calls((launch, read, copy, put))
    return (
        f"  beside its work: a launch {1e4 * launched:.1f} us, a blocking read {5e4 * was_read:.1f} us, memory "
        f"{2e-9 * values.nbytes / copied:.0f} GB/s, to the device {1e-9 * values.nbytes / sent:.1f} GB/s"
    )


LONGEST = 120.0  # seconds of all checks together
SAME, CLOSE = 1e-11, 1e-10  # of the largest light: by the same steps, and by fixed points that end at some accuracy
OF_FLOATS = 1e-4  # of single precision
SURFACE, MODES = "a surface", "eigenvectors of the processor, light by the device"  # in doubles alone
LITTLE = 4e6  # bytes of matrices that a device with little memory holds at once
Told = Callable[[str], None]


@dataclass(frozen=True)
class Check:
    """What was checked in which form: the largest difference, what is allowed, and seconds; ``problem``: what went
    wrong instead."""

    name: str
    form: str
    gap: float
    allowed: float
    seconds: float
    problem: str = ""

    @property
    def passed(self) -> bool:
        """Whether it is as it should be; no number is not."""
        return not self.problem and self.gap <= self.allowed


@dataclass(frozen=True, eq=False)
class Verified:
    """What was found on a device: its checks, those for which there was no time, kernels that were never launched
    and how many there are, what it was asked in each form, what it takes beside its work, and seconds a BRDF of gold,
    by name."""

    device: Device
    checks: Sequence[Check]
    left_out: Sequence[str]
    idle: Sequence[str]
    kernels: int
    asked: Sequence[Traffic]
    costs: str
    gold: Mapping[str, float] = field(default_factory=dict)

    @property
    def failures(self) -> list[Check]:
        """What is not as it should be."""
        return [check for check in self.checks if not check.passed]


class MistakeError(Exception):
    """Something other than a number is not as it should be."""


def make_scenes() -> dict[str, Scene]:
    """By name; small ones, polarizing, of several layers, over bases, under a surface."""
    powder = spheres(1.6 + 0.01j, radius_um=0.15, wavelength_um=0.5)
    pigment = spheres(2.0 + 0.01j, radius_um=0.1, wavelength_um=0.5, host_index=1.5)
    gap, clouds = Layer(rayleigh(), 0.0, 0.1), Layer(henyey_greenstein(0.5), 0.9, 2.0)
    pile = [Layer.of(powder, thickness=0.4), Layer(rayleigh(), 1.0, 0.7), gap, clouds]
    coated: list[Any] = [Interface(1.0, 1.5), Layer.of(pigment, thickness=1.0)]
    return {
        "endless": Scene([Layer.of(powder, thickness=np.inf)]),
        "pile": Scene(pile, Lambertian(0.4)),
        "surface": Scene(coated, Lambertian(0.3)),
    }


ASKED: dict[str, Any] = {
    "accuracy": 1e-11,
    "mu_i": [0.25, 0.9],
    "mu_o": [0.15, 0.6, 1.0],
    "phi": [0.0, 35.0, 110.0, 180.0],
    "nodes": 8,
}
IN_FLOATS: dict[str, Any] = {"precision": "single", "accuracy": OF_FLOATS}
MIXED: dict[str, Any] = {"precision": "mixed"}  # floats, corrected in doubles
DEPTHS: dict[str, Any] = {
    "mu0": 0.6,
    "mu": [0.9, 0.2, -0.2, -0.9],
    "phi": [0.0, 50.0],
    "tau": np.linspace(0.0, 3.1, 12),
    "nodes": 8,
}


def make_batch(count: int = 6) -> list[Scene]:
    """Scenes that are solved in one call: the wavelengths of a spectrum."""
    return [
        Scene([Layer.of(spheres("gold", radius_um=0.05, wavelength_um=wavelength), thickness=np.inf)])
        for wavelength in np.linspace(0.45, 0.65, count)
    ]


def measure_gap(found: Any, right: Any) -> float:
    """The largest difference over the largest light; not a number where one is none."""
    return float(np.abs(found - right).max() / max(float(np.abs(right).max()), 1e-300))


@dataclass(eq=False)
class Verification:
    """The checks of a device in one form, in doubles or, where it has none, in floats."""

    session: Session
    found: dict[str, Any] = field(default_factory=dict)

    @property
    def asked(self) -> dict[str, Any]:
        """What every call asks of the device: its backend, and floats where it has no doubles."""
        return {"backend": "opencl"} | (IN_FLOATS if self.session.precision == "single" else {})

    def list_checks(self) -> dict[str, tuple[float, Callable[[], float]]]:
        """By name, what is allowed and what finds the largest difference, the quick ones first."""
        checks = {
            "products and inverses": (1e-12, self.check_matrices),
            "invariance, no bottom": (CLOSE, lambda: self.compare_brdf("endless", "invariance")),
            "doubling, no bottom": (SAME, lambda: self.compare_brdf("endless", "doubling")),
            "doubling, four layers on a base, transmission": (SAME, lambda: self.compare_brdf("pile", "doubling")),
            "the same by a launch a step": (SAME, self.compare_step_by_step),
            "twelve depths": (SAME, self.compare_depths),
            SURFACE: (SAME, lambda: self.compare_brdf("surface", "doubling")),
            MODES: (CLOSE, self.compare_modes),
            "a batch of scenes": (CLOSE, self.compare_batch),
            "each as by itself": (0.0, self.compare_alone),
            "less memory than they need": (0.0, self.compare_little_memory),
            "stopped midway, then solved again": (0.0, self.compare_stopped),
            "corrected floats, no bottom": (CLOSE, lambda: self.compare_brdf("endless", "invariance", MIXED)),
            "in floats, no bottom": (OF_FLOATS, lambda: self.compare_brdf("endless", "invariance", IN_FLOATS)),
            "in floats, four layers on a base": (OF_FLOATS, lambda: self.compare_brdf("pile", "doubling", IN_FLOATS)),
        }
        if self.session.precision == "double":
            return checks
        exact = {name: (allowed and OF_FLOATS, call) for name, (allowed, call) in checks.items()}
        return {name: check for name, check in exact.items() if name not in (SURFACE, MODES) and "floats" not in name}

    def check_matrices(self) -> float:
        """Of products and inverses of several sizes, NumPy's."""
        gaps = []
        for rows, inner, columns in ((5, 3, 7), (40, 33, 48), (64, 50, 64), (130, 80, 70)):
            a, b = (np.random.default_rng(rows).random((3, *shape)) for shape in ((inner, rows), (columns, inner)))
            items = self.session.upload(np.arange(3, dtype=np.int32))
            made = make_stack(self.session, 3, rows, columns)
            multiply_stacks(self.session, items, upload_stack(self.session, a), upload_stack(self.session, b), made)
            gaps.append(measure_gap(download_stack(self.session, made), b @ a))
            square = a[:, :, :inner] + inner * np.eye(inner)
            stack = upload_stack(self.session, square)
            Algebra(self.session, Sizes(inner, 0, 0, 1), 3).invert_stack(np.ones(3, bool), stack)
            gaps.append(measure_gap(download_stack(self.session, stack), np.linalg.inv(square)))
        return max(gaps)

    def compare_brdf(self, name: str, algorithm: str, more: Mapping[str, Any] = NOTHING) -> float:
        """One scene, with light at the bottom where there is one; ``more`` is asked of the device."""
        scene = make_scenes()[name]
        asked = ASKED | {"algorithm": algorithm, "transmission": np.isfinite(scene.thickness)}
        found, right = (brdf(scene, **(asked | own)) for own in ({**self.asked, **more}, {"backend": "openmp"}))
        if right.transmission is None or found.transmission is None:
            return measure_gap(found.mueller, right.mueller)
        return max(measure_gap(found.mueller, right.mueller), measure_gap(found.transmission, right.transmission))

    def compare_step_by_step(self) -> float:
        """Doubling as where matrices are large: one launch a step, not one for all."""
        self.session.at_once = False
        try:
            return self.compare_brdf("pile", "doubling")
        finally:
            self.session.at_once = True

    def compare_depths(self) -> float:
        """Radiance at depths inside a pile, and the fluxes there."""
        asked = DEPTHS | {"algorithm": "doubling"}
        backends = self.asked, {"backend": "openmp"}
        found, right = (radiance(make_scenes()["pile"], **(asked | own)) for own in backends)
        names = "stokes", "flux_up", "flux_down"
        return max(measure_gap(getattr(found, name), getattr(right, name)) for name in names)

    def compare_modes(self) -> float:
        """The algorithm that the device has no eigenvectors for."""
        asked = DEPTHS | {"algorithm": "modes"}
        names = "opencl+lapack", "openmp"
        found, right = (radiance(make_scenes()["pile"], **asked, backend=name) for name in names)
        return measure_gap(found.stokes, right.stokes)

    def compare_batch(self) -> float:
        """How far scenes solved in one call are from the processor's."""
        self.found["batch"] = self.solve_batch()
        right = [each.mueller for each in brdfs(make_batch(), **ASKED, backend="openmp")]
        return max(measure_gap(*pair) for pair in zip(self.found["batch"], right, strict=True))

    def solve_batch(self, progress: Progress | None = None) -> list[Array]:
        """Mueller matrices of all."""
        return [each.mueller for each in brdfs(make_batch(), **(ASKED | self.asked), progress=progress)]

    def compare_with_batch(self, found: Sequence[Array]) -> float:
        """With what the batch gave before."""
        before = self.found.setdefault("batch", self.solve_batch())
        return max(measure_gap(*pair) for pair in zip(found, before, strict=False))

    def compare_alone(self) -> float:
        """The first two of the batch, each by itself."""
        return self.compare_with_batch([brdf(scene, **(ASKED | self.asked)).mueller for scene in make_batch()[:2]])

    def compare_little_memory(self) -> float:
        """The batch on a device that holds a part of it at once."""
        before = self.found.setdefault("batch", self.solve_batch())
        parts: list[list[int]] = [[], []]
        self.solve_batch(lambda done, total: parts[0].append(done))
        with limit_room(self.session, LITTLE):
            found = self.solve_batch(lambda done, total: parts[1].append(done))
        if len(parts[1]) <= len(parts[0]):
            raise MistakeError("the batch was not split")
        return max(measure_gap(*pair) for pair in zip(found, before, strict=True))

    def compare_stopped(self) -> float:
        """The batch stopped on its way, as Ctrl-C does, and then solved."""
        asked: Any = ASKED | self.asked
        requests = [choose_method(make_brdf_request(scene, **asked)) for scene in make_batch()]
        run = make_run(requests[0])
        plans = [plan_request(request, run) for request in requests]
        reached = []

        def stop(done: int, total: int) -> None:
            reached.append(done / total)
            run.stop[0] = 1

        with limit_room(self.session, LITTLE):
            try:
                solve_plans(plans, run, stop)
            except KeyboardInterrupt:
                pass
            else:
                raise MistakeError("it did not stop")
        if not reached or reached[-1] >= 1.0:
            raise MistakeError("it stopped when all was done")
        return self.compare_with_batch(self.solve_batch())


@contextmanager
def limit_room(session: Session, most: float) -> Iterator[None]:
    """The device seems to hold so many bytes of matrices at once."""
    before, session.room = session.room, most
    try:
        yield
    finally:
        session.room = before


def verify_device(
    index: int | None = None,
    told: Told = lambda line: None,
    seconds: float = LONGEST,
    wanted: Sequence[str] = (),
) -> Verified:
    """The checks of a device of `vrte.cl.device.devices`, by default of that which is taken, within about so many
    seconds: what there is no time for is left out; ``told`` of each when it begins; ``wanted``: by default all.

    Raises DeviceError where there is no such device or its kernels do not compile.
    """
    all_devices = device.devices()
    chosen = all_devices.index(device.find_chosen_device()) if index is None else index
    if not 0 <= chosen < len(all_devices):
        raise DeviceError(f"there is no OpenCL device {index}: {device.list_names(all_devices)}")
    found, begin = all_devices[chosen], time.perf_counter()
    checks: list[Check] = []
    left_out: list[str] = []
    launched: set[str] = set()
    asked: list[Traffic] = []
    for form in list_forms(found):
        told(f"compiling, form {form!r}")
        with device.raise_device_errors():
            opened = open_session(found.handle, form, found.widest)
        with device.take_device(chosen, opened):
            listed = Verification(opened).list_checks()
            for name, (allowed, call) in listed.items():
                if wanted and name not in wanted:
                    continue
                longest = max((check.seconds for check in checks), default=0.0)
                if time.perf_counter() - begin + longest > seconds:
                    left_out.append(f"{name}, form {form!r}")
                    continue
                told(f"{name}, form {form!r}")
                checks.append(perform_check(name, form, allowed, call))
        launched |= {name for twin in (opened, *opened.beside.values()) for name in twin.kernels}
        asked.append(opened.traffic)
        kernels = set(opened.kernels.types)
    costs, gold = "", dict[str, float]()
    in_time = time.perf_counter() - begin < 0.5 * seconds
    if in_time and not wanted and found.double_precision and all(check.passed for check in checks):
        told("gold, timed")
        with device.take_device(chosen), device.raise_device_errors():
            costs = measure_costs(device.session())
            gold = time_gold(begin + seconds, checks)
    if not gold and not wanted:
        left_out.append("gold, timed")
    return Verified(found, checks, left_out, sorted(kernels - launched), len(kernels), asked, costs, gold)


def list_forms(found: Device) -> list[str]:
    """The forms of kernels that a device can run, its own first."""
    if found.handle.max_work_group_size < WORK_GROUP:
        return ["cpu"]
    return sorted(FORMS, reverse=found.kind != "cpu")


def perform_check(name: str, form: str, allowed: float, call: Callable[[], float]) -> Check:
    """A check and its time; an error is one that did not pass."""
    start, gap, problem = time.perf_counter(), np.inf, ""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            gap = call()
        except Exception as error:  # wrong numbers may lead to any
            problem = str(error) or type(error).__name__
    return Check(name, form, gap, allowed, time.perf_counter() - start, problem)


def time_gold(end: float, checks: list[Check]) -> dict[str, float]:
    """Seconds a BRDF of the paper's gold powder (Table 3), alone and in a batch, as far as there is time until the
    clock shows ``end``; the first is checked, too."""
    mu = np.linspace(0.05, 1.0, 20)
    asked: Any = {"mu_i": mu, "mu_o": mu, "phi": np.arange(0.0, 361.0, 10.0), "nodes": 40}
    powders = {each: spheres("gold", radius_um=0.6, wavelength_um=each) for each in np.linspace(0.4, 0.41, 64).tolist()}
    found: dict[str, float] = {}

    def solve(count: int, turn: int) -> list[Array]:
        thickness = 100.0 * (1.0 + 1e-10 * turn)  # so that nothing is remembered of the turn before
        scenes = [Scene([Layer.of(powder, thickness=thickness)]) for powder in list(powders.values())[:count]]
        start = time.perf_counter()
        made = brdfs(scenes, **asked, backend="opencl")
        taken = time.perf_counter() - start
        name = "one of thick gold" if count == 1 else f"{count} of thick gold together"
        found[name] = min(taken / count, found.get(name, np.inf))
        return [each.mueller for each in made]

    def compare() -> float:
        right = brdf(Scene([Layer.of(powders[0.4], thickness=100.0)]), **asked, backend="openmp").mueller
        return max(measure_gap(solve(1, turn)[0], right) for turn in range(2))

    checks.append(perform_check("gold, 40 nodes", "its own", CLOSE, compare))
    for count in (8, 64):
        each = min(found.values(), default=np.inf)
        if time.perf_counter() + 2.5 * count * each < end:
            for turn in range(2):
                solve(count, turn)
    return found


def describe_verified(found: Verified) -> str:
    """What to send in a report: the machine, every check, what was left out, times, as text."""
    own = found.device
    lines = [
        f"vrte {vrte.__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"pyopencl {version('pyopencl')}, {platform.system()} {platform.machine()}",
        f"{own.name} ({own.kind}, {'doubles' if own.double_precision else 'no doubles'}) on {own.platform}, driver "
        f"{own.driver}, {own.handle.version.strip()}",
        f"{own.units} compute units at {own.clock / 1e6:.0f} MHz, {own.memory / 1e9:.1f} GB, largest array "
        f"{own.largest / 1e9:.1f} GB, local memory {own.handle.local_mem_size} B, work-groups of "
        f"{own.handle.max_work_group_size}, architecture {own.architecture}",
        "",
        f"  {'check':52}{'form':9}{'largest difference':>19}{'allowed':>10}{'s':>8}",
    ]
    for check in found.checks:
        gap = "failed" if check.problem else f"{check.gap:.1e}"
        mark = "" if check.passed else "  <- WRONG" + (f": {check.problem}" if check.problem else "")
        lines.append(f"  {check.name:52}{check.form:9}{gap:>19}{check.allowed:10.0e}{check.seconds:8.2f}{mark}")
    passed = len(found.checks) - len(found.failures)
    lines += [
        "",
        f"  {passed} of {len(found.checks)} checks passed; {found.kernels - len(found.idle)} of "
        f"{found.kernels} kernels were launched",
    ]
    went = {name: sum(vars(each)[name] for each in found.asked) for name in vars(Traffic())}
    lines.append("  " + ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in went.items()))
    if found.idle:
        lines.append(f"  never launched: {', '.join(found.idle)}")
    if found.left_out:
        lines.append(f"  left out for want of time: {'; '.join(found.left_out)}")
    if found.costs:
        gold = (
            f"  {task:18}{1e3 * taken:10.1f} ms a BRDF{1 / taken:8.1f} a second" for task, taken in found.gold.items()
        )
        lines += [found.costs, *gold]
    return "\n".join(lines)


def complain_about(found: Verified) -> str:
    """One sentence where something is not as it should be, otherwise empty."""
    if not found.checks:
        words = "compiling its kernels took all of it, and a second time they are kept; or the machine is busy"
        return f"{found.device.name} is not verified: there was no time for any check ({words})"
    if not found.failures:
        return ""
    first = found.failures[0]
    what = first.problem or f"differs by {first.gap:.1e} of the largest light, allowed are {first.allowed:.0e}"
    more = f", and {len(found.failures) - 1} more checks did not pass" if len(found.failures) > 1 else ""
    return f"{found.device.name} is not to be trusted: {first.name}, form {first.form!r}: {what}{more}"
