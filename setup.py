"""Builds the compiled core; everything else is in pyproject.toml."""

import os
import shutil
import subprocess
import sys
import tempfile
from glob import glob
from pathlib import Path

import numpy
from Cython.Build import cythonize
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

OPENMP_PROBE = "#include <omp.h>\nint main(void) { return omp_get_max_threads() < 1; }\n"


def openmp_flags(compiler: list[str]) -> list[str]:
    """The compiler's OpenMP flags, or none (and a message) where a probe does not build."""
    flags = ["/openmp"] if sys.platform == "win32" else ["-fopenmp"]
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "probe.c")
        source.write_text(OPENMP_PROBE)
        command = [*compiler, *flags, str(source), "-o", str(Path(folder, "probe"))]
        built = subprocess.run(command, capture_output=True, check=False).returncode == 0
    if not built:
        print("vrte: this compiler has no OpenMP; the core is built with one thread.", file=sys.stderr)
    return flags if built else []


class BuildCore(build_ext):
    """build_ext that asks the compiler for OpenMP before it compiles."""

    def build_extensions(self) -> None:
        compiler = getattr(self.compiler, "compiler_so", ["cl"])[:1]
        if sys.platform != "win32" and shutil.which(compiler[0]) is None:
            sys.exit(f"vrte: no C compiler ({compiler[0]}) was found; install gcc or clang.")
        flags = openmp_flags(compiler)
        for extension in self.extensions:
            extension.extra_compile_args += flags
            extension.extra_link_args += flags
        super().build_extensions()


core = Extension(
    "vrte._core",
    ["vrte/_core.pyx"],
    include_dirs=[numpy.get_include(), "vrte"],
    depends=sorted(glob("vrte/core/*")),  # its stages: a change of one builds the core anew
    define_macros=[("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION")],
    extra_compile_args=[] if os.name == "nt" else ["-O3", "-fno-math-errno"],
)

setup(
    ext_modules=cythonize([core], compiler_directives={"language_level": 3}),
    cmdclass={"build_ext": BuildCore},
)
