"""What the examples in docstrings find: a folder of their own, and a small result to write."""

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent


def pytest_configure(config: pytest.Config) -> None:
    """Compiled OpenCL kernels stay with the other caches of the tests, out of the user's."""
    cache = getattr(config, "cache", None)
    folder = cache.mkdir("opencl") if cache else tempfile.mkdtemp(prefix="vrte-tests-")
    os.environ.setdefault("POCL_CACHE_DIR", str(folder))
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")


@pytest.fixture(scope="session")
def small_brdf() -> Any:
    """A BRDF that takes a millisecond."""
    import numpy as np

    import vrte

    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    return vrte.brdf(scene, [0.6, 1.0], np.linspace(0.05, 1.0, 20), np.arange(0, 361, 10), nodes=4)


@pytest.fixture(autouse=True)
def folder_of_the_examples(
    request: pytest.FixtureRequest, doctest_namespace: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Doctests run in a folder with gold_powder.toml and rayleigh.csv; formats, report and app have `brdf`."""
    if not isinstance(request.node, pytest.DoctestItem):
        return
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples" / "gold_powder.toml", tmp_path)
    Path("rayleigh.csv").write_text(
        "l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,0,0,0,1.5,0,0\n2,0.5,3,0,0,1.224744871391589,0\n"
    )
    if any(package in request.node.name for package in ("vrte.formats", "vrte.report", "vrte.app")):
        doctest_namespace["brdf"] = request.getfixturevalue("small_brdf")
