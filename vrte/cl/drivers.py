"""Drivers that pip installed, made visible to OpenCL's loader beside those of the system.

The loader reads, once a process, a folder of files *.icd, each a line with the path of a driver's library. Intel's
runtime for processors brings such a file, too, but its path is of the machine that built it.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib import metadata
from pathlib import Path

FOLDER = "OCL_ICD_VENDORS"  # the variable that names the folder to read
FILES = "OCL_ICD_FILENAMES"  # and on Windows the one that names libraries beside those of the registry
SYSTEM = Path("/etc/OpenCL/vendors")
WINDOWS = os.name == "nt"
INTEL = ("libintelocl.so", "intelocl64.dll")


def find_intel_runtime() -> Path | None:
    """The library of Intel's runtime for processors, where pip installed it."""
    with suppress(metadata.PackageNotFoundError):
        for file in metadata.files("intel-opencl-rt") or ():
            library = Path(os.path.normpath(file.locate()))
            if library.name in INTEL and library.is_file():
                return library
    return None


def list_system_drivers() -> list[str]:
    """What the loader would read if nobody told it otherwise: libraries by name, or by a path that is there."""
    folder = Path(os.environ.get("OPENCL_VENDOR_PATH") or SYSTEM)
    lines: list[str] = []
    for path in sorted(folder.glob("*.icd")):
        with suppress(OSError, UnicodeDecodeError):
            lines += path.read_text(encoding="utf-8").split("\n")[:1]
    libraries = [line.strip() for line in lines if line.strip()]
    return [library for library in libraries if not os.path.isabs(library) or os.path.exists(library)]


@contextmanager
def make_drivers_visible() -> Iterator[None]:
    """While platforms are listed for the first time: Intel's runtime is found beside all others. A folder that
    OCL_ICD_VENDORS names already stands, and so does the system's own Intel runtime."""
    library = find_intel_runtime()
    beside = list_system_drivers()
    if library is None or os.environ.get(FOLDER) or any(Path(name).name in INTEL for name in beside):
        yield
    elif WINDOWS:
        with set_variable(FILES, os.pathsep.join(filter(None, (os.environ.get(FILES), str(library))))):
            yield
    else:
        with ExitStack() as stack:
            with suppress(OSError):  # nowhere to write: without Intel's
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="vrte-opencl-"))
                for number, name in enumerate([*beside, str(library)]):
                    Path(folder, f"{number:03}.icd").write_text(f"{name}\n", encoding="utf-8")
                stack.enter_context(set_variable(FOLDER, folder))
            yield


@contextmanager
def set_variable(name: str, value: str) -> Iterator[None]:
    """A variable of the environment for a while."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
