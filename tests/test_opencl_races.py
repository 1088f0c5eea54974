"""Both forms of every OpenCL kernel under oclgrind, which interprets them and sees each access to memory: what two
work-items do to one number without a barrier between them, what lies beyond an array, what nobody has written.

oclgrind is no Python package (Debian and Ubuntu: apt install oclgrind)."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vrte.cl.building import parse_argument_types
from vrte.cl.session import read_sources

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("oclgrind") is None, reason="oclgrind is not installed"),
]
ROOT = Path(__file__).parents[1]
# its compiler's optimiser makes instructions that oclgrind does not know
COMMAND = ["oclgrind", "--build-options", "-O0 -cl-opt-disable", "--local-mem-size", "131072", "--num-threads", "1"]
OF_A_GPU = re.compile(r"_gpu|^invariance_pairs$")
OF_A_PROCESSOR = {"product", "invert", "invariance_converge", "add_orders", "add_scattering"}
NEVER_IN_FLOATS = {"diagonal_gap", "divide_by_rates", "lead_straight", "judge_missing", "find_missing"}
NEVER_IN_DOUBLES = {"lead_on", "judge_step", "mix_steps"}


def list_kernels(form: str, precision: str) -> set[str]:
    """Those that a form launches in a precision."""
    every = set(parse_argument_types(read_sources(precision)))
    other = OF_A_PROCESSOR if form == "gpu" else {name for name in every if OF_A_GPU.search(name)}
    return (every | {"probe"}) - other - (NEVER_IN_FLOATS if precision == "single" else NEVER_IN_DOUBLES)


@pytest.mark.parametrize("checked", ["--data-races", "--uninitialized"])
@pytest.mark.parametrize("form", ["cpu", "gpu"])
def test_memory(form: str, checked: str, tmp_path: Path) -> None:
    log, result = tmp_path / "log", tmp_path / "launched.json"
    script = [sys.executable, "-m", "tests.race_kernels", form, str(result)]
    done = subprocess.run(
        [*COMMAND, checked, "--log", str(log), *script],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYOPENCL_NO_CACHE": "1", "POCL_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    complaints = log.read_text() if log.exists() else ""
    assert not complaints.strip(), complaints[:3000]
    assert done.returncode == 0, done.stderr[-3000:]
    wanted = {f"{name} {kind}" for kind in ("double", "single") for name in list_kernels(form, kind)}
    assert set(json.loads(result.read_text())) == wanted
