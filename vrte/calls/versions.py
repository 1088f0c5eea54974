"""What a bug report needs: versions of vrte and of what it requires, the machine, and the environment."""

import os
import platform
import re
from collections.abc import Iterator
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from vrte import _core
from vrte.basics.errors import DeviceError, MissingExtraError
from vrte.basics.running import count_usable_cpus, find_blas_libraries
from vrte.cl import device

FEATURES = ("sse4_2", "avx", "avx2", "fma", "f16c", "avx512f", "avx512dq", "avx512vl", "asimd", "sve")
COMPILERS = rb"GCC: \([^)\0]*\) [0-9.]+|clang version [0-9.]+"  # as compilers sign what they make
DEVELOPMENT = {"test", "bench", "docs", "wheel"}  # extras for who works on vrte
VARIABLES = re.compile("(OMP|OPENBLAS|MKL|GOMP|KMP|BLIS|VECLIB|VRTE|POCL|PYOPENCL|OCL)_")


def show_versions() -> None:
    """What a bug report needs, printed: versions, the machine, BLAS, OpenCL devices, environment variables.

    The home folder is written as ~. The command `vrte --version --verbose` prints the same.

    Returns
    -------
    None
        The text goes to standard output.

    Examples
    --------
    >>> import vrte
    >>> vrte.show_versions()  # doctest: +ELLIPSIS
    vrte ...
    """
    print(describe_versions())


def describe_versions() -> str:
    """All that a bug report needs, a line each, with ~ in place of the home folder's path."""
    from vrte import __version__  # which is set when all modules are loaded

    versions, variables = find_versions(), [name for name in sorted(os.environ) if VARIABLES.match(name)]
    facts = {
        "Python": f"{platform.python_version()} ({platform.python_implementation()}), {platform.platform()}",
        "processor": describe_processor(),
        "compiled core": describe_core(),
        **{f"BLAS {index}": words for index, words in enumerate(list_blas(), 1)},
        "refractive indices": describe_database(),
        "OpenCL": list_devices(),
        "installed": ", ".join(f"{name} {version}" for name, version in versions.items() if version),
        "not installed": ", ".join(name for name, version in versions.items() if not version),
        "environment": ", ".join(f"{name}={os.environ[name]}" for name in variables),
    }
    text = "\n".join([f"vrte {__version__}", *(f"{name}: {words or 'none'}" for name, words in facts.items())])
    home = str(Path.home())
    return re.sub(rf"{re.escape(home)}(?![\w-])", "~", text) if len(home) > 1 else text


def describe_processor() -> str:
    """Its name, its cores, and the instructions that matter here, as Linux lists them."""
    lines = []
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    known = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    name = known.get("model name") or platform.processor() or platform.machine()
    flags = (known.get("flags") or known.get("Features") or "").split()
    features = f"; {', '.join(one for one in FEATURES if one in flags)}" if flags else ""
    return f"{name}, {count_usable_cpus()} of {os.cpu_count()} cores may be used{features}"


def describe_core() -> str:
    """How the compiled core was made, and which of its variants this processor takes."""
    signed = re.findall(COMPILERS, Path(_core.__file__).read_bytes())
    compilers = ", ".join(dict.fromkeys(one.decode().replace("GCC:", "GCC") for one in signed)) or "an unnamed compiler"
    threads = "OpenMP" if _core.HAS_OPENMP else "no OpenMP: one thread"
    return f"{Path(_core.__file__).name}, {compilers}; {threads}; variant: {_core.CPU_VARIANT}"


def list_blas() -> Iterator[str]:
    """Every BLAS of this process: NumPy's and SciPy's may differ."""
    for library in find_blas_libraries():
        kind, file = getattr(library, "architecture", None) or "", "/".join(Path(library.filepath).parts[-2:])
        yield f"{library.internal_api} {library.version} {kind}, {library.num_threads} threads, {file}"


def describe_database() -> str:
    """Which edition of the refractiveindex.info database is asked."""
    from vrte.optics.refractive_index import refractive_index

    try:
        return refractive_index("gold", 0.64).source.rpartition(" in ")[2]
    except (OSError, ValueError, ImportError) as error:
        return f"cannot be read: {error}"


def list_devices() -> str:
    """OpenCL devices, or why there are none."""
    try:
        return "; ".join(f"{one.name} ({one.platform}, driver {one.driver})" for one in device.devices())
    except (MissingExtraError, DeviceError) as error:
        return str(error)


def find_versions() -> dict[str, str]:
    """Versions of what vrte requires and of what its extras bring, "" where it is not installed."""
    required, found = list[str](), dict[str, str]()
    with suppress(metadata.PackageNotFoundError):  # built in place and never installed
        required = metadata.requires("vrte") or []
    for requirement in required:
        name = re.split(r"[\s\[;<>=!~(]", requirement, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([\w-]+)", requirement)
        if name == "vrte" or (extra and extra[1] in DEVELOPMENT):
            continue
        found[name] = ""
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return dict(sorted(found.items()))
