"""Builds the compiled core; everything else is in pyproject.toml."""

import os
import runpy
import shutil
import sys
import tempfile
from glob import glob
from pathlib import Path

import numpy
from Cython.Build import cythonize
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError, LinkError

OPENMP_PROBE = "#include <omp.h>\nint main(void) { return omp_get_max_threads() < 1; }\n"
OPENMP_WAYS = {  # flags of the compiler and of the linker
    "win32": [(["/openmp"], [])],
    "darwin": [(["-Xpreprocessor", "-fopenmp"], ["-lomp"]), (["-fopenmp"], ["-fopenmp"])],  # Apple's clang; others
}


class BuildCore(build_ext):
    """build_ext that asks the compiler for OpenMP before it compiles."""

    def find_openmp(self) -> tuple[list[str], list[str]]:
        """Flags with which a probe is built as the core will be, with CFLAGS and LDFLAGS, or none (and a message)."""
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder, "probe.c")
            source.write_text(OPENMP_PROBE)
            for compiling, linking in OPENMP_WAYS.get(sys.platform, [(["-fopenmp"], ["-fopenmp"])]):
                try:
                    objects = self.compiler.compile([str(source)], output_dir=folder, extra_postargs=compiling)
                    self.compiler.link_shared_object(objects, str(Path(folder, "probe")), extra_postargs=linking)
                except (CompileError, LinkError):
                    continue
                return compiling, linking
        print("vrte: this compiler has no OpenMP; the core is built with one thread.", file=sys.stderr)
        return [], []

    def build_extensions(self) -> None:
        compiler = getattr(self.compiler, "compiler_so", None)  # MSVC is found by the class itself
        if compiler and shutil.which(compiler[0]) is None:
            sys.exit(f"vrte: no C compiler ({compiler[0]}) was found; install gcc or clang.")
        compiling, linking = self.find_openmp()
        for extension in self.extensions:
            extension.extra_compile_args += compiling
            extension.extra_link_args += linking
        super().build_extensions()


ROOT = Path(__file__).parent
declared = runpy.run_path(str(ROOT / "vrte/core/declare.py"))["declare"](ROOT)

core = Extension(
    "vrte._core",
    ["vrte/_core.pyx"],
    include_dirs=[numpy.get_include(), "vrte", str(declared)],
    # its stages: a change of one builds the core anew
    depends=sorted([*glob("vrte/core/**/*.*", recursive=True), *glob(f"{declared}/*")]),
    define_macros=[("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION")],
    extra_compile_args=[] if os.name == "nt" else ["-O3", "-g0", "-fno-math-errno", "-fno-trapping-math"],
)

setup(
    ext_modules=cythonize([core], include_path=[str(declared)], compiler_directives={"language_level": 3}),
    cmdclass={"build_ext": BuildCore},
)
