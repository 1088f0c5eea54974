"""Which OpenCL devices there are, which one is taken and why, and the one session on it.

The rule: devices that compute in double precision before those that do not; of either, a GPU with memory of its own
before one in the processor's, these before an accelerator, that before a CPU; of several the one with the largest rate
of doubles, of equals the first; on a CPU PoCL before other drivers. One that does not compile is passed over.
The environment variable VRTE_OPENCL_DEVICE wins over it: an index as `vrte devices` prints it, or a part of a device's
or platform's name that only one device has; or several of these with commas between them, or "all", for devices that
share batches, of which the first does what is no batch.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from vrte.basics.errors import DeviceError, import_extra
from vrte.cl import caches, drivers, errors, probe, rates
from vrte.cl.session import FORKED, Session, open_session

VARIABLE = "VRTE_OPENCL_DEVICE"
PREFERENCE = ("gpu", "accelerator", "cpu", "other")
WORDS = {"gpu": "GPU", "accelerator": "accelerator", "cpu": "CPU", "other": "device"}
INSTALL = (
    "a GPU's driver comes from its maker, a processor's with pip install 'vrte[opencl]' or from the system "
    "(Debian and Ubuntu: apt install pocl-opencl-icd)"
)
ALL = "all"
_lock, _here = threading.RLock(), threading.local()
_state: dict[str, Any] = {"process": None, "devices": None, "sessions": {}, "complaints": {}}


@dataclass(frozen=True)
class Device:
    """What a device says of itself: ``memory`` and ``largest`` (one allocation) in bytes, ``clock`` in Hz; ``shared``:
    its memory is the processor's; ``handle`` is pyopencl's."""

    platform: str
    name: str
    kind: str
    double_precision: bool
    memory: int
    largest: int
    units: int
    driver: str
    clock: float = 1e9
    shared: bool = False
    architecture: str = ""
    handle: Any = field(default=None, repr=False, compare=False)

    @property
    def rate(self) -> float:
        """Operations in doubles a second, about."""
        return rates.estimate_rate(self.architecture, self.kind, self.units, self.clock)

    @property
    def widest(self) -> str:
        """The most precise that it computes in, "double" or "single"."""
        return "double" if self.double_precision else "single"

    @property
    def is_built_in(self) -> bool:
        """Whether it is the graphics part of a processor."""
        return self.kind == "gpu" and self.shared


def devices() -> tuple[Device, ...]:
    """All devices of all platforms, in the order in which OpenCL lists them; asked for once a process.

    Raises MissingExtraError without pyopencl; DeviceError where there is no platform, no device, or this process was
    forked from one that had used OpenCL.
    """
    if _state["process"] not in (None, os.getpid()):  # before the lock, which another thread may have held at the fork
        raise DeviceError(FORKED)
    with _lock:
        if _state["devices"] is None:
            _state["devices"] = _find_devices()
        found: tuple[Device, ...] = _state["devices"]
        return found


def _find_devices() -> tuple[Device, ...]:
    pyopencl = import_extra("pyopencl", "OpenCL", "opencl")
    _state["process"] = os.getpid()
    with caches.keep_files_private(), raise_device_errors():
        try:
            with drivers.make_drivers_visible():
                platforms = pyopencl.get_platforms()
        except pyopencl.Error as error:
            raise DeviceError(f"there is no OpenCL platform: {INSTALL} ({errors.name_of(error)})") from error
        found = tuple(
            _describe_device(platform, handle) for platform in platforms for handle in _list_available(platform)
        )
    if not found:
        names = ", ".join(platform.name.strip() for platform in platforms)
        raise DeviceError(f"no OpenCL platform has a device (platforms: {names or 'none'})")
    return found


def _list_available(platform: Any) -> Sequence[Any]:
    import pyopencl

    try:
        listed = platform.get_devices()
    except pyopencl.Error:  # DEVICE_NOT_FOUND: a driver without its device
        return ()
    return [device for device in listed if device.available]


def _describe_device(platform: Any, handle: Any) -> Device:
    import pyopencl

    kinds = pyopencl.device_type
    kind = next((name for name in PREFERENCE[:3] if handle.type & getattr(kinds, name.upper())), "other")
    return Device(
        platform=platform.name.strip(),
        name=handle.name.strip(),
        kind=kind,
        double_precision=has_doubles(handle),
        memory=handle.global_mem_size,
        largest=handle.max_mem_alloc_size,
        units=handle.max_compute_units,
        driver=handle.driver_version.strip(),
        clock=1e6 * float(read_property(handle, "max_clock_frequency", 0) or 1000),
        shared=bool(read_property(handle, "host_unified_memory", False)),
        architecture=rates.name_architecture(handle),
        handle=handle,
    )


def read_property(handle: Any, name: str, otherwise: Any) -> Any:
    """What a device says, or something else where its driver raises an error on the question."""
    import pyopencl

    try:
        return getattr(handle, name)
    except (pyopencl.Error, AttributeError):
        return otherwise


def has_doubles(handle: Any) -> bool:
    """Whether a device says that it computes in double precision; some drivers fail on the second question."""
    return "cl_khr_fp64" in handle.extensions.split() or bool(read_property(handle, "double_fp_config", 0))


def find_complaint(index: int) -> str:
    """Why a device of `devices` does not compute, in one line; empty where it does. Tried once a process."""
    device = devices()[index]
    with _lock:
        complaints: dict[tuple[int, str, str], str] = _state["complaints"]
        key = index, device.platform, device.name
        if key not in complaints:
            complaints[key] = probe.try_device(index, device.platform, device.handle, device.widest)
        return complaints[key]


def choose(
    found: Sequence[Device], asked_for: str = "", complaint_of: Callable[[int], str] = lambda index: ""
) -> tuple[int, str]:
    """The index of the device to take, and why; ``asked_for``: what VRTE_OPENCL_DEVICE says; ``complaint_of``: why the
    device of an index does not compute.

    Raises DeviceError: nothing that compiles, or nothing (or more than one device) that it names.

    >>> gpu = Device("A", "card", "gpu", True, 8 << 30, 2 << 30, 40, "1")
    >>> cpu = Device("B", "processor", "cpu", True, 64 << 30, 16 << 30, 8, "2")
    >>> choose([cpu, gpu])
    (1, 'the only GPU')
    >>> choose([cpu, gpu], "proc")
    (0, 'VRTE_OPENCL_DEVICE=proc')
    >>> choose([cpu, gpu], "1,0")
    (1, 'VRTE_OPENCL_DEVICE=1,0; batches are shared by 1, 0')
    >>> choose([cpu, gpu], complaint_of=lambda index: "it fails" if index == 1 else "")
    (0, 'the only CPU (passed over: 1)')
    """
    if asked_for:
        wanted = select_output(found, asked_for, complaint_of)
        shared = f"; batches are shared by {', '.join(map(str, wanted))}" if len(wanted) > 1 else ""
        return wanted[0], f"{VARIABLE}={asked_for}{shared}"
    able = sorted(range(len(found)), key=lambda index: _rank(found[index]))
    complaints: dict[int, str] = {}
    for index in able:
        if not (complaint := complaint_of(index)):
            left = [
                i for i in able if i not in complaints and found[i].double_precision == found[index].double_precision
            ]
            reason = _explain_choice(found, index, left) + (
                "" if found[index].double_precision else ", without doubles"
            )
            passed = ", ".join(map(str, sorted(complaints)))
            return index, f"{reason} (passed over: {passed})" if passed else reason
        complaints[index] = complaint
    reported = "; ".join(f"{index} = {found[index].name}: {complaint}" for index, complaint in complaints.items())
    raise DeviceError(f"no OpenCL device compiles kernels ({reported}): {INSTALL}")


def _rank(device: Device) -> tuple[bool, int, bool, bool, float]:
    """The best first. PoCL's doubling takes two thirds of the time of Intel's on the same processor."""
    slower_driver = device.kind == "cpu" and device.platform != probe.POCL
    index = PREFERENCE.index(device.kind)
    return not device.double_precision, index, slower_driver, device.is_built_in, -device.rate


def _explain_choice(found: Sequence[Device], best: int, left: Sequence[int]) -> str:
    """Why the best of those left is taken."""
    kind = found[best].kind
    among = [found[index] for index in left if found[index].kind == kind]
    if len(among) == 1:
        return f"the only {WORDS[kind]}" if len(found) > 1 else "the only device"
    if kind == "cpu" and {device.platform != probe.POCL for device in among} == {True, False}:
        return "the CPU by PoCL, the faster driver"
    apart = [device for device in among if not device.is_built_in]
    if len(apart) == 1 and len(among) > 1:
        return f"the only {WORDS[kind]} with memory of its own"
    equal = len({device.rate for device in apart or among}) == 1
    reported = f"about {found[best].rate:.2g} operations a second in doubles"
    return f"the first {WORDS[kind]}" if equal else f"the fastest {WORDS[kind]}, {reported}"


def select_output(
    found: Sequence[Device], asked_for: str, complaint_of: Callable[[int], str] = lambda index: ""
) -> list[int]:
    """The indices of the devices that VRTE_OPENCL_DEVICE names: one, some with commas between them, or all that compute
    as precisely as the best, that one first.

    Raises DeviceError where one is named twice or does not compute, and as `choose` does.
    """
    if asked_for.casefold() == ALL:
        best = choose(found, "", complaint_of)[0]
        alike = (i for i, device in enumerate(found) if device.widest == found[best].widest and not complaint_of(i))
        return sorted(alike, key=lambda i: (i != best, i))
    wanted = [_find_one(found, part.strip(), asked_for) for part in asked_for.split(",")]
    if len(set(wanted)) < len(wanted):
        raise DeviceError(f"{VARIABLE}={asked_for} names a device twice: {list_names(found)}")
    for index in wanted:
        if complaint := complaint_of(index):
            raise DeviceError(f"{VARIABLE}={asked_for} names a device that does not compute: {complaint}")
    return wanted


def _find_one(found: Sequence[Device], part: str, asked_for: str) -> int:
    if part.isdecimal():
        matches = [int(part)] if int(part) < len(found) else []
    else:
        text = part.casefold()
        matches = [i for i, each in enumerate(found) if text and text in f"{each.platform}\n{each.name}".casefold()]
    if len(matches) != 1:
        problem = "fits no OpenCL device" if not matches else "fits more than one OpenCL device"
        raise DeviceError(f"{VARIABLE}={asked_for} {problem}: {list_names(found)}")
    return matches[0]


def list_names(found: Sequence[Device]) -> str:
    """All devices in one line, with their indices."""
    return ", ".join(
        f"{index} = {device.name} ({device.platform}{'' if device.double_precision else ', no fp64'})"
        for index, device in enumerate(found)
    )


def find_chosen_device() -> Device:
    """The device that `session` opens.

    Raises as `devices` and `choose` do.
    """
    found = devices()
    index, _ = find_lent_device()
    return found[choose(found, read_wanted_device(), find_complaint)[0] if index is None else index]


def list_sharing_devices() -> list[int]:
    """The indices of those that share a batch in this thread, the chosen one first.

    Raises as `devices` and `choose` do.
    """
    asked_for = read_wanted_device()
    several = find_lent_device()[0] is None and ("," in asked_for or asked_for.casefold() == ALL)
    return select_output(devices(), asked_for, find_complaint) if several else [devices().index(find_chosen_device())]


def read_wanted_device() -> str:
    """What VRTE_OPENCL_DEVICE says, empty where it is not set."""
    return os.environ.get(VARIABLE, "").strip()


def session(precision: str = "double") -> Session:
    """The session on the chosen device in "double" or "single" precision, opened once a process.

    Raises as `devices` and `choose` do, and DeviceError where the device has no double precision, or the kernels cannot
    be built.
    """
    _, lent = find_lent_device()
    if lent is not None:
        return lent if lent.precision == precision else lent.in_precision(precision)
    device = find_chosen_device()
    if precision == "double" and not device.double_precision:
        raise DeviceError(f"the OpenCL device {device.name} computes in single precision only: {list_names(devices())}")
    with _lock:
        opened: dict[int, Session] = _state["sessions"]
        if id(device) not in opened:
            reported = {} if device.double_precision else {"precision": "single"}
            with raise_device_errors():
                opened[id(device)] = open_session(device.handle, **reported)
        found = opened[id(device)]
        if precision == device.widest:
            return found
        with raise_device_errors():
            return found.in_precision(precision)


@contextmanager
def take_device(index: int, session: Session | None = None) -> Iterator[None]:
    """Whatever is chosen otherwise, a device of `devices` is taken meanwhile, in all threads, and a session on it."""
    before, _state["lent"] = _state.get("lent"), (index, session)
    try:
        yield
    finally:
        _state["lent"] = before


@contextmanager
def take_device_here(index: int) -> Iterator[None]:
    """The same in this thread alone, without a session of its own."""
    _here.lent = index, None
    try:
        yield
    finally:
        del _here.lent


def find_lent_device() -> tuple[int | None, Session | None]:
    """The index and the session of what `take_device` takes, None where it does not."""
    lent: tuple[int | None, Session | None] = getattr(_here, "lent", None) or _state.get("lent") or (None, None)
    return lent


def forget() -> None:
    """The next call of `session` opens a new one, and devices are listed again."""
    with _lock:
        if _state["process"] in (None, os.getpid()):
            _state["sessions"], _state["devices"] = {}, None


@contextmanager
def raise_device_errors() -> Iterator[None]:
    """Around a solve: what OpenCL raises inside becomes a DeviceError, and the session is forgotten, because queue and
    memory may be lost with it."""
    try:
        yield
    except Exception as error:
        found = errors.make_device_error(error)
        if found is None:
            raise
        forget()
        raise found from error
