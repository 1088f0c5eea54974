"""Whether the vrte that is installed works: python check_installed.py, in any folder, with vrte and pytest installed.

The compiled core with its threads, the command, and the quick tests that need no other package than pytest. Run by
cibuildwheel in the environment of each wheel, and by make test-pythons.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = "boundaries facets published scene small_scenes stages sums"
USE_IT = """
import os, vrte, vrte._core
print("vrte", vrte.__version__, "in", os.path.dirname(vrte.__file__))
assert not os.path.samefile(os.path.dirname(vrte.__file__), os.path.join({root!r}, "vrte")), "the sources, not a wheel"
assert vrte._core.HAS_OPENMP, "the core was built without OpenMP"
"""


def main() -> int:
    """Exit code of the first of the three that fails."""
    vrte = Path(sysconfig.get_path("scripts"), "vrte")
    tests = [str(ROOT / "tests" / f"test_{name}.py") for name in TESTS.split()]
    brdf = [str(vrte), "brdf", str(ROOT / "examples" / "gold_powder.toml"), "-o", "gold.csv"]
    pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml"), *tests]
    with tempfile.TemporaryDirectory() as folder:
        for command in ([sys.executable, "-c", USE_IT.format(root=str(ROOT))], brdf, [sys.executable, *pytest]):
            done = subprocess.run(command, cwd=folder, env=os.environ | {"PYTHONSAFEPATH": "1"}, check=False)
            if done.returncode:
                return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
