"""Which vrte is tested, and what the examples in docstrings find: a folder of their own, and a small result to write.

The sources beside this file where they were built in place, otherwise the package that is installed: its tests run from
here all the same, without the examples.
"""

import os
import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent
BUILT_HERE = (ROOT / "vrte" / f"_core{sysconfig.get_config_var('EXT_SUFFIX')}").is_file()
collect_ignore: list[str] = ["vrte/mitsuba"]  # needs Mitsuba, and has no examples

if not BUILT_HERE:
    sys.path[:] = [folder for folder in sys.path if Path(folder or os.curdir).resolve() != ROOT]
    os.environ["PYTHONSAFEPATH"] = "1"  # processes that tests start here do not look here either
    collect_ignore.append("vrte")
    try:
        import vrte
    except ModuleNotFoundError:
        pytest.exit(f"vrte is neither built in {ROOT} (make env, or pip install --editable .) nor installed", 4)
if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))  # bench, which some tests are about

import vrte  # noqa: E402  # whole, before pytest collects its folders one by one: `vrte.appearance` is a call


def pytest_configure(config: pytest.Config) -> None:
    """Compiled OpenCL kernels stay with the other caches of the tests, out of the user's."""
    cache = getattr(config, "cache", None)
    folder = cache.mkdir("opencl") if cache else tempfile.mkdtemp(prefix="vrte-tests-")
    os.environ.setdefault("POCL_CACHE_DIR", str(folder))
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")


def pytest_report_header() -> str | None:
    """Says so where the tests are of another vrte than this folder's."""
    if BUILT_HERE:
        return None
    import vrte

    return f"vrte: {Path(vrte.__file__).parent}, because {ROOT / 'vrte'} was not built in place; no doctests"


@pytest.fixture(scope="session")
def small_brdf() -> Any:
    """A BRDF that takes a millisecond."""
    import numpy as np

    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    return vrte.brdf(scene, [0.6, 1.0], np.linspace(0.05, 1.0, 20), np.arange(0, 361, 10), nodes=4)


@pytest.fixture(scope="session")
def painted() -> Any:
    """A grey film as `vrte.paint` has it in its example, for the examples that stand on one."""
    grey = {"layer": [{"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}]}
    return vrte.paint(grey, [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70], nodes=4)


@pytest.fixture(scope="session")
def fitted() -> Any:
    """The fit of the example of `vrte.fit`, for the examples that stand on one."""
    rows = vrte.Measurement("total_reflectance", 0.0, 0.001, theta_i_deg=[0.0, 30.0, 60.0])
    layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    measured = rows.measure(rows.predict({"layer": [layer]}, nodes=4))
    return vrte.fit(measured, {"layer": [{**layer, "thickness": 0.3}]}, ["layer[1].thickness"], nodes=4)


@pytest.fixture(scope="session")
def matched() -> Any:
    """A match like the one of the example of `vrte.match`, for the examples that stand on one."""
    film = {"pigment": "rutile", "volume_fraction": 0.1, "binder": "alkyd", "thickness_um": 20.0}
    at = [0.43, 0.47, 0.51, 0.55, 0.59, 0.63, 0.67]
    asked = {"contrast_ratio": 0.9, "wavelengths_um": at, "nodes": 4, "starts": 1}
    return vrte.match({"paint": film}, ["thickness_um"], **asked)


@pytest.fixture(autouse=True)
def folder_of_the_examples(
    request: pytest.FixtureRequest, doctest_namespace: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Doctests run in a folder with gold_powder.toml and rayleigh.csv; those that speak of results have `brdf`."""
    if not isinstance(request.node, pytest.DoctestItem):
        return
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples" / "gold_powder.toml", tmp_path)
    Path("rayleigh.csv").write_text(
        "l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,0,0,0,1.5,0,0\n2,0.5,3,0,0,1.224744871391589,0\n"
    )
    doctest_namespace.pop("brdf", None)  # one dictionary for all of them
    if any(
        package in request.node.name
        for package in ("vrte.formats", "vrte.pictures", "bench.", "vrte.app", "vrte.results")
    ):
        doctest_namespace["brdf"] = request.getfixturevalue("small_brdf")
    for name in ("painted", "fitted", "matched"):
        if f"{name}." in request.node.dtest.examples[0].source:
            doctest_namespace[name] = request.getfixturevalue(name)
