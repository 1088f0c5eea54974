"""Which OpenCL devices there are, which one is taken and why, and the one session on it.

The rule: devices that compute in double precision before those that do not; of either, a GPU with memory of its own
before one in the processor's, these before an accelerator, that before a CPU; of several the one with the most memory,
of equals the first; on a CPU PoCL before other drivers. One that does not compile is passed over. The environment
variable VRTE_OPENCL_DEVICE wins over it: an index as `vrte devices` prints it, or a part of a device's or platform's
name that only one device has.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from vrte.basics.errors import DeviceError, import_extra
from vrte.cl import caches, drivers, errors, probe
from vrte.cl.session import FORKED, Session, open_session
from vrte.request.how import OF_SINGLE

VARIABLE = "VRTE_OPENCL_DEVICE"
PREFERENCE = ("gpu", "accelerator", "cpu", "other")
WORDS = {"gpu": "GPU", "accelerator": "accelerator", "cpu": "CPU", "other": "device"}
INSTALL = (
    "a GPU's driver comes from its maker, a processor's with pip install 'vrte[opencl]' or from the system "
    "(Debian and Ubuntu: apt install pocl-opencl-icd)"
)
_lock = threading.RLock()
_state: dict[str, Any] = {"process": None, "devices": None, "sessions": {}, "complaints": {}}


@dataclass(frozen=True)
class Device:
    """What a device says of itself: ``memory`` and ``largest`` (one allocation) in bytes; ``shared``: its memory is the
    processor's; ``handle`` is pyopencl's."""

    platform: str
    name: str
    kind: str
    double_precision: bool
    memory: int
    largest: int
    units: int
    driver: str
    shared: bool = False
    handle: Any = field(default=None, repr=False, compare=False)

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
        return _state["devices"]


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
        shared=bool(read_property(handle, "host_unified_memory", False)),
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
    >>> choose([cpu, gpu], complaint_of=lambda index: "it fails" if index == 1 else "")
    (0, 'the only CPU (passed over: 1)')
    """
    if asked_for:
        index = _find_one(found, asked_for)
        if complaint := complaint_of(index):
            raise DeviceError(f"{VARIABLE}={asked_for} names a device that does not compute: {complaint}")
        return index, f"{VARIABLE}={asked_for}"
    able = sorted(range(len(found)), key=lambda index: _rank(found[index]))
    complaints: dict[int, str] = {}
    for index in able:
        if not (complaint := complaint_of(index)):
            doubles = found[index].double_precision
            left = [found[i] for i in able if i not in complaints and found[i].double_precision == doubles]
            reason = _explain_choice(found[index], left, len(found)) + ("" if doubles else ", without doubles")
            passed = ", ".join(map(str, sorted(complaints)))
            return index, f"{reason} (passed over: {passed})" if passed else reason
        complaints[index] = complaint
    reported = "; ".join(f"{index} = {found[index].name}: {complaint}" for index, complaint in complaints.items())
    raise DeviceError(f"no OpenCL device compiles kernels ({reported}): {INSTALL}")


def _rank(device: Device) -> tuple[bool, int, bool, bool, int]:
    """The best first. PoCL's doubling takes two thirds of the time of Intel's on the same processor, whose devices say
    different amounts of one memory."""
    of_cpu = device.kind == "cpu"
    index, memory = PREFERENCE.index(device.kind), 0 if of_cpu else device.memory
    return not device.double_precision, index, of_cpu and device.platform != probe.POCL, device.is_built_in, -memory


def _explain_choice(best: Device, left: Sequence[Device], number: int) -> str:
    """Why the best of those left is taken, among a ``number`` of devices."""
    among = [each for each in left if each.kind == best.kind]
    if len(among) == 1:
        return f"the only {WORDS[best.kind]}" if number > 1 else "the only device"
    if best.kind == "cpu" and {each.platform != probe.POCL for each in among} == {True, False}:
        return "the CPU by PoCL, the faster driver"
    apart = [each for each in among if not each.is_built_in]
    if len(apart) == 1:
        return f"the only {WORDS[best.kind]} with memory of its own"
    equal = best.kind == "cpu" or len({each.memory for each in apart or among}) == 1
    return f"the {'first ' if equal else ''}{WORDS[best.kind]}" + ("" if equal else " with the most memory")


def _find_one(found: Sequence[Device], asked_for: str) -> int:
    if asked_for.isdecimal():
        matches = [int(asked_for)] if int(asked_for) < len(found) else []
    else:
        text = asked_for.casefold()
        matches = [i for i, each in enumerate(found) if text in f"{each.platform}\n{each.name}".casefold()]
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
    found, lent = devices(), _state.get("lent")
    return found[lent[0] if lent else choose(found, read_wanted_device(), find_complaint)[0]]


def read_wanted_device() -> str:
    """What VRTE_OPENCL_DEVICE says, empty where it is not set."""
    return os.environ.get(VARIABLE, "").strip()


def choose_precision(asked: str, accuracy: float, device: Device) -> tuple[str, str]:
    """The precision that a device computes in, and why.

    Raises DeviceError where a device without doubles cannot give what is asked for.

    >>> card = Device("A", "card", "gpu", False, 8 << 30, 2 << 30, 40, "1")
    >>> choose_precision("auto", 1e-3, card)
    ('single', 'the device has no doubles')
    """
    if device.double_precision:
        return ("double", "the device has doubles") if asked == "auto" else (asked, "asked for")
    if asked == "double":
        raise DeviceError(f"the OpenCL device {device.name} has no doubles, which precision 'double' needs")
    if accuracy < OF_SINGLE:
        raise DeviceError(
            f"the OpenCL device {device.name} has no doubles, and single precision is good for an accuracy of "
            f"{OF_SINGLE:g}, not {accuracy:g}: ask for accuracy={OF_SINGLE:g}, or take another device"
        )
    return "single", "asked for" if asked == "single" else "the device has no doubles"


def session(precision: str = "double") -> Session:
    """The session on the chosen device in "double" or "single" precision, opened once a process.

    Raises as `devices` and `choose` do, and DeviceError where the device has no double precision, or the kernels cannot
    be built.
    """
    lent = (_state.get("lent") or (0, None))[1]
    if lent is not None:
        return lent if lent.precision == precision else lent.in_precision(precision)
    device = find_chosen_device()
    if precision == "double" and not device.double_precision:
        raise DeviceError(f"the OpenCL device {device.name} computes in single precision only: {list_names(devices())}")
    with _lock, raise_device_errors():
        opened: dict[int, Session] = _state["sessions"]
        if id(device) not in opened:
            opened[id(device)] = open_session(device.handle, precision=device.widest)
        found = opened[id(device)]
        return found if precision == device.widest else found.in_precision(precision)


@contextmanager
def take_device(index: int, session: Session) -> Iterator[None]:
    """Whatever is chosen otherwise, a device of `devices` is taken meanwhile, in all threads, and a session on it."""
    before, _state["lent"] = _state.get("lent"), (index, session)
    try:
        yield
    finally:
        _state["lent"] = before


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
