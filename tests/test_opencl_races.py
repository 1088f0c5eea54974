"""Every OpenCL kernel under oclgrind, which interprets them and sees each access to memory: what two
work-items do to one number without a barrier between them, what lies beyond an array, what nobody has written.

oclgrind is no Python package (Debian and Ubuntu: apt install oclgrind)."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vrte.cl.building import KERNEL
from vrte.cl.session import read_sources

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("oclgrind") is None, reason="oclgrind is not installed"),
]
ROOT = Path(__file__).parents[1]
# its compiler's optimiser makes instructions that oclgrind does not know
COMMAND = ["oclgrind", "--build-options", "-O0 -cl-opt-disable", "--local-mem-size", "131072", "--num-threads", "1"]


@pytest.mark.parametrize("checked", ["--data-races", "--uninitialized"])
@pytest.mark.parametrize("lanes", [1, 4])
def test_memory(lanes: int, checked: str, tmp_path: Path) -> None:
    log, result = tmp_path / "log", tmp_path / "launched.json"
    script = [sys.executable, "-m", "tests.race_kernels", str(lanes), str(result)]
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
    kernels = {kind: {"probe", *KERNEL.findall(read_sources(kind))} for kind in ("double", "single")}
    wanted = {f"{name} {kind}" for kind, names in kernels.items() for name in names}
    assert set(json.loads(result.read_text())) == wanted
